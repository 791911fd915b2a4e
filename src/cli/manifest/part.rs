//! The scenes of a manifest that one process bakes.

use super::arguments::ManifestArguments;
use crate::base::error::{Error, Result};
use crate::base::shard::Shard;

/// Environment variables of schedulers for the number of a task of an array, and the number of the
/// first task. Slurm, PBS and Kubernetes count as the user asks; the first scene is 0.
const VARIABLES: [(&str, &str, u64); 7] = [
    ("Slurm", "SLURM_ARRAY_TASK_ID", 0),
    ("AWS Batch", "AWS_BATCH_JOB_ARRAY_INDEX", 0),
    ("PBS", "PBS_ARRAY_INDEX", 0),
    ("SGE", "SGE_TASK_ID", 1),
    ("LSF", "LSB_JOBINDEX", 1),
    ("Cloud Run", "CLOUD_RUN_TASK_INDEX", 0),
    ("Kubernetes", "JOB_COMPLETION_INDEX", 0),
];
/// SGE's value in a job that is not an array.
const UNDEFINED: &str = "undefined";

/// Scenes of a manifest, by their numbers from 0.
#[derive(Debug, Clone, Copy)]
pub enum Part {
    /// All.
    All,
    /// One.
    Scene(u64),
    /// Every Nth.
    Shard(Shard),
}

impl Part {
    /// From the command line or the environment.
    ///
    /// # Errors
    /// `Usage` if the environment has no task number.
    pub fn of(arguments: &ManifestArguments) -> Result<Self> {
        match (arguments.index, arguments.index_from_env, arguments.shard) {
            (Some(number), ..) => Ok(Self::Scene(number)),
            (None, true, _) => of_environment(),
            (None, false, Some(shard)) => Ok(Self::Shard(shard)),
            (None, false, None) => Ok(Self::All),
        }
    }

    /// True if the scene of this number is in it.
    pub fn has(self, number: u64) -> bool {
        match self {
            Self::All => true,
            Self::Scene(own) => number == own,
            Self::Shard(shard) => shard.has(number),
        }
    }
}

fn of_environment() -> Result<Part> {
    for (scheduler, variable, first) in VARIABLES {
        let Some(value) = std::env::var_os(variable) else { continue };
        let value = value.to_string_lossy();
        if value.is_empty() || value == UNDEFINED {
            continue;
        }
        let number = value.parse::<u64>().ok().and_then(|number| number.checked_sub(first));
        return number.map(Part::Scene).ok_or_else(|| {
            let message = format!(
                "--index-from-env: found {variable}={value} of {scheduler}, expected a number from \
                 {first} on: submit an array of tasks"
            );
            Error::usage(message)
        });
    }
    let names: Vec<&str> = VARIABLES.iter().map(|(_, variable, _)| *variable).collect();
    Err(Error::usage(format!(
        "--index-from-env: found no number of a task, expected one in {}: submit an array of \
         tasks, or pass --index",
        names.join(", ")
    )))
}
