//! Khronos' validator, glTF-Transform and three.js take written assets for sound glTF.
//!
//! Needs node 20 and `npm ci --prefix tests/gltf`.

use std::path::Path;
use std::process::Command;

use crate::common::{baked_bytes, field, fixture, folder, others, root};
use mipvog::bake::BakeOptions;
use serde_json::json;

fn run(here: &Path, arguments: &[&str]) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"));
    let output = command.current_dir(here).args(arguments).arg("--quiet").output().expect("starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn other_programs_take_what_is_written() {
    let Some(mut check) = others::node() else { return };
    let folder = folder();
    let here = folder.path();
    let scene = fixture("trained/lego64/fine_last.tar").display().to_string();
    let bake = ["bake", &scene, "--stepsize", "0.5"];
    for (container, asset, more) in [
        ("a.mipvog", "a.glb", &["--fallback-triangles", "3000"][..]),
        ("a.mipvog", "a.gltf", &[]),
        ("a.mipvog", "lods.glb", &["--fallback-triangles", "2000", "--fallback-lods", "3"]),
        ("a.mipvog", "outside.glb", &["--external"]),
        ("b.mipvog", "small.glb", &["--fallback-triangles", "4", "--levels", "1"]),
        ("c.mipvog", "code.gltf", &["--filter", "code"]),
    ] {
        run(here, &[&bake[..], &["-o", container, "--force", "--gltf", asset], more].concat());
    }
    let empty = field([9; 3], &[-100.0; 729], &[0.0; 3 * 729]);
    let empty = baked_bytes(&empty, &BakeOptions::default()).expect("a container");
    std::fs::write(here.join("empty.mipvog"), empty).expect("writable");
    run(here, &["unpack", "empty.mipvog", "-o", "empty.safetensors"]);
    run(here, &["bake", "empty.safetensors", "-o", "e.mipvog", "--gltf", "empty.glb"]);
    run(here, &["detach", "a.glb", "-o", "bare.glb"]);
    run(here, &["attach", "bare.glb", "a.mipvog", "--node", "0", "-o", "again.glb"]);
    run(here, &["attach", "again.glb", "e.mipvog", "-o", "two.glb"]);
    run(here, &["detach", "two.glb", "--field", "0", "-o", "second.glb"]);
    let read = |name: &str| std::fs::read(here.join(name)).expect("written");
    assert!(read("a.glb") == read("again.glb"));
    let tiny = fixture("baked/tiny.rate.f16.mipvog").display().to_string();
    for name in ["splats.glb", "splats.gltf"] {
        let small = ["--splats", "500", "--turntable", "8", "--size", "64"];
        run(here, &[&["export", &tiny, "--to", "splat", "-o", name][..], &small].concat());
    }
    // An asset without anything but a node, and without a scene.
    for (name, document) in [
        ("node", json!({ "asset": { "version": "2.0" }, "nodes": [{ "name": "n" }] })),
        ("nothing", json!({ "asset": { "version": "2.0" } })),
    ] {
        let (plain, out) = (format!("{name}.plain.gltf"), format!("{name}.gltf"));
        std::fs::write(here.join(&plain), document.to_string()).expect("writable");
        run(here, &["attach", &plain, "a.mipvog", "-o", &out]);
    }
    check.current_dir(here).arg(root().join("tests/gltf/check.mjs"));
    let names = [
        "a.glb",
        "a.gltf",
        "lods.glb",
        "outside.glb",
        "small.glb",
        "code.gltf",
        "empty.glb",
        "bare.glb",
        "two.glb",
        "second.glb",
        "node.gltf",
        "nothing.gltf",
        "splats.glb",
        "splats.gltf",
    ];
    let output = check.args(names).output().expect("starts");
    let says = [output.stdout, output.stderr].map(|o| String::from_utf8_lossy(&o).into_owned());
    assert!(output.status.success(), "{}", says.concat());
    assert_eq!(says[0].lines().count(), names.len());
}
