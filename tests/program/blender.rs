//! The script of the book for Blender: it is Python, and Blender shows what it sets up as the field.
//!
//! Blender is asked where `target/blender/bin/python3` has it as a module: `python3 -m venv
//! target/blender` (with the Python of Blender's version), then
//! `target/blender/bin/pip install -r tests/blender/requirements.txt`.

use std::path::Path;
use std::process::Command;

use crate::common::pages::text;
use crate::common::{fixture, folder, program};

const FENCE: &str = "\n```python blender_volume.py\n";

#[test]
fn blender_shows_a_volume_as_the_field() {
    let page = text(Path::new("docs/tasks/blender.md"));
    let script = page.split_once(FENCE).and_then(|(_, rest)| rest.split_once("\n```"));
    let (script, _) = script.expect("the script");
    let folder = folder();
    let here = folder.path();
    std::fs::write(here.join("script.py"), script).expect("writable");
    // The names of the grids are those that exports write.
    assert!(script.contains("attribute(\"density\"") && script.contains("attribute(\"Cd\""));
    let parse = "import ast, sys; ast.parse(open(sys.argv[1]).read())";
    match Command::new("python3").args(["-c", parse, "script.py"]).current_dir(here).status() {
        Ok(status) => assert!(status.success(), "no Python"),
        Err(_) => eprintln!("note: no python3 here; the script was not parsed"),
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = root.join("target/blender/bin/python3");
    if !python.exists() {
        eprintln!("note: no bpy in target/blender; Blender was not asked");
        return;
    }
    let run = |arguments: &[&str]| {
        let status = program().current_dir(here).args(arguments).arg("--quiet").status();
        assert!(status.expect("starts").success(), "{arguments:?}");
    };
    let scene = fixture("trained/lego64/fine_last.tar").display().to_string();
    let cameras = fixture("trained/lego64/transforms_test.json").display().to_string();
    run(&["bake", &scene, "--stepsize", "0.5", "-o", "a.mipvog"]);
    run(&["export", "a.mipvog", "-o", "a.vdb"]);
    run(&["render", "a.mipvog", "--cameras", &cameras, "--frames", "0", "--size", "64", "-o", "."]);
    let output = Command::new(&python)
        .arg(root.join("tests/blender/check.py"))
        .args(["script.py", "a.vdb", &cameras, "r_0.s1.png"])
        .current_dir(here)
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .expect("Python starts");
    let printed = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{printed}{errors}");
    let psnr = printed.lines().rev().find_map(|line| line.trim().parse::<f64>().ok());
    // As the report of the export says: linear light and softer surfaces.
    assert!(psnr.is_some_and(|psnr| psnr > 21.0), "{printed}");
}
