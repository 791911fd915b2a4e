//! The program as users and pipelines see it: reports, exit codes, files.

use std::path::Path;
use std::process::Output;

use crate::common::{assert_schema, fixture, folder, program};
use serde_json::Value;

/// Runs the program in `folder`.
pub fn run(folder: &Path, arguments: &[&str]) -> Output {
    program().current_dir(folder).args(arguments).output().expect("starts")
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs the program, which must succeed, and holds its report to the verb's schema.
pub fn report(folder: &Path, arguments: &[&str]) -> Value {
    let output = run(folder, &[arguments, &["--format", "json"]].concat());
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    against_schema(arguments[0], &output.stdout)
}

pub fn against_schema(verb: &str, stdout: &[u8]) -> Value {
    let report: Value = serde_json::from_slice(stdout).expect("one JSON document");
    assert_schema(verb, &report);
    report
}

/// Runs the program, which must fail with this code and say each of these things.
pub fn refused(folder: &Path, arguments: &[&str], code: i32, says: &[&str]) {
    let before = entries(folder);
    let output = run(folder, arguments);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
    for part in says {
        assert!(message.contains(part), "{arguments:?}: no {part:?} in {message}");
    }
    assert!(!message.contains("panicked"), "{message}");
    assert_eq!(entries(folder), before, "{arguments:?} left something behind");
}

pub fn entries(folder: &Path) -> Vec<std::ffi::OsString> {
    let mut names: Vec<_> =
        std::fs::read_dir(folder).expect("a folder").flatten().map(|e| e.file_name()).collect();
    names.sort();
    names
}

pub fn scene() -> String {
    fixture("trained/lego64/fine_last.tar").display().to_string()
}

#[test]
fn a_trained_scene_bakes_end_to_end() {
    let folder = folder();
    let here = folder.path();
    let bake = report(here, &["bake", &scene(), "-o", "lego.mipvog", "--preset", "faithful"]);
    let bytes = std::fs::metadata(here.join("lego.mipvog")).expect("written").len();
    assert_eq!(bake["output_bytes"], bytes);
    let inspect = report(here, &["inspect", "lego.mipvog"]);
    assert_eq!(
        (&inspect["file_bytes"], &inspect["levels"]),
        (&bake["output_bytes"], &bake["levels"])
    );
    assert_eq!(inspect["mlp"], serde_json::json!([34, 16, 16, 3]));
    assert_eq!(inspect["version"], serde_json::json!([1, 0]));
    let validate = report(here, &["validate", "lego.mipvog"]);
    assert_eq!(validate["valid"], true);
    report(here, &["unpack", "lego.mipvog", "-o", "lego.safetensors"]);
    report(here, &["bake", "lego.safetensors", "-o", "again.mipvog"]);
    let read = |name: &str| std::fs::read(here.join(name)).expect("written");
    assert!(read("lego.mipvog") == read("again.mipvog"));
    // A setting that the container has already is no change.
    report(here, &["bake", "lego.safetensors", "-o", "third.mipvog", "--preset", "faithful"]);
    assert!(read("lego.mipvog") == read("third.mipvog"));
    let deeper = ["--bits", "12", "--background", "0"];
    report(here, &[&["bake", "lego.safetensors", "-o", "deep.mipvog"], &deeper[..]].concat());
    let deep = report(here, &["inspect", "deep.mipvog"]);
    assert_eq!(deep["metadata"]["levels"][0]["diffuse"]["bits"], 12);
    report(here, &["bake", "lego.safetensors", "-o", "paper.mipvog", "--filter", "paper"]);
    assert_eq!(report(here, &["inspect", "paper.mipvog"])["metadata"]["filter"], "paper");
    let checkpoint = report(here, &["inspect", &scene()]);
    assert_eq!(checkpoint["scene"]["dimensions"], serde_json::json!([64, 64, 64]));
}

#[test]
fn every_kind_of_input_can_be_inspected() {
    let folder = folder();
    for name in
        ["tiny/fine_last.tar", "dvgo/flat.npz", "dvgo/flat.safetensors", "dvgo/protocol4.tar"]
    {
        let path = fixture("trained").join(name).display().to_string();
        let report = report(folder.path(), &["inspect", &path]);
        assert!(report["problem"].is_null(), "{name}: {}", report["problem"]);
    }
}

#[test]
fn coarser_levels_come_first_and_prefixes_grow() {
    let folder = folder();
    let here = folder.path();
    report(here, &["bake", &scene(), "-o", "a.mipvog", "--filter", "paper"]);
    let inspect = report(here, &["inspect", "a.mipvog"]);
    let levels = inspect["levels"].as_array().expect("levels");
    let prefixes: Vec<u64> =
        levels.iter().map(|l| l["prefix_bytes"].as_u64().expect("bytes")).collect();
    assert!(prefixes.is_sorted_by(|fine, coarse| fine > coarse), "{prefixes:?}");
    assert_eq!(Some(prefixes[0]), inspect["file_bytes"].as_u64());
}

#[test]
fn damage_is_found_and_told() {
    let folder = folder();
    let here = folder.path();
    let mut bytes = std::fs::read(fixture("baked/tiny.code.mipvog")).expect("a fixture");
    let last = bytes.len() - 3000;
    bytes[last] ^= 4;
    std::fs::write(here.join("bad.mipvog"), &bytes).expect("writable");
    let output = run(here, &["validate", "bad.mipvog", "--format", "json"]);
    assert_eq!(output.status.code(), Some(1));
    let report = against_schema("validate", &output.stdout);
    assert_eq!(report["valid"], false);
    assert_eq!(report["findings"][0]["code"], "chunk-checksum");
    refused(
        here,
        &["unpack", "bad.mipvog", "-o", "x.safetensors"],
        3,
        &["bad.mipvog", "checksum", "help:"],
    );
}

#[test]
fn inputs_are_validated_and_findings_told_in_every_form() {
    let folder = folder();
    let here = folder.path();
    let health = &report(here, &["validate", &scene(), "--stepsize", "0.5"])["health"];
    assert_eq!(health["nodes"], 64 * 64 * 64);
    let inspected = report(here, &["inspect", &scene()]);
    let channels = inspected["scene"]["channels"].as_u64().expect("a number") as usize;
    assert_eq!(health["channels"].as_array().map(Vec::len), Some(1 + channels));
    // An unpacked container is an input too.
    let container = fixture("baked/tiny.paper.mipvog").display().to_string();
    report(here, &["unpack", &container, "-o", "x.safetensors"]);
    assert_eq!(report(here, &["validate", "x.safetensors"])["findings"], serde_json::json!([]));
    let broken = fixture("broken/values-nonfinite.safetensors").display().to_string();
    let validate = ["validate", &broken, "--stepsize", "0.5", "--format"];
    let output = run(here, &[&validate[..], &["json"]].concat());
    assert_eq!(output.status.code(), Some(1));
    let report = against_schema("validate", &output.stdout);
    assert_eq!((&report["valid"], &report["health"]["nonfinite"]), (&false.into(), &1.into()));
    let output = run(here, &[&validate[..], &["sarif"]].concat());
    assert_eq!(output.status.code(), Some(1));
    let log: Value = serde_json::from_slice(&output.stdout).expect("one JSON document");
    assert_eq!(log["runs"][0]["results"][0]["ruleId"], "values-nonfinite");
    let output = run(here, &[&validate[..], &["text", "--max-findings", "0"]].concat());
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains("1 finding more") && text.contains("not valid"), "{text}");
    // Errors that are not listed count.
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(message.contains("not valid: 1 error\n"), "{message}");
    let help = String::from_utf8_lossy(&run(here, &["-h"]).stdout).into_owned();
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(help.contains("or sarif for the findings of validate"), "{help}");
    refused(here, &["inspect", &scene(), "--format", "sarif"], 2, &["sarif", "validate"]);
}

#[test]
fn bad_inputs_have_their_exit_codes() {
    let folder = folder();
    let here = folder.path();
    std::fs::write(here.join("empty"), b"").expect("writable");
    std::fs::write(here.join("notes.txt"), b"just some text").expect("writable");
    std::fs::create_dir(here.join("sub")).expect("writable");
    std::fs::write(here.join("taken.mipvog"), b"mine").expect("writable");
    let hostile = |name: &str| fixture("trained/hostile").join(name).display().to_string();
    let out = ["-o", "x.mipvog"];
    let bake = |input: &str| -> Vec<String> {
        ["bake", input].into_iter().chain(out).map(str::to_owned).collect()
    };
    for (input, code, says) in [
        ("empty".to_owned(), 3, "empty"),
        ("notes.txt".to_owned(), 3, "text"),
        ("missing".to_owned(), 5, "missing"),
        ("sub".to_owned(), 5, "sub"),
        (hostile("os_system.tar"), 4, "os.system"),
        (hostile("bomb.tar"), 6, "bomb.tar"),
        (hostile("huge_shape.tar"), 3, "huge_shape.tar"),
    ] {
        let arguments = bake(&input);
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        refused(here, &arguments, code, &[says, "error:", "help:"]);
    }
    refused(here, &["bake", &scene(), "-o", "taken.mipvog"], 7, &["taken.mipvog", "--force"]);
    assert_eq!(std::fs::read(here.join("taken.mipvog")).expect("kept"), b"mine");
    // Folders that were made for an output go with it.
    refused(here, &["bake", "notes.txt", "-o", "new/folder/x.mipvog"], 3, &["notes.txt"]);
    refused(here, &["bake", &scene(), "-o", "sub"], 5, &["sub"]);
    refused(here, &["bake", &scene(), "-o", "x.mipvog", "--bits", "3"], 2, &["--bits"]);
    refused(
        here,
        &["bake", &scene(), "-o", "x.mipvog", "--block-size", "65"],
        2,
        &["--block-size"],
    );
    refused(here, &["bake", &scene(), "-o", "x.mipvog", "--filter", "sharp"], 2, &["mean5"]);
    refused(here, &["frobnicate"], 2, &["frobnicate"]);
    refused(here, &["inspect", "notes.txt"], 3, &["notes.txt"]);
}

#[test]
fn slices_are_written_to_folders() {
    let folder = folder();
    let here = folder.path();
    let tiny = fixture("baked/dvgo.mask.mipvog").display().to_string();
    report(here, &["unpack", &tiny, "-o", "exr/", "--levels", "1"]);
    report(here, &["unpack", &tiny, "-o", "png/", "--slices", "png"]);
    // Levels of 9 x 7 x 5 nodes: 9 planes, then 4.
    assert_eq!(entries(&here.join("exr")).len(), 4);
    assert_eq!(entries(&here.join("png")).len(), 2 * (9 + 4));
    let exr = std::fs::read(here.join("exr/level1.x0000.exr")).expect("written");
    assert_eq!(exr[..4], [0x76, 0x2f, 0x31, 0x01]);
    let picture = std::fs::read(here.join("png/level0.diffuse.x0003.png")).expect("written");
    assert!(picture.starts_with(b"\x89PNG"));
}

#[test]
fn completions_and_the_manual_print() {
    let folder = folder();
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let output = run(folder.path(), &["completions", shell]);
        assert!(output.status.success() && output.stdout.len() > 500, "{shell}");
    }
    let output = run(folder.path(), &["man"]);
    assert!(String::from_utf8_lossy(&output.stdout).contains("alpha\\-threshold"));
}

#[test]
#[cfg(unix)]
fn pipes_devices_and_odd_names_are_no_trap() {
    use std::os::unix::ffi::OsStrExt;
    use std::process::Command;

    let folder = folder();
    let here = folder.path();
    let fifo = Command::new("mkfifo").arg(here.join("pipe")).status().expect("mkfifo");
    assert!(fifo.success());
    refused(here, &["inspect", "pipe"], 5, &["pipe", "regular"]);
    refused(here, &["bake", "/dev/null", "-o", "x.mipvog"], 5, &["/dev/null"]);
    refused(here, &["bake", &scene(), "-o", "pipe", "--force"], 5, &["pipe"]);
    refused(here, &["validate", "pipe", "--threads", "100000"], 2, &["--threads"]);
    let odd = std::ffi::OsStr::from_bytes(b"odd\xff.mipvog");
    let mut bake = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"));
    let bake = bake.current_dir(here).args(["bake", &scene(), "-o"]).arg(odd);
    // The warnings have no reader either.
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").expect("a full device");
    let status = bake.stdout(std::process::Stdio::null()).stderr(full).status().expect("starts");
    assert!(status.success() && here.join(odd).is_file());
}

#[test]
fn fields_are_rendered_and_compared() {
    let folder = folder();
    let here = folder.path();
    let cameras = fixture("trained/lego64/transforms_test.json").display().to_string();
    let view = ["--cameras", &cameras, "--size", "48x48", "--frames", "0,r_50"];
    let scene_options = ["--stepsize", "0.5", "--near", "2", "--far", "6"];
    report(
        here,
        &[&["bake", &scene(), "-o", "a.mipvog", "--levels", "1"], &scene_options[..]].concat(),
    );
    let more = ["--scales", "1,2", "--exr", "--sheet"];
    let render = report(here, &[&["render", "a.mipvog", "-o", "out"], &view[..], &more].concat());
    assert_eq!(render["frames"].as_array().map(Vec::len), Some(4));
    let name = render["frames"][0]["frame"].as_str().expect("a name");
    for file in ["s1.png", "s2.png", "s1.exr", "s2.exr", "sheet.png"] {
        assert!(here.join("out").join(format!("{name}.{file}")).is_file(), "{file}");
    }
    refused(here, &[&["render", "a.mipvog", "-o", "out"], &view[..]].concat(), 7, &["--force"]);
    let scene = scene();
    let compared =
        [&["compare", &scene, "a.mipvog", "--scales", "1,2"], &view[..], &scene_options].concat();
    let compare = report(here, &compared);
    let psnr = |scale: usize| compare["scales"][scale]["psnr"].as_f64().expect("a number");
    // One level: at full size only the bits differ, at half size one ray stands for four.
    assert!(psnr(0) > 50.0 && (15.0..40.0).contains(&psnr(1)), "{compare}");
    let turn = ["--turntable", "2", "--size", "16x16"];
    report(here, &[&["render", &scene, "-o", "turn"], &turn[..], &scene_options].concat());
}

#[test]
fn cameras_that_cannot_be_are_refused() {
    let folder = folder();
    let here = folder.path();
    let frame = |matrix: &str| format!(r#"{{"file_path":"a","transform_matrix":{matrix}}}"#);
    let identity = "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";
    let cases = [
        ("empty frames", r#"{"camera_angle_x":0.7,"frames":[]}"#.to_owned(), "frames"),
        ("no lens", format!(r#"{{"frames":[{}]}}"#, frame(identity)), "focal"),
        ("no focal length", format!(r#"{{"fl_x":0,"frames":[{}]}}"#, frame(identity)), "focal"),
        (
            "flat",
            format!(
                r#"{{"fl_x":9,"frames":[{}]}}"#,
                frame("[[0,0,0,0],[0,0,0,0],[0,0,0,0],[0,0,0,1]]")
            ),
            "determinant",
        ),
        (
            "not finite",
            format!(
                r#"{{"fl_x":9,"frames":[{}]}}"#,
                frame("[[1e999,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]")
            ),
            "cameras.json",
        ),
        (
            "short matrix",
            format!(r#"{{"fl_x":9,"frames":[{}]}}"#, frame("[[1,0,0,0]]")),
            "cameras.json",
        ),
        ("huge", format!(r#"{{"fl_x":9,"w":1e6,"h":2,"frames":[{}]}}"#, frame(identity)), "pixels"),
        ("no JSON", "cameras".to_owned(), "cameras.json"),
    ];
    let field = fixture("baked/tiny.code.mipvog").display().to_string();
    for (case, text, says) in cases {
        std::fs::write(here.join("cameras.json"), text).expect("writable");
        let code = if case == "huge" { 6 } else { 3 };
        refused(here, &["render", &field, "--cameras", "cameras.json", "-o", "out"], code, &[says]);
    }
    // Inside the box, looking at nothing in particular: a picture, no error.
    let inside = "[[1,0,0,0],[0,1,0,0],[0,0,1,0.1],[0,0,0,1]]";
    let text = format!(r#"{{"fl_x":9,"w":8,"h":8,"frames":[{}]}}"#, frame(inside));
    std::fs::write(here.join("cameras.json"), text).expect("writable");
    report(here, &["render", &field, "--cameras", "cameras.json", "-o", "out"]);
    let missing = ["--cameras", "cameras.json", "--scales", "1"];
    std::fs::create_dir(here.join("pictures")).expect("writable");
    refused(here, &[&["compare", "pictures", &field], &missing[..]].concat(), 5, &["a.png"]);
    std::fs::copy(here.join("out/a.s1.png"), here.join("pictures/a.png")).expect("copied");
    report(here, &[&["compare", "pictures", &field], &missing[..]].concat());
    let other = [&["compare", "pictures", &field, "--size", "5x5"], &missing[..]].concat();
    refused(here, &other, 2, &["--size"]);
}

#[test]
fn every_reader_of_a_verb_keeps_to_the_limits() {
    let folder = folder();
    let here = folder.path();
    let tiny = fixture("baked/dvgo.mask.mipvog").display().to_string();
    std::fs::copy(&tiny, here.join("tiny.mipvog")).expect("copied");
    let cameras = format!(
        r#"{{"camera_angle_x": 0.7, "frames": [{{"file_path": "a",
        "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}}]}}{}"#,
        " ".repeat(1 << 20)
    );
    std::fs::write(here.join("cameras.json"), cameras).expect("writable");
    let scene = scene();
    let from = ["--cameras", "cameras.json", "--size", "8x8"];
    let bake = ["bake", &scene, "-o", "x.mipvog"];
    let text = ["--limit", "header-bytes=1000000"];
    for verb in [
        &["render", "tiny.mipvog", "-o", "out"][..],
        &["compare", "tiny.mipvog", "tiny.mipvog"],
        &["sweep", &scene, "-o", "out"],
        &bake,
    ] {
        refused(here, &[verb, &from, &text].concat(), 6, &["cameras.json", "1000000"]);
    }
    let fit = ["--filter", "fit", "--fit-cameras", "cameras.json"];
    refused(here, &[&bake[..], &fit, &text].concat(), 6, &["cameras.json"]);
    // More chunks than the container has that the gate and the mesh read back.
    let chunks = ["--limit", "chunks=3"];
    let turntable = ["--turntable", "1", "--size", "8x8"];
    refused(here, &[&bake[..], &turntable, &chunks].concat(), 6, &["chunks", "3"]);
    refused(here, &[&bake[..], &["--gltf", "x.glb"], &chunks].concat(), 6, &["chunks", "3"]);
    let swept = run(here, &[&["sweep", &scene, "-o", "out"], &turntable[..], &chunks].concat());
    assert_eq!(swept.status.code(), Some(1), "{}", stderr(&swept));
    report(here, &bake);
    let again = [&bake[..], &["--if-changed"]].concat();
    assert_eq!(report(here, &again)["unchanged"], true);
    assert_ne!(report(here, &[&again[..], &chunks].concat())["unchanged"], true);
    // A picture of 3 MB beside a container of a few kilobytes.
    let picture = ["render", "tiny.mipvog", "-o", "pictures", "--turntable", "1"];
    report(here, &picture);
    let memory = ["--turntable", "1", "--scales", "1", "--limit", "memory=1000000"];
    let name = &entries(&here.join("pictures"))[0];
    let plain = name.to_string_lossy().replace(".s1.png", ".png");
    std::fs::rename(here.join("pictures").join(name), here.join("pictures").join(plain))
        .expect("renamed");
    let compare = ["compare", "pictures", "tiny.mipvog"];
    refused(here, &[&compare[..], &memory].concat(), 6, &["1000000"]);
}
