//! `sweep`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::{ArgAction, ArgMatches, Args, Command, FromArgMatches};

use super::cameras::{CameraArguments, check_memory, checked_scales};
use super::common::Common;
use super::detail::warn_of_figures;
use super::folders::input_path;
use super::layout::{Table, columns, folded};
use super::outcome::{Outcome, assumed, counted, readable, warn};
use super::output::{refuse_file_name, refuse_stdout};
use super::progress::Bar;
use super::scene::SceneArguments;
use super::shell;
use super::stored::argument;
use super::sweep_command::bake_command;
use super::values::by_name;
use crate::bake::{BAKE_OPTIONS, Preset};
use crate::base::bytes::{SourceFile, remove_stale};
use crate::base::error::{Error, Result};
use crate::base::progress::Step;
use crate::base::shard::Shard;
use crate::container::is_container;
use crate::sweep::{
    Grid, List, SettingReport, Share, SweepForecast, SweepOptions, SweepReport, forecast_sweep,
    sweep,
};
use mipvog_inputs::tensor;
use mipvog_outputs::gltf::asset::is_asset;

/// Bake with many settings and plot the best ones
///
/// Every combination of the given lists is baked; separate values with commas. By default, four bit
/// depths are tried with three filters, and eight pictures are taken from around the scene.
/// Settings that an earlier sweep finished in the same folder, from the same input and cameras, are
/// not baked again. If a setting fails, the others are still measured, and the exit code is 1.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mipvog-bake sweep fine_last.tar -o sweep/
  mipvog-bake sweep fine_last.tar --cameras transforms.json --bits 6,8,10 -o sweep/
  mipvog-bake sweep fine_last.tar --max-error 0.01,0.02 --preset web -o sweep/
  mipvog-bake sweep fine_last.tar --bits 6,8 --shard 0/2 -o sweep/")]
pub struct Arguments {
    /// A trained model, as bake takes it
    #[arg(value_parser = input_path())]
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
    /// Scales to measure: 1 is full size, 2 a half, 4 a quarter
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
    refuse_file_name(&arguments.output, "name a folder, such as -o sweep/")?;
    let bar = Bar::new(common);
    bar.plan(vec![(Step::Sweep, 1.0)]);
    let grid = Grid { lists: arguments.lists.0.clone(), presets: arguments.preset.clone() };
    let mut settings = grid.settings()?;
    settings.iter().try_for_each(|setting| setting.options.check())?;
    let limits = common.limits();
    let cameras = arguments.cameras.file();
    let found = arguments.scene.settings(&arguments.input, cameras.as_ref(), &limits)?;
    let path = mipvog_inputs::file_of(&arguments.input);
    let content = SourceFile::open(&path)?;
    if is_container(&content) || is_asset(&content) {
        let error = Error::wrong_kind("a baked field", "a trained model").in_file(&path);
        return Err(error.advise("a sweep bakes a model again and again: pass its checkpoint"));
    }
    let file = tensor::open(&path, &limits)?;
    if file.unpacked_metadata().is_some() {
        let message = "an unpacked container holds what one setting kept; a sweep needs the \
                       trained input it came from";
        return Err(Error::usage(message).in_file(&arguments.input));
    }
    let source = mipvog_inputs::open_tensors(&file, &found.options, &limits)?;
    for assumption in &source.assumptions {
        warn(&assumed(&assumption.message), common);
    }
    let cameras = match arguments.cameras.given() {
        true => arguments.cameras.cameras(&source.field.scene.bounds, common)?,
        false => arguments.cameras.around(&source.renderer(None, &limits)?, &bar)?,
    };
    check_memory(&cameras, 1, &limits)?;
    for setting in settings.iter_mut().filter(|setting| setting.options.sees()) {
        setting.options.seen_from.clone_from(&cameras);
    }
    for setting in &mut settings {
        setting.command = bake_command(arguments.input.as_os_str(), setting);
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
        let scales = report.scales.iter().map(|scale| format!("1/{scale}, dB"));
        let heads = ["setting", "size", "bake time"].map(str::to_owned);
        let mut table = Table::new(heads.into_iter().chain(scales), 1);
        for setting in &report.settings {
            table.add(row(setting));
        }
        let mut text = table.text(columns());
        let mut add = |line: &str| text += &(folded(&format!("  {line}"), columns(), 4) + "\n");
        add(
            "* no other setting is both smaller and more accurate; + none is both faster and more \
             accurate",
        );
        let ([across, down], frames) = (report.size, counted(report.frames.len(), "picture"));
        add(&format!("dB: PSNR against the unbaked scene, mean of {frames} of {across} x {down}"));
        let resumed = report.settings.iter().filter(|setting| setting.resumed).count();
        if resumed > 0 {
            add(&format!("{resumed} of {} settings were finished before", report.settings.len()));
        }
        for setting in &report.settings {
            if let Some(failure) = &setting.failure {
                add(&format!("{} failed: {failure}", shown_name(&setting.name, setting.preset)));
            }
        }
        match self.shard {
            None => add(&format!("plots: {}", self.output.join("sweep.html").display())),
            Some(_) => add("--merge writes the plots of all shards"),
        }
        if let Some(setting) = report.recommended() {
            let file = self.output.join(&setting.file);
            let next = shell::command(["view".as_ref(), file.as_os_str()]);
            writeln!(text, "  the best trade-off: {next}").ok();
        }
        text
    }
}

fn shown_name(name: &str, preset: Option<&str>) -> String {
    let preset = preset.filter(|preset| *preset != name);
    name.to_owned() + &preset.map_or_else(String::new, |preset| format!(" ({preset})"))
}

fn forecast_text(forecast: &SweepForecast) -> String {
    let SweepForecast { settings, repeat, .. } = forecast;
    let mut table = Table::new(["setting", "size", "bake time", ""], 1);
    for setting in settings {
        let seconds = setting.seconds.map(|seconds| format!("{seconds:.3} s"));
        let note = match (&setting.failure, setting.resumed) {
            (Some(_), _) => "failed",
            (None, true) => "finished before",
            (None, false) => "",
        };
        table.add([
            shown_name(&setting.name, setting.preset),
            setting.output_bytes.map_or_else(|| "-".to_owned(), readable),
            seconds.unwrap_or_else(|| "-".to_owned()),
            note.to_owned(),
        ]);
    }
    let mut text = table.text(columns());
    for setting in settings {
        if let Some(failure) = &setting.failure {
            let line = format!("  {} failed: {failure}", setting.name);
            text += &(folded(&line, columns(), 4) + "\n");
        }
    }
    let (count, bytes) = (counted(settings.len(), "setting"), readable(forecast.output_bytes));
    let time = match forecast.seconds {
        Some(seconds) => format!("{seconds:.1} s"),
        None => "an unknown time, because a fit ends when nothing is gained any more".to_owned(),
    };
    let line = format!(
        "  {count}, each baked {}: about {bytes} in {time}; rendering takes longer",
        counted(*repeat, "time")
    );
    text + &folded(&line, columns(), 4) + "\n"
}

/// The cells of a setting.
fn row(setting: &SettingReport) -> Vec<String> {
    let name = shown_name(&setting.name, setting.preset);
    let (Some(bytes), Some(seconds)) = (setting.output_bytes, setting.seconds) else {
        return vec![name, "failed".to_owned()];
    };
    let errors = setting.errors.iter().zip(&setting.fronts);
    let errors = errors.map(|(errors, fronts)| format!("{:.2} {:2}", errors.psnr, fronts.marks()));
    [name, readable(bytes), format!("{seconds:.3} s")].into_iter().chain(errors).collect()
}
