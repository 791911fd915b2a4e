//! The families of coarser levels that a bake can make.

use super::LevelRule;
use crate::levels::mips::{self, Kernel, Matter, Settled};
use crate::model::baked::{Blend, FootprintNeighbour, LevelOfDetail, StepRule};
use crate::model::field::{Activation, Scene};
use crate::model::grid::Nodes;
use crate::view::render::TrainedLevels;
use crate::view::sample::Levels;

/// How coarser levels are made, and with them the level-of-detail rule that they were made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Filter {
    /// The research code's: colour only, mean of 3; density stays level 0's. What published
    /// checkpoints were trained with.
    Code,
    /// The paper's: mean of 5 over density and colour.
    Paper,
    /// The paper's form with another low-pass.
    Kernel(Kernel),
    /// Means of matter under a tent, stored as square root of optical depth: what looks right from
    /// afar.
    RateTent,
    /// The levels of `rate-tent`, fitted to what level 0 looks like from afar.
    Fit,
    /// Means of opacity over one interval under a box, stored as opacity.
    Coverage,
}

/// Intervals over which `rate-tent` counts opacity; the best of 1 to 8 on trained scenes.
const REACH: f32 = 4.5;

impl Filter {
    /// Every filter.
    pub fn all() -> Vec<Self> {
        let kernels = Kernel::ALL.into_iter().map(Self::Kernel);
        let first = [Self::RateTent, Self::Coverage, Self::Fit, Self::Code, Self::Paper];
        first.into_iter().chain(kernels).collect()
    }

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Code => "code",
            Self::Paper => "paper",
            Self::Kernel(kernel) => kernel.name(),
            Self::RateTent => "rate-tent",
            Self::Coverage => "coverage",
            Self::Fit => "fit",
        }
    }

    /// The low-pass of its levels.
    pub fn kernel(self) -> Kernel {
        match self {
            Self::Code => Kernel::Mean3,
            Self::Paper => Kernel::Mean5,
            Self::Kernel(kernel) => kernel,
            Self::RateTent | Self::Fit => Kernel::Tent,
            Self::Coverage => Kernel::Mean3,
        }
    }

    /// What is averaged, where it is not raw values.
    pub fn matter(self, activation: &Activation) -> Option<Matter> {
        let (reach, settled) = match self {
            Self::RateTent | Self::Fit => (REACH, Settled::SqrtOpticalDepth),
            Self::Coverage => (1.0, Settled::Opacity),
            Self::Code | Self::Paper | Self::Kernel(_) => return None,
        };
        Some(Matter::new(*activation, reach, settled))
    }

    /// How two levels are mixed, and how far apart samples of coarser levels are.
    pub fn rules(self) -> (Blend, StepRule) {
        match self {
            Self::RateTent | Self::Fit | Self::Coverage => {
                (Blend::AfterActivation, StepRule::LevelOfDetail)
            }
            Self::Code | Self::Paper | Self::Kernel(_) => {
                (Blend::BeforeActivation, StepRule::Constant)
            }
        }
    }

    /// Whether coarser levels hold density of their own.
    pub fn filters_density(self) -> bool {
        self != Self::Code
    }

    /// Sizes of the levels of a field, at most `most`.
    pub fn level_sizes(self, finest: Nodes, most: Option<usize>) -> Vec<Nodes> {
        mips::level_sizes(finest, most.unwrap_or_else(|| self.default_levels(finest)))
    }

    fn default_levels(self, finest: Nodes) -> usize {
        let levels = mips::default_level_count(finest);
        // The research code's level of detail ends at 4.
        if self == Self::Code { levels.min(5) } else { levels }
    }

    /// Levels as this filter makes them, as many as it makes unless told otherwise.
    pub fn levels(self, scene: &Scene) -> Levels {
        Levels {
            most: self.level_sizes(scene.nodes, None).len(),
            kernel: self.kernel(),
            density: self.filters_density(),
            matter: self.matter(&scene.activation),
        }
    }

    /// The levels of a trained field that is rendered without baking, by the rules of training where
    /// training had such levels.
    pub fn trained_levels(self, scene: &Scene) -> TrainedLevels {
        let levels = self.levels(scene);
        let (blend, step_rule) = self.rules();
        let neighbour = match blend {
            Blend::BeforeActivation => FootprintNeighbour::SameIndex,
            Blend::AfterActivation => FootprintNeighbour::SameDistance,
        };
        let level_of_detail = self.level_of_detail(neighbour);
        TrainedLevels { levels, level_of_detail, blend, step_rule }
    }

    /// The rule that says which level a sample reads. Training measured footprints to the sample of
    /// the same index; containers measure them at the same distance, which does not depend on where
    /// rays enter the box.
    pub fn level_of_detail(self, neighbour: FootprintNeighbour) -> LevelOfDetail {
        let published = |rule: LevelRule| {
            let (factor, most) = rule.constants();
            (factor, 0.0, most)
        };
        let (factor, bias, most) = match self {
            Self::Code => published(LevelRule::Code),
            Self::Paper | Self::Kernel(_) => published(LevelRule::Paper),
            Self::RateTent => (0.55, -0.15, None),
            Self::Coverage => (0.5, -0.1, None),
            Self::Fit => (0.5, 0.1, None),
        };
        LevelOfDetail { factor, bias, neighbour, most }
    }
}

impl std::str::FromStr for Filter {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let all = Self::all();
        all.iter().copied().find(|filter| filter.name() == name).ok_or_else(|| {
            let names: Vec<_> = all.iter().map(|filter| filter.name()).collect();
            format!("expected one of {}", names.join(", "))
        })
    }
}
