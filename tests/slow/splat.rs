//! Exports of splats.

use crate::common::{fixture, folder, program};
use glam::DVec3;

#[test]
fn an_export_looks_like_the_field_and_is_the_same_for_any_number_of_threads() {
    let folder = folder();
    let tiny = fixture("baked/tiny.rate.f16.mipvog");
    // Small pictures, so that this ends soon.
    let frame = |number: usize| {
        let angle = number as f64;
        let (x, y, z) = (angle.cos(), angle.sin(), 0.2 + 0.6 * (0.37 * angle).sin());
        let back = DVec3::new(x, y, z).normalize();
        let right = DVec3::Z.cross(back).normalize();
        let (up, eye) = (back.cross(right), 5.0 * back);
        let row = |axis: usize| [right[axis], up[axis], back[axis], eye[axis]];
        serde_json::json!({
            "file_path": format!("{number}"),
            "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
        })
    };
    let frames: Vec<_> = (0..24).map(frame).collect();
    let cameras = serde_json::json!({
        "camera_angle_x": 0.6, "w": 64, "h": 64, "frames": frames,
    });
    std::fs::write(folder.path().join("cameras.json"), cameras.to_string()).expect("writable");
    let export = |output: &str, more: &[&str]| {
        let mut command = program();
        command.current_dir(folder.path()).arg("export").arg(&tiny);
        let to = if more.contains(&"--to") { &[][..] } else { &["--to", "splat"] };
        command.args(to).args(["-o", output, "--format", "json"]);
        command.args(["--cameras", "cameras.json"]).args(more);
        let output = command.output().expect("starts");
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        (output.status.code(), report)
    };
    let (code, report) = export("a.ply", &["--require-psnr", "28"]);
    assert_eq!(code, Some(0), "{report}");
    let count = report["details"]["splats"].as_u64().expect("a number");
    let bytes = |name: &str| std::fs::read(folder.path().join(name)).expect("written");
    let file = bytes("a.ply");
    let header = format!("element vertex {count}\n");
    assert!(file.windows(header.len()).any(|words| words == header.as_bytes()));
    assert_eq!(export("b.ply", &["--threads", "1"]).0, Some(0));
    assert!(file == bytes("b.ply"), "the same bytes");
    let half = (count / 2).to_string();
    let (code, report) = export("c.ply", &["--splats", &half]);
    assert_eq!(code, Some(0), "{report}");
    assert!(report["details"]["splats"].as_u64().expect("a number") <= count / 2);
    let (code, report) = export("d.spz", &["--require-psnr", "28"]);
    assert_eq!((code, &report["details"]["file_format"]), (Some(0), &"SPZ 3".into()), "{report}");
    assert!(5 * bytes("d.spz").len() < file.len(), "a fifth");
    let (code, report) = export("d.glb", &["--require-psnr", "28"]);
    let format = "KHR_gaussian_splatting".into();
    assert_eq!((code, &report["details"]["file_format"]), (Some(0), &format), "{report}");
    assert_eq!(report["picture_size"], serde_json::json!([64, 64]));
    for (output, more, expected) in [
        ("e.obj", &[][..], 2),
        ("e.ply", &["--splats", "0"][..], 2),
        ("e.ply", &["--to", "spz"], 2),
        ("a.ply", &[], 7),
    ] {
        assert_eq!(export(output, more).0, Some(expected), "{output} {more:?}");
    }
}
