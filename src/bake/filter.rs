//! The families of coarser levels that a bake can make.

use crate::baked::{Aside, LevelOfDetail};
use crate::grid::Nodes;
use crate::mips::{self, Kernel};

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
}

impl Filter {
    /// Every filter.
    pub fn all() -> Vec<Self> {
        let kernels = Kernel::ALL.into_iter().map(Self::Kernel);
        [Self::Code, Self::Paper].into_iter().chain(kernels).collect()
    }

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Code => "code",
            Self::Paper => "paper",
            Self::Kernel(kernel) => kernel.name(),
        }
    }

    /// The low-pass of its levels.
    pub fn kernel(self) -> Kernel {
        match self {
            Self::Code => Kernel::Mean3,
            Self::Paper => Kernel::Mean5,
            Self::Kernel(kernel) => kernel,
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

    /// The rule that says which level a sample reads. Training measured footprints to the sample of
    /// the same index; containers measure them at the same distance, which does not depend on where
    /// rays enter the box.
    pub fn level_of_detail(self, aside: Aside, scale: f32) -> LevelOfDetail {
        let (factor, most) = match self {
            Self::Code => (0.5, Some(4.0)),
            Self::Paper | Self::Kernel(_) => (1.0 / 3.0, None),
        };
        LevelOfDetail { factor: factor * scale, bias: 0.0, aside, most }
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
