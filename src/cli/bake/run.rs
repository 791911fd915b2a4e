//! A bake from the command line, from its input to its files.

use std::time::Instant;

use serde_json::Value;

use super::super::common::Common;
use super::super::fit::warn_of_idle_levels;
use super::super::incremental::depfile_rule;
use super::super::inputs::refuse_inputs;
use super::super::layout::{folded, message_columns};
use super::super::outcome::{Outcome, denied, say, warn};
use super::super::output::{create_container, digest};
use super::super::progress::Bar;
use super::again::bake_again;
use super::arguments::{Arguments, Content};
use super::forecast::dry_run;
use super::report::Work;
use super::trained::bake_trained;
use crate::bake::{BakeOption, BakeOptions, BakeReport, Preset, Quality, StageReport};
use crate::base::bytes::{ByteSink, Output};
use crate::base::error::{Error, Result};

/// Options in a line for people: names and values, without the digits that float32 cannot hold.
fn options_text(options: &Value) -> String {
    let shown = |value: &Value| match value {
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_f64() => {
            #[expect(clippy::cast_possible_truncation, reason = "options are float32")]
            let short = number.as_f64().unwrap_or_default() as f32;
            short.to_string()
        }
        other => other.to_string(),
    };
    // Values without an option follow from other options.
    let is_option = |name: &str| BakeOption::find(name).is_some();
    let members = options.as_object().into_iter().flatten().filter(|(_, value)| !value.is_null());
    let pairs = members.map(|(name, value)| (name.replace('_', "-"), shown(value)));
    let pairs = pairs.filter(|(name, _)| is_option(name));
    pairs.map(|(name, value)| format!("--{name} {value}")).collect::<Vec<_>>().join(" ")
}

/// The options that a preset stands for.
fn preset_text(options: &BakeOptions) -> String {
    let mut json = options.to_json();
    let is_web = options.max_error == Preset::Web.options().max_error;
    if !is_web || options.nearby_coarseness == 0.0 {
        return options_text(&json);
    }
    // Some colours are coarser than these errors, which only --quality can say.
    json["max_error"] = Value::Null;
    format!("{} --quality {}", options_text(&json), Quality::OF_WEB)
}

/// Bakes the input.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    let clock = Instant::now();
    let limits = common.limits();
    let input = arguments.open(&limits)?;
    let options = arguments.options(&input.content, common)?;
    if !common.quiet {
        let preset = arguments.preset.map(|preset| format!("preset {}: ", preset.name()));
        let preset = preset.map(|name| name + &preset_text(&options));
        // What a quality means for cameras, beside the errors that it is a name for.
        let quality = options.min_weight.filter(|_| arguments.given.has("quality"));
        let quality = quality.map(|weight| {
            let (coarseness, fill) = (options.coarseness, options.fill_error.unwrap_or_default());
            format!(
                "quality, with cameras: --min-weight {weight} --coarseness {coarseness} \
                 --fill-error {fill}"
            )
        });
        for line in preset.into_iter().chain(quality) {
            say(&folded(&line, message_columns(), 4));
        }
    }
    if arguments.dry_run {
        return match &input.content {
            Content::Trained(file) => dry_run(arguments, file, &options, common),
            Content::Stored(_) => {
                let message = "--dry-run belongs to a trained input, not to a container";
                Err(Error::usage(message).in_file(&arguments.input))
            }
        };
    }
    if options.memory.is_some() && arguments.gltf.path().is_some() {
        let rest = "the mesh of --gltf is made of the whole container";
        warn(&format!("--memory applies to the bake only: {rest}"), common);
    }
    let replace = arguments.force || arguments.incremental.replaces(&arguments.output);
    let mut output = create_container(&arguments.output, replace)?;
    refuse_inputs([&*arguments.output], &arguments.merge)?;
    let replaces_asset = arguments.force || (replace && arguments.gltf.is_own());
    let mut asset = arguments.gltf.create(&arguments.output, replaces_asset)?;
    let mut depfile = arguments.incremental.create_depfile(&arguments.output, arguments.force)?;
    let bar = Bar::new(common);
    let baked = match &input.content {
        Content::Stored(unpacked) => {
            bake_again(arguments, (unpacked, input.length()), &options, &mut output, &bar, common)
        }
        Content::Trained(file) => {
            bake_trained(arguments, file, &options, &mut output, &bar, common)
        }
    };
    let mut baked = baked.map_err(|error| error.in_file(&arguments.input))?;
    if !baked.report.unchanged {
        let thumbnail = arguments.thumbnail;
        output = thumbnail.add(output, &arguments.output, replace, &limits, &bar)?;
        baked.report.set_output_bytes(output.length());
    }
    drop(bar);
    if let Content::Stored(_) = &input.content {
        // Repacking is cheap, so the bytes themselves show whether anything has changed.
        let (incremental, written) = (&arguments.incremental, output.written());
        baked.report.unchanged = incremental.is_same(written, &arguments.output)?;
    }
    warn_of_content(&baked.report, common);
    let passes = baked.passes() && denied(common).is_none();
    let report = &mut baked.report;
    let (mut gltf, mut sha256) = (None, None);
    // An output that fails its gate does not get its name.
    if passes {
        let container = if report.unchanged { &*arguments.output } else { output.written() };
        sha256 = Some(digest(container)?);
        if let Some(asset) = &mut asset {
            let clock = Instant::now();
            let written = arguments.gltf.write(container, &arguments.output, &limits, asset)?;
            let (seconds, bytes) = (clock.elapsed().as_secs_f64(), written.bytes());
            report.stages.push(StageReport { name: "gltf", seconds, bytes });
            gltf = Some(written);
        }
        if let Some(depfile) = &mut depfile {
            depfile.append(depfile_rule(&arguments.output, &baked.inputs).as_bytes())?;
        }
        let container = Some(output).filter(|_| !report.unchanged);
        Output::finish_all(container.into_iter().chain(asset).chain(depfile).collect())?;
    }
    let work = Work {
        input: arguments.held.as_ref().map_or(&arguments.input, |held| held.path()),
        output: &arguments.output,
        seconds: clock.elapsed().as_secs_f64(),
        bytes_read: input.bytes_read(),
        sha256,
    };
    baked.outcome("bake", &work, gltf.as_ref(), common)
}

/// Warns of missing content of a container.
fn warn_of_content(report: &BakeReport, common: &Common) {
    if let Some(fitted) = &report.fitted {
        warn_of_idle_levels(fitted, common);
    }
    if !report.unchanged && report.levels.iter().all(|level| level.blocks_stored == 0) {
        warn("the container is empty: no voxel of the input is dense enough to show", common);
    }
    if report.nonfinite_values > 0 {
        let count = report.nonfinite_values;
        warn(&format!("{count} values were not finite and became empty"), common);
    }
}
