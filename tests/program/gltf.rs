//! Verbs on glTF assets.

use std::path::Path;
use std::process::Output;

use crate::common::asset::{NAME, document};
use crate::common::{assert_schema, fixture, folder, open_bytes, program};
use mipvog_outputs::gltf::mesh::meshes;
use serde_json::{Value, json};

const ONE: &str = "dvgo.mask.mipvog";

fn run(folder: &Path, arguments: &[&str]) -> Output {
    program().current_dir(folder).args(arguments).output().expect("starts")
}

/// Runs the program, which must succeed, and holds its report to the verb's schema.
fn report(folder: &Path, arguments: &[&str]) -> Value {
    let output = run(folder, &[arguments, &["--format", "json"]].concat());
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {stderr}");
    let report: Value = serde_json::from_slice(&output.stdout).expect("one JSON document");
    assert_schema(arguments[0], &report);
    report
}

#[test]
fn verbs_take_assets_where_they_take_containers() {
    let folder = folder();
    let here = folder.path();
    let scene = fixture("trained/tiny/fine_last.tar").display().to_string();
    let bake = ["bake", &scene, "-o", "a.mipvog", "--force"];
    let mesh = ["--fallback-triangles", "500"];
    let baked = report(here, &[&bake[..], &["--gltf", "a.glb"], &mesh].concat());
    let bytes = std::fs::metadata(here.join("a.glb")).expect("written").len();
    assert_eq!(baked["gltf"]["output_bytes"], bytes);
    assert!(baked["gltf"]["triangles"].as_u64().is_some_and(|n| (4..=500).contains(&n)));
    report(here, &[&bake[..], &["--gltf", "b.gltf"], &mesh].concat());
    report(here, &[&bake[..], &["--gltf", "c.glb", "--external"], &mesh].concat());
    let container = report(here, &["inspect", "a.mipvog"]);
    report(here, &["unpack", "a.mipvog", "-o", "a.safetensors"]);
    let read = |name: &str| std::fs::read(here.join(name)).expect("written");
    let camera = ["--turntable", "1", "--size", "24x24"];
    report(here, &[&["render", "a.mipvog", "-o", "container"], &camera[..]].concat());
    for (asset, kind) in [("a.glb", "glb"), ("b.gltf", "gltf"), ("c.glb", "glb")] {
        assert_eq!(report(here, &["validate", asset])["findings"], json!([]), "{asset}");
        let inspect = report(here, &["inspect", asset]);
        assert_eq!((&inspect["kind"], &inspect["fields"][0]["nodes"]), (&kind.into(), &json!([0])));
        for key in ["levels", "metadata", "chunks", "mlp", "file_bytes"] {
            assert_eq!(inspect["fields"][0][key], container[key], "{asset}: {key}");
        }
        report(here, &["unpack", asset, "-o", "b.safetensors", "--force"]);
        assert!(read("a.safetensors") == read("b.safetensors"), "{asset}");
        report(here, &[&["render", asset, "-o", "asset", "--force"], &camera[..]].concat());
        for entry in std::fs::read_dir(here.join("container")).expect("pictures").flatten() {
            let name = entry.file_name();
            let picture = std::fs::read(here.join("asset").join(&name)).expect("the same name");
            assert!(std::fs::read(entry.path()).expect("a picture") == picture, "{asset}");
        }
    }
    let compare =
        report(here, &[&["compare", "a.mipvog", "a.glb", "--scales", "1"], &camera[..]].concat());
    assert_eq!(compare["scales"][0]["max_abs"], 0.0);
    // The asset without the field, and with it again.
    let detach = report(here, &["detach", "a.glb", "-o", "bare.glb"]);
    assert_eq!((&detach["fields"], &detach["left"]), (&json!([0]), &json!(0)));
    let attach = report(here, &["attach", "bare.glb", "a.mipvog", "--node", "0", "-o", "d.glb"]);
    assert_eq!((&attach["field"], &attach["embedded"]), (&json!(0), &json!(true)));
    assert!(read("d.glb") == read("a.glb"));
    let other = fixture("baked").join(ONE).display().to_string();
    report(here, &["attach", "d.glb", &other, "-o", "two.glb"]);
    let second = report(here, &["unpack", "two.glb", "--field", "1", "-o", "two.safetensors"]);
    let first = report(here, &["unpack", &other, "-o", "one.safetensors"]);
    assert_eq!(first["levels"], second["levels"]);
    assert!(read("one.safetensors") == read("two.safetensors"));
    // The files that an asset names do not move with it; the output names them from its own folder.
    std::fs::create_dir(here.join("deep er")).expect("writable");
    let moved = ["attach", "b.gltf", &other, "-o", "deep er/b.gltf"];
    let output = run(here, &moved);
    let warning = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && warning.contains("too: a.mipvog\n"), "{warning}");
    let fields = document(&read("deep er/b.gltf"))["extensions"][NAME]["radianceFields"].clone();
    assert!(fields[1]["uri"].as_str().is_some_and(|uri| uri.starts_with("../")), "{fields}");
    let second = ["unpack", "deep er/b.gltf", "--field", "1", "-o", "c.safetensors"];
    report(here, &second);
    assert!(read("c.safetensors") == read("one.safetensors"));
    let output = run(here, &["detach", "deep er/b.gltf", "-o", "b.gltf", "--force"]);
    assert!(output.status.success() && output.stderr.is_empty());
    std::fs::remove_file(here.join("a.mipvog")).expect("a file");
    let failed = run(here, &["validate", "c.glb"]);
    assert_eq!(failed.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&failed.stdout).contains("field-missing"));
}

#[test]
fn an_independent_reader_finds_the_mesh() {
    let folder = folder();
    let here = folder.path();
    let scene = fixture("trained/tiny/fine_last.tar").display().to_string();
    let lods = ["--fallback-triangles", "400", "--fallback-lods", "2"];
    let bake = ["bake", &scene, "-o", "a.mipvog", "--gltf", "a.glb"];
    let baked = report(here, &[&bake[..], &lods].concat());
    let container = open_bytes(&std::fs::read(here.join("a.mipvog")).expect("written"));
    let meshes = meshes(&container.expect("a container"), 400, 2).expect("meshes");
    let counts: Vec<usize> = meshes.iter().map(|mesh| mesh.triangles.len()).collect();
    assert_eq!(counts.len(), 3);
    assert!(counts.windows(2).all(|pair| 4 * pair[1] <= pair[0]), "{counts:?}");
    assert_eq!(baked["gltf"]["triangles"], counts[0]);
    assert_eq!(baked["gltf"]["coarser_triangles"], json!(counts[1..]));
    let bytes = std::fs::read(here.join("a.glb")).expect("written");
    // Validates the crate's own rules of glTF, too.
    let asset = gltf::Gltf::from_slice(&bytes).expect("a valid asset");
    let node = asset.default_scene().and_then(|scene| scene.nodes().next()).expect("a node");
    let extension = |node: &gltf::Node, name: &str| node.extension_value(name).cloned();
    assert_eq!(extension(&node, "MSFT_lod"), Some(json!({ "ids": [1, 2] })));
    assert!(extension(&node, NAME).is_some());
    assert_eq!(asset.default_scene().map(|scene| scene.nodes().count()), Some(1));
    for (node, mesh) in asset.nodes().zip(&meshes) {
        let primitive = node.mesh().and_then(|mesh| mesh.primitives().next());
        let primitive = primitive.expect("a primitive");
        let reader = primitive.reader(|_| asset.blob.as_deref());
        let positions: Vec<[f32; 3]> = reader.read_positions().expect("positions").collect();
        assert_eq!(positions, mesh.positions);
        let indices: Vec<u32> = reader.read_indices().expect("indices").into_u32().collect();
        assert_eq!(indices, mesh.triangles.as_flattened());
        let colors = reader.read_colors(0).expect("colours").into_rgb_f32();
        for (found, wanted) in colors.zip(&mesh.colors) {
            for (found, wanted) in found.iter().zip(wanted) {
                assert!((f64::from(*found) - wanted).abs() < 1.0 / 65535.0);
            }
        }
        let bounds = primitive.bounding_box();
        assert_eq!([bounds.min, bounds.max], mesh.extent());
        // Training's z, up there, is y here; x stays.
        let rotation = node.transform().matrix();
        let turned = |axis: usize| [0, 1, 2].map(|row| rotation[axis][row].round());
        assert_eq!([turned(0), turned(2)], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    }
}

#[test]
fn what_cannot_be_has_its_exit_code() {
    let folder = folder();
    let here = folder.path();
    let scene = fixture("trained/tiny/fine_last.tar").display().to_string();
    let one = fixture("baked").join(ONE).display().to_string();
    std::fs::write(here.join("plain.gltf"), "{\"asset\":{\"version\":\"2.0\"}}").expect("writable");
    std::fs::write(here.join("next.gltf"), "{\"asset\":{\"version\":\"3.0\"}}").expect("writable");
    std::fs::write(here.join("text.gltf"), "{ no").expect("writable");
    std::fs::write(here.join("taken.glb"), "mine").expect("writable");
    let bake = ["bake", &scene, "-o", "x.mipvog", "--gltf"];
    let cases: [(Vec<&str>, i32, &str); 14] = [
        ([&bake[..], &["x.obj"]].concat(), 2, ".glb or .gltf"),
        ([&bake[..], &["taken.glb"]].concat(), 7, "--force"),
        ([&bake[..], &["x.mipvog"]].concat(), 2, "x.mipvog"),
        ([&bake[..], &["x.glb", "--fallback-triangles", "3"]].concat(), 2, "--fallback-triangles"),
        (vec!["bake", &scene, "-o", "x.mipvog", "--external"], 2, "--gltf"),
        (vec!["attach", "plain.gltf", &one, "-o", "x.gltf", "--node", "0"], 2, "--node"),
        (vec!["attach", "plain.gltf", &one, "-o", "x.glb"], 2, "must be one, too"),
        (vec!["attach", "text.gltf", &one, "-o", "x.gltf"], 3, "text.gltf"),
        (vec!["attach", "next.gltf", &one, "-o", "x.gltf"], 4, "glTF 3.0"),
        (vec!["attach", "missing.gltf", &one, "-o", "x.gltf"], 5, "missing.gltf"),
        (vec!["attach", "plain.gltf", "text.gltf", "-o", "x.gltf"], 3, "text.gltf"),
        (vec!["detach", "plain.gltf", "-o", "x.gltf"], 2, "no radiance field"),
        (vec!["render", "plain.gltf", "-o", "x", "--turntable", "1"], 3, "radiance fields"),
        (vec!["unpack", &scene, "-o", "x.safetensors"], 3, "container"),
    ];
    for (arguments, code, says) in cases {
        let output = run(here, &arguments);
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
        assert!(message.contains(says), "{arguments:?}: {message}");
        assert!(!message.contains("panicked"), "{message}");
        let mut left: Vec<_> =
            std::fs::read_dir(here).expect("a folder").flatten().map(|e| e.file_name()).collect();
        left.sort();
        assert_eq!(left, ["next.gltf", "plain.gltf", "taken.glb", "text.gltf"], "{arguments:?}");
    }
}
