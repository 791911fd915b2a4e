//! Rotates splats to the axes of formats with y up.

use super::project::{COLOR, GaussianSplat};
use crate::model::baked::Group;
use crate::model::harmonics::FUNCTIONS;
use crate::unpacked::Rotation;

/// A rotation of splats: of their centres and of their harmonics. Round splats have no other axes.
#[derive(Debug)]
pub(super) struct Turn {
    rotation: Rotation,
    /// For each coefficient beyond band 0: its source coefficients and their factors.
    sums: Vec<Vec<(usize, f32)>>,
}

impl Turn {
    /// From training axes, whose z is up: `(x, y, z)` to `(x, z, -y)`.
    pub(super) fn z_up_to_y_up() -> Self {
        Self::of(Rotation::of_quarter_turns([3, 0, 0]))
    }

    /// The inverse.
    pub(super) fn y_up_to_z_up() -> Self {
        Self::of(Rotation::of_quarter_turns([1, 0, 0]))
    }

    #[expect(clippy::cast_possible_truncation, reason = "splats are float32")]
    fn of(rotation: Rotation) -> Self {
        let sum = |(first, band, channel): (usize, usize, usize)| {
            let pairs = rotation.channel(Group::Band(band), channel);
            pairs.into_iter().map(|(from, factor)| (first + from, factor as f32)).collect()
        };
        let bands = (1..).take_while(|band| band * band < FUNCTIONS);
        let channels = bands.flat_map(|band| {
            let first = COLOR + 3 * band * band;
            (0..3 * (2 * band + 1)).map(move |channel| (first, band, channel))
        });
        Self { rotation, sums: channels.map(sum).collect() }
    }

    /// A splat after the rotation.
    #[expect(clippy::cast_possible_truncation, reason = "splats are float32")]
    pub(super) fn splat(&self, splat: &GaussianSplat) -> GaussianSplat {
        let mut out = *splat;
        let at = self.rotation.vector([0, 1, 2].map(|axis| f64::from(splat[axis])));
        out.iter_mut().zip(at).for_each(|(out, at)| *out = at as f32);
        for (out, sum) in out[COLOR + 3..].iter_mut().zip(&self.sums) {
            *out = sum.iter().map(|&(from, factor)| factor * splat[from]).sum();
        }
        out
    }
}
