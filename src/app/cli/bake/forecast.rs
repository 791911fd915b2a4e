//! `bake --dry-run`.

use serde_json::{Value, json};

use super::super::common::Common;
use super::super::container_report::levels_text;
use super::super::outcome::{Outcome, peak_memory_bytes, readable};
use super::super::progress::Bar;
use super::super::view_report::ViewReport;
use super::arguments::Arguments;
use super::trained::{open, with_cameras};
use crate::bake::{BakeOptions, forecast};
use crate::base::error::Result;
use crate::input::tensor::TensorFile;

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
    let memory = peak_memory_bytes().zip(forecast.more_memory_bytes).map(|(own, more)| own + more);
    let mut json = json!({
        "input": arguments.input.to_string_lossy(),
        "output": arguments.output.to_string_lossy(),
        "dry_run": true,
        "seconds": forecast.seconds,
        "peak_memory_bytes": memory,
        "least_memory_bytes": forecast.least_memory_bytes,
        "bytes_read": file.file.bytes_read() + forecast.more_bytes_read,
        "options": options.to_json(),
        "settings": settings.report(&source),
        "view": ViewReport::of_source(&source, arguments.color_fit),
    });
    if let (Value::Object(json), Ok(Value::Object(report))) =
        (&mut json, serde_json::to_value(&forecast.report))
    {
        json.extend(report);
    }
    if let Some(steps) = forecast.fit_steps {
        json["fit_steps"] = steps.into();
    }
    let mut text =
        format!("{}: about {}", arguments.output.display(), readable(forecast.report.output_bytes));
    text += &match (forecast.seconds, forecast.fit_steps) {
        (Some(seconds), _) => format!(" in {seconds:.1} s"),
        (None, steps) => format!(" after a fit of up to {} steps", steps.unwrap_or(0)),
    };
    text += &memory.map_or_else(String::new, |bytes| format!(", {} of memory", readable(bytes)));
    let least = forecast.least_memory_bytes;
    text += &least.map_or_else(String::new, |bytes| format!("; least --memory {bytes}"));
    text.push('\n');
    text += &levels_text(&forecast.report.levels);
    Outcome::new("bake", &json, text)
}
