//! `export`: files of other programs, read back from their bytes.

use std::path::Path;

use crate::common::grids::{self, SmallGrid, Values};
use crate::common::{assert_schema, fixture, folder, program};
use serde_json::Value;

/// Runs `export`; the code, the report, the errors.
fn export(here: &Path, arguments: &[&str]) -> (Option<i32>, Value, String) {
    let mut command = program();
    command.current_dir(here).arg("export").args(arguments).args(["--format", "json"]);
    let output = command.output().expect("starts");
    let report = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output.status.code(), report, String::from_utf8_lossy(&output.stderr).into_owned())
}

/// The report of an export that works, held to the schema and to the files.
fn exported(here: &Path, arguments: &[&str]) -> Value {
    let (code, report, errors) = export(here, arguments);
    assert_eq!(code, Some(0), "{arguments:?}: {errors}");
    assert_schema("export", &report);
    for file in report["files"].as_array().expect("a list") {
        let path = here.join(file["path"].as_str().expect("a path"));
        let length = path.metadata().expect("a file").len();
        assert_eq!(file["bytes"], length);
    }
    report
}

fn names(here: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(here).expect("a folder");
    let name = |entry: std::io::Result<std::fs::DirEntry>| entry.expect("an entry").file_name();
    let mut names: Vec<String> =
        entries.map(|entry| name(entry).to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn tiny() -> String {
    fixture("baked/tiny.rate.f16.mipvog").display().to_string()
}

#[test]
fn flipbooks_come_closer_with_more_points_and_more_digits() {
    let folder = folder();
    let here = folder.path();
    let tiny = tiny();
    let psnr = |arguments: &[&str]| {
        let line = [&[&tiny, "--to", "flipbook", "--force"], arguments].concat();
        exported(here, &line)["psnr"].as_f64().expect("a number")
    };
    let png = psnr(&["-o", "a.png"]);
    let exr = psnr(&["-o", "a.exr"]);
    let fine = psnr(&["-o", "a.exr", "--supersample", "3"]);
    assert!(png > 10.0 && exr > png - 1.0 && fine > exr, "{png} {exr} {fine}");
    assert!(names(here).iter().any(|name| name.starts_with("a_") && name.ends_with(".exr")));
}

/// Programs interpolate beyond the outermost points, or clamp there: in either case density on the
/// faces of the box keeps its colour.
#[test]
fn matter_on_the_faces_of_the_box_keeps_its_colour() {
    let folder = folder();
    let here = folder.path();
    let nodes = [24usize, 20, 28];
    let count: usize = nodes.iter().product();
    let color = (0..count).flat_map(|node| [0.2, 0.9, (node % 28) as f32 / 27.0]).collect();
    let full = SmallGrid {
        arrays: vec![
            ("density", nodes.to_vec(), Values::F32(vec![1e3; count])),
            ("color", [&nodes[..], &[3]].concat(), Values::F32(color)),
            ("aabb", vec![2, 3], Values::F32(vec![-1.0, -1.0, -1.0, 1.0, 1.0, 1.0])),
        ],
        settings: Vec::new(),
    };
    std::fs::write(here.join("full.safetensors"), full.to_bytes()).expect("written");
    for (format, name) in [("vdb", "a.vdb"), ("flipbook", "a.exr"), ("flipbook", "b.png")] {
        let report = exported(here, &["full.safetensors", "--to", format, "-o", name]);
        let psnr = report["psnr"].as_f64().expect("a number");
        // The rest is the rim by which interpolated density is larger than the box. Black faces had
        // 7.6 and 5.8 dB.
        assert!(psnr > 16.0, "{name}: {psnr}");
    }
}

/// A field that shows nothing.
#[test]
fn an_empty_field_is_an_empty_volume_and_no_splats() {
    let folder = folder();
    let here = folder.path();
    let mut empty = grids::sampled();
    *empty.array("density") = ("density", vec![5, 4, 3], Values::F32(vec![0.0; 60]));
    std::fs::write(here.join("empty.safetensors"), empty.to_bytes()).expect("written");
    exported(here, &["empty.safetensors", "--to", "vdb", "-o", "empty.vdb"]);
    let valid = program().current_dir(here).args(["validate", "empty.vdb"]).output();
    let valid = valid.expect("starts");
    assert!(valid.status.success(), "{}", String::from_utf8_lossy(&valid.stdout));
    let (code, _, errors) = export(here, &["empty.safetensors", "--to", "splat", "-o", "a.ply"]);
    assert_eq!(code, Some(2), "{errors}");
    assert!(errors.contains("shows nothing"), "{errors}");
    // OpenVDB treats voxels this small as zero.
    let tiny = Values::F32(vec![-1e-7, -1e-7, -1e-7, 1e-7, 1e-7, 1e-7]);
    *empty.array("aabb") = ("aabb", vec![2, 3], tiny);
    std::fs::write(here.join("tiny.safetensors"), empty.to_bytes()).expect("written");
    let (code, _, errors) = export(here, &["tiny.safetensors", "--to", "vdb", "-o", "tiny.vdb"]);
    assert_eq!(code, Some(4), "{errors}");
    assert_eq!(names(here), ["empty.safetensors", "empty.vdb", "tiny.safetensors"]);
}

#[test]
fn a_missed_gate_leaves_nothing_and_taken_names_are_refused() {
    let folder = folder();
    let here = folder.path();
    let tiny = tiny();
    let line = [&tiny, "--to", "flipbook", "-o", "a.png", "--resolution", "12"];
    let (code, report, errors) = export(here, &[&line[..], &["--require-psnr", "90"]].concat());
    assert_eq!(code, Some(1), "{errors}");
    assert_schema("export", &report);
    assert_eq!((&report["passed"], &report["files"]), (&false.into(), &Value::Array(Vec::new())));
    assert!(errors.contains("not written"), "{errors}");
    assert!(names(here).is_empty(), "{:?}", names(here));
    let first = exported(here, &line);
    assert_eq!(export(here, &line).0, Some(7), "names are taken");
    let again = exported(here, &[&line[..], &["--force", "--threads", "1"]].concat());
    assert_eq!(first["files"], again["files"], "the same bytes for any number of threads");
}

#[test]
fn what_cannot_be_is_refused_before_any_work() {
    let folder = folder();
    let here = folder.path();
    let tiny = tiny();
    for (arguments, code, says) in [
        (&["--to", "gif", "-o", "a.gif"][..], 2, "flipbook"),
        (&["--to", "flipbook", "-o", "-"], 2, "several files"),
        (&["--to", "flipbook", "-o", "a.jpg"], 2, ".png"),
        (&["--to", "flipbook", "-o", "a.png", "--supersample", "0"], 2, "1 to 16"),
        (&["--to", "flipbook", "-o", "a.png", "--resolution", "1"], 2, "2 cells"),
        (&["--to", "flipbook", "-o", "a.png", "--resolution", "1100"], 2, "16384"),
        (&["--to", "flipbook", "-o", "a.png", "--level", "9"], 2, "level"),
        (&["--to", "flipbook", "-o", "a.png", "--memory", "1kB"], 6, "bytes"),
        (&["--to", "flipbook", "-o", "a.png", "--crop", "5,5,5,6,6,6"], 2, "crop"),
        (&["--to", "flipbook", "-o", "a.png", "--require-psnr", "nan"], 2, "finite"),
    ] {
        let (found, _, errors) = export(here, &[&[tiny.as_str()], arguments].concat());
        assert_eq!(found, Some(code), "{arguments:?}: {errors}");
        assert!(errors.contains(says), "{arguments:?}: {errors}");
    }
    assert!(names(here).is_empty(), "{:?}", names(here));
}
