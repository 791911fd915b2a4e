//! The program as users and pipelines see it: reports, exit codes, files.

use std::path::Path;
use std::process::Output;

use crate::common::{assert_schema, fixture, folder, program};
use serde_json::Value;

/// Runs the program in `folder`.
fn run(folder: &Path, arguments: &[&str]) -> Output {
    program().current_dir(folder).args(arguments).output().expect("starts")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs the program, which must succeed, and holds its report to the verb's schema.
fn report(folder: &Path, arguments: &[&str]) -> Value {
    let output = run(folder, &[arguments, &["--format", "json"]].concat());
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    against_schema(arguments[0], &output.stdout)
}

fn against_schema(verb: &str, stdout: &[u8]) -> Value {
    let report: Value = serde_json::from_slice(stdout).expect("one JSON document");
    assert_schema(verb, &report);
    report
}

/// Runs the program, which must fail with this code and say each of these things.
fn refused(folder: &Path, arguments: &[&str], code: i32, says: &[&str]) {
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

fn entries(folder: &Path) -> Vec<std::ffi::OsString> {
    let mut names: Vec<_> =
        std::fs::read_dir(folder).expect("a folder").flatten().map(|e| e.file_name()).collect();
    names.sort();
    names
}

fn scene() -> String {
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
    assert!(text.contains("truncated: 1 ") && text.contains("not valid"), "{text}");
    // Errors that are not listed count.
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(message.contains("not valid: 1 error\n"), "{message}");
    let help = String::from_utf8_lossy(&run(here, &["bake", "-h"]).stdout).into_owned();
    assert!(help.contains("sarif is for the findings of validate only"), "{help}");
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
fn an_option_on_an_unpacked_container_leaves_the_others_as_they_are() {
    let folder = folder();
    let here = folder.path();
    let shape = ["--filter", "paper", "--bits", "12", "--alpha-threshold", "0.01"];
    report(here, &[&["bake", &scene(), "-o", "a.mipvog"], &shape[..]].concat());
    report(here, &["unpack", "a.mipvog", "-o", "a.safetensors"]);
    report(here, &["bake", "a.safetensors", "-o", "b.mipvog", "--block-size", "4"]);
    let metadata = report(here, &["inspect", "b.mipvog"])["metadata"].clone();
    assert_eq!(metadata["filter"], "paper");
    assert_eq!(metadata["levels"][0]["density"]["bits"], 12);
    assert_eq!(metadata["levels"][0]["block_size"], 4);
    for bad in [["--near", "nan"], ["--background", "inf"], ["--color-threshold", "2"]] {
        refused(
            here,
            &[&["bake", "a.safetensors", "-o", "x.mipvog"], &bad[..]].concat(),
            2,
            &[bad[0]],
        );
    }
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
fn a_missed_gate_writes_nothing() {
    let folder = folder();
    let here = folder.path();
    let cameras = fixture("trained/lego64/transforms_test.json").display().to_string();
    let scene = scene();
    let bake = ["bake", &scene, "-o", "a.mipvog", "--stepsize", "0.5"];
    let view = ["--cameras", &cameras, "--size", "32x32", "--frames", "0"];
    let gate = |least| [&bake[..], &view, &["--require-psnr", least]].concat();
    let missed = run(here, &[&gate("90")[..], &["--format", "json"]].concat());
    assert_eq!(missed.status.code(), Some(1), "{}", stderr(&missed));
    let quality = &against_schema("bake", &missed.stdout)["quality"];
    assert_eq!(quality["passed"], false);
    assert!(entries(here).is_empty());
    let passed = report(here, &gate("10"));
    assert_eq!(passed["quality"]["passed"], true);
    assert_eq!(passed["quality"]["errors"].as_array().map(Vec::len), Some(4));
    assert!(here.join("a.mipvog").is_file());
    // Cameras alone measure without a gate; a gate needs cameras, and a trained input.
    assert!(report(here, &[&bake[..], &view, &["--force"]].concat())["quality"]["passed"] == true);
    refused(here, &[&bake[..], &["--require-psnr", "3"]].concat(), 2, &["--cameras"]);
    report(here, &["unpack", "a.mipvog", "-o", "a.safetensors"]);
    let again = ["bake", "a.safetensors", "-o", "b.mipvog", "--turntable", "2"];
    refused(here, &again, 2, &["trained input"]);
}

#[test]
fn a_quality_stands_for_other_options() {
    let folder = folder();
    let here = folder.path();
    let scene = scene();
    let bake =
        |out: &'static str| ["bake", &scene, "-o", out, "--stepsize", "0.5"].map(str::to_owned);
    let baked = |out: &'static str, options: &[&str]| {
        let arguments = bake(out);
        let own: Vec<&str> =
            arguments.iter().map(String::as_str).chain(options.iter().copied()).collect();
        report(here, &own)
    };
    let bytes = |name: &str| std::fs::read(here.join(name)).expect("a container");
    baked("web.mipvog", &["--preset", "web"]);
    baked("75.mipvog", &["--quality", "75"]);
    assert!(bytes("web.mipvog") == bytes("75.mipvog"));
    baked("50.mipvog", &["--quality", "50"]);
    assert!(bytes("50.mipvog").len() < bytes("75.mipvog").len());
    // Cameras are used, and an option that is given counts.
    let view = ["--turntable", "2", "--size", "16x16", "--quality", "50"];
    let seen = baked("seen.mipvog", &[&view[..], &["--coarseness", "3"]].concat());
    let option = |name: &str| seen["options"][name].as_f64().expect("a number");
    let found = ["min_weight", "fill_error", "coarseness"].map(option);
    assert_eq!(found, [0.002f32, 0.5, 3.0].map(f64::from));
    assert!(bytes("seen.mipvog").len() < bytes("50.mipvog").len());
    // A container takes it too; it does not know any more what viewers nearby see.
    report(here, &["bake", "75.mipvog", "-o", "again.mipvog", "--quality", "25"]);
    assert!(bytes("again.mipvog").len() < bytes("75.mipvog").len());
    for more in [["--bits", "8"], ["--max-error", "0.1"], ["--max-bytes", "1MB"]] {
        let arguments =
            [&["bake", &scene, "-o", "no.mipvog", "--quality", "50"][..], &more].concat();
        refused(here, &arguments, 2, &["--quality"]);
    }
    let wrong = ["bake", &scene, "-o", "no.mipvog", "--quality", "0"];
    refused(here, &wrong, 2, &["1 to 100"]);
}

#[test]
fn an_error_instead_of_bits_is_kept_and_told() {
    let folder = folder();
    let here = folder.path();
    let scene = scene();
    let bake = |more: &[&str]| report(here, &[&["bake", &scene, "--force"], more].concat());
    // Explicit options override a preset's bits.
    let lossy = bake(&["-o", "a.mipvog", "--max-error", "0.02", "--preset", "archive"]);
    assert_eq!(lossy["options"]["max_error"].as_f64(), Some(f64::from(0.02f32)));
    assert!(lossy["options"]["bits"].is_null());
    let groups = |report: &Value| -> Vec<Value> {
        let levels = report["levels"].as_array().expect("levels");
        levels
            .iter()
            .flat_map(|level| level["groups"].as_array().expect("groups"))
            .cloned()
            .collect()
    };
    for group in groups(&lossy) {
        assert!(group["max_error"].as_f64() <= Some(0.02f32.into()), "{group}");
        assert!(group["bits"].as_str().expect("bits").parse().is_ok_and(|bits: u32| bits <= 8));
    }
    assert!(lossy["stages"].as_array().expect("stages").iter().any(|s| s["name"] == "ranges"));
    let usual = bake(&["-o", "b.mipvog"]);
    assert!(usual["options"].get("max_error").is_none());
    assert!(lossy["output_bytes"].as_u64() < usual["output_bytes"].as_u64());

    // People see the same with three digits, none too few.
    let text = run(here, &["inspect", "b.mipvog"]);
    let text = String::from_utf8_lossy(&text.stdout).into_owned();
    let cells: Vec<&str> = text.split(" bit ").skip(1).collect();
    assert_eq!(cells.len(), groups(&usual).len(), "{text}");
    for (cell, group) in cells.into_iter().zip(groups(&usual)) {
        let shown = cell.split_whitespace().next().and_then(|shown| shown.parse::<f64>().ok());
        let (shown, error) = (shown.expect("a number"), group["max_error"].as_f64().expect("one"));
        assert!((error..error * 1.01).contains(&shown), "{shown} for {error}");
    }

    // An unpacked container keeps its error where it is baked anew, unless bits are asked for.
    report(here, &["unpack", "a.mipvog", "-o", "a.safetensors"]);
    let again = |more: &[&str]| {
        report(here, &[&["bake", "a.safetensors", "-o", "c.mipvog", "--force"], more].concat())
    };
    let same = again(&[]);
    assert_eq!((&same["output_bytes"], groups(&same)), (&lossy["output_bytes"], groups(&lossy)));
    assert_eq!(
        again(&["--block-size", "4"])["options"]["max_error"],
        lossy["options"]["max_error"]
    );
    let deep = again(&["--block-size", "4", "--bits", "12"]);
    assert!(deep["options"].get("max_error").is_none());
    assert_eq!(deep["levels"][0]["groups"][0]["bits"], "12");
    let coarse = again(&["--max-error", "0.1"]);
    assert!(coarse["output_bytes"].as_u64() < lossy["output_bytes"].as_u64());
    // Errors add up: those of the first bake are still there.
    for (coarse, lossy) in groups(&coarse).iter().zip(groups(&lossy)) {
        let [after, before] = [coarse, &lossy].map(|g| g["max_error"].as_f64().expect("an error"));
        assert!(before <= after && after <= before + 0.1 + 1e-6, "{coarse}");
    }

    // One error for each group.
    let apart = bake(&["-o", "d.mipvog", "--max-error", "0.02:0.01:0.06"]);
    assert_eq!(apart["options"]["max_error"], "0.02:0.01:0.06");
    for group in groups(&apart) {
        let most = match group["group"].as_str() {
            Some("density" | "anisotropy") => Some(0.02),
            Some("diffuse" | "directional") => Some(0.01),
            Some("features") => Some(0.06),
            _ => None,
        };
        assert!(group["max_error"].as_f64() <= most.map(|most: f32| most.into()), "{group}");
    }
    report(here, &["unpack", "d.mipvog", "-o", "a.safetensors", "--force"]);
    assert_eq!(again(&["--block-size", "4"])["options"]["max_error"], "0.02:0.01:0.06");

    let bad = ["bake", &scene, "-o", "x.mipvog", "--max-error"];
    refused(here, &[&bad[..], &["0.1:0.2"]].concat(), 2, &["--max-error", "colons"]);
    for error in ["0", "0.5", "nan", "1e-7", "0.01:0.5:0.01"] {
        refused(here, &[&bad[..], &[error]].concat(), 2, &["--max-error", "1e-6 to 0.25"]);
    }
    refused(here, &[&bad[..], &["0.01", "--bits", "8"]].concat(), 2, &["--bits", "--max-error"]);
}

#[test]
fn settings_are_swept_and_resumed() {
    let folder = folder();
    let here = folder.path();
    let tiny = fixture("trained/tiny/fine_last.tar").display().to_string();
    let view = ["--turntable", "2", "--size", "16x16", "--scales", "1,4"];
    let lists = ["--bits", "6,f16", "--filter", "code,mean3", "--preset", "web", "-o", "out"];
    let arguments = [&["sweep", &tiny], &view[..], &lists].concat();
    let first = report(here, &arguments);
    let settings = first["settings"].as_array().expect("settings");
    assert_eq!(settings.len(), 5);
    assert_eq!(settings[4]["preset"], "web");
    for setting in settings {
        let file = here.join("out").join(setting["file"].as_str().expect("a name"));
        let bytes = std::fs::metadata(file).expect("baked").len();
        assert_eq!((&setting["output_bytes"], &setting["resumed"]), (&bytes.into(), &false.into()));
        // The first thing that the front must have is the smallest.
        let smallest = settings.iter().all(|other| other["output_bytes"].as_u64() >= Some(bytes));
        assert!(!smallest || setting["fronts"][0]["bytes"] == true, "{setting}");
    }
    let again = report(here, &arguments);
    assert!(again["settings"].as_array().expect("settings").iter().all(|s| s["resumed"] == true));
    let text = run(here, &arguments);
    let text = String::from_utf8_lossy(&text.stdout).into_owned();
    assert!(text.contains("code-6bit-t1e-3-b8-z1 ") && text.contains("*"), "{text}");
    assert!(text.contains("5 of 5 settings were finished before"), "{text}");

    let bad = |more: &[&str], code: i32, says: &str| {
        let arguments = [&["sweep", &tiny, "-o", "new"], &view[..], more].concat();
        refused(here, &arguments, code, &[says]);
    };
    bad(&["--bits", "8,3"], 2, "--bits");
    bad(&["--max-error", "0.01,1"], 2, "--max-error");
    bad(&["--filter", "code,sharp"], 2, "mean5");
    bad(&["--alpha-threshold", "1e-3,2"], 2, "--alpha-threshold");
    bad(&["--scales", "99"], 2, "--scales");
    bad(&["--repeat", "0"], 2, "--repeat");
    report(here, &["bake", &tiny, "-o", "a.mipvog"]);
    report(here, &["unpack", "a.mipvog", "-o", "a.safetensors"]);
    let unpacked = [&["sweep", "a.safetensors", "-o", "new"], &view[..]].concat();
    refused(here, &unpacked, 2, &["a.safetensors", "trained"]);
    std::fs::create_dir(here.join("new")).expect("writable");
    std::fs::write(here.join("new/sweep.csv"), "mine").expect("writable");
    bad(&[], 7, "sweep.csv");
    assert_eq!(entries(&here.join("new")), ["sweep.csv"]);

    // An input that cannot be rendered has nothing to compare with: no setting's fault, and nothing
    // is written.
    let mut bytes = std::fs::read(fixture("trained/dvgo/flat.safetensors")).expect("a fixture");
    let header = usize::from(u16::from_le_bytes([bytes[0], bytes[1]]));
    let density = 8 + header + 44..8 + header + 1304;
    bytes[density].as_chunks_mut().0.fill(f32::NAN.to_le_bytes());
    std::fs::write(here.join("nan.safetensors"), bytes).expect("writable");
    let nan = [&["sweep", "nan.safetensors", "-o", "nan"], &view[..]].concat();
    refused(here, &nan, 3, &["nan.safetensors", "not finite"]);
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

#[test]
fn no_option_of_a_bake_is_ignored() {
    let folder = folder();
    let here = folder.path();
    let tiny = fixture("baked/tiny.rate.filled.mipvog").display().to_string();
    report(here, &["unpack", &tiny, "-o", "a.safetensors"]);
    let bake = ["bake", "a.safetensors", "-o", "x.mipvog"];
    let refuse = |options: &[&str]| {
        refused(here, &[&bake[..], options].concat(), 2, &[options[0]]);
    };
    refuse(&["--fill-error", "0.1"]);
    refuse(&["--nonfinite", "empty"]);
    refuse(&["--fit-steps", "3"]);
    refuse(&["--fit-seconds", "3"]);
    refuse(&["--stepsize", "0.25"]);
    refuse(&["--mlp", "none"]);
    refuse(&["--coarse", "a.safetensors"]);
    refuse(&["--memory", "1G"]);
    refuse(&["--turntable", "1"]);
    refuse(&["--size", "8x8"]);
    refuse(&["--frames", "1"]);
    refuse(&["--min-weight", "0.1"]);
    refuse(&["--coarseness", "1"]);
    refuse(&["--dry-run"]);
    // The finest level is baked anew, and the option counts.
    let anew = ["--filter", "mean3", "--nonfinite", "empty", "--fill-error", "0.1"];
    report(here, &[&bake[..], &anew].concat());
    let trained = ["bake", &scene(), "-o", "y.mipvog"];
    refused(here, &[&trained[..], &["--fit-steps", "3"]].concat(), 2, &["--fit-steps"]);
    refused(here, &[&trained[..], &["--size", "8x8"]].concat(), 2, &["--size"]);
    // Level 0 alone can be filtered again.
    report(here, &["unpack", &tiny, "-o", "b.safetensors", "--levels", "1"]);
    let coarse = ["bake", "b.safetensors", "-o", "z.mipvog", "--filter", "mean3"];
    let output = run(here, &coarse);
    assert!(!output.status.success());
}
