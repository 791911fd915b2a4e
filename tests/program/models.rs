//! Verbs on models of other systems, and the exit codes of those that lie.

use crate::common::factored;
use crate::common::merf::small_merf;
use crate::common::model_lies::LIES;
use crate::common::snerg::small_snerg;
use crate::common::{assert_schema, fixture, folder, program};

/// Runs the program; its exit code and its JSON.
fn run(line: &[&str]) -> (Option<i32>, serde_json::Value, String) {
    let output = program().args(line).args(["--format", "json"]).output().expect("starts");
    let json = serde_json::from_slice(&output.stdout).unwrap_or_default();
    (output.status.code(), json, String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn verbs_take_models_and_refuse_what_they_cannot_do() {
    let here = folder();
    let path = |name: &str| here.path().join(name).to_string_lossy().into_owned();
    let fixture = |name: &str| fixture("grids").join(name).to_string_lossy().into_owned();
    let tree = fixture("plenoctree.npz");
    let (code, inspected, _) = run(&["inspect", &tree]);
    assert_eq!((code, inspected["model"].as_str()), (Some(0), Some("plenoctree")));
    assert_schema("inspect", &inspected);
    let out = path("tree.mipvog");
    let (code, report, _) = run(&["bake", &tree, "-o", &out]);
    assert_eq!(code, Some(0));
    assert_schema("bake", &report);
    let psnr = report["quality"]["errors"][0]["psnr"].as_f64().expect("the loss of resampling");
    assert!((26.0..60.0).contains(&psnr), "{psnr} dB");
    let model = fixture("plenoxels_cubic.npz");
    let picture = path("picture.png");
    for (options, expected) in [
        (["--filter", "rate-tent"], "its own rules"),
        (["--level-of-detail", "2"], "0 to 0"),
        (["--view", "sh:4"], "sh:D"),
        (["--scene-scale", "0"], "scene"),
    ] {
        let line = ["render", &model, "-o", &picture, options[0], options[1]];
        let (code, _, message) = run(&line);
        assert_eq!(code, Some(2), "{options:?}: {message}");
        assert!(message.contains(expected), "{options:?}: {message}");
    }
    let (code, _, message) = run(&["render", &out, "-o", &picture, "--view", "none"]);
    assert_eq!(code, Some(2), "{message}");
    let compared = ["compare", &model, &model, "--turntable", "2", "--size", "24x24"];
    let (code, report, _) = run(&compared);
    assert_eq!(code, Some(0));
    assert!(report["scales"][0]["psnr"].as_f64().is_some_and(|psnr| psnr > 150.0), "{report}");
}

#[test]
fn verbs_take_a_folder_of_merf() {
    let (scene, here) = (small_merf(), folder());
    let assets = here.path().join("assets");
    std::fs::create_dir(&assets).expect("a folder");
    scene.write(&assets, false);
    let run = |arguments: &[&str]| {
        let output = program().current_dir(here.path()).args(arguments).output();
        output.expect("it runs")
    };
    let output = run(&["inspect", "assets", "--format", "json"]);
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_schema("inspect", &report);
    assert_eq!((&report["model"], &report["kind"]), (&"merf".into(), &"folder".into()));
    for arguments in [
        &["bake", "assets", "-o", "scene.mipvog"][..],
        &["render", "assets", "--turntable", "1", "--size", "16x16", "-o", "pictures"],
        &["compare", "assets", "scene.mipvog", "--turntable", "2", "--size", "24x24"],
    ] {
        let output = run(&[arguments, &["--drop-background"]].concat());
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{arguments:?}: {text}");
    }
    // All of the scene, in boxes around each other.
    let output = run(&["bake", "assets", "-o", "whole.mipvog"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let output = run(&["inspect", "whole.mipvog", "--format", "json"]);
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_schema("inspect", &report);
    let reach = |value: &serde_json::Value| value["bounds"]["max"][0].as_f64().expect("a corner");
    let levels = report["levels"].as_array().expect("levels");
    assert!(levels.windows(2).all(|pair| reach(&pair[0]) <= reach(&pair[1])));
    assert!(reach(&levels[0]) < reach(&report), "{}", report["bounds"]);
    // Other formats take the boxes of its container, which is baked first if there is none.
    for name in ["box.vdb", "splats.spz"] {
        let exported = |input: &str| {
            let line = ["export", input, "-o", name, "--force", "--format", "json"];
            let output = run(&line);
            let text = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{input} to {name}: {text}");
            serde_json::from_slice::<serde_json::Value>(&output.stdout).expect("JSON")
        };
        let (first, second) = (exported("assets"), exported("whole.mipvog"));
        assert_eq!(first["psnr"], second["psnr"], "{name}");
        let lost = |report: &serde_json::Value| report["lost"].as_array().expect("a list").len();
        assert_eq!(lost(&first), lost(&second) + 1, "{name}: {}", first["lost"]);
        assert!(first["lost"][0].as_str().expect("text").contains("a bake with default options"));
    }
}

#[test]
fn verbs_take_a_folder_of_snerg() {
    let (scene, here) = (small_snerg(), folder());
    let assets = here.path().join("assets");
    std::fs::create_dir(&assets).expect("a folder");
    scene.write(&assets);
    let run = |arguments: &[&str]| {
        let output = program().current_dir(here.path()).args(arguments).output();
        output.expect("it runs")
    };
    let output = run(&["inspect", "assets", "--format", "json"]);
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_schema("inspect", &report);
    assert_eq!((&report["model"], &report["kind"]), (&"snerg".into(), &"folder".into()));
    for arguments in [
        &["validate", "assets"][..],
        &["bake", "assets", "-o", "scene.mipvog"],
        &["compare", "assets", "scene.mipvog", "--turntable", "2", "--size", "24x24"],
        &["render", "assets", "--turntable", "1", "--size", "16x16", "-o", "pictures"],
    ] {
        let output = run(arguments);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{arguments:?}: {text}");
    }
    let over = run(&["bake", "assets", "-o", "assets/rgba_001.png", "--force"]);
    assert!(!over.status.success(), "an output must not replace an input");
    let output = run(&["inspect", "."]);
    assert!(!output.status.success(), "a folder of anything else is no input");
}

#[test]
fn every_verb_takes_small_models() {
    let here = folder();
    for (number, make) in factored::SMALL_MODELS.into_iter().enumerate() {
        let path = here.path().join(format!("{number}.th"));
        let baked = here.path().join(format!("{number}.mipvog"));
        std::fs::write(&path, make().to_bytes()).expect("writable");
        let run = |line: &[&str]| {
            let mut program = program();
            program.arg(line[0]).arg(&path).args(&line[1..]).arg("--drop-background");
            let ran = program.args(["--format", "json"]).output().expect("starts");
            let message = String::from_utf8_lossy(&ran.stderr).into_owned();
            assert_eq!(ran.status.code(), Some(0), "{number}: {line:?}: {message}");
            serde_json::from_slice::<serde_json::Value>(&ran.stdout).expect("JSON")
        };
        let out = baked.to_str().expect("text");
        assert_schema("bake", &run(&["bake", "-o", out, "--bits", "f32", "--levels", "1"]));
        assert_schema("validate", &run(&["validate"]));
        // Options of the model are no mistake beside its bake.
        let compared = run(&["compare", out, "--turntable", "3", "--size", "32x32"]);
        let psnr = compared["scales"][0]["psnr"].as_f64().expect("a number");
        println!("{number}: {psnr:.1} dB");
        // Matter is random and reaches the faces, where one sample more or less shows.
        assert!(psnr > 10.0, "{number}: {psnr} dB");
    }
}

#[test]
fn lies_have_exit_codes_and_leave_no_file() {
    let here = folder();
    for (make, name, code, lie) in LIES {
        let mut file = make();
        lie(&mut file);
        let path = here.path().join("model.th");
        std::fs::write(&path, file.to_bytes()).expect("writable");
        let mut program = program();
        let line = program.arg("bake").arg(&path).arg("-o").arg(here.path().join("out.mipvog"));
        let ran = line.arg("--drop-background").output().expect("starts");
        let message = String::from_utf8_lossy(&ran.stderr);
        assert_eq!(ran.status.code(), Some(code), "{name}: {message}");
        assert!(!here.path().join("out.mipvog").exists(), "{name} leaves a file");
    }
}
