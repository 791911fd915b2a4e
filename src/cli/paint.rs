//! Colours of messages on a terminal.

use std::ffi::OsStr;
use std::io::IsTerminal;

use super::common::When;

/// True if messages on stderr have colours. `NO_COLOR` and `CLICOLOR=0` switch them off,
/// `CLICOLOR_FORCE` on; an explicit `--color` overrides all of them.
pub fn is_colored(asked: When) -> bool {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    let terminal = std::io::stderr().is_terminal()
        && set("TERM").as_deref() != Some(OsStr::new("dumb"))
        && set("CLICOLOR").as_deref() != Some(OsStr::new("0"));
    match asked {
        When::Always => true,
        When::Never => false,
        When::Auto if set("NO_COLOR").is_some() => false,
        When::Auto => terminal || set("CLICOLOR_FORCE").is_some_and(|value| value != "0"),
    }
}

/// The label of an error or a verdict.
pub fn error_label(colored: bool) -> &'static str {
    if colored { "\x1b[1;31merror:\x1b[0m" } else { "error:" }
}
