//! The words for colours that are fitted.

use super::views::Views;
use crate::source::Assumption;

/// A fit of harmonics of a degree, or of plain colours, as reports and provenance state it. The
/// cameras that it follows are a part of its value, because they decide the colours.
pub fn fit_assumption(degree: usize, is_plain: bool, cameras: &[[f64; 3]]) -> Assumption {
    let seen = Views::new(cameras).label();
    Assumption {
        key: "view",
        value: if is_plain { format!("none{seen}") } else { format!("sh:{degree}{seen}") },
        message: format!(
            "colours come from a network for each sample: a bake fits harmonics of degree {degree} \
             to it at each node, along the directions it is seen from; pictures of the unbaked \
             file use the network; option view sets the degree"
        ),
    }
}
