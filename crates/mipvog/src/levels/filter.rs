//! Filters: how coarser levels are made, and the rules to render them by.
//!
//! [`LevelFilter`] alone defines both. The pyramid, the search for visible nodes, the reference
//! renderer and the metadata of containers query it.

use std::fmt::Debug;
use std::ops::Deref;
use std::sync::Arc;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::sizes::{default_level_count, level_sizes};
use super::{AlphaDomain, Kernel, LevelRule};
use crate::model::baked::{
    Bends, Blend, DensityDomain, FootprintNeighbour, LevelOfDetail, StepRule,
};
use crate::model::field::Activation;
use crate::model::grid::Nodes;

/// Intervals over which `rate-tent` counts opacity; the best of 1 to 8 on trained scenes.
const RATE_SPAN: f32 = 5.0;
/// The same for levels without directional terms.
const ISOTROPIC_SPAN: f32 = 4.5;

/// Bends of `rate-tent`'s rule. Pixels of one voxel read a little of level 1; pixels that are 5 %
/// smaller read none. From four voxels on, coarser levels than those of a line look better.
const RATE_BENDS: [[f32; 2]; 2] = [[0.0, -0.53], [2.0, 0.3]];

/// The values that a filter averages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FilterDomain {
    /// Logits as they are stored, as in training.
    Logits {
        /// True if coarser levels have their own density. Otherwise they have only colours, and use
        /// the density of level 0.
        density: bool,
    },
    /// Alpha, and colours premultiplied by visible alpha.
    Alpha {
        /// Intervals over which opacity is alpha, above 0.
        span: f32,
        /// The density that coarser levels store: optical depth or opacity.
        stored: DensityDomain,
    },
}

/// The rules that make coarser levels and pick a sample's level.
///
/// ```
/// use mipvog::{BakeOptions, FilterDomain, LevelFilter};
///
/// /// The paper's levels under a binomial low-pass.
/// #[derive(Debug)]
/// struct Binomial;
///
/// impl LevelFilter for Binomial {
///     fn name(&self) -> &str {
///         "binomial"
///     }
///     fn weights(&self) -> Vec<f64> {
///         vec![0.25, 0.5, 0.25]
///     }
///     fn domain(&self) -> FilterDomain {
///         FilterDomain::Logits { density: true }
///     }
/// }
///
/// let options = BakeOptions::default().with_filter(Binomial);
/// assert_eq!(options.filter.name(), "binomial");
/// ```
pub trait LevelFilter: Debug + Send + Sync {
    /// The name that containers and reports state.
    fn name(&self) -> &str;

    /// The low-pass before each halving: an odd number of centred weights along an axis, which sum
    /// to 1.
    fn weights(&self) -> Vec<f64>;

    /// The values that are averaged.
    fn domain(&self) -> FilterDomain;

    /// Default number of levels for a field of `finest` nodes; at least 1. Default: down to 4 nodes
    /// along the longest axis.
    fn level_count(&self, finest: Nodes) -> usize {
        default_level_count(finest)
    }

    /// How two levels are blended. Default: after activation if alpha is averaged, before it
    /// otherwise.
    fn blend(&self) -> Blend {
        match self.domain() {
            FilterDomain::Alpha { .. } => Blend::AfterActivation,
            FilterDomain::Logits { .. } => Blend::BeforeActivation,
        }
    }

    /// Spacing of samples on coarser levels. Default: that of the level's nodes if alpha is
    /// averaged, that of level 0 otherwise.
    fn step_rule(&self) -> StepRule {
        match self.domain() {
            FilterDomain::Alpha { .. } => StepRule::LevelOfDetail,
            FilterDomain::Logits { .. } => StepRule::Constant,
        }
    }

    /// The rule that picks the level of a sample: factor and bias on the base-2 logarithm of the
    /// footprint, and an upper bound. Default: factor 0.5, bias 0, no bound.
    fn level_of_detail(&self) -> (f32, f32, Option<f32>) {
        (0.5, 0.0, None)
    }

    /// Changes of that rule's slope, each from a given footprint on. Default: none.
    fn bends(&self) -> Bends {
        Bends::default()
    }

    /// True if coarser levels have directional terms, provided that they store the square root of
    /// optical depth. Readers of format 1.1 cannot read such levels. Default: no.
    fn is_directional(&self) -> bool {
        false
    }

    /// True if levels are fitted to pictures of level 0 after filtering. Default: no.
    fn is_fitted(&self) -> bool {
        false
    }
}

/// Derived properties of a filter, for the pipeline.
impl dyn LevelFilter + '_ {
    /// True if coarser levels have density of their own.
    pub fn has_density(&self) -> bool {
        self.domain() != FilterDomain::Logits { density: false }
    }

    /// The averaged alpha; none for logits.
    pub fn alpha(&self, activation: &Activation) -> Option<AlphaDomain> {
        match self.domain() {
            FilterDomain::Alpha { span, stored } => {
                Some(AlphaDomain::new(*activation, span, stored))
            }
            FilterDomain::Logits { .. } => None,
        }
    }

    /// The meaning of densities that a level stores.
    pub fn density_domain(&self, level: usize) -> DensityDomain {
        match self.domain() {
            FilterDomain::Alpha { stored, .. } if level > 0 => stored,
            _ => DensityDomain::Raw,
        }
    }

    /// Sizes of the levels of a field, finest first: at most `count`, or the filter's default
    /// number.
    pub fn level_sizes(&self, finest: Nodes, count: Option<usize>) -> Vec<Nodes> {
        level_sizes(finest, count.unwrap_or_else(|| self.level_count(finest)))
    }

    /// The rule of levels. Filters of stored values measure footprints as training did, to the
    /// sample of the same index. Other filters measure them at the same distance, independent of
    /// where rays enter the box.
    pub fn rule(&self) -> LevelOfDetail {
        let (factor, bias, bound) = self.level_of_detail();
        let neighbour = match self.blend() {
            Blend::BeforeActivation => FootprintNeighbour::SameIndex,
            Blend::AfterActivation => FootprintNeighbour::SameDistance,
        };
        LevelOfDetail { factor, bias, neighbour, bound, bends: self.bends() }
    }
}

/// A filter that can be shared: any type that is a [`LevelFilter`] converts into it.
#[derive(Debug, Clone)]
pub struct SharedFilter(Arc<dyn LevelFilter>);

impl<F: LevelFilter + 'static> From<F> for SharedFilter {
    fn from(filter: F) -> Self {
        Self(Arc::new(filter))
    }
}

impl Deref for SharedFilter {
    type Target = dyn LevelFilter;

    fn deref(&self) -> &Self::Target {
        &*self.0
    }
}

/// Filters are equal if their names are.
impl PartialEq for SharedFilter {
    fn eq(&self, other: &Self) -> bool {
        self.name() == other.name()
    }
}

impl Serialize for SharedFilter {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(self.name())
    }
}

/// By the name of a [`Filter`]; others have no text.
impl<'de> Deserialize<'de> for SharedFilter {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let name = String::deserialize(from)?;
        name.parse::<Filter>().map(Self::from).map_err(serde::de::Error::custom)
    }
}

/// The built-in filters, by their names on the command line.
///
/// ```
/// use mipvog::{Filter, LevelFilter};
///
/// let filter: Filter = "paper".parse().expect("a filter");
/// assert_eq!(filter, Filter::Paper);
/// assert_eq!(filter.weights(), [0.2; 5]);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Filter {
    /// Tent-weighted means of alpha, stored as the square root of optical depth. Looks right at a
    /// distance.
    RateTent,
    /// As `rate-tent`, without directional terms, for readers of format 1.1.
    Isotropic,
    /// Box-filtered opacity over one interval, stored as opacity.
    Coverage,
    /// The levels of `rate-tent`, fitted to distant pictures of level 0.
    Fit,
    /// The research code's levels: colour only, mean of 3; density stays level 0's. Published
    /// checkpoints were trained with it.
    Code,
    /// The paper's levels: mean of 5 over density and colour.
    Paper,
    /// As the paper, with another low-pass.
    Kernel(Kernel),
}

impl Filter {
    /// Every filter.
    pub fn all() -> Vec<Self> {
        let kernels = Kernel::ALL.into_iter().map(Self::Kernel);
        let first =
            [Self::RateTent, Self::Isotropic, Self::Coverage, Self::Fit, Self::Code, Self::Paper];
        first.into_iter().chain(kernels).collect()
    }

    /// Its levels, in a sentence.
    pub fn purpose(self) -> &'static str {
        match self {
            Self::RateTent => {
                "Tent-weighted means of colour and opacity; looks right at a distance"
            }
            Self::Isotropic => "rate-tent without directional terms; for readers of format 1.1",
            Self::Coverage => "Box-filtered opacity",
            Self::Fit => "rate-tent, then optimized on distant pictures; takes seconds to minutes",
            Self::Code => "Means of colour over 3 nodes, as in the published training code",
            Self::Paper => "Means of density and colour over 5 nodes, as in the paper",
            Self::Kernel(_) => "As paper, with another kernel",
        }
    }

    /// Its name on the command line.
    pub fn label(self) -> &'static str {
        match self {
            Self::RateTent => "rate-tent",
            Self::Isotropic => "isotropic",
            Self::Coverage => "coverage",
            Self::Fit => "fit",
            Self::Code => "code",
            Self::Paper => "paper",
            Self::Kernel(kernel) => kernel.name(),
        }
    }
}

impl LevelFilter for Filter {
    fn name(&self) -> &str {
        self.label()
    }

    fn weights(&self) -> Vec<f64> {
        let kernel = match self {
            Self::RateTent | Self::Isotropic | Self::Fit => Kernel::Tent,
            Self::Coverage | Self::Code => Kernel::Mean3,
            Self::Paper => Kernel::Mean5,
            Self::Kernel(kernel) => *kernel,
        };
        kernel.weights()
    }

    fn domain(&self) -> FilterDomain {
        match self {
            Self::RateTent | Self::Fit => {
                FilterDomain::Alpha { span: RATE_SPAN, stored: DensityDomain::SqrtOpticalDepth }
            }
            Self::Isotropic => FilterDomain::Alpha {
                span: ISOTROPIC_SPAN,
                stored: DensityDomain::SqrtOpticalDepth,
            },
            Self::Coverage => FilterDomain::Alpha { span: 1.0, stored: DensityDomain::Opacity },
            Self::Code => FilterDomain::Logits { density: false },
            Self::Paper | Self::Kernel(_) => FilterDomain::Logits { density: true },
        }
    }

    fn level_count(&self, finest: Nodes) -> usize {
        let count = default_level_count(finest);
        // The research code's level of detail ends at 4.
        if *self == Self::Code { count.min(5) } else { count }
    }

    fn level_of_detail(&self) -> (f32, f32, Option<f32>) {
        let published = |rule: LevelRule| {
            let (factor, bound) = rule.constants();
            (factor, 0.0, bound)
        };
        match self {
            Self::RateTent => (1.0, 0.08, None),
            Self::Isotropic => (0.5, 0.0, None),
            Self::Coverage => (0.5, -0.1, None),
            Self::Fit => (0.5, 0.1, None),
            Self::Code => published(LevelRule::Code),
            Self::Paper | Self::Kernel(_) => published(LevelRule::Paper),
        }
    }

    fn bends(&self) -> Bends {
        match self {
            Self::RateTent => Bends::new(&RATE_BENDS).unwrap_or_default(),
            _ => Bends::default(),
        }
    }

    fn is_directional(&self) -> bool {
        matches!(self, Self::RateTent | Self::Fit)
    }

    fn is_fitted(&self) -> bool {
        *self == Self::Fit
    }
}

impl std::str::FromStr for Filter {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let all = Self::all();
        all.iter().copied().find(|filter| filter.label() == name).ok_or_else(|| {
            let names: Vec<_> = all.iter().map(|filter| filter.label()).collect();
            format!("expected one of {}", names.join(", "))
        })
    }
}
