//! Named sets of options.

use super::{BakeOptions, Filter, MaxErrors};
use crate::quantize::Bits;

/// A set of options for a purpose.
///
/// ```
/// use mipvog::{Bits, Preset};
///
/// assert_eq!(Preset::Archive.options().bits, Bits::F32);
/// assert_eq!(Preset::Faithful.options().filter.name(), "code");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// The checkpoint as trained: the research code's levels, 8 bits.
    Faithful,
    /// Levels that look right from afar, compressed hardest.
    Web,
    /// Every kept value exactly as trained, and levels that look right from afar.
    Archive,
}

/// Largest errors of `web`. They are the largest of a sweep on trained scenes whose pictures stay
/// more than 50 dB from the unbaked scene's: 0.1 dB against photographs. Features affect pictures
/// only through the network, and weakly, so their errors may be larger.
pub(super) const WEB_ERRORS: MaxErrors =
    MaxErrors::new(0.02, 0.018, 0.05).with_direction(0.04, 0.04);
/// Codes by which colours of `web` may move at nodes of importance 1 to viewers nearby. Below 1, no
/// code moves in a scene of uniform importance.
pub(super) const WEB_NEARBY_COARSENESS: f32 = 0.4;

impl Preset {
    /// Every preset.
    pub const ALL: [Self; 3] = [Self::Faithful, Self::Web, Self::Archive];

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Faithful => "faithful",
            Self::Web => "web",
            Self::Archive => "archive",
        }
    }

    /// Its purpose, in a sentence.
    pub const fn purpose(self) -> &'static str {
        match self {
            Self::Faithful => {
                "As the checkpoint was trained: the levels of the research code, 8 bits"
            }
            Self::Web => "Looks right at a distance; the smallest file that loses at most 0.1 dB",
            Self::Archive => {
                "Every stored value of level 0 exactly as trained; looks right at a distance"
            }
        }
    }

    /// The options that it stands for.
    pub fn options(self) -> BakeOptions {
        let mut options = BakeOptions::default();
        match self {
            Self::Faithful => options.filter = Filter::Code.into(),
            Self::Web => {
                options.max_error = Some(WEB_ERRORS);
                options.nearby_coarseness = WEB_NEARBY_COARSENESS;
            }
            Self::Archive => options.bits = Bits::F32,
        }
        options
    }
}
