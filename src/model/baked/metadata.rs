//! The renderer's settings beside the bulk: the JSON of a container's `META` chunk.

use serde::{Deserialize, Serialize};

use super::{ColorLayout, Decode, DensityDomain, Encoding, Group, LevelOfDetail};
use crate::model::activate;
use crate::model::field::{Activation, ColorDomain, March, nullable};
use crate::model::grid::{BlockGrid, Bounds, Nodes};
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};
use crate::model::view_dependence::ViewDependence;
use crate::model::view_mlp::{ViewInput, ViewMlp};

/// All that is not bulk. Levels go fine to coarse.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Metadata {
    /// The box that every level spans, in training axes.
    pub bounds: Bounds,
    /// Raw density to opacity.
    pub activation: Activation,
    /// Steps along a ray.
    pub march: March,
    /// The rule for a step's length at each level.
    pub step_rule: StepRule,
    /// The rule for the level that a sample reads.
    pub level_of_detail: LevelOfDetail,
    /// Mixing of two levels.
    pub blend: Blend,
    /// Colour behind the field.
    pub background: [f32; 3],
    /// Color space of colours.
    pub color_space: ColorSpace,
    /// Colour channels of a node beyond three: specular features, or coefficients of harmonics
    /// beyond band 0.
    pub features: usize,
    /// View-dependent colour; `None` for a diffuse field.
    #[serde(deserialize_with = "nullable")]
    pub view: Option<ViewMetadata>,
    /// True if samples outside the free-space mask in chunk `MASK` are dropped.
    pub free_space: bool,
    /// Opacity over one interval up to which blocks were dropped. Not for single samples.
    pub alpha_threshold: f32,
    /// Name of the filter that made the coarser levels.
    pub filter: String,
    /// Fine to coarse.
    pub levels: Vec<LevelMetadata>,
}

impl Metadata {
    /// The meaning of colours.
    pub fn color_domain(&self) -> ColorDomain {
        let diffuse = self.levels.first().and_then(|level| level.diffuse.as_ref());
        match diffuse.map(|encoding| encoding.decode) {
            Some(Decode::Linear | Decode::Coefficient(_)) => ColorDomain::Linear,
            _ => ColorDomain::Logit,
        }
    }

    /// The view dependence that is stated, with its `network` where it has one.
    pub fn view_dependence(&self, network: Option<&ViewMlp>) -> Option<ViewDependence> {
        match self.view.as_ref()? {
            ViewMetadata::Harmonics(harmonics) => Some(ViewDependence::Harmonics(harmonics.rules)),
            ViewMetadata::Network(_) => network.cloned().map(ViewDependence::Network),
        }
    }

    /// A colour channel from 0 to 1 of a diffuse value; of harmonics the mean over all directions.
    pub fn mean_color(&self, value: f32) -> f64 {
        let view = self.view.as_ref().and_then(ViewMetadata::harmonics);
        match (view, self.color_domain()) {
            (Some(rules), _) => {
                let band_0 = Harmonics { degree: 0, ..*rules };
                let [color, ..] = band_0.color(&[BAND_0; FUNCTIONS], &[value; 3]);
                f64::from(color).clamp(0.0, 1.0)
            }
            (None, ColorDomain::Linear) => f64::from(value).clamp(0.0, 1.0),
            (None, ColorDomain::Logit) => activate::sigmoid(value.into()),
        }
    }

    /// The parts of a node's values beside density.
    pub fn layout(&self) -> ColorLayout {
        let harmonics = self.view.as_ref().and_then(ViewMetadata::harmonics);
        ColorLayout {
            features: if harmonics.is_some() { 0 } else { self.features },
            degree: harmonics.map_or(0, |harmonics| harmonics.degree),
            directional: self.has_directional(),
            anisotropy: self.has_anisotropy(),
        }
    }

    /// True if a level has directional brightness.
    pub fn has_directional(&self) -> bool {
        self.levels.iter().any(|level| level.directional.is_some())
    }

    /// True if a level has anisotropy.
    pub fn has_anisotropy(&self) -> bool {
        self.levels.iter().any(|level| level.anisotropy.is_some())
    }
}

/// One level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LevelMetadata {
    /// Nodes along x, y and z.
    pub dimensions: [usize; 3],
    /// Nodes along a block's edge.
    pub block_size: usize,
    /// Stored blocks, those whose colours are inherited among them.
    pub blocks_stored: usize,
    /// Blocks whose colours are inherited from the next coarser level; left out where there are
    /// none.
    #[serde(default, skip_serializing_if = "is_none")]
    pub blocks_filled: usize,
    /// Density; `None` where every level uses level 0's.
    #[serde(deserialize_with = "nullable")]
    pub density: Option<Encoding>,
    /// Diffuse colour.
    #[serde(deserialize_with = "nullable")]
    pub diffuse: Option<Encoding>,
    /// Specular features; `None` without any.
    #[serde(deserialize_with = "nullable")]
    pub features: Option<Encoding>,
    /// Coefficients of harmonics, band 1 first; left out where there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bands: Vec<Encoding>,
    /// Directional brightness, [`Decode::Directional`]; left out where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub directional: Option<Encoding>,
    /// Anisotropy of density, [`Decode::Anisotropy`]; left out where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub anisotropy: Option<Encoding>,
}

fn is_none(count: &usize) -> bool {
    *count == 0
}

impl LevelMetadata {
    /// The cut into blocks.
    pub fn grid(&self) -> BlockGrid {
        BlockGrid { nodes: Nodes(self.dimensions), edge: self.block_size }
    }

    /// The domain of the level's density; raw where it has none, as every file's level 0 may be.
    pub fn density_domain(&self) -> DensityDomain {
        let stated = self.density.as_ref().and_then(|density| density.decode.density());
        stated.unwrap_or(DensityDomain::Raw)
    }

    /// True if colours are stored in integer codes, as inherited blocks require.
    pub fn has_integer_colors(&self) -> bool {
        let mut colors = Group::COLORS.into_iter().filter_map(|group| self.encoding(group));
        colors.all(|encoding| !encoding.number.is_float())
    }

    /// All encodings with their groups, to be changed, in the order of [`Group::ALL`].
    pub fn encodings_mut(&mut self) -> impl Iterator<Item = (Group, &mut Encoding)> {
        let bands = self.bands.iter_mut().enumerate();
        let groups = [
            (Group::Density, self.density.as_mut()),
            (Group::Diffuse, self.diffuse.as_mut()),
            (Group::Features, self.features.as_mut()),
        ];
        let groups = groups.into_iter().filter_map(|(group, encoding)| Some((group, encoding?)));
        let directional = self.directional.as_mut().map(|encoding| (Group::Directional, encoding));
        let anisotropy = self.anisotropy.as_mut().map(|encoding| (Group::Anisotropy, encoding));
        let bands = bands.map(|(i, encoding)| (Group::Band(i + 1), encoding));
        groups.chain(bands).chain(directional).chain(anisotropy)
    }

    /// The encoding of a group, to be changed.
    pub fn encoding_mut(&mut self, group: Group) -> Option<&mut Encoding> {
        match group {
            Group::Density => self.density.as_mut(),
            Group::Diffuse => self.diffuse.as_mut(),
            Group::Features => self.features.as_mut(),
            Group::Band(band) => self.bands.get_mut(band - 1),
            Group::Directional => self.directional.as_mut(),
            Group::Anisotropy => self.anisotropy.as_mut(),
        }
    }

    /// The encoding of a group.
    pub fn encoding(&self, group: Group) -> Option<&Encoding> {
        match group {
            Group::Density => self.density.as_ref(),
            Group::Diffuse => self.diffuse.as_ref(),
            Group::Features => self.features.as_ref(),
            Group::Band(band) => self.bands.get(band - 1),
            Group::Directional => self.directional.as_ref(),
            Group::Anisotropy => self.anisotropy.as_ref(),
        }
    }
}

/// Rules for a step's length at each level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepRule {
    /// `stepsize * voxel_size` at every level, as trained.
    Constant,
    /// `stepsize * voxel_size * 2^lambda` from a sample of level of detail `lambda` to the next.
    LevelOfDetail,
}

/// Mixing of two levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Blend {
    /// Decoded values are mixed, then activated once, as trained.
    BeforeActivation,
    /// Optical depths and activated colours of the levels are mixed.
    AfterActivation,
}

/// Color spaces of colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColorSpace {
    /// Display-referred sRGB, as the training pictures.
    SrgbDisplay,
}

/// View-dependent colour.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum ViewMetadata {
    /// Harmonics.
    Harmonics(HarmonicsMetadata),
    /// The network of chunk `VMLP`.
    Network(NetworkMetadata),
}

impl ViewMetadata {
    /// The network, if it is one.
    pub fn network(&self) -> Option<&NetworkMetadata> {
        match self {
            Self::Network(network) => Some(network),
            Self::Harmonics(_) => None,
        }
    }

    /// The harmonics, if it is them.
    pub fn harmonics(&self) -> Option<&Harmonics> {
        match self {
            Self::Network(_) => None,
            Self::Harmonics(harmonics) => Some(&harmonics.rules),
        }
    }

    /// The facts of a field's view dependence.
    pub fn of(view: &ViewDependence) -> Self {
        match view {
            ViewDependence::Network(network) => Self::Network(NetworkMetadata {
                widths: network.widths(),
                frequencies: network.frequencies,
                input: network.input,
            }),
            ViewDependence::Harmonics(rules) => {
                Self::Harmonics(HarmonicsMetadata { kind: HarmonicsKind::default(), rules: *rules })
            }
        }
    }
}

/// The rules of harmonics.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HarmonicsMetadata {
    /// The name of the kind.
    kind: HarmonicsKind,
    /// The rules.
    #[serde(flatten)]
    pub rules: Harmonics,
}

/// The name of the kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
enum HarmonicsKind {
    #[default]
    #[serde(rename = "spherical_harmonics")]
    SphericalHarmonics,
}

/// The network of chunk `VMLP`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkMetadata {
    /// Widths from input to output.
    pub widths: Vec<usize>,
    /// Octaves of the direction embedding.
    pub frequencies: usize,
    /// The rest of the first layer's input, after the embedding.
    pub input: ViewInput,
}
