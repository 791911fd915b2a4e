//! Programs of others, which tests ask where they are. The gate has them and sets `MIPVOG_TOOLS`:
//! none may be missing there.

use std::ffi::OsString;
use std::process::Command;
use std::sync::OnceLock;

use super::root;

/// Python with the modules of `tests/second_reader/requirements.txt`: the interpreter of
/// `MIPVOG_PYTHON`, else of `target/python`, else any.
pub fn python() -> Option<Command> {
    static FOUND: OnceLock<Option<OsString>> = OnceLock::new();
    let found = FOUND.get_or_init(|| {
        let own = root().join("target/python/bin/python3");
        let own = if own.is_file() { own.into() } else { "python3".into() };
        let python = std::env::var_os("MIPVOG_PYTHON").unwrap_or(own);
        answers(Command::new(&python).args(["-c", "import numpy, zstandard"])).then_some(python)
    });
    let mut python = Command::new(noted(found.as_ref(), "Python with NumPy and zstandard")?);
    python.env("PYTHONDONTWRITEBYTECODE", "1");
    Some(python)
}

/// Node with the packages of `tests/gltf`.
pub fn node() -> Option<Command> {
    let has_packages = root().join("tests/gltf/node_modules").is_dir();
    let found = (has_packages && answers(Command::new("node").arg("--version"))).then_some("node");
    noted(found, "Node with the packages of tests/gltf").map(Command::new)
}

fn answers(command: &mut Command) -> bool {
    command.output().is_ok_and(|output| output.status.success())
}

fn noted<T>(found: Option<T>, name: &str) -> Option<T> {
    if found.is_none() {
        assert!(std::env::var_os("MIPVOG_TOOLS").is_none(), "no {name}");
        eprintln!("note: no {name} here; it was not asked");
    }
    found
}
