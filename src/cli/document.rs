//! `completions` and `man`.

use clap::Args;
use clap_complete::Shell;

use super::outcome::write_stdout;
use crate::base::error::{Error, Result};

/// Print a completion script for a shell
#[derive(Debug, Args)]
pub struct CompletionArguments {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Prints a completion script.
pub fn completions(arguments: &CompletionArguments, mut program: clap::Command) -> Result<()> {
    let mut bytes = Vec::new();
    clap_complete::generate(arguments.shell, &mut program, "mipvog-bake", &mut bytes);
    write_stdout(&bytes)
}

/// Prints the version, as `--version` does.
pub fn version(program: &clap::Command) -> Result<()> {
    write_stdout(program.render_version().as_bytes())
}

/// Prints the manual page, of the program and then of each verb.
pub fn man(program: &clap::Command) -> Result<()> {
    let mut bytes = Vec::new();
    let io = |error| Error::io(error, std::path::Path::new("stdout"));
    clap_mangen::Man::new(program.clone()).render(&mut bytes).map_err(io)?;
    for verb in program.get_subcommands().filter(|verb| verb.get_name() != "help") {
        clap_mangen::Man::new(verb.clone()).render(&mut bytes).map_err(io)?;
    }
    write_stdout(&bytes)
}
