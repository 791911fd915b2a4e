//! Scenes that are merged into one container, and thumbnails.

use std::path::Path;
use std::process::Output;

use crate::common::{assert_schema, fixture, folder, open_bytes, program};
use mipvog::picture;
use serde_json::Value;

fn run(here: &Path, arguments: &[&str]) -> Output {
    program().current_dir(here).args(arguments).output().expect("starts")
}

/// Runs a line that must work, and returns its report.
fn report(here: &Path, line: &[&str]) -> Value {
    let output = run(here, &[line, &["--format", "json"]].concat());
    assert!(output.status.success(), "{line:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

fn refused(here: &Path, line: &[&str], code: i32, says: &str) {
    let output = run(here, line);
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{line:?}: {message}");
    assert!(message.contains(says), "{line:?}: no {says:?} in {message}");
}

/// A container, `a.mipvog`, and its checkpoint, `in.tar`.
fn workplace() -> tempfile::TempDir {
    let folder = folder();
    let here = folder.path();
    std::fs::copy(fixture("baked/tiny.rate.mipvog"), here.join("a.mipvog")).expect("copied");
    std::fs::copy(fixture("trained/tiny/fine_last.tar"), here.join("in.tar")).expect("copied");
    folder
}

#[test]
fn the_halves_of_a_scene_merge_to_that_scene() {
    let folder = workplace();
    let here = folder.path();
    for (half, crop) in [("l.mipvog", "-9,-9,-9,0,9,9"), ("r.mipvog", "0,-9,-9,9,9,9")] {
        report(here, &["transcode", "a.mipvog", "-o", half, "--crop", crop]);
    }
    let line = ["bake", "l.mipvog", "--merge", "r.mipvog", "--bits", "f16", "-o", "b.mipvog"];
    let merged = report(here, &line);
    assert_schema("bake", &merged);
    assert_eq!(merged["levels"][0]["dimensions"], serde_json::json!([32, 32, 32]));
    let line = ["compare", "a.mipvog", "b.mipvog", "--turntable", "4", "--size", "64"];
    let psnr = report(here, &line)["scales"][0]["pooled_psnr"].as_f64().expect("a number");
    // Values are rounded to half floats.
    assert!(psnr > 60.0, "{psnr}");
    let inspected = report(here, &["inspect", "b.mipvog"]);
    let others = &inspected["provenance"]["companions"];
    assert_eq!(others[0]["role"], "merged", "{others}");
}

#[test]
fn a_moved_scene_stands_beside_the_first() {
    let folder = workplace();
    let here = folder.path();
    report(here, &["transcode", "a.mipvog", "-o", "b.mipvog", "--translate", "3,0,0"]);
    let line = ["bake", "in.tar", "--stepsize", "0.5", "--merge", "b.mipvog", "-o", "c.mipvog"];
    let line = [&line[..], &["--depfile", "c.d", "--turntable", "4", "--size", "64"]].concat();
    let merged = report(here, &line);
    let quality = &merged["quality"]["errors"][0]["pooled_psnr"];
    assert!(quality.as_f64().expect("a number") > 40.0, "{quality}");
    let rule = std::fs::read_to_string(here.join("c.d")).expect("a rule");
    assert!(rule.contains("b.mipvog") && rule.contains("in.tar"), "{rule}");
    // The second scene alone, cut out of both, looks as it did.
    let crop = "1.9,-9,-9,9,9,9";
    report(here, &["transcode", "c.mipvog", "-o", "d.mipvog", "--crop", crop]);
    let line = ["compare", "b.mipvog", "d.mipvog", "--turntable", "4", "--size", "64"];
    let psnr = report(here, &line)["scales"][0]["pooled_psnr"].as_f64().expect("a number");
    // Both quantized once more, on a grid that is a share of a voxel away.
    assert!(psnr > 35.0, "{psnr}");
    // Nothing has changed; then the other scene has.
    let line = [&line_of_changes()[..], &["--if-changed"]].concat();
    assert_eq!(report(here, &line)["unchanged"], true);
    report(here, &["transcode", "a.mipvog", "-o", "b.mipvog", "--force", "--translate", "4,0,0"]);
    assert_ne!(report(here, &line)["unchanged"], true);
}

fn line_of_changes() -> [&'static str; 8] {
    ["bake", "in.tar", "--stepsize", "0.5", "--merge", "b.mipvog", "-o", "c.mipvog"]
}

#[test]
fn scenes_that_do_not_fit_are_refused_by_name() {
    let folder = workplace();
    let here = folder.path();
    report(here, &["transcode", "a.mipvog", "-o", "turned.mipvog", "--rotate", "0,0,90"]);
    let line = |other| ["bake", "a.mipvog", "--merge", other, "-o", "x.mipvog"];
    refused(here, &line("turned.mipvog"), 4, "turned.mipvog: key view dependence");
    refused(here, &line("none.mipvog"), 5, "none.mipvog");
    let world = fixture("baked/world.mipvog");
    refused(here, &line(world.to_str().expect("UTF-8")), 4, "nested boxes");
    report(here, &["transcode", "a.mipvog", "-o", "far.mipvog", "--translate", "9000,0,0"]);
    refused(here, &line("far.mipvog"), 6, "nodes of the merged field");
    let line = ["bake", "a.mipvog", "--merge", "far.mipvog", "-o", "far.mipvog", "--force"];
    refused(here, &line, 7, "--force does not replace an input");
    assert!(!here.join("x.mipvog").exists());
}

#[test]
fn thumbnails_are_put_in_and_taken_out() {
    let folder = workplace();
    let here = folder.path();
    let line = ["bake", "in.tar", "--stepsize", "0.5", "--thumbnail", "48", "-o", "b.mipvog"];
    let baked = report(here, &line);
    let length = std::fs::metadata(here.join("b.mipvog")).expect("a file").len();
    assert_eq!(baked["output_bytes"], length);
    let inspected = report(here, &["inspect", "b.mipvog", "--thumbnail", "t.png"]);
    let chunks = inspected["chunks"].as_array().expect("a list");
    let kinds: Vec<&str> = chunks.iter().filter_map(|chunk| chunk["kind"].as_str()).collect();
    // In front of the levels, so that the start of the file shows it.
    assert_eq!(kinds[..4], ["META", "VMLP", "prov", "thmb"], "{kinds:?}");
    let png = here.join("t.png");
    assert_eq!(picture::size(&png).expect("a picture"), [48, 48]);
    assert!(run(here, &["validate", "b.mipvog"]).status.success());
    // The picture is that of `render`.
    report(here, &["render", "b.mipvog", "-o", "r.png", "--size", "48", "--supersample", "2"]);
    let read = |name: &str| picture::read(&here.join(name), 1 << 20).expect("a picture").bytes;
    assert_eq!(read("t.png"), read("r.png"));
    // The rest of the file is as it is without one.
    report(here, &["bake", "in.tar", "--stepsize", "0.5", "-o", "plain.mipvog"]);
    let chunks = |name: &str| {
        let container =
            open_bytes(&std::fs::read(here.join(name)).expect("a file")).expect("sound");
        let others = container.entries().iter().filter(|entry| &entry.kind != b"thmb");
        others.map(|entry| (entry.kind, entry.level, entry.checksum)).collect::<Vec<_>>()
    };
    assert_eq!(chunks("b.mipvog"), chunks("plain.mipvog"));
    // Other bits keep it, another scene does not.
    let kept = |line: &[&str]| {
        report(here, &[&["transcode", "b.mipvog", "-o", "c.mipvog", "--force"], line].concat());
        let bytes = std::fs::read(here.join("c.mipvog")).expect("a file");
        open_bytes(&bytes).expect("sound").thumbnail().expect("sound").is_some()
    };
    assert!(kept(&["--bits", "6"]));
    assert!(!kept(&["--translate", "1,0,0"]));
    assert!(!kept(&["--drop-islands", "10"]));
    assert!(kept(&["--translate", "1,0,0", "--thumbnail", "16"]));
    // What is there counts for `--if-changed`.
    let again = [&line[..], &["--if-changed"]].concat();
    assert_eq!(report(here, &again)["unchanged"], true);
    let larger = ["bake", "in.tar", "--stepsize", "0.5", "--thumbnail", "64", "-o", "b.mipvog"];
    assert_ne!(report(here, &[&larger[..], &["--if-changed"]].concat())["unchanged"], true);
    refused(here, &["inspect", "a.mipvog", "--thumbnail", "x.png"], 3, "no thumbnail");
    refused(here, &["inspect", "b.mipvog", "--thumbnail", "t.png"], 7, "t.png");
    refused(here, &["inspect", "b.mipvog", "--thumbnail", "b.mipvog", "--force"], 7, "b.mipvog");
    refused(here, &["inspect", "in.tar", "--thumbnail", "x.png"], 3, "in.tar");
    refused(
        here,
        &["bake", "in.tar", "--thumbnail", "8", "-o", "x.mipvog"],
        2,
        "expected 16 to 1024",
    );
}
