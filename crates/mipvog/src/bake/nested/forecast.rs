//! The forecast of a bake with a world: the sum of the forecasts of its boxes.

use super::{World, check};
use crate::bake::report::Stages;
use crate::bake::{BakeOptions, Forecast, forecast as forecast_box};
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::model::field::RadianceField;

/// Forecasts [`super::bake`]. Each box is forecast with the values that its shell has inside the
/// smaller one.
///
/// # Errors
///
/// As for a bake.
pub fn forecast(
    field: &RadianceField,
    options: &BakeOptions,
    progress: &dyn Progress,
) -> Result<Forecast> {
    check(field, options)?;
    let mut stages = Stages::start();
    let folder = std::env::temp_dir();
    let world = World { field, options, folder: &folder, stages: &mut stages, progress };
    let last = field.shells.len();
    let mut all: Option<Forecast> = None;
    for number in 0..=last {
        let own = world.own_field(number, None)?;
        let levels = match number == last {
            true => options.levels.map(|levels| levels - number),
            false => Some(2),
        };
        let options = BakeOptions { levels, ..world.own_options(number) };
        let found = forecast_box(&own, &options, progress)?;
        match &mut all {
            Some(all) => add(all, found, number),
            None => all = Some(found),
        }
    }
    let mut all = all.ok_or_else(Error::cancelled)?;
    stages.list = std::mem::take(&mut all.report.stages);
    stages.join_same();
    all.report.stages = stages.list;
    Ok(all)
}

/// Adds the next larger box. Work adds up; memory is that of the largest box plus everything held.
fn add(all: &mut Forecast, mut found: Forecast, number: usize) {
    let sum = |a: Option<f64>, b: Option<f64>| Some(a? + b?);
    let most = |a: Option<u64>, b: Option<u64>| Some(a?.max(b?));
    all.seconds = sum(all.seconds, found.seconds);
    all.more_bytes_read += found.more_bytes_read;
    all.least_memory_bytes = most(all.least_memory_bytes, found.least_memory_bytes);
    all.most_memory_bytes = most(all.most_memory_bytes, found.most_memory_bytes)
        .map(|most| most + all.report.output_bytes);
    let held = all.more_memory_bytes.zip(found.more_memory_bytes);
    all.more_memory_bytes = held.map(|(all, found)| all + found);
    all.report.output_bytes += found.report.output_bytes;
    all.report.nonfinite_values += found.report.nonfinite_values;
    all.report.stages.append(&mut found.report.stages);
    let mut levels = found.report.levels.into_iter();
    all.report.shells.extend(levels.next().map(|mut shell| {
        shell.level = number;
        shell
    }));
    let first = all.report.levels.len();
    all.report.levels.extend(levels.zip(first..).map(|(mut level, number)| {
        level.level = number;
        level
    }));
    all.report.pruned.extend(found.report.pruned.into_iter().skip(1).zip(first..).map(
        |(mut pruned, number)| {
            pruned.level = number;
            pruned
        },
    ));
}
