//! Texels of the atlas and of the planes, which two pictures hold.

use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::base::parallel;
use crate::folder::Folder;

/// Codes of a colour, the density, and four features.
pub(super) type Texel = [u8; 8];
/// The place of density among them.
pub(super) const DENSITY: usize = 3;

/// Reads two pictures, one of colours and density and one of features, as texels.
pub(super) fn pair(
    folder: &Folder,
    [colors, features]: &[String; 2],
    size: [usize; 2],
    limits: &Limits,
) -> Result<Vec<Texel>> {
    let half = limits.shared_by(2);
    let (colors, features) =
        parallel::join(|| folder.read(colors, size, &half), || folder.read(features, size, &half));
    let (colors, features) = (colors?, features?);
    let pairs = colors.bytes.as_chunks::<4>().0.iter().zip(features.bytes.as_chunks::<4>().0);
    Ok(pairs.map(|([r, g, b, d], [f, h, i, j])| [*r, *g, *b, *d, *f, *h, *i, *j]).collect())
}
