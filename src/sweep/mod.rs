//! Bakes over settings: each one's cost in time and bytes, its loss at every scale, and the choice
//! of the best ones.
//!
//! 1. **Settings** ([`Grid`]): every combination of the lists that were given, each once, in a
//!    stable order and under a stable name.
//! 2. **Measure**: each setting is baked into `FOLDER/NAME.mipvog`, timed, read back, rendered and
//!    compared with the unbaked input, whose pictures are made once for all settings.
//! 3. **Keep** ([`record`]): a finished setting leaves `FOLDER/NAME.json`. A later sweep takes a
//!    result from there if everything that it follows from is the same, and neither bakes nor
//!    renders.
//! 4. **Tell**: the [`front`] of size and of time at each scale; `sweep.json`, `sweep.csv`
//!    ([`csv`]) and `sweep.html` ([`page`]), written anew by every run.
//!
//! Machines that share a folder share a sweep ([`Share`]): each takes a shard of the settings and
//! keeps its results, and one more run merges them into the reports.
//!
//! [`forecast_sweep`] tells the cost of all that and writes nothing.
//!
//! A setting that cannot be baked has a failure for a result, and the others go on. An operating
//! system that fails, or a caller who cancels, ends the sweep. Finished results stay.

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
