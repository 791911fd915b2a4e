//! Limits and cut containers on the command line.

use crate::common::{assert_schema, fixture, folder, open_bytes, program};

#[test]
fn limits_are_set_on_the_command_line() {
    let folder = folder();
    let run = |arguments: &[&str]| {
        let mut command = program();
        let output = command.current_dir(folder.path()).args(arguments).output().expect("starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let scene = fixture("trained/dvgo/flat.safetensors").display().to_string();
    let container = fixture("baked/dvgo.mask.mipvog").display().to_string();
    for (verb, file, output) in
        [("bake", &scene, "x.mipvog"), ("unpack", &container, "x.safetensors")]
    {
        let arguments = [verb, file.as_str(), "-o", output];
        let (code, message) = run(&[&arguments[..], &["--limit", "nodes=314"]].concat());
        assert!(code == Some(6) && message.contains("raise --limit"), "{message}");
        assert!(!folder.path().join(output).exists());
    }
    let (code, message) = run(&["unpack", &container, "-o", "x.npz", "--limit", "memory=100"]);
    assert!(code == Some(6) && message.contains("raise --limit"), "{message}");
    let (code, _) = run(&["unpack", &container, "-o", "x.npz", "--limit", "memory=1000000"]);
    assert_eq!(code, Some(0));
    for wrong in ["size=3", "nodes", "nodes=many"] {
        let (code, message) = run(&["inspect", &container, "--limit", wrong]);
        assert!(code == Some(2) && message.contains("expected"), "{message}");
    }
}

#[test]
fn prefixes_are_inspected_and_rendered_and_else_refused() {
    let folder = folder();
    let here = folder.path();
    let bytes = std::fs::read(fixture("baked/tiny.rate.mipvog")).expect("a golden file");
    let whole = open_bytes(&bytes).expect("valid");
    let levels = whole.metadata().levels.len();
    let own = whole.entries().iter().filter(|entry| entry.level == Some(1));
    let prefix = own.map(|entry| entry.prefix).max().expect("a level");
    std::fs::write(here.join("cut.mipvog"), &bytes[..prefix as usize]).expect("writable");
    let run = |arguments: &[&str]| {
        let output = program().current_dir(here).args(arguments).output().expect("starts");
        (output.status.code(), output.stdout, String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, report, message) = run(&["inspect", "cut.mipvog", "--format", "json"]);
    assert_eq!(code, Some(0), "{message}");
    let report: serde_json::Value = serde_json::from_slice(&report).expect("a report");
    assert_schema("inspect", &report);
    assert_eq!(report["levels_missing"], serde_json::json!([0]));
    let view = ["--turntable", "1", "--size", "8x8", "-o", "pictures"];
    let (code, _, message) = run(&[&["render", "cut.mipvog"][..], &view].concat());
    assert_eq!(code, Some(0), "{message}");
    assert!(message.contains(&format!("the finest 1 of {levels} levels are missing")), "{message}");
    for refused in
        [&["validate", "cut.mipvog"][..], &["unpack", "cut.mipvog", "-o", "x.safetensors"]]
    {
        assert_ne!(run(refused).0, Some(0), "{refused:?}");
    }
}
