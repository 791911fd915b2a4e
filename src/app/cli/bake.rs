//! `bake`.

use std::fmt::Write;
use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde_json::{Value, json};

use super::common::Common;
use super::field::SceneArguments;
use super::fit::{FitArguments, check_judges, warn_of_idle_levels};
use super::gate::{GateArguments, GateReport};
use super::gltf::GltfArguments;
use super::incremental::{IncrementalArguments, depfile_rule};
use super::inspect::levels_text;
use super::outcome::{Outcome, peak_memory_bytes, readable, say, warn};
use super::output::create as create_output;
use super::plan;
use super::progress::Bar;
use super::stored::StoredArguments;
use super::values::Background;
use crate::bake::fit::FittedLevel;
use crate::bake::{
    BakeOptions, BakeReport, Changes, Origin, Preset, StageReport, bake, forecast, repack,
};
use crate::base::bytes::{ByteSink, Output};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::codec::unpack::{Unpacked, metadata_text};
use crate::input;
use crate::input::checkpoint::{MlpChoice, Source};
use crate::input::tensor::{self, TensorFile};
use crate::model::field::RadianceField;

/// Bake a trained scene, or an unpacked container, into a container
#[derive(Debug, Args)]
pub struct Arguments {
    /// A Mip-VoG or DirectVoxGO checkpoint, a .safetensors or .npz file of the same names, or an
    /// unpacked container
    input: PathBuf,
    /// The container to write
    #[arg(short, long, value_name = "OUT.mipvog")]
    output: PathBuf,
    /// Forecast time, memory and bytes from a part of the scene, and write nothing
    #[arg(long)]
    dry_run: bool,
    /// Overwrite the output if it exists
    #[arg(long)]
    force: bool,
    /// A set of options; explicit ones override it
    #[arg(long, value_enum)]
    preset: Option<Preset>,
    #[command(flatten)]
    stored: StoredArguments,
    #[command(flatten)]
    fit: FitArguments,
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    gate: GateArguments,
    #[command(flatten)]
    gltf: GltfArguments,
    #[command(flatten)]
    incremental: IncrementalArguments,
}

/// The results of a bake.
struct Baked {
    report: BakeReport,
    /// Every option.
    resolved: Value,
    gate: Option<GateReport>,
    /// The files that the container depends on.
    inputs: Vec<PathBuf>,
}

/// Bakes the input.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    let clock = Instant::now();
    let limits = common.limits();
    let file = tensor::open(&arguments.input, &limits)?;
    let unpacked = match metadata_text(&file) {
        Some(_) => Some(Unpacked::open(&file, &limits)?),
        None => None,
    };
    // The settings of an unpacked container stay, unless an option or a preset says otherwise.
    let mut options = match (arguments.preset, &unpacked) {
        (Some(preset), _) => preset.options(),
        (None, Some(unpacked)) => {
            BakeOptions::of_container(&unpacked.metadata, &unpacked.provenance)
        }
        (None, None) => BakeOptions::default(),
    };
    arguments.stored.apply(&mut options);
    arguments.fit.apply(&mut options, &limits)?;
    options.limits = limits.clone();
    if options.memory.is_some() && arguments.gate.measures()? {
        let message = "--memory excludes --cameras and --turntable: pictures are rendered from \
                       the whole field; use compare afterwards";
        return Err(Error::usage(message));
    }
    if arguments.fit.given() && !options.filter.is_fitted() {
        let message = "--fit-steps, --fit-seconds and --fit-cameras need --filter fit";
        return Err(Error::usage(message));
    }
    options.check()?;
    arguments.scene.source_options().check()?;
    if !arguments.gate.measures()? && options.sees() {
        let message = "--min-weight and --coarseness need --cameras or --turntable to be seen from";
        return Err(Error::usage(message));
    }
    if let Some(preset) = arguments.preset
        && !common.quiet
    {
        say(&format!("preset {}: {}", preset.name(), options.to_json()));
    }
    if arguments.dry_run {
        if unpacked.is_some() {
            let message = "--dry-run belongs to a trained input, not to an unpacked container";
            return Err(Error::usage(message).in_file(&arguments.input));
        }
        return arguments.forecast(&file, &options, &limits, common);
    }
    let replace = arguments.force || arguments.incremental.replaces(&arguments.output);
    let mut output = create_output(&arguments.output, replace)?;
    let mut asset = arguments.gltf.create(&arguments.output, replace)?;
    let mut depfile = arguments.incremental.create_depfile()?;
    let bar = Bar::new(common);
    let Baked { mut report, resolved, gate, inputs } = match &unpacked {
        Some(unpacked) => arguments.bake_unpacked(unpacked, &file, &options, &mut output, &bar),
        None => arguments.bake_trained(&file, &options, &limits, &mut output, &bar, common),
    }
    .map_err(|error| error.in_file(&arguments.input))?;
    drop(bar);
    let passed = gate.as_ref().is_none_or(|gate| gate.passed);
    let mut gltf = None;
    // An output that fails its gate does not get its name.
    if passed {
        if let Some(asset) = &mut asset {
            let clock = Instant::now();
            let container = if report.unchanged { &*arguments.output } else { output.written() };
            let written = arguments.gltf.write(container, &arguments.output, &limits, asset)?;
            let (seconds, bytes) = (clock.elapsed().as_secs_f64(), written.bytes());
            report.stages.push(StageReport { name: "gltf", seconds, bytes });
            gltf = Some(written);
        }
        if let Some(depfile) = &mut depfile {
            depfile.append(depfile_rule(&arguments.output, &inputs).as_bytes())?;
        }
        let container = Some(output).filter(|_| !report.unchanged);
        for file in container.into_iter().chain(asset).chain(depfile) {
            file.finish()?;
        }
    }
    if let Some(fitted) = &report.fitted {
        warn_of_idle_levels(fitted, common);
    }
    if report.nonfinite_values > 0 {
        let count = report.nonfinite_values;
        warn(&format!("{count} values were not finite and became empty"), common);
    }
    let seconds = clock.elapsed().as_secs_f64();
    let mut json = json!({
        "input": arguments.input.to_string_lossy(),
        "output": arguments.output.to_string_lossy(),
        "seconds": seconds,
        "peak_memory_bytes": peak_memory_bytes(),
        "bytes_read": file.file.bytes_read(),
        "options": resolved,
    });
    if let (Value::Object(json), Ok(Value::Object(report))) =
        (&mut json, serde_json::to_value(&report))
    {
        json.extend(report);
    }
    if let Some(gate) = &gate {
        json["quality"] = json!(gate);
    }
    if let Some(gltf) = &gltf {
        json["gltf"] = json!(gltf);
    }
    let mut text = arguments.text(&report, seconds, file.file.bytes_read(), common);
    text += &gate.map_or_else(String::new, |gate| gate.text());
    text += &gltf.map_or_else(String::new, |gltf| gltf.text());
    Ok(Outcome { failed: !passed, ..Outcome::new("bake", &json, text)? })
}

impl Arguments {
    fn bake_trained(
        &self,
        file: &TensorFile,
        options: &BakeOptions,
        limits: &Limits,
        output: &mut Output,
        bar: &Bar,
        common: &Common,
    ) -> Result<Baked> {
        let source = self.open_trained(file, limits, common)?;
        let origin = Origin::of_source(&source);
        let cameras = match self.gate.measures()? {
            true => Some(self.gate.cameras(&source.field, limits)?),
            false => None,
        };
        if let Some(cameras) = cameras.as_ref().filter(|_| options.filter.is_fitted()) {
            check_judges(&options.fit_cameras, cameras)?;
        }
        let options = &self.with_cameras(options, &source.field, limits)?;
        let current =
            self.incremental.current(&self.output, &source.field, options, &origin, limits)?;
        let judges = cameras.as_deref().unwrap_or_default();
        bar.plan(plan::of_bake(options, source.field.scene.nodes, judges));
        let mut report = match current {
            Some(report) => report,
            None => bake(&source.field, options, &origin, output, bar)?,
        };
        let gate = match cameras {
            Some(cameras) => {
                let clock = Instant::now();
                let written = if report.unchanged { &*self.output } else { output.written() };
                let gate = self.gate.measure(&source.field, &cameras, written, limits, bar)?;
                let (seconds, bytes) = (clock.elapsed().as_secs_f64(), report.output_bytes);
                report.stages.push(StageReport { name: "compare", seconds, bytes });
                Some(gate)
            }
            None => None,
        };
        let scene = &source.field.scene;
        let mut resolved = options.to_json();
        resolved["scene"] = json!({
            "march": scene.march,
            "activation": scene.activation,
            "background": scene.background,
            "mlp": source.field.view_mlp.as_ref().map(crate::model::view_mlp::ViewMlp::widths),
        });
        let mut inputs = vec![self.input.clone()];
        inputs.extend(source.companions.into_iter().map(|companion| companion.path));
        inputs.extend([self.gate.camera_file(), self.fit.camera_file()].into_iter().flatten());
        Ok(Baked { report, resolved, gate, inputs })
    }

    /// Forecasts the cost and the output of a bake.
    fn forecast(
        &self,
        file: &TensorFile,
        options: &BakeOptions,
        limits: &Limits,
        common: &Common,
    ) -> Result<Outcome> {
        let source = self.open_trained(file, limits, common)?;
        let options = self.with_cameras(options, &source.field, limits)?;
        let bar = Bar::new(common);
        let forecast = forecast(&source.field, &options, &bar)?;
        drop(bar);
        let memory = peak_memory_bytes().map(|bytes| bytes + forecast.more_memory_bytes);
        let mut json = json!({
            "input": self.input.to_string_lossy(),
            "output": self.output.to_string_lossy(),
            "dry_run": true,
            "seconds": forecast.seconds,
            "peak_memory_bytes": memory,
            "bytes_read": file.file.bytes_read() + forecast.more_bytes_read,
            "options": options.to_json(),
        });
        if let (Value::Object(json), Ok(Value::Object(report))) =
            (&mut json, serde_json::to_value(&forecast.report))
        {
            json.extend(report);
        }
        let text = format!(
            "{}: about {} in {:.1} s, {} of memory\n",
            self.output.display(),
            readable(forecast.report.output_bytes),
            forecast.seconds,
            memory.map_or("unknown".to_owned(), readable),
        );
        Outcome::new("bake", &json, text)
    }

    /// Opens a trained input, and warns of settings that it lacks.
    fn open_trained(&self, file: &TensorFile, limits: &Limits, common: &Common) -> Result<Source> {
        let source = input::open_tensors(file, &self.scene.source_options(), limits)?;
        source.assumptions.iter().for_each(|assumption| warn(&assumption.message, common));
        Ok(source)
    }

    /// The options with the cameras that they depend on.
    fn with_cameras(
        &self,
        options: &BakeOptions,
        field: &RadianceField,
        limits: &Limits,
    ) -> Result<BakeOptions> {
        let mut options = options.clone();
        if options.sees() {
            options.seen_from = self.gate.cameras(field, limits)?;
        }
        Ok(options)
    }

    fn bake_unpacked(
        &self,
        unpacked: &Unpacked,
        file: &TensorFile,
        options: &BakeOptions,
        output: &mut Output,
        bar: &Bar,
    ) -> Result<Baked> {
        let stored = &self.stored;
        let metadata = &unpacked.metadata;
        let asked = |given: bool| given || self.preset.is_some();
        let changes = Changes {
            bits: asked(stored.bits.is_some())
                .then_some(options.bits)
                .filter(|_| options.max_error.is_none()),
            max_error: options.max_error.filter(|_| asked(stored.max_error.is_some())),
            zstd_level: asked(stored.zstd_level.is_some()).then_some(options.zstd_level),
            levels: stored.levels,
            lod_rule: stored.lod_rule,
            lod_scale: stored.lod_scale,
            near: self.scene.near,
            far: self.scene.far,
            background: self.scene.background.map(|Background(color)| color),
            color_threshold: self.scene.color_threshold,
        };
        // A setting that the container has already is no change.
        let anew = (asked(stored.filter.is_some()) && options.filter.name() != metadata.filter)
            || (asked(stored.alpha_threshold.is_some())
                && options.alpha_threshold != metadata.alpha_threshold)
            || (asked(stored.block_size.is_some())
                && metadata.levels.iter().any(|level| level.block_size != options.block_size));
        self.refuse_ignored(anew)?;
        if anew {
            let mut field = unpacked.field().ok_or_else(|| {
                Error::malformed(Place::File, "no densities of level 0", "some, to filter again")
            })?;
            changes.apply_to_scene(&mut field.scene);
            let origin = Origin {
                kind: "unpacked container".to_owned(),
                digest: file.digest,
                covers_values: false,
                companions: Vec::new(),
                assumptions: Vec::new(),
            };
            let report = bake(&field, options, &origin, output, bar)?;
            let inputs = vec![self.input.clone()];
            return Ok(Baked { report, resolved: options.to_json(), gate: None, inputs });
        }
        let report = repack(unpacked, &changes, &options.limits, output, bar)?;
        let inputs = vec![self.input.clone()];
        Ok(Baked { report, resolved: changes.to_json(), gate: None, inputs })
    }

    /// Refuses options that packing an unpacked container again, or baking its finest level `anew`,
    /// would ignore.
    fn refuse_ignored(&self, anew: bool) -> Result<()> {
        let (scene, stored) = (&self.scene, &self.stored);
        let ignored = [
            ("--stepsize", scene.stepsize.is_some()),
            ("--coarse", scene.coarse.is_some()),
            ("--mlp", scene.mlp != MlpChoice::Auto),
            ("--cameras or --turntable", self.gate.measures()?),
            ("--memory", stored.memory.is_some()),
            ("--if-changed", self.incremental.is_asked()),
            ("--fill-error", stored.fill_error.is_some() && !anew),
            ("--nonfinite empty", stored.replaces_nonfinite() && !anew),
            ("--fit-steps, --fit-seconds or --fit-cameras", self.fit.given() && !anew),
        ];
        match ignored.iter().find(|(_, given)| *given) {
            None => Ok(()),
            Some((option, _)) => Err(Error::usage(format!(
                "{option} has no effect on an unpacked container: it belongs to a trained input"
            ))),
        }
    }

    fn text(&self, report: &BakeReport, seconds: f64, bytes_read: u64, common: &Common) -> String {
        let bytes = readable(report.output_bytes);
        let read = readable(bytes_read);
        let output = self.output.display();
        let mut text = match report.unchanged {
            true => format!("{output}: {bytes}, nothing has changed\n"),
            false => format!("{output}: {bytes} in {seconds:.2} s, {read} read\n"),
        };
        text += &levels_text(&report.levels);
        if let Some(finest) = report.pruned.first() {
            writeln!(
                text,
                "  of {} nodes {} are opaque, {} of them outside the free-space mask, {} retained",
                finest.nodes, finest.opaque_nodes, finest.masked_nodes, finest.needed_nodes
            )
            .ok();
        }
        if let Some(fitted) = &report.fitted {
            for FittedLevel { level, steps, psnr_before, psnr_after } in &fitted.levels {
                writeln!(
                    text,
                    "  level {level} fitted in {steps} steps, {psnr_before:.2} to {psnr_after:.2} dB"
                )
                .ok();
            }
        }
        for stage in report.stages.iter().filter(|_| common.verbose) {
            let (seconds, bytes) = (stage.seconds, readable(stage.bytes));
            writeln!(text, "  {:8} {seconds:8.3} s {bytes:>10}", stage.name).ok();
        }
        text
    }
}
