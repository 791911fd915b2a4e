//! Harmonics that are fitted to networks: the directions of the fit, the figure along others, and
//! the gate for it.

use std::path::Path;

use crate::common::{assert_schema, fixture, folder, program};
use mipvog::Camera;
use serde_json::{Value, json};

/// Runs `bake`; its exit code, its report and its warnings.
fn bake(input: &Path, output: &Path, options: &[&str]) -> (Option<i32>, Value, String) {
    let mut line = program();
    line.arg("bake").arg(input).arg("-o").arg(output);
    let run = line.args(options).args(["--format", "json"]).output().expect("starts");
    let report = serde_json::from_slice(&run.stdout).unwrap_or_default();
    (run.status.code(), report, String::from_utf8_lossy(&run.stderr).into_owned())
}

/// Writes a camera file of cameras around the origin on the side that `side` names.
fn cameras(path: &Path, count: u32, side: f64) {
    let frames = (0..count).map(|number| {
        let (turn, height) = (2.4 * f64::from(number), f64::from(number) / f64::from(count));
        let eye = [4.0 * turn.cos(), 4.0 * turn.sin(), side * (0.3 + 3.0 * height)];
        let camera = Camera::look_at(eye, [0.0; 3], 40.0, [16, 16]).expect("a camera");
        let rows = camera.to_world.transpose().to_cols_array_2d();
        json!({ "file_path": format!("r_{number}"), "transform_matrix": rows })
    });
    let frames: Vec<Value> = frames.collect();
    let file = json!({ "camera_angle_x": 0.7, "w": 16, "h": 16, "frames": frames });
    std::fs::write(path, file.to_string()).expect("written");
}

fn psnr(report: &Value) -> f64 {
    report["view"]["held_out_psnr"].as_f64().unwrap_or_else(|| panic!("{}", report["view"]))
}

#[test]
fn more_bands_come_closer_along_directions_that_no_fit_has_seen() {
    let here = folder();
    let out = here.path().join("scene.mipvog");
    // Degrees 1 and 2 as measured, less half a decibel.
    for (name, least) in [("tensorf_vm.th", [35.0, 36.5]), ("tensorf_cp.th", [35.7, 37.3])] {
        let model = fixture("grids").join(name);
        for (degree, least) in least.into_iter().enumerate() {
            let view = format!("sh:{}", degree + 1);
            let (code, report, message) = bake(&model, &out, &["--force", "--view", &view]);
            assert_eq!(code, Some(0), "{message}");
            assert_schema("bake", &report);
            assert_eq!(report["view"]["fitted"], true);
            assert!(psnr(&report) > least, "{name}, {view}: {}", psnr(&report));
        }
    }
}

#[test]
fn a_fit_follows_the_cameras() {
    let here = folder();
    let [above, below, out] =
        ["above.json", "below.json", "scene.mipvog"].map(|name| here.path().join(name));
    cameras(&above, 48, 1.0);
    cameras(&below, 48, -1.0);
    let model = fixture("grids").join("tensorf_vm.th");
    let from = |cameras: &Path, options: &[&str]| {
        let cameras = cameras.to_string_lossy().into_owned();
        let line = [&["--cameras", &cameras, "--frames", "r_0"], options].concat();
        let (code, report, message) = bake(&model, &out, &line);
        assert_eq!(code, Some(0), "{message}");
        (psnr(&report), report["unchanged"].clone(), std::fs::read(&out).expect("a container"))
    };
    let (own, _, bytes) = from(&above, &["--force"]);
    assert!(own > 36.0, "{own}");
    // The same cameras give the same bytes, others another fit.
    let (again, unchanged, _) = from(&above, &["--if-changed"]);
    assert_eq!((again.to_bits(), unchanged), (own.to_bits(), Value::Bool(true)));
    let (_, unchanged, other) = from(&below, &["--if-changed"]);
    assert_eq!(unchanged, Value::Bool(false));
    assert_ne!(bytes, other);
}

#[test]
fn a_gate_holds_fitted_colours() {
    let here = folder();
    let out = here.path().join("scene.mipvog");
    let model = fixture("grids").join("tensorf_cp.th");
    let (code, report, message) = bake(&model, &out, &["--require-view-psnr", "60"]);
    assert_eq!(code, Some(1), "{message}");
    assert!(!out.exists() && message.contains("60 dB required"), "{message}");
    assert_eq!(report["view"]["required_psnr"], 60.0);
    let (code, _, message) = bake(&model, &out, &["--require-view-psnr", "30"]);
    assert!(code == Some(0) && out.exists(), "{message}");
    let few = ["--force", "--require-view-psnr", "30", "--memory", "2G"];
    let (code, _, message) = bake(&model, &out, &few);
    assert!(code == Some(2) && message.contains("--memory"), "{message}");
    let none = ["--force", "--require-view-psnr", "nan"];
    assert_eq!(bake(&model, &out, &none).0, Some(2));
    // Colours that are the model's own have nothing that the gate could judge.
    let stored = fixture("grids").join("tensorf_vm_sh.th");
    let (code, _, message) = bake(&stored, &out, &["--force", "--require-view-psnr", "60"]);
    assert!(code == Some(2) && message.contains("--require-view-psnr"), "{message}");
    let (code, report, message) = bake(&stored, &out, &["--force"]);
    assert_eq!(code, Some(0), "{message}");
    assert_eq!(report["view"]["held_out_psnr"], Value::Null);
}

#[test]
fn colours_that_are_limited_are_counted_where_cameras_look() {
    let here = folder();
    let out = here.path().join("scene.mipvog");
    let model = fixture("grids").join("plenoxels_cubic.npz");
    let (code, report, message) = bake(&model, &out, &[]);
    assert_eq!(code, Some(0), "{message}");
    assert_eq!(report["view"]["clamped_share"], Value::Null);
    let looks = ["--force", "--turntable", "2", "--size", "24"];
    let (_, report, _) = bake(&model, &out, &looks);
    let share = report["view"]["clamped_share"].as_f64().expect("a share");
    assert!((0.0..0.5).contains(&share), "{share}");
}
