//! A trained scene, baked.

use std::sync::Arc;
use std::time::Instant;

use serde_json::json;

use super::super::cameras::CameraSource;
use super::super::common::Common;
use super::super::detail::warn_of_figures;
use super::super::fit::check_judges;
use super::super::inputs::refuse_inputs;
use super::super::outcome::{assumed, warn};
use super::super::plan;
use super::super::progress::Bar;
use super::super::scene::FoundSettings;
use super::super::view_report::ViewReport;
use super::arguments::Arguments;
use super::merge::with_others;
use super::report::Baked;
use crate::bake::{BakeOptions, StageReport, bake};
use crate::base::bytes::{Output, SourceFile};
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::container::Container;
use crate::model::camera::{Camera, turntable};
use crate::model::field::RadianceField;
use crate::model::view_mlp::ViewMlp;
use crate::view::compare::{Reference, compare_directions};
use crate::view::panorama;
use crate::view::render::Renderer;
use mipvog_inputs::Source;
use mipvog_inputs::network::held_out_eyes;
use mipvog_inputs::tensor::TensorFile;

/// Cameras around a model that is resampled for a bake, and pixels along a side of their pictures.
const LOOKS: usize = 4;
const LOOK_SIDE: usize = 160;

/// Size of a container's values above which unrequested pictures are skipped: the bake itself takes
/// less memory.
const MOST_BYTES: u64 = 3 << 29;

/// Cameras around a model, or inside its world.
fn looks(source: &Source, limits: &Limits, bar: &Bar) -> Result<Vec<Camera>> {
    if source.field.shells.is_empty() {
        return Ok(turntable(&source.field.scene.bounds, LOOKS, [LOOK_SIDE; 2]));
    }
    panorama(&source.renderer(None, limits)?, LOOKS, [LOOK_SIDE; 2], bar)
}

/// Bakes a trained scene into `output`, and measures it if a gate requires that.
pub fn bake_trained(
    arguments: &Arguments,
    file: &TensorFile,
    options: &BakeOptions,
    output: &mut Output,
    bar: &Bar,
    common: &Common,
) -> Result<Baked> {
    let limits = &options.limits;
    let (source, settings) = open(arguments, file, options, common)?;
    let mut inputs = vec![mipvog_inputs::file_of(&arguments.input)];
    inputs.extend(settings.files.iter().cloned());
    inputs.extend(source.side_files.iter().map(|side_file| side_file.path.clone()));
    let outputs = [arguments.gltf.path(), arguments.incremental.depfile()];
    refuse_inputs(outputs.into_iter().flatten().chain([&*arguments.output]), &inputs)?;
    let origin = source.origin();
    let cameras = match arguments.gate.measures()? {
        true => Some(arguments.fit.judges(arguments.gate.cameras(&source.field, common)?)),
        // The loss of resampling is always reported; a memory bound excludes pictures.
        false if source.is_resampled() && options.memory.is_none() => {
            Some(looks(&source, limits, bar)?)
        }
        false => None,
    };
    if let Some(cameras) = cameras.as_ref().filter(|_| options.filter.is_fitted()) {
        check_judges(options, cameras)?;
    }
    let mut view = ViewReport::of_source(&source, arguments.color_fit);
    view.require(arguments.gate.required_view_psnr())?;
    let options = &with_cameras(arguments, options, &source.field, common)?;
    let current = arguments.incremental.current(
        &arguments.output,
        &source.field,
        options,
        &origin,
        arguments.thumbnail,
        limits,
    )?;
    let judges = cameras.as_deref().unwrap_or_default();
    bar.plan(plan::of_bake(options, source.field.scene.nodes, judges));
    let mut report = match current {
        Some(report) => report,
        None => bake(&source.field, options, &origin, output, bar)?,
    };
    let looks_along = (view.is_fitted() && options.memory.is_none())
        || (view.has_harmonics() && arguments.gate.measures()?);
    let (mut gate, mut unmeasured) = (None, None);
    if looks_along || !judges.is_empty() {
        let clock = Instant::now();
        let written = if report.unchanged { &*arguments.output } else { output.written() };
        let container = Container::open(Arc::new(SourceFile::open(written)?), limits)?;
        let is_asked = arguments.gate.measures()? || arguments.gate.required_view_psnr().is_some();
        let bytes = container.metadata().value_bytes();
        unmeasured = Some(bytes).filter(|bytes| !is_asked && *bytes > MOST_BYTES);
        if unmeasured.is_none() {
            let unbaked = source.renderer(None, limits)?;
            let baked = Renderer::of_container(&container)?;
            if looks_along {
                let bounds = &source.field.scene.bounds;
                let eyes = held_out_eyes(&settings.options.cameras, bounds);
                let errors = compare_directions(&unbaked, &baked, &eyes, bar)?;
                view.measured(errors);
            }
            if !judges.is_empty() {
                let reference = Reference::Field(Box::new(unbaked));
                let measured = arguments.gate.measure(&reference, &baked, judges, bar)?;
                if arguments.gate.measures()? {
                    warn_of_figures(&measured.errors, judges, None, common);
                }
                gate = Some(measured);
            }
        }
        let (seconds, bytes) = (clock.elapsed().as_secs_f64(), report.output_bytes);
        report.stages.push(StageReport { name: "compare", seconds, bytes });
    }
    let scene = &source.field.scene;
    let mut resolved = options.to_json();
    resolved["scene"] = json!({
        "march": scene.march,
        "activation": scene.activation,
        "background": scene.background,
        "mlp": source.field.network().map(ViewMlp::widths),
    });
    let reported = settings.report(&source);
    inputs.extend(arguments.gate.camera_file().into_iter().flat_map(CameraSource::paths));
    inputs.extend(arguments.fit.camera_file());
    let input_bytes = source.content_bytes();
    Ok(Baked { report, resolved, settings: reported, view, gate, inputs, unmeasured, input_bytes })
}

/// Opens a trained input with the settings that are found, and warns of missing ones.
pub fn open(
    arguments: &Arguments,
    file: &TensorFile,
    options: &BakeOptions,
    common: &Common,
) -> Result<(Source, FoundSettings)> {
    let cameras = arguments.gate.camera_file();
    let limits = &options.limits;
    let mut settings = arguments.scene.settings(&arguments.input, cameras.as_ref(), limits)?;
    let mut source = mipvog_inputs::open_tensors(file, &settings.options, limits)?;
    for assumption in &source.assumptions {
        warn(&assumed(&assumption.message), common);
    }
    if let Some(merged) = with_others(&source.field, arguments, options, common)? {
        // The rules of the first model's own program do not apply to the others.
        (source.field, source.model) = (merged.field, None);
        source.has_checksums &= merged.have_checksums;
        source.side_files.extend(merged.files);
        settings.files.extend(merged.settings);
    }
    Ok((source, settings))
}

/// The options with the cameras that they depend on.
pub fn with_cameras(
    arguments: &Arguments,
    options: &BakeOptions,
    field: &RadianceField,
    common: &Common,
) -> Result<BakeOptions> {
    let mut options = options.clone();
    if options.sees() {
        options.seen_from = arguments.gate.cameras(field, common)?;
    }
    Ok(options)
}
