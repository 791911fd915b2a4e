//! `bake --dry-run`.

use serde_json::{Value, json};

use super::super::common::Common;
use super::super::container_report::levels_text;
use super::super::outcome::{Outcome, peak_memory_bytes, readable};
use super::super::progress::Bar;
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
    let options = with_cameras(arguments, options, &source.field)?;
    let bar = Bar::new(common);
    let forecast = forecast(&source.field, &options, &bar)?;
    drop(bar);
    let memory = peak_memory_bytes().map(|bytes| bytes + forecast.more_memory_bytes);
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
    });
    if let (Value::Object(json), Ok(Value::Object(report))) =
        (&mut json, serde_json::to_value(&forecast.report))
    {
        json.extend(report);
    }
    let unknown = || "unknown".to_owned();
    let mut text = format!(
        "{}: about {} in {:.1} s, {} of memory; the least --memory is {}\n",
        arguments.output.display(),
        readable(forecast.report.output_bytes),
        forecast.seconds,
        memory.map_or_else(unknown, readable),
        forecast.least_memory_bytes.map_or_else(|| "none".to_owned(), readable),
    );
    text += &levels_text(&forecast.report.levels);
    Outcome::new("bake", &json, text)
}
