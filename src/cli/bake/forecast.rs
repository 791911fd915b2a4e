//! `bake --dry-run`.

use super::super::common::Common;
use super::super::container_report::levels_text;
use super::super::layout::{columns, folded};
use super::super::outcome::{Outcome, peak_memory_bytes, readable};
use super::super::progress::Bar;
use super::super::view_report::ViewReport;
use super::arguments::Arguments;
use super::report::BakeJson;
use super::trained::{open, with_cameras};
use crate::bake::{BakeOptions, Forecast, LevelReport, forecast};
use crate::base::error::Result;
use crate::model::camera::Camera;
use crate::model::field::Grid;
use mipvog_inputs::Source;
use mipvog_inputs::tensor::TensorFile;

/// Forecasts the cost and the output of a bake.
pub fn dry_run(
    arguments: &Arguments,
    file: &TensorFile,
    options: &BakeOptions,
    common: &Common,
) -> Result<Outcome> {
    let (source, settings) = open(arguments, file, options, common)?;
    let options = with_cameras(arguments, options, &source.field, common)?;
    let bar = Bar::new(common);
    let forecast =
        forecast(&source.field, &options, &bar).map_err(|error| error.in_file(&arguments.input))?;
    drop(bar);
    let own = peak_memory_bytes().zip(forecast.more_memory_bytes).map(|(own, more)| own + more);
    let measures = arguments.gate.measures()?;
    let judging = match measures {
        true => judging_bytes(&source, &forecast, &arguments.gate.cameras(&source.field, common)?),
        false => 0,
    };
    // If a part was measured, the larger of two estimates, because too low an estimate would kill a
    // job.
    let memory = own.map(|own| own.max(forecast.most_memory_bytes.unwrap_or(0)) + judging);
    // Pictures are rendered from whole fields, which a memory bound excludes.
    let least = forecast.least_memory_bytes.filter(|_| !measures);
    // What a bake needs is bounded from above there, and estimated here.
    let memory = memory.map(|memory| memory.max(least.unwrap_or(0)));
    let json = BakeJson {
        input: arguments.input.to_string_lossy().into_owned(),
        output: arguments.output.to_string_lossy().into_owned(),
        dry_run: Some(true),
        input_bytes: None,
        sha256: None,
        seconds: forecast.seconds,
        peak_memory_bytes: memory,
        least_memory_bytes: Some(least),
        bytes_read: file.file.bytes_read() + forecast.more_bytes_read,
        options: options.to_json(),
        settings: settings.report(&source),
        view: ViewReport::of_source(&source, arguments.color_fit),
        report: forecast.report.clone(),
        fit_steps: forecast.fit_steps,
        quality: None,
        gltf: None,
    };
    let bytes = readable(forecast.report.output_bytes);
    let mut line = format!("{}: about {bytes}", arguments.output.display());
    line += &match (forecast.seconds, forecast.fit_steps) {
        (Some(seconds), _) => format!(" in {seconds:.1} s"),
        (None, steps) => format!(" after a fit of up to {} steps", steps.unwrap_or(0)),
    };
    line += &memory.map_or_else(String::new, |bytes| format!(", {} of memory", readable(bytes)));
    line += &least.map_or_else(String::new, |bytes| {
        let shown = readable(bytes);
        format!("; smallest --memory {bytes} ({shown})")
    });
    let mut text = folded(&line, columns(), 4) + "\n";
    text += &levels_text(&forecast.report.levels, &forecast.report.shells, common.verbose);
    Outcome::new("bake", &json, text)
}

/// Memory per pixel of the two pictures that a gate compares; measured.
const PIXEL_BYTES: u64 = 240;

/// Memory to judge a bake's pictures, beside the bake's: both fields as float32, with what their
/// loading takes, and two pictures of the largest camera; measured.
fn judging_bytes(source: &Source, forecast: &Forecast, cameras: &[Camera]) -> u64 {
    let channels = 1 + source.field.color_channels() as u64;
    let values = |nodes: u64| 4 * channels * nodes;
    let unbaked = match source.model {
        None => values(source.field.scene.nodes.count() as u64),
        Some(_) => source.field.grids().map(Grid::memory_bytes).sum(),
    };
    let nodes = |level: &LevelReport| level.blocks_stored * level.block_size.pow(3);
    let baked: usize = forecast.report.levels.iter().map(nodes).sum();
    let pixels = cameras.iter().map(|camera| (camera.lens.width * camera.lens.height) as u64);
    2 * (unbaked + values(baked as u64)) + PIXEL_BYTES * pixels.max().unwrap_or(0)
}
