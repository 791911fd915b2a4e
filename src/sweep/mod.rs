//! Bakes with many settings: the cost of each in time and bytes, its loss at every scale, and the
//! selection of the best ones.
//!
//! 1. **Settings** ([`Grid`]): every combination of the given lists, each once, in a stable order
//!    and under a stable name.
//! 2. **Measure**: each setting is baked into `FOLDER/NAME.mipvog`, timed, read back, rendered and
//!    compared with the unbaked input, whose pictures are made once for all settings.
//! 3. **Keep** ([`record`]): a finished setting leaves `FOLDER/NAME.json`. A later sweep reuses the
//!    result if all of its inputs are the same, without baking or rendering.
//! 4. **Report**: the [`front`] of size and of time at each scale; `sweep.json`, `sweep.csv`
//!    ([`csv`]) and `sweep.html` ([`page`]), written anew by every run.
//!
//! Machines that share a folder share a sweep ([`Share`]): each takes a shard of the settings and
//! keeps its results, and one more run merges them into the reports.
//!
//! [`forecast_sweep`] estimates the cost of all that, and writes nothing.
//!
//! If a setting cannot be baked, its result is a failure, and the others continue. Errors of the
//! operating system and cancellation end the sweep. Finished results stay.

mod csv;
mod forecast;
mod measure;
mod options;
mod page;
mod pareto;
mod plot;
mod record;
mod report;
mod run;
mod setting;
mod thumbnail;

pub use forecast::{SettingForecast, SweepForecast, forecast_sweep};
pub use options::{Share, SweepOptions};
pub use pareto::{Point, front};
pub use record::RECORD_SCHEMA;
pub use report::{Fronts, Measured, SCHEMA, SettingReport, SweepReport};
pub use run::sweep;
pub use setting::{Grid, List, Setting};
pub use thumbnail::Thumbnail;
