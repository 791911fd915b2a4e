//! The arguments of `bake --manifest`.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command, FromArgMatches};

use crate::base::shard::Shard;

/// Many scenes.
#[derive(Debug, Args)]
pub struct ManifestArguments {
    /// Bake many scenes: a file with one JSON object per line, {"input", "output", "options"}.
    /// Paths are relative to the file's folder; outputs are relative to --output, if given. Options
    /// on the command line apply to every scene; options of a line override them. Results are JSON
    /// lines on stdout
    #[arg(long, value_name = "FILE")]
    pub manifest: Option<PathBuf>,
    /// Bake only this line, counted from 0
    #[arg(long, value_name = "N", conflicts_with_all = ["input", "index_from_env", "shard"])]
    pub index: Option<u64>,
    /// Bake only the line of the task number that the scheduler sets: Slurm, AWS Batch, PBS, SGE,
    /// LSF, Cloud Run or Kubernetes
    #[arg(long, conflicts_with_all = ["input", "shard"])]
    pub index_from_env: bool,
    /// Bake every Nth line, starting with line I, counted from 0
    #[arg(long, value_name = "I/N", conflicts_with = "input")]
    pub shard: Option<Shard>,
    /// Also write the results to a file, once all scenes have ended; existing results are replaced
    #[arg(long, value_name = "FILE.jsonl", conflicts_with = "input")]
    pub results: Option<PathBuf>,
}

/// The options that the command line gives, by their names in it: a scene's line may override them.
#[derive(Debug, Default)]
pub struct ExplicitOptions(pub Vec<(String, Vec<OsString>)>);

impl ExplicitOptions {
    /// True if the option of this name is among them.
    pub fn has(&self, name: &str) -> bool {
        self.0.iter().any(|(own, _)| own == name)
    }
}

impl FromArgMatches for ExplicitOptions {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut given = Self::default();
        given.update_from_arg_matches(matches)?;
        Ok(given)
    }

    // Without this, the values would be taken out of the matches, and other arguments need them.
    fn from_arg_matches_mut(matches: &mut ArgMatches) -> Result<Self, clap::Error> {
        Self::from_arg_matches(matches)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        for id in matches.ids().map(clap::Id::as_str) {
            if matches.value_source(id) != Some(ValueSource::CommandLine) {
                continue;
            }
            // A group of arguments has no values of its own.
            let Ok(Some(values)) = matches.try_get_raw(id) else { continue };
            self.0.push((id.replace('_', "-"), values.map(ToOwned::to_owned).collect()));
        }
        Ok(())
    }
}

impl Args for ExplicitOptions {
    fn augment_args(command: Command) -> Command {
        command
    }

    fn augment_args_for_update(command: Command) -> Command {
        command
    }
}
