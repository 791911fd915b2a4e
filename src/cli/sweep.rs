//! `sweep`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::{ArgAction, ArgMatches, Args, Command, FromArgMatches};

use super::cameras::{CameraArguments, check_memory, checked_scales};
use super::common::Common;
use super::detail::warn_of_figures;
use super::outcome::{Outcome, assumed, counted, readable, warn};
use super::output::refuse_stdout;
use super::progress::Bar;
use super::scene::SceneArguments;
use super::stored::argument;
use super::values::by_name;
use crate::bake::{BAKE_OPTIONS, Preset};
use crate::base::bytes::remove_stale;
use crate::base::error::{Error, Result};
use crate::base::progress::Step;
use crate::base::shard::Shard;
use crate::sweep::{
    Grid, List, SettingReport, Share, SweepForecast, SweepOptions, SweepReport, forecast_sweep,
    sweep,
};
use mipvog_inputs::tensor;

/// Bake with many settings, measure time, size and error, and plot the best ones
///
/// Every combination of the given lists is baked; separate values with commas. By default, four bit
/// depths are tried with three filters. Settings that an earlier sweep finished in the same folder,
/// from the same input and cameras, are not baked again. If a setting fails, the others are still
/// measured, and the exit code is 1.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mipvog-bake sweep fine_last.tar --stepsize 0.5 --cameras transforms.json --frames 0,1 -o sweep/
  mipvog-bake sweep fine_last.tar --turntable 4 --size 400 --filter rate-tent --bits 6,8 -o sweep/
  mipvog-bake sweep fine_last.tar --turntable 4 --max-error 0.01,0.02 --preset web -o sweep/
  mipvog-bake sweep fine_last.tar --turntable 4 --bits 6,8,10 -o sweep/ --dry-run
  mipvog-bake sweep fine_last.tar --turntable 4 --bits 6,8 --threads 2 --shard 0/2 -o sweep/
  mipvog-bake sweep fine_last.tar --turntable 4 --bits 6,8 --threads 2 --merge -o sweep/")]
pub struct Arguments {
    /// A checkpoint, or a .safetensors or .npz file of the same names
    input: PathBuf,
    /// Folder for the containers, their results, and sweep.html, sweep.csv and sweep.json
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Forecast size and bake time of each setting from parts of the scene, and write nothing
    #[arg(long)]
    dry_run: bool,
    /// Presets to try in addition to the combinations
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', value_parser = by_name::<Preset>())]
    preset: Vec<Preset>,
    /// Scales to measure: full size, a half, a quarter and so on
    #[arg(long, value_name = "S,...", value_delimiter = ',', default_value = "1,2,4,8",
          value_parser = clap::value_parser!(u16).range(1..=1024))]
    scales: Vec<u16>,
    /// Bakes of each setting; the median time counts
    #[arg(long, value_name = "N", default_value_t = 3,
          value_parser = clap::value_parser!(u8).range(1..))]
    repeat: u8,
    /// Bake every Nth setting, starting with setting I, counted from 0, and write no report:
    /// machines with a common folder can share a sweep
    #[arg(long, value_name = "I/N", conflicts_with_all = ["merge", "dry_run"])]
    shard: Option<Shard>,
    /// Bake nothing; write the reports from the results of all shards in the folder
    #[arg(long, conflicts_with = "dry_run")]
    merge: bool,
    /// Overwrite files that were not written by a sweep
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    lists: Lists,
    #[command(flatten)]
    cameras: CameraArguments,
    #[command(flatten)]
    scene: SceneArguments,
}

/// The values to try of each option of [`BAKE_OPTIONS`] that has a list.
#[derive(Debug)]
struct Lists(Vec<List>);

impl Args for Lists {
    fn augment_args(command: Command) -> Command {
        let arguments = BAKE_OPTIONS.iter().filter_map(|option| {
            let (value_name, help) = option.list?;
            let list = argument(option, value_name, help);
            Some(list.action(ArgAction::Append).value_delimiter(','))
        });
        command.args(arguments)
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for Lists {
    fn from_arg_matches(matches: &ArgMatches) -> std::result::Result<Self, clap::Error> {
        let lists = BAKE_OPTIONS.iter().filter(|option| option.list.is_some());
        let lists = lists.filter_map(|option| {
            let values = matches.get_many::<String>(option.key)?;
            Some(List { option, values: values.cloned().collect() })
        });
        Ok(Self(lists.collect()))
    }

    fn update_from_arg_matches(
        &mut self,
        matches: &ArgMatches,
    ) -> std::result::Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// Sweeps.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    refuse_stdout(&arguments.output, "sweep writes a folder")?;
    let bar = Bar::new(common);
    bar.plan(vec![(Step::Sweep, 1.0)]);
    let grid = Grid { lists: arguments.lists.0.clone(), presets: arguments.preset.clone() };
    let mut settings = grid.settings()?;
    settings.iter().try_for_each(|setting| setting.options.check())?;
    let limits = common.limits();
    let cameras = arguments.cameras.file();
    let found = arguments.scene.settings(&arguments.input, cameras.as_ref(), &limits)?;
    let file = tensor::open(&mipvog_inputs::file_of(&arguments.input), &limits)?;
    if file.unpacked_metadata().is_some() {
        let message = "an unpacked container holds what one setting kept; a sweep needs the \
                       trained input it came from";
        return Err(Error::usage(message).in_file(&arguments.input));
    }
    let source = mipvog_inputs::open_tensors(&file, &found.options, &limits)?;
    for assumption in &source.assumptions {
        warn(&assumed(&assumption.message), common);
    }
    let cameras = arguments.cameras.cameras(&source.field.scene.bounds, common)?;
    check_memory(&cameras, 1, &limits)?;
    for setting in settings.iter_mut().filter(|setting| setting.options.sees()) {
        setting.options.seen_from.clone_from(&cameras);
    }
    let options = SweepOptions {
        settings,
        scales: checked_scales(&arguments.scales, &cameras)?,
        repeat: arguments.repeat.into(),
        overwrite: arguments.force,
        share: arguments.share(),
        limits,
    };
    if arguments.dry_run {
        let forecast = forecast_sweep(&source, &cameras, &options, &arguments.output, &bar)?;
        drop(bar);
        let failed = forecast.settings.iter().filter(|setting| setting.failure.is_some()).count();
        let failure = failure(failed, forecast.settings.len());
        let text = forecast_text(&forecast);
        return Ok(Outcome { failure, ..Outcome::new("sweep-forecast", &forecast, text)? });
    }
    remove_stale(&arguments.output);
    let report = sweep(&source, &cameras, &options, &arguments.output, &bar)?;
    drop(bar);
    if let Some(first) = report.settings.iter().find(|setting| setting.failure.is_none()) {
        warn_of_figures(&first.errors, &cameras, None, common);
    }
    let failed = report.settings.iter().filter(|setting| setting.failure.is_some()).count();
    let failure = failure(failed, report.settings.len());
    Ok(Outcome { failure, ..Outcome::new("sweep", &report, arguments.text(&report))? })
}

/// The reason of exit code 1, if any setting failed.
fn failure(failed: usize, count: usize) -> Option<String> {
    (failed > 0).then(|| format!("{failed} of {count} settings could not be baked"))
}

impl Arguments {
    fn share(&self) -> Share {
        match self.shard {
            Some(shard) => Share::Shard(shard),
            None if self.merge => Share::Merge,
            None => Share::All,
        }
    }

    fn text(&self, report: &SweepReport) -> String {
        let names =
            report.settings.iter().map(|setting| shown_name(&setting.name, setting.preset).len());
        let width = names.max().unwrap_or(0);
        let mut text = format!("  {:width$} {:>10} {:>10}", "setting", "size", "bake time");
        for scale in &report.scales {
            write!(text, " {:>9}  ", format!("1/{scale}, dB")).ok();
        }
        text = text.trim_end().to_owned() + "\n";
        for setting in &report.settings {
            text += &row(setting, width);
        }
        let (resumed, all) = (
            report.settings.iter().filter(|setting| setting.resumed).count(),
            report.settings.len(),
        );
        let ([across, down], frames) = (report.size, report.frames.len());
        writeln!(
            text,
            "dB: PSNR against the unbaked scene, mean over {frames} pictures of {across} x {down} \
             pixels, whole and averaged down; time: median of {} bakes with {} threads\n\
             * is on the front of size, + on that of time: no other setting is as good in both\n\
             {resumed} of {all} settings were finished before; {}",
            report.repeat,
            report.threads,
            match self.shard {
                None => format!("{} has the plots", self.output.join("sweep.html").display()),
                Some(_) => "--merge writes the plots of all shards".to_owned(),
            }
        )
        .ok();
        let smallest = report.settings.iter().filter(|s| s.fronts.iter().any(|f| f.bytes));
        if let Some(setting) = smallest.min_by_key(|setting| setting.output_bytes) {
            let file = self.output.join(&setting.file);
            writeln!(text, "look at one: mipvog-bake view {}", file.display()).ok();
        }
        text
    }
}

fn shown_name(name: &str, preset: Option<&str>) -> String {
    name.to_owned() + &preset.map_or_else(String::new, |preset| format!(" ({preset})"))
}

fn forecast_text(forecast: &SweepForecast) -> String {
    let SweepForecast { settings, repeat, .. } = forecast;
    let names: Vec<String> =
        settings.iter().map(|setting| shown_name(&setting.name, setting.preset)).collect();
    let width = names.iter().map(String::len).max().unwrap_or(0);
    let mut text = format!("  {:width$} {:>10} {:>10}\n", "setting", "size", "bake time");
    for (setting, name) in settings.iter().zip(&names) {
        let bytes = setting.output_bytes.map_or_else(|| "-".to_owned(), readable);
        let seconds = setting.seconds.map(|seconds| format!("{seconds:.3} s"));
        let seconds = seconds.unwrap_or_else(|| "-".to_owned());
        let note = match (&setting.failure, setting.resumed) {
            (Some(failure), _) => format!("  failed: {failure}"),
            (None, true) => "  finished before".to_owned(),
            (None, false) => String::new(),
        };
        writeln!(text, "  {name:width$} {bytes:>10} {seconds:>10}{note}").ok();
    }
    let (count, bytes) = (counted(settings.len(), "setting"), readable(forecast.output_bytes));
    let time = match forecast.seconds {
        Some(seconds) => format!("about {seconds:.1} s of bakes, {repeat} of each setting"),
        None => "an unknown time, for a fit ends where nothing is gained any more".to_owned(),
    };
    writeln!(text, "{count}: about {bytes} in {time}; pictures take more").ok();
    text
}

fn row(setting: &SettingReport, width: usize) -> String {
    let name = shown_name(&setting.name, setting.preset);
    let (Some(bytes), Some(seconds)) = (setting.output_bytes, setting.seconds) else {
        let failure = setting.failure.as_deref().unwrap_or_default();
        return format!("  {name:width$} failed: {failure}\n");
    };
    let mut text = format!("  {name:width$} {:>10} {seconds:>8.3} s", readable(bytes));
    for (errors, fronts) in setting.errors.iter().zip(&setting.fronts) {
        write!(text, " {:>9.2}{:2}", errors.psnr, fronts.marks()).ok();
    }
    text.trim_end().to_owned() + "\n"
}
