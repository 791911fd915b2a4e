//! The glTF extension: schemas, findings, and the program's verbs on assets.

#![cfg(feature = "cli")]

use crate::common;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Output;

use crate::common::asset::{NAME, attached, changed, document, glb, parts};
use crate::common::{assert_schema, fixture, folder, program};
use jsonschema::Registry;
use mipvog_bake::unstable::app::check::{Report, check};
use mipvog_bake::unstable::base::finding::{Code, Severity};
use mipvog_bake::unstable::base::limits::Limits;
use mipvog_bake::unstable::output::gltf::attach::{AttachOptions, NodeChoice};
use mipvog_bake::unstable::output::gltf::mesh::meshes;
use serde_json::{Value, json};

const ONE: &str = "dvgo.mask.mipvog";
const SCHEMAS: &str = "formats/MIPVOG_radiance_field/schema";

fn schema(name: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(SCHEMAS).join(name);
    serde_json::from_slice(&std::fs::read(path).expect("a schema")).expect("JSON")
}

/// Errors of a value by a schema of the extension.
fn against(name: &str, value: &Value) -> Vec<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(SCHEMAS);
    let names = std::fs::read_dir(folder).expect("the schemas").flatten();
    let mut registry = Registry::new();
    for other in names.map(|entry| entry.file_name().to_string_lossy().into_owned()) {
        registry = registry.add(format!("json-schema:///{other}"), schema(&other)).expect("a name");
    }
    let registry = registry.prepare().expect("schemas that fit");
    let root = json!({ "$ref": format!("json-schema:///{name}") });
    let validator =
        jsonschema::options().with_registry(&registry).build(&root).expect("a valid schema");
    validator.iter_errors(value).map(|e| format!("{}: {e}", e.instance_path())).collect()
}

/// A sound asset of one field on a node with a mesh.
fn asset(here: &Path) -> Vec<u8> {
    let text = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "a", "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                        "min": [0.0, 0.0, 0.0], "max": [0.0, 0.0, 0.0] }],
        "buffers": [{ "byteLength": 36 }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
    });
    let plain = glb(&text.to_string(), &[(*b"BIN\0", vec![0; 36])]);
    let mut options = AttachOptions::default();
    options.node = Some(NodeChoice::Index(0));
    attached(here, &plain, ONE, &options).expect("attached")
}

fn field(document: &mut Value) -> &mut Value {
    &mut document["extensions"][NAME]["radianceFields"][0]
}

#[test]
fn what_is_written_is_valid_by_the_schemas() {
    let folder = folder();
    let external = {
        let mut options = AttachOptions::default();
        options.external = true;
        options
    };
    for name in [ONE, "tiny.code.mipvog", "tiny.rate.mipvog"] {
        for options in [AttachOptions::default(), external.clone()] {
            let asset = asset(folder.path());
            let asset = attached(folder.path(), &asset, name, &options).expect("attached");
            let document = document(&asset);
            let own = &document["extensions"][NAME];
            let errors = against(&format!("glTF.{NAME}.schema.json"), own);
            assert!(errors.is_empty(), "{name}: {errors:?}");
            for node in document["nodes"].as_array().expect("nodes") {
                let own = &node["extensions"][NAME];
                let errors = against(&format!("node.{NAME}.schema.json"), own);
                assert!(errors.is_empty(), "{name}: {errors:?}");
            }
        }
    }
}

#[test]
fn schemas_refuse_what_the_page_forbids() {
    let folder = folder();
    let good = document(&asset(folder.path()));
    let own = |document: &Value| {
        against(&format!("glTF.{NAME}.schema.json"), &document["extensions"][NAME])
    };
    assert!(own(&good).is_empty());
    let mut extended = good.clone();
    field(&mut extended)["extras"] = json!([1, { "a": null }]);
    field(&mut extended)["extensions"] = json!({ "EXT_x": {} });
    field(&mut extended)["levels"][0]["extras"] = json!("x");
    assert!(own(&extended).is_empty());
    type Change = &'static dyn Fn(&mut Value);
    let bad: [(&str, Change); 9] = [
        ("no fields", &|d| d["extensions"][NAME]["radianceFields"] = json!([])),
        ("both places", &|d| field(d)["uri"] = "x".into()),
        ("no place", &|d| drop(field(d).as_object_mut().map(|f| f.remove("bufferView")))),
        ("a type", &|d| field(d)["mimeType"] = "model/gltf+json".into()),
        ("a digest", &|d| field(d)["sha256"] = "AB".into()),
        ("a box", &|d| field(d)["min"] = json!([0, 0])),
        ("levels", &|d| field(d)["levels"] = json!([])),
        ("opacity", &|d| field(d)["opacity"]["interval"] = json!(0)),
        ("extensions", &|d| field(d)["extensions"] = json!({ "EXT_x": 1 })),
    ];
    for (case, change) in bad {
        let mut document = good.clone();
        change(&mut document);
        assert!(!own(&document).is_empty(), "{case} was taken");
    }
    assert!(
        !against(&format!("node.{NAME}.schema.json"), &json!({ "radianceField": -1 })).is_empty()
    );
}

#[test]
fn the_page_has_a_row_for_every_property() {
    let page = include_str!("../../formats/MIPVOG_radiance_field/README.md");
    for (heading, name) in [
        ("### Document\n", format!("glTF.{NAME}")),
        ("### Radiance field\n", "radianceField".to_owned()),
        ("### Level\n", "radianceField.level".to_owned()),
        ("### Opacity\n", "radianceField.opacity".to_owned()),
        ("### MLP\n", "radianceField.mlp".to_owned()),
        ("### Harmonics\n", "radianceField.harmonics".to_owned()),
        ("## Adding a field to a node\n", format!("node.{NAME}")),
    ] {
        let (_, section) = page.split_once(heading).expect("the heading is there");
        let section = section.split("\n#").next().unwrap_or_default();
        let rows: Vec<&str> = section.lines().filter(|line| line.starts_with("| **")).collect();
        let schema = schema(&format!("{name}.schema.json"));
        let properties = schema["properties"].as_object().expect("properties");
        let own: Vec<&String> = properties
            .keys()
            .filter(|name| !["extensions", "extras"].contains(&&***name))
            .collect();
        assert_eq!(rows.len(), own.len(), "{name}: {own:?}");
        for property in own {
            let row = rows.iter().find(|row| row.starts_with(&format!("| **{property}** |")));
            let row = row.unwrap_or_else(|| panic!("{name} has no row for {property}"));
            let required =
                schema["required"].as_array().expect("a list").contains(&json!(property));
            assert_eq!(row.ends_with("Yes |"), required, "{row}");
        }
    }
}

fn checked(bytes: &[u8], path: &Path) -> Report {
    std::fs::write(path, bytes).expect("writable");
    check(path, &Limits::default()).expect("a file that can be read")
}

#[test]
fn every_finding_of_an_asset_can_be_reached() {
    let folder = folder();
    let path = folder.path().join("x.glb");
    let good = asset(folder.path());
    assert!(checked(&good, &path).findings.is_empty());
    let mut reached = BTreeSet::new();
    let mut expect = |bytes: &[u8], code: &str, place: &str| {
        let report = checked(bytes, &path);
        let found = report.findings.iter().find(|finding| finding.code.name() == code);
        let found = found.unwrap_or_else(|| panic!("no {code} in {:?}", report.findings));
        assert!(found.place.contains(place), "{code} at {}, not {place}", found.place);
        assert_eq!(report.valid, report.findings.iter().all(|f| f.severity == Severity::Warning));
        reached.insert(code.to_owned());
    };
    let edit = |change: &dyn Fn(&mut Value)| changed(&good, change);
    let at = |key: &str| format!("/extensions/{NAME}/radianceFields/0{key}");
    expect(&good[..100], "asset", "file");
    expect(b"{\"asset\":{}}", "asset", "/asset/version");
    expect(b"{ nothing", "asset", "JSON");
    expect(&edit(&|d| d["nodes"][0]["mesh"] = json!(7)), "asset-rule", "/nodes/0/mesh");
    expect(&edit(&|d| d["accessors"][0]["count"] = json!("x")), "asset-rule", "JSON");
    expect(&edit(&|d| d["extensionsUsed"] = json!(["x"])), "extension-used", "/extensionsUsed");
    let required = edit(&|d| d["extensionsRequired"] = json!([NAME]));
    expect(&required, "extension-required", "/extensionsRequired/0");
    expect(&edit(&|d| field(d)["levels"] = json!(1)), "field-property", &at(""));
    expect(&edit(&|d| field(d)["mimeType"] = json!("a/b")), "field-property", &at("/mimeType"));
    expect(&edit(&|d| field(d)["uri"] = json!("a")), "field-source", &at(""));
    expect(&edit(&|d| field(d)["bufferView"] = json!(2)), "field-source", &at("/bufferView"));
    let long = edit(&|d| d["bufferViews"][1]["byteLength"] = json!(1u64 << 40));
    expect(&long, "field-source", "/bufferViews/1");
    for name in ["target", "byteStride"] {
        let vertices = edit(&|d| d["bufferViews"][1][name] = json!(34962));
        expect(&vertices, "field-source", &format!("/bufferViews/1/{name}"));
    }
    let missing = edit(&|d| {
        field(d).as_object_mut().expect("a field").remove("bufferView");
        field(d)["uri"] = json!("missing.mipvog");
    });
    expect(&missing, "field-missing", "");
    for (key, value) in [
        ("min", json!([-9, -9, -9])),
        ("max", json!([9, 9, 9])),
        ("dimensions", json!([9, 9, 9])),
        ("blockSize", json!(7)),
        ("featureCount", json!(9)),
        ("opacity", json!({ "order": "raw", "shift": 0.5, "interval": 0.5 })),
        ("mlp", json!({ "widths": [1, 3], "frequencies": 0, "input": "features" })),
        ("levels", json!([{ "dimensions": [2, 2, 2], "blockSize": 8, "byteLength": 64 }])),
    ] {
        let other = edit(&|d| field(d)[key] = value.clone());
        expect(&other, "field-metadata", &at(&format!("/{key}")));
    }
    let short = edit(&|d| field(d)["levels"][0]["byteLength"] = json!(64));
    expect(&short, "field-metadata", &at("/levels"));
    expect(&edit(&|d| field(d)["sha256"] = json!("00")), "field-hash", &at("/sha256"));
    let dangling = edit(&|d| d["nodes"][0]["extensions"][NAME]["radianceField"] = json!(5));
    expect(&dangling, "field-node", "/nodes/0/extensions");
    expect(&dangling, "field-unused", &at(""));
    let bare = edit(&|d| drop(d["nodes"][0].as_object_mut().map(|node| node.remove("mesh"))));
    expect(&bare, "field-fallback", "/nodes/0");
    // A fault of the container within has its place there, in bytes of the asset.
    let (text, mut chunks) = parts(&good);
    let last = chunks[0].1.len() - 100;
    chunks[0].1[last] ^= 1;
    let damaged = glb(&text, &chunks);
    let chunk = damaged.len() - chunks[0].1.len();
    expect(&damaged, "chunk-checksum", &format!("{}, container at byte {}", at(""), chunk + 64));
    expect(&damaged, "field-hash", &at("/sha256"));
    chunks[0].1[64 + 8] = 9;
    expect(&glb(&text, &chunks), "header", &format!("byte {}", chunk + 64 + 8));
    let own = Code::ALL.iter().map(|code| code.name());
    let own: BTreeSet<_> =
        own.filter(|n| ["asset", "extension", "field"].iter().any(|p| n.starts_with(p))).collect();
    let missed: Vec<_> = own.iter().filter(|name| !reached.contains(**name)).collect();
    assert!(missed.is_empty(), "{missed:?}");
}

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
    let container = common::open_bytes(&std::fs::read(here.join("a.mipvog")).expect("written"));
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
        (vec!["attach", "plain.gltf", &one, "-o", "x.glb"], 2, "stays one"),
        (vec!["attach", "text.gltf", &one, "-o", "x.gltf"], 3, "text.gltf"),
        (vec!["attach", "next.gltf", &one, "-o", "x.gltf"], 4, "glTF 3.0"),
        (vec!["attach", "missing.gltf", &one, "-o", "x.gltf"], 5, "missing.gltf"),
        (vec!["attach", "plain.gltf", "text.gltf", "-o", "x.gltf"], 3, "text.gltf"),
        (vec!["detach", "plain.gltf", "-o", "x.gltf"], 2, "0 radiance fields"),
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
