//! Descriptions of colour fits.

use super::views::Views;
use crate::source::Assumption;

/// A fit of harmonics of a degree, or of plain colours, for reports and provenance. Its cameras are
/// part of the value, because they affect the colours.
pub fn fit_assumption(degree: usize, is_plain: bool, cameras: &[[f64; 3]]) -> Assumption {
    let seen = Views::new(cameras).label();
    Assumption {
        key: "view",
        value: if is_plain { format!("none{seen}") } else { format!("sh:{degree}{seen}") },
        message: format!(
            "colours come from a network that runs at every sample: a bake replaces it with harmonics \
             of degree {degree}, fitted along the directions that see each part of it; pictures of \
             the unbaked file use the network; option view sets the degree"
        ),
    }
}
