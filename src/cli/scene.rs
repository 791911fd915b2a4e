//! Settings of a scene and their sources.
//!
//! In order of precedence: the command line, `scene.toml` or `scene.json` beside the input, the
//! camera file, the checkpoint itself, the default.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use serde_json::{Value, json};

use super::cameras::CameraSource;
use super::layout::TIE;
use super::output::STANDARD_STREAM;
use super::values::{Background, parse_appearance, parse_background, parse_mlp, parse_view};
use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::model::camera::Camera;
use crate::view::render::Renderer;
use mipvog_inputs::{AppearanceChoice, MlpChoice, SourceOptions, ViewChoice};
use mipvog_inputs::{SceneSettings, Source};

/// The user's settings for a scene, beside those of its file.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Scene")]
pub struct SceneArguments {
    /// Step length in voxels [default: the container's; else that of scene.toml, scene.json, the
    /// camera file or the checkpoint; else 0.5, with a warning]
    #[arg(long, value_name = "VOXELS")]
    pub stepsize: Option<f32>,
    /// Skip the colour of samples whose weight is at most this, 0 to 1 [default: likewise; else
    /// 0.0001, or 0 for models without a network]
    #[arg(long, value_name = "WEIGHT")]
    pub color_threshold: Option<f32>,
    /// Distance along the camera's axis at which rays start [default: likewise; else 0]
    #[arg(long, value_name = "T")]
    pub near: Option<f32>,
    /// Farthest distance at which sampling may start; rays are not cut there [default: likewise;
    /// else unlimited]
    #[arg(long, value_name = "T")]
    pub far: Option<f32>,
    /// Colour behind the field: one number or three, 0 to 1, or #RRGGBB, white, black [default:
    /// likewise; else white]
    #[arg(long, value_name = "COLOR", value_parser = parse_background)]
    pub background: Option<Background>,
    /// View network: auto (the checkpoint's), none, or a file
    #[arg(long, value_name = "auto|none|FILE", default_value = "auto", value_parser = parse_mlp)]
    pub mlp: MlpChoice,
    /// Coarse checkpoint, which has the threshold of the free-space mask [default: beside the
    /// input]
    #[arg(long, value_name = "FILE")]
    pub coarse: Option<std::path::PathBuf>,
    /// Input units per scene unit, such as 0.66667 for Plenoxels of NeRF-synthetic scenes [default:
    /// from the input or a file beside it, else 1]
    #[arg(long, value_name = "F")]
    pub scene_scale: Option<f32>,
    /// View-dependent colour: keep, none, or sh:D for harmonics up to degree D, 0 to 3
    #[arg(long, value_name = "keep|sh:D|none", default_value = "keep", value_parser = parse_view)]
    pub view: ViewChoice,
    /// Keep only the inner box of an unbounded scene. Left out are Plenoxels' background spheres,
    /// the contracted space of DirectVoxGO, MERF and nerfacto, and all beyond the unit cube of
    /// Instant-NGP
    #[arg(long)]
    pub drop_background: bool,
    /// Voxels along the longest axis of a model without a grid, such as Instant-NGP [default: 256;
    /// for the first box of an unbounded scene, as many as the model has]. For PeRFception's
    /// Plenoxels, cells along each axis
    #[arg(long, value_name = "N")]
    pub resolution: Option<usize>,
    /// How far the outermost box of an unbounded scene reaches, in half sides of its inner box
    /// [default: all that the model shows]
    #[arg(long, value_name = "F")]
    pub extent: Option<f32>,
    /// Appearance of a nerfacto model: mean, zero, or that of a training picture by its number,
    /// from 0 [default: as in nerfstudio's own pictures]
    #[arg(long, value_name = "mean|zero|N", value_parser = parse_appearance)]
    pub appearance: Option<AppearanceChoice>,
    /// Grid of an OpenVDB file that holds density [default: density, else the only fog volume]
    #[arg(long, value_name = "NAME")]
    pub grid: Option<String>,
}

/// The settings for an input, from every place but the input itself.
#[derive(Debug, Clone)]
pub struct FoundSettings {
    /// As the library takes them.
    pub options: SourceOptions,
    /// Files that settings came from.
    pub files: Vec<PathBuf>,
    /// The place that each setting came from.
    origins: BTreeMap<&'static str, String>,
}

/// A setting of the scene and its source.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct SettingReport {
    /// Name of the option that sets it.
    name: &'static str,
    /// Value of the setting; null means unbounded.
    value: Value,
    /// Source of the value, such as the command line or a file.
    from: String,
}

impl SceneArguments {
    /// The command line's own settings, as the library takes them.
    pub fn source_options(&self) -> SourceOptions {
        SourceOptions {
            stepsize: self.stepsize,
            coarse: self.coarse.clone(),
            mlp: self.mlp.clone(),
            near: self.near,
            far: self.far,
            background: self.background.map(|Background(color)| color),
            color_threshold: self.color_threshold,
            scene_scale: self.scene_scale,
            view: self.view,
            cameras: Vec::new(),
            drop_background: self.drop_background,
            resolution: self.resolution,
            extent: self.extent,
            appearance: self.appearance.unwrap_or_default(),
            grid: self.grid.clone(),
        }
    }

    /// The same without the options that say how a trained model is read.
    pub fn of_container(&self) -> Self {
        Self {
            mlp: MlpChoice::Auto,
            coarse: None,
            scene_scale: None,
            view: ViewChoice::Keep,
            drop_background: false,
            resolution: None,
            extent: None,
            appearance: None,
            grid: None,
            ..self.clone()
        }
    }

    /// True if an option says how a trained model is read, which no container needs.
    pub fn reads_a_model(&self) -> bool {
        let other_view = self.mlp != MlpChoice::Auto || self.view != ViewChoice::Keep;
        let reads = self.drop_background || self.resolution.is_some() || self.extent.is_some();
        let reads = reads || self.appearance.is_some() || self.grid.is_some();
        other_view || self.coarse.is_some() || self.scene_scale.is_some() || reads
    }

    /// For cameras that no file states: near and far are bounds of the cameras that the scene was
    /// trained from, and from elsewhere they would cut parts off.
    pub fn see_all(&self, field: &mut Renderer) {
        let march = &mut field.view_mut().march;
        (march.near, march.far) = (self.near.unwrap_or(0.0), self.far);
    }

    /// The settings for a trained input, which `cameras` are looked through for too.
    ///
    /// # Errors
    ///
    /// FoundSettings out of range; a file of settings that cannot be read.
    pub fn settings(
        &self,
        input: &Path,
        cameras: Option<&CameraSource>,
        limits: &Limits,
    ) -> Result<FoundSettings> {
        let mut options = self.source_options();
        options.check()?;
        let mut origins = BTreeMap::new();
        let given = [
            ("stepsize", options.stepsize.is_some()),
            ("near", options.near.is_some()),
            ("far", options.far.is_some()),
            ("background", options.background.is_some()),
            ("color_threshold", options.color_threshold.is_some()),
        ];
        for (name, _) in given.into_iter().filter(|(_, given)| *given) {
            origins.insert(name, "command line".to_owned());
        }
        let mut files = Vec::new();
        // The standard input lies beside nothing.
        let beside = match input == Path::new(STANDARD_STREAM) {
            true => None,
            false => SceneSettings::beside(input, limits)?,
        };
        // The reader of cameras reports an unreadable camera file.
        if let Some(file) = cameras
            && let Ok(found) = file.read(Some([1; 2]), limits)
        {
            let place = |camera: &Camera| camera.to_world.w_axis.truncate().to_array();
            options.cameras = found.sound().map(place).collect();
        }
        let cameras = cameras.and_then(|file| SceneSettings::read(&file.path, limits).ok());
        for stated in beside.into_iter().chain(cameras) {
            let names = stated.complete(&mut options);
            let name = stated.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            origins.extend(names.iter().map(|&setting| (setting, name.clone())));
            if !names.is_empty() {
                files.push(stated.path);
            }
        }
        let found = FoundSettings { options, files, origins };
        found.check_bounds()?;
        found.options.check()?;
        Ok(found)
    }
}

impl FoundSettings {
    /// Refuses bounds of rays that exclude each other, by the places that they came from.
    fn check_bounds(&self) -> Result<()> {
        let (Some(near), Some(far)) = (self.options.near, self.options.far) else { return Ok(()) };
        let [near_from, far_from] = ["near", "far"].map(|name| &self.origins[name]);
        if near < far || near_from == far_from {
            return Ok(());
        }
        let far = format!("far {far} ({far_from})");
        Err(Error::usage(format!("near {near} ({near_from}): expected less than {far}")))
    }

    /// The settings that `source` was opened with.
    pub fn report(&self, source: &Source) -> Vec<SettingReport> {
        let scene = &source.field.scene;
        let march = &scene.march;
        let values = [
            ("stepsize", json!(march.stepsize)),
            ("near", json!(march.near)),
            ("far", json!(march.far)),
            ("background", json!(scene.background)),
            ("color_threshold", json!(march.color_threshold)),
        ];
        let from = |name, value: &Value| match self.origins.get(name) {
            Some(origin) => origin.clone(),
            None if source.recorded.contains(&name) => source.recorded_in(),
            None if is_default(name, value) => "default".to_owned(),
            None => "model".to_owned(),
        };
        let report = |(name, value)| SettingReport { name, from: from(name, &value), value };
        values.map(report).into()
    }
}

/// True for a setting's default; some models have their own.
fn is_default(name: &str, value: &Value) -> bool {
    match name {
        "stepsize" => *value == json!(0.5),
        "near" => *value == json!(0.0f32),
        "background" => *value == json!([1.0, 1.0, 1.0]),
        _ => true,
    }
}

/// The settings in a line for people.
pub fn settings_text(settings: &[SettingReport]) -> String {
    let shown = settings.iter().map(|SettingReport { name, value, from }| {
        let value = plain(value);
        format!("{}{TIE}{value}{TIE}({from})", name.replace('_', "-"))
    });
    format!("  {}", shown.collect::<Vec<_>>().join(", "))
}

/// A setting as its option takes it, without the digits that float32 does not have.
fn plain(value: &Value) -> String {
    match value {
        Value::Null => "unlimited".to_owned(),
        Value::Array(values) if values.iter().all(|value| Some(value) == values.first()) => {
            values.first().map_or_else(String::new, plain)
        }
        Value::Array(values) => values.iter().map(plain).collect::<Vec<_>>().join(","),
        #[expect(clippy::cast_possible_truncation, reason = "settings are float32")]
        value => value.as_f64().map_or_else(String::new, |number| (number as f32).to_string()),
    }
}
