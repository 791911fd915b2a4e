//! OpenUSD's own library opens what `export --to usd` writes.
//!
//! The library is asked where `target/usd/bin/python3` has it: `python3 -m venv target/usd`, then
//! `target/usd/bin/pip install -r tests/usd/requirements.txt`.

use std::path::Path;
use std::process::Command;

use crate::common::{fixture, folder, program};

#[test]
fn openusd_opens_the_stage_and_finds_the_grids() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = root.join("target/usd/bin/python3");
    let folder = folder();
    let tiny = fixture("baked/tiny.rate.f16.mipvog");
    for (up, axis, features) in [("z", "Z", false), ("y", "Y", true)] {
        let mut export = program();
        export.current_dir(folder.path()).arg("export").arg(&tiny).args(["--to", "usd"]);
        export.args(["--resolution", "16", "--up", up, "-o", "scene.usda", "--force", "--quiet"]);
        let mut names = vec!["density".to_owned(), "Cd".to_owned()];
        if features {
            export.arg("--features");
            names.extend((0..4).map(|channel| format!("feature_{channel}")));
        }
        assert!(export.status().expect("starts").success());
        if !python.exists() {
            eprintln!("note: no usd-core in target/usd; OpenUSD was not asked");
            return;
        }
        let check = root.join("tests/usd/check.py");
        let output = Command::new(&python)
            .arg(check)
            .arg(folder.path().join("scene.usda"))
            .args(names)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .output()
            .expect("Python starts");
        let printed = String::from_utf8_lossy(&output.stdout);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{printed}{errors}");
        assert_eq!(printed.trim(), axis);
    }
}
