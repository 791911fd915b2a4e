//! The options that all verbs share.

use clap::{Args, ValueEnum};

use super::values;
use super::warnings::Warnings;
use super::watcher::SharedWatcher;
#[cfg(feature = "network")]
use crate::base::bytes::NetworkPermit;
use crate::base::limits::{LimitName, Limits};

/// Options that all verbs share.
#[derive(Debug, Args)]
#[command(next_help_heading = "General")]
pub(super) struct Common {
    /// Report format: text, json (errors too), or sarif for the findings of validate
    #[arg(long, global = true, value_enum, default_value_t = Format::Text)]
    pub(super) format: Format,
    /// Number of threads, 0 to 256; 0 means one per processor
    #[arg(long, global = true, value_name = "N", default_value_t = 0,
          value_parser = clap::value_parser!(u16).range(0..=256))]
    pub(super) threads: u16,
    /// Set a limit on what files may request, such as memory=1000000000; can be repeated. An
    /// unknown name lists all limits
    #[arg(long = "limit", global = true, value_name = "NAME=COUNT", value_parser = values::parse_limit)]
    pub(super) limits: Vec<(LimitName, u64)>,
    /// Allow https:// inputs; needs a program built with the feature network. Without this option,
    /// the network is not used
    #[arg(long, global = true)]
    pub(super) allow_network: bool,
    /// Exit with 1 if there is a warning; bake and export then write nothing
    #[arg(long, global = true)]
    pub(super) deny_warnings: bool,
    /// Print no report, progress or warnings
    #[arg(long, short, global = true)]
    pub(super) quiet: bool,
    /// Print more: tables of levels, frames and stages
    #[arg(long, short, global = true, conflicts_with = "quiet")]
    pub(super) verbose: bool,
    /// Colours in error messages
    #[arg(long, global = true, value_enum, default_value_t = When::Auto)]
    pub(super) color: When,
    /// Progress on stderr; auto means on terminals only
    #[arg(long, global = true, value_enum, default_value_t = When::Auto)]
    pub(super) progress: When,
    /// The program that holds this library and watches the work.
    #[arg(skip)]
    pub(super) watcher: Option<SharedWatcher>,
    /// The warnings of the run.
    #[arg(skip)]
    pub(super) warnings: Warnings,
}

impl Common {
    /// Allows fetching inputs while it lives, if requested.
    #[cfg(feature = "network")]
    pub(super) fn network_permit(&self) -> Option<NetworkPermit> {
        self.allow_network.then(NetworkPermit::new)
    }

    /// Nothing is fetched without the feature.
    #[cfg(not(feature = "network"))]
    pub(super) fn network_permit(&self) -> Option<()> {
        None
    }

    /// Limits on the sizes that files may ask for.
    pub(super) fn limits(&self) -> Limits {
        let mut limits = Limits::default();
        for (name, count) in &self.limits {
            *limits.get_mut(*name) = *count;
        }
        limits
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Format {
    /// For people.
    Text,
    /// One JSON document.
    Json,
    /// A SARIF 2.1.0 log of findings.
    Sarif,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum When {
    Auto,
    Always,
    Never,
}
