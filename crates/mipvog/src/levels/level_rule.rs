//! Published rules that pick the level of a sample.

use serde::{Deserialize, Serialize};

use crate::model::baked::{Bends, LevelOfDetail};

/// A published rule, in place of a filter's own, which measured best.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LevelRule {
    /// One third of the footprint's logarithm, as in the paper.
    Paper,
    /// Half of it, at most 4, as in the research code.
    Code,
    /// All of it, as for mipmaps of textures.
    Mipmap,
}

impl LevelRule {
    /// Every rule.
    pub const ALL: [Self; 3] = [Self::Paper, Self::Code, Self::Mipmap];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Code => "code",
            Self::Mipmap => "mipmap",
        }
    }

    /// What it does, in a line.
    pub fn purpose(self) -> String {
        let (factor, bound) = self.constants();
        let bound = bound.map_or(String::new(), |bound| format!(", at most {bound}"));
        format!("{factor:.3} times the footprint's logarithm to base 2{bound}")
    }

    /// Factor of the footprint's logarithm, and the bound of the level.
    pub fn constants(self) -> (f32, Option<f32>) {
        match self {
            Self::Paper => (1.0 / 3.0, None),
            Self::Code => (0.5, Some(4.0)),
            Self::Mipmap => (1.0, None),
        }
    }

    /// `rule` with these constants; its measure of footprints stays.
    pub fn applied_to(self, rule: LevelOfDetail) -> LevelOfDetail {
        let (factor, bound) = self.constants();
        LevelOfDetail { factor, bias: 0.0, bound, bends: Bends::default(), ..rule }
    }
}

impl std::str::FromStr for LevelRule {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|rule| rule.name() == text)
            .ok_or("expected paper, code or mipmap")
    }
}
