//! `transcode`, and `bake` of the program's own files.

use std::path::Path;

use crate::common::{assert_schema, fixture, folder, program};
use serde_json::Value;

fn run(here: &Path, arguments: &[&str]) -> std::process::Output {
    program().current_dir(here).args(arguments).output().expect("starts")
}

fn report(here: &Path, arguments: &[&str]) -> Value {
    let output = run(here, &[arguments, &["--format", "json"]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).expect("a report");
    assert_schema(arguments[0], &report);
    report
}

#[test]
fn the_program_bakes_its_own_files() {
    let folder = folder();
    let here = folder.path();
    let scene = fixture("trained/tiny/fine_last.tar").display().to_string();
    report(here, &["bake", &scene, "-o", "a.mipvog", "--gltf", "a.glb"]);
    report(here, &["unpack", "a.mipvog", "-o", "a.safetensors"]);
    let read = |name: &str| std::fs::read(here.join(name)).expect("a container");
    let options: [&[&str]; 6] = [
        &[],
        &["--bits", "6"],
        &["--preset", "web"],
        &["--filter", "paper", "--near", "0.25"],
        &["--block-size", "4", "--max-error", "0.05"],
        &["--levels", "2", "--background", "0", "--lod-scale", "2"],
    ];
    for options in options {
        for (input, output) in [("a.safetensors", "b"), ("a.mipvog", "c"), ("a.glb", "d")] {
            let bake = ["bake", input, "-o", output, "--force"];
            report(here, &[&bake[..], options].concat());
        }
        assert!(read("b") == read("c") && read("b") == read("d"), "{options:?}");
    }
    for ignored in [
        ["--stepsize", "0.5"],
        ["--memory", "1G"],
        ["--turntable", "2"],
        ["--require-view-psnr", "90"],
    ] {
        let refused = run(here, &[&["bake", "a.mipvog", "-o", "x"][..], &ignored].concat());
        assert_eq!(refused.status.code(), Some(2), "{ignored:?}");
    }
    assert!(!here.join("x").exists());
}

#[test]
fn transcoding_reports_as_a_bake_does() {
    let folder = folder();
    let here = folder.path();
    let scene = fixture("trained/lego64/fine_last.tar").display().to_string();
    let bake = ["bake", &scene, "--stepsize", "0.5", "-o", "a.mipvog"];
    let whole = report(here, &bake)["output_bytes"].as_u64().expect("bytes");
    let transcode = |more: &[&str]| {
        let verb = ["transcode", "a.mipvog", "-o", "b.mipvog", "--force"];
        report(here, &[&verb[..], more].concat())
    };
    let small = transcode(&["--max-bytes", "0.1MB"]);
    assert!(small["output_bytes"].as_u64() <= Some(100_000));
    assert_eq!(small["chosen"]["without_finest"], 1);
    assert_eq!(small["chosen"]["bytes"], small["output_bytes"]);
    assert_eq!(small["options"]["max_bytes"], 100_000);
    // What was to be dropped anyway counts too: the options that are told make the same file.
    let dropped = transcode(&["--max-bytes", "0.1MB", "--without-finest", "1"]);
    assert_eq!(dropped["chosen"]["without_finest"], 1);
    let part = transcode(&["--crop=-1,-1,-1,1,1,0.2", "--drop-islands", "50"]);
    assert!(part["output_bytes"].as_u64() < Some(whole));
    assert!(part["islands"]["dropped"].as_u64() > Some(0));
    let fewer = transcode(&["--without-finest", "1", "--levels", "2", "--bits", "6"]);
    assert_eq!(fewer["levels"].as_array().expect("levels").len(), 2);
    assert_eq!(fewer["levels"][0]["dimensions"], serde_json::json!([32, 32, 32]));
    assert_eq!(report(here, &["validate", "b.mipvog"])["valid"], true);
    // An output that is there stays; a checkpoint is no container.
    let taken = run(here, &["transcode", "a.mipvog", "-o", "b.mipvog"]);
    assert!(!taken.status.success());
    let other = run(here, &["transcode", &scene, "-o", "c.mipvog"]);
    assert_eq!(other.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&other.stderr).contains("bake it first"));
    for wrong in [&["--crop", "1,2,3"][..], &["--levels", "0"], &["--max-bytes", "many"]] {
        let verb = ["transcode", "a.mipvog", "-o", "c.mipvog"];
        let refused = run(here, &[&verb[..], wrong].concat());
        assert_eq!(refused.status.code(), Some(2), "{wrong:?}");
    }
    assert!(!here.join("c.mipvog").exists());
}

#[test]
fn containers_are_rotated_scaled_and_moved() {
    let folder = folder();
    let here = folder.path();
    let scene = fixture("trained/tiny/fine_last.tar").display().to_string();
    report(here, &["bake", &scene, "-o", "a.mipvog"]);
    let bounds = |name: &str| {
        let bounds = &report(here, &["inspect", name])["metadata"]["bounds"];
        ["min", "max"]
            .map(|corner| [0, 1, 2].map(|axis| bounds[corner][axis].as_f64().expect("a number")))
    };
    let transcode = |more: &[&str]| {
        let verb = ["transcode", "a.mipvog", "-o", "b.mipvog", "--force"];
        report(here, &[&verb[..], more].concat())
    };
    let [min, max] = bounds("a.mipvog");
    let moved = transcode(&["--up", "y", "--scale", "2", "--translate=-1,0,0.5"]);
    assert_eq!(moved["options"]["rotate"], serde_json::json!([90, 0, 0]));
    assert_eq!(moved["options"]["scale"], 2.0);
    assert_eq!(moved["options"]["translate"], serde_json::json!([-1.0, 0.0, 0.5]));
    // y is up now: (x, y, z) is (x, -z, y).
    let want = [
        [2.0 * min[0] - 1.0, -2.0 * max[2], 2.0 * min[1] + 0.5],
        [2.0 * max[0] - 1.0, -2.0 * min[2], 2.0 * max[1] + 0.5],
    ];
    let found = bounds("b.mipvog");
    let pairs = want.as_flattened().iter().zip(found.as_flattened());
    assert!(pairs.clone().all(|(want, found)| (want - found).abs() < 1e-6), "{found:?} {want:?}");
    assert_eq!(report(here, &["validate", "b.mipvog"])["valid"], true);
    // Nothing is moved without options that move, or by those that do not.
    let read = |name: &str| std::fs::read(here.join(name)).expect("a container");
    transcode(&["--rotate", "360,0,-720", "--scale", "1", "--translate", "0,0,0"]);
    assert!(read("a.mipvog") == read("b.mipvog"));
    for (wrong, says) in [
        (&["--rotate", "45,0,0"][..], "multiples of 90 degrees"),
        (&["--rotate", "90"], "three numbers"),
        (&["--rotate", "90,0,0", "--up", "y"], "cannot be used with"),
        (&["--up", "w"], "possible values"),
        (&["--scale", "0"], "above 0"),
        (&["--scale", "-2"], "above 0"),
        (&["--scale", "nan"], "above 0"),
        (&["--translate", "1,2"], "three numbers"),
        (&["--translate", "inf,0,0"], "three numbers"),
        (&["--translate", "0,1e9,0"], "along axis y"),
    ] {
        let refused =
            run(here, &[&["transcode", "a.mipvog", "-o", "c.mipvog"][..], wrong].concat());
        assert_eq!(refused.status.code(), Some(2), "{wrong:?}");
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(message.contains(says), "{wrong:?}: {message}");
    }
    assert!(!here.join("c.mipvog").exists());
}
