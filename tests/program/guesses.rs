//! First guesses: what people type before they read the help works, or says what to type.

use std::path::Path;
use std::process::Output;

use crate::common::{assert_follows, assert_schema, fixture, folder, program};
use serde_json::Value;
use sha2::Digest as _;

fn run(here: &Path, arguments: &[&str]) -> Output {
    program().current_dir(here).args(arguments).output().expect("starts")
}

fn words(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a line that must work; what it prints, on both streams.
fn works(here: &Path, line: &[&str]) -> (String, String) {
    let output = run(here, line);
    assert!(output.status.success(), "{line:?}: {}", words(&output.stderr));
    (words(&output.stdout), words(&output.stderr))
}

/// Runs a line that must not work, and say each of these things.
fn teaches(here: &Path, line: &[&str], code: i32, says: &[&str]) {
    let output = run(here, line);
    let message = words(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{line:?}: {message}");
    for part in says {
        assert!(message.contains(part), "{line:?}: no {part:?} in {message}");
    }
}

/// A small scene, `in.tar`, `lego/fine_last.tar`, and its container `a.mipvog`.
fn workplace() -> tempfile::TempDir {
    let folder = folder();
    let here = folder.path();
    std::fs::create_dir(here.join("lego")).expect("writable");
    let tiny = fixture("trained/tiny/fine_last.tar");
    std::fs::copy(&tiny, here.join("in.tar")).expect("copied");
    std::fs::copy(&tiny, here.join("lego/fine_last.tar")).expect("copied");
    std::fs::copy(fixture("baked/tiny.rate.mipvog"), here.join("a.mipvog")).expect("copied");
    folder
}

const STEP: [&str; 2] = ["--stepsize", "0.5"];

#[test]
fn a_file_alone_names_the_verb() {
    let folder = workplace();
    let here = folder.path();
    let view = "mipvog-bake view a.mipvog shows it";
    teaches(here, &["a.mipvog"], 2, &["a.mipvog is a file, not a verb", view]);
    teaches(here, &["in.tar"], 2, &["mipvog-bake bake in.tar -o in.mipvog bakes it"]);
    teaches(here, &["lego"], 2, &["mipvog-bake bake lego -o lego.mipvog bakes it"]);
    let options = "--translate is an option of transcode";
    teaches(here, &["translate", "a.mipvog"], 2, &["translate is not a verb", options]);
    teaches(here, &["frobnicate"], 2, &["unrecognized subcommand 'frobnicate'"]);
}

#[test]
fn a_second_path_is_an_output() {
    let folder = workplace();
    let here = folder.path();
    let bake = "mipvog-bake bake in.tar -o out.mipvog";
    teaches(here, &["bake", "in.tar", "out.mipvog"], 2, &["pass it after -o", bake]);
    teaches(here, &["bake", "in.tar"], 2, &["mipvog-bake bake in.tar -o in.mipvog"]);
    let transcode = ["transcode", "a.mipvog", "b.mipvog"];
    teaches(here, &transcode, 2, &["an output goes after -o: -o b.mipvog"]);
    assert!(!here.join("out.mipvog").exists() && !here.join("b.mipvog").exists());
}

#[test]
fn a_folder_means_the_checkpoint_in_it() {
    let folder = workplace();
    let here = folder.path();
    let (report, _) = works(here, &["bake", "lego/", "-o", "x.mipvog", "--stepsize", "0.5"]);
    assert!(
        report.contains("smaller than fine_last.tar") || report.contains("larger than"),
        "{report}"
    );
    works(here, &["inspect", "lego"]);
    works(here, &["validate", "lego", "--stepsize", "0.5"]);
    works(here, &["render", "lego", "--size", "8", "-o", "x.png"]);
    std::fs::create_dir(here.join("other")).expect("writable");
    std::fs::copy(here.join("in.tar"), here.join("other/model.tar")).expect("copied");
    let bake = ["bake", "other", "-o", "y.mipvog"];
    teaches(here, &bake, 5, &["pass a file in it: other/model.tar"]);
    std::fs::create_dir(here.join("empty")).expect("writable");
    teaches(here, &["bake", "empty", "-o", "y.mipvog"], 5, &["pass a file instead of a folder"]);
}

#[test]
fn inputs_go_into_a_folder_under_names_of_their_own() {
    let folder = workplace();
    let here = folder.path();
    works(here, &[&["bake", "in.tar", "-o", "new/"], &STEP[..]].concat());
    assert!(here.join("new/in.mipvog").is_file());
    for name in ["chair", "lamp"] {
        std::fs::create_dir(here.join(name)).expect("writable");
        let to = here.join(name).join("fine_last.tar");
        std::fs::copy(here.join("in.tar"), to).expect("copied");
    }
    let bake = ["bake", "chair/fine_last.tar", "lamp/fine_last.tar", "-o", "many/"];
    let (text, _) = works(here, &[&bake[..], &STEP].concat());
    assert!(here.join("many/chair.mipvog").is_file() && here.join("many/lamp.mipvog").is_file());
    assert!(text.contains("chair.mipvog: ") && text.contains("lamp.mipvog: "), "{text}");
    // One that fails does not stop the others, and programs get a line each.
    let some = ["bake", "gone.tar", "in.tar", "-o", "some/", "--format", "json"];
    let output = run(here, &[&some[..], &STEP].concat());
    assert_eq!(output.status.code(), Some(1), "{}", words(&output.stderr));
    let results: Vec<Value> = words(&output.stdout)
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert_eq!(results.len(), 2);
    results.iter().for_each(|result| assert_follows("scene-result", result));
    assert_eq!((&results[0]["status"], &results[0]["exit_code"]), (&"failed".into(), &5.into()));
    assert_eq!(results[1]["status"], "baked");
    assert_eq!(results[1]["sha256"].as_str().map(str::len), Some(64));
    let file = ["bake", "in.tar", "lego/fine_last.tar", "-o", "x.mipvog"];
    teaches(here, &file, 2, &["several inputs go into a folder", "-o x/"]);
    let alike = ["bake", "in.tar", "./in.tar", "-o", "alike/"];
    teaches(here, &alike, 2, &["have one name"]);
}

#[test]
fn the_name_of_an_export_says_its_format() {
    let folder = workplace();
    let here = folder.path();
    for (output, format) in [
        ("a.vdb", "vdb"),
        ("a.usda", "usd"),
        ("a.html", "html"),
        ("a.glb", "glb"),
        ("flip.png", "flipbook"),
    ] {
        let line = ["export", "a.mipvog", "-o", output, "--force", "--format", "json"];
        let (report, _) = works(here, &line);
        let report: Value = serde_json::from_str(&report).expect("JSON");
        assert_schema("export", &report);
        assert_eq!(report["format"], format, "{output}");
    }
    works(here, &["export", "a.mipvog", "--to", "openvdb", "-o", "b.vdb"]);
    works(here, &["export", "a.mipvog", "--to", "mesh", "-o", "b.glb"]);
    let nothing = ["export", "a.mipvog", "-o", "a.xyz"];
    teaches(here, &nothing, 2, &["does not say the format", "--to", "vdb"]);
    teaches(here, &["bake", "in.tar", "-o", "scene.glb"], 2, &["bake --gltf scene.glb"]);
    teaches(here, &["bake", "in.tar", "-o", "scene.vdb"], 2, &["export"]);
}

#[test]
fn a_mesh_alone_is_an_export() {
    let folder = workplace();
    let here = folder.path();
    let export = ["export", "a.mipvog", "-o", "mesh.glb", "--triangles", "200", "--format", "json"];
    let (report, _) = works(here, &export);
    let report: Value = serde_json::from_str(&report).expect("JSON");
    let triangles = report["details"]["triangles"].as_u64().expect("a number");
    assert!((4..=200).contains(&triangles), "{report}");
    assert!(report["psnr"].as_f64().is_some_and(|psnr| psnr > 8.0), "{report}");
    let (inspected, _) = works(here, &["inspect", "mesh.glb"]);
    assert!(inspected.contains("radiance fields: 0"), "{inspected}");
    // It takes a field again.
    works(here, &["attach", "mesh.glb", "a.mipvog", "--node", "0", "-o", "both.glb"]);
    let level = ["export", "a.mipvog", "-o", "m.glb", "--level", "1"];
    teaches(here, &level, 2, &["--level"]);
    let crop = ["export", "a.mipvog", "-o", "m.glb", "--crop", "0,0,0,1,1,1"];
    teaches(here, &crop, 2, &["--crop"]);
}

#[test]
fn options_of_other_verbs_are_named() {
    let folder = workplace();
    let here = folder.path();
    let quality = ["transcode", "a.mipvog", "-o", "b.mipvog", "--quality", "50"];
    let command = "mipvog-bake bake a.mipvog -o b.mipvog --quality 50";
    teaches(here, &quality, 2, &["transcode has no option --quality", command]);
    let turntable = ["inspect", "a.mipvog", "--turntable", "3"];
    teaches(here, &turntable, 2, &["--turntable is an option of", "render"]);
    teaches(here, &["render", "a.mipvog", "--sise", "3"], 2, &["--size"]);
}

#[test]
fn without_cameras_the_scene_is_seen_from_around() {
    let folder = workplace();
    let here = folder.path();
    let compare = ["compare", "in.tar", "a.mipvog", "--stepsize", "0.5", "--scales", "1"];
    let (report, _) = works(here, &[&compare[..], &["--size", "16"]].concat());
    assert!(report.contains("8 frames"), "{report}");
    let sweep = ["sweep", "in.tar", "--stepsize", "0.5", "--size", "16", "--scales", "1"];
    let few = ["--bits", "8", "--filter", "rate-tent", "--repeat", "1", "-o", "s"];
    let (report, _) = works(here, &[&sweep[..], &few].concat());
    assert!(report.contains("mean of 8 pictures of 16 x 16"), "{report}");
    assert!(report.contains("the best trade-off: "), "{report}");
    works(here, &["render", "a.mipvog", "--size", "16", "-o", "photos/"]);
    let photos = ["compare", "photos", "a.mipvog"];
    teaches(here, &photos, 2, &["--cameras FILE"]);
}

#[test]
fn cameras_in_a_folder_and_of_others_are_known() {
    let folder = workplace();
    let here = folder.path();
    let cameras = fixture("trained/lego64/transforms_test.json");
    std::fs::copy(cameras, here.join("lego/transforms.json")).expect("copied");
    let view = ["--frames", "0", "--size", "8"];
    works(here, &[&["render", "a.mipvog", "--cameras", "lego", "-o", "x"], &view[..]].concat());
    let model = here.join("colmap/sparse/0");
    std::fs::create_dir_all(&model).expect("writable");
    let write = |name: &str, text: &str| std::fs::write(model.join(name), text).expect("writable");
    write("cameras.txt", "# Camera list\n1 PINHOLE 8 8 10 10 4 4\n");
    write("images.txt", "1 1 0 0 0 0 0 4 1 a.png\n\n");
    works(here, &["render", "a.mipvog", "--cameras", "colmap", "-o", "y"]);
    assert!(here.join("y/a.s1.png").is_file());
    std::fs::write(here.join("poses_bounds.npy"), b"\x93NUMPY\x01\0").expect("writable");
    let llff = ["render", "a.mipvog", "--cameras", "poses_bounds.npy", "-o", "z"];
    teaches(here, &llff, 3, &["LLFF", "transforms.json"]);
    let order = ["attach", "a.mipvog", "mesh.glb", "-o", "both.glb"];
    works(here, &["export", "a.mipvog", "-o", "mesh.glb", "--triangles", "100"]);
    let swapped = "mipvog-bake attach mesh.glb a.mipvog -o both.glb";
    teaches(here, &order, 2, &["the asset comes first", swapped]);
}

#[test]
fn warnings_can_be_denied_and_stand_in_reports() {
    let folder = workplace();
    let here = folder.path();
    let bake = ["bake", "in.tar", "-o", "x.mipvog", "--format", "json"];
    let output = run(here, &[&bake[..], &["--deny-warnings"]].concat());
    assert_eq!(output.status.code(), Some(1), "{}", words(&output.stderr));
    assert!(!here.join("x.mipvog").exists());
    assert!(words(&output.stderr).contains("--deny-warnings is set"), "{}", words(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_schema("bake", &report);
    assert!(report["sha256"].is_null());
    let told: Vec<&str> =
        report["warnings"].as_array().expect("a list").iter().filter_map(Value::as_str).collect();
    assert!(told.iter().any(|text| text.contains("stepsize")), "{told:?}");
    let (report, _) = works(here, &bake);
    let report: Value = serde_json::from_str(&report).expect("JSON");
    let bytes = std::fs::read(here.join("x.mipvog")).expect("written");
    let sha256 = mipvog::base::bytes::hex(&sha2::Sha256::digest(&bytes).into());
    assert_eq!(report["sha256"], sha256);
    // In a batch, the scene is named.
    let lines = "{\"input\": \"in.tar\", \"output\": \"y.mipvog\"}\n";
    std::fs::write(here.join("scenes.jsonl"), lines).expect("writable");
    let batch = ["bake", "--manifest", "scenes.jsonl"];
    let (results, told) = works(here, &batch);
    assert!(told.contains("warning: in.tar: "), "{told}");
    let result: Value = serde_json::from_str(results.trim()).expect("JSON");
    assert_follows("scene-result", &result);
    assert_eq!(result["sha256"], sha256);
    assert!(!result["warnings"].as_array().expect("a list").is_empty());
    std::fs::remove_file(here.join("y.mipvog")).expect("there");
    let output = run(here, &[&batch[..], &["--deny-warnings"]].concat());
    assert_eq!(output.status.code(), Some(1));
    assert!(!here.join("y.mipvog").exists());
    // Other verbs fail after their work.
    let render = ["render", "in.tar", "--size", "8", "-o", "x.png", "--deny-warnings"];
    teaches(here, &render, 1, &["--deny-warnings is set"]);
}

#[test]
fn errors_are_json_where_reports_are() {
    let folder = workplace();
    let here = folder.path();
    let error = |line: &[&str]| {
        let output = run(here, &[line, &["--format", "json"]].concat());
        let document: Value = serde_json::from_slice(&output.stdout).expect("one JSON document");
        assert_schema("error", &document);
        assert_eq!(document["schema"], "mipvog-error/1");
        let error = document["error"].clone();
        assert_eq!(error["exit_code"].as_i64(), output.status.code().map(i64::from), "{error}");
        let text = error["message"].as_str().expect("a message");
        assert!(words(&output.stderr).contains(text), "{}", words(&output.stderr));
        error
    };
    let missing = error(&["bake", "gone.tar", "-o", "x.mipvog"]);
    assert_eq!((&missing["kind"], &missing["file"]), (&"io".into(), &"gone.tar".into()));
    assert_eq!(missing["help"], "check the path");
    assert!(missing["place"].is_null());
    let mut cut = std::fs::read(here.join("a.mipvog")).expect("a file");
    cut.truncate(3000);
    std::fs::write(here.join("cut.mipvog"), cut).expect("writable");
    assert_eq!(error(&["unpack", "cut.mipvog", "-o", "x.npz"])["exit_code"], 3);
    assert_eq!(
        error(&["render", "a.mipvog", "-o", "x.png", "--level-of-detail", "9"])["exit_code"],
        2
    );
    // Lines that cannot be parsed, too.
    assert_eq!(error(&["bake", "in.tar"])["kind"], "usage");
    assert_eq!(error(&["frobnicate"])["exit_code"], 2);
    assert_eq!(
        error(&["transcode", "a.mipvog", "-o", "b.mipvog", "--quality", "5"])["exit_code"],
        2
    );
    // A standard output that is a file's stays empty.
    let line = ["bake", "gone.tar", "-o", "-", "--format", "json"];
    let output = run(here, &line);
    assert!(output.stdout.is_empty() && words(&output.stderr).contains("mipvog-error/1"));
}

#[test]
fn findings_are_lines_that_name_their_file() {
    let folder = workplace();
    let here = folder.path();
    let mut cut = std::fs::read(here.join("a.mipvog")).expect("a file");
    cut.truncate(3000);
    std::fs::write(here.join("cut.mipvog"), cut).expect("writable");
    let output = run(here, &["validate", "a.mipvog", "cut.mipvog", "in.tar"]);
    assert_eq!(output.status.code(), Some(1));
    let text = words(&output.stdout);
    let has = |start: &str| text.lines().any(|line| line.starts_with(start));
    assert!(has("a.mipvog: valid") && has("cut.mipvog: not valid"), "{text}");
    assert!(has("cut.mipvog: length: "), "{text}");
    assert!(has("in.tar: unstated: warning: "), "{text}");
    // What is listed is not told again.
    let told = words(&output.stderr);
    assert!(told.contains("cut.mipvog: not valid: ") && !told.contains("the first at"), "{told}");
}
