//! The `mipvog-bake` program; see `mipvog-bake help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    mipvog_bake::cli::main()
}
