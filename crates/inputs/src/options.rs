//! User options for an input.

use std::path::PathBuf;

use mipvog::bake::option_rules;

use crate::base::error::{Error, Result};

/// The user's settings for an input.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SourceOptions {
    /// Step length in voxels. Default: 0.5, with an assumption
    pub stepsize: Option<f32>,
    /// The coarse checkpoint, for the threshold of the mask. Default: the one that the checkpoint
    /// names, or the one beside it
    pub coarse: Option<PathBuf>,
    /// The network to bake. Default: the checkpoint's
    pub mlp: MlpChoice,
    /// Distance along the camera's axis at which rays start. Default: 0
    pub near: Option<f32>,
    /// Farthest distance at which sampling may start, likewise. Default: unlimited
    pub far: Option<f32>,
    /// Colour behind the field. Default: white
    pub background: Option<[f32; 3]>,
    /// Samples of at most this weight add no colour. Default: the checkpoint's
    /// `fast_color_thres`, else 1e-4
    pub color_threshold: Option<f32>,
    /// Input units per scene unit, above 0: positions are divided by it, and densities multiplied.
    /// Default: from the input, else 1
    pub scene_scale: Option<f32>,
    /// The view-dependent colour to keep. Default: all
    pub view: ViewChoice,
    /// Camera positions for which colours are fitted, if a model's colours need a fit; one in eight
    /// is held out. Default, and for fewer than 16: positions all around
    pub cameras: Vec<[f64; 3]>,
    /// Keeps only the inner box of an unbounded scene. Default: everything that the model shows
    pub drop_background: bool,
    /// Nodes along the longest axis of a model that has none, or along an edge of an unbounded
    /// scene's first box. Default: 256, or as many as the model has there. Of PeRFception's
    /// Plenoxels the cells along each axis. Default: the least power of 2 that holds them
    pub resolution: Option<usize>,
    /// How far the outermost box of an unbounded scene reaches, in half sides of the inner one, 1
    /// to 1e6. Default: all that the model shows
    pub extent: Option<f32>,
    /// The appearance that nerfacto's colours are taken with. Default: as nerfstudio's own pictures
    pub appearance: AppearanceChoice,
    /// The grid of an OpenVDB file that holds density. Default: `density`, else the only fog volume
    pub grid: Option<String>,
}

/// The appearance of a model that has one for each picture of its training.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AppearanceChoice {
    /// That of pictures at evaluation.
    #[default]
    Auto,
    /// The mean of all.
    Mean,
    /// Zeros.
    Zero,
    /// That of a picture, by its number in the training, from 0.
    Picture(usize),
}

/// The part of the view-dependent colour that is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ViewChoice {
    /// All that the model has.
    #[default]
    Keep,
    /// Harmonics up to this degree, 0 to 3.
    Harmonics(usize),
    /// Colours that do not depend on the view.
    None,
}

/// The network to bake.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum MlpChoice {
    /// The checkpoint's, if it has one.
    #[default]
    Auto,
    /// None: only the first three channels of colour, as they are.
    None,
    /// The `rgbnet` of another file.
    File(PathBuf),
}

impl SourceOptions {
    /// Scales that scenes have: beyond them float32 loses boxes.
    pub(crate) const SCALES: std::ops::RangeInclusive<f32> = 1e-9..=1e9;

    /// Refuses values that are out of range.
    pub fn check(&self) -> Result<()> {
        let refuse = |option, found: &dyn std::fmt::Debug, expected: &str| {
            Err(Error::invalid_option(option, format!("{found:?}"), expected))
        };
        if let Some(step) = self.stepsize.filter(|step| !(*step > 0.0 && *step <= 64.0)) {
            return refuse("stepsize", &step, "a number of voxels above 0, up to 64");
        }
        self.near.map_or(Ok(()), option_rules::near)?;
        let near = self.near.unwrap_or(0.0);
        if let Some(far) = self.far.filter(|far| !(*far > near && far.is_finite())) {
            return refuse("far", &far, "a distance beyond near");
        }
        self.background.map_or(Ok(()), option_rules::background)?;
        if let Some(nodes) = self.resolution.filter(|nodes| !(2..=1 << 16).contains(nodes)) {
            return refuse("resolution", &nodes, "2 to 65536 nodes");
        }
        if let Some(extent) = self.extent.filter(|extent| !(1.0..=1e6).contains(extent)) {
            return refuse("extent", &extent, "1 to 1e6 half sides of the inner box");
        }
        let scale = self.scene_scale;
        if let Some(scale) = scale.filter(|scale| !Self::SCALES.contains(scale)) {
            return refuse("scene_scale", &scale, "a number from 1e-9 to 1e9");
        }
        self.color_threshold.map_or(Ok(()), option_rules::color_threshold)
    }
}
