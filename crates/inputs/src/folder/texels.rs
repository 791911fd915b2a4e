//! Texels, with codes in two pictures.

use super::pictures::Folder;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::parallel;
use crate::picture::Rgba;

/// Codes of a colour, of opacity or density, and of four features.
pub type Texel = [u8; 8];
/// The place of opacity or density among them.
pub const OPACITY: usize = 3;

/// A picture of colours and opacities, and one of features.
#[derive(Debug)]
pub struct Texels {
    colors: Rgba,
    features: Option<Rgba>,
}

impl Texels {
    /// Reads both pictures. Without the second one, features are 0.
    ///
    /// # Errors
    /// Errors of the pictures.
    pub fn read(
        folder: &Folder,
        [colors, features]: &[String; 2],
        has_features: bool,
        size: [usize; 2],
        limits: &Limits,
    ) -> Result<Self> {
        let half = limits.shared_by(2);
        let (colors, features) = parallel::join(
            || folder.read(colors, size, &half),
            || has_features.then(|| folder.read(features, size, &half)).transpose(),
        );
        Ok(Self { colors: colors?, features: features? })
    }

    /// `count` texels, row by row, from one on.
    pub fn run(&self, first: usize, count: usize) -> impl Iterator<Item = Texel> {
        let of = move |picture: &Rgba| -> Vec<[u8; 4]> {
            let bytes = picture.bytes.get(4 * first..4 * (first + count));
            bytes.unwrap_or_default().as_chunks::<4>().0.to_vec()
        };
        let features = self.features.as_ref().map_or_else(|| vec![[0; 4]; count], of);
        of(&self.colors).into_iter().zip(features).map(|(color, features)| {
            let ([r, g, b, a], [f, h, i, j]) = (color, features);
            [r, g, b, a, f, h, i, j]
        })
    }
}
