//! The glTF extension: schemas and findings.

use std::collections::BTreeSet;
use std::path::Path;

use crate::common::asset::{NAME, attached, changed, document, glb, parts};
use crate::common::{Schema, folder};
use mipvog::base::finding::{Code, Severity};
use mipvog::base::limits::Limits;
use mipvog_bake::check::{Report, check};
use mipvog_outputs::gltf::attach::{AttachOptions, NodeChoice};
use serde_json::{Value, json};

const ONE: &str = "dvgo.mask.mipvog";
const SCHEMAS: &str = "formats/MIPVOG_radiance_field/schema";

fn schema(name: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(SCHEMAS).join(name);
    serde_json::from_slice(&std::fs::read(path).expect("a schema")).expect("JSON")
}

/// What is wrong with a value by a schema of the extension.
fn against(name: &str, value: &Value) -> Option<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(SCHEMAS);
    let names = std::fs::read_dir(folder).expect("the schemas").flatten();
    let names = names.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let address = |name: String| (format!("json-schema:///{name}"), schema(&name));
    let all = std::iter::once(name.to_owned()).chain(names).map(address);
    Schema::new(all).error(value)
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
    let options = AttachOptions { node: Some(NodeChoice::Index(0)), ..AttachOptions::default() };
    attached(here, &plain, ONE, &options).expect("attached")
}

fn field(document: &mut Value) -> &mut Value {
    &mut document["extensions"][NAME]["radianceFields"][0]
}

#[test]
fn what_is_written_is_valid_by_the_schemas() {
    let folder = folder();
    let external = { AttachOptions { external: true, ..AttachOptions::default() } };
    for name in [ONE, "tiny.code.mipvog", "tiny.rate.mipvog"] {
        for options in [AttachOptions::default(), external.clone()] {
            let asset = asset(folder.path());
            let asset = attached(folder.path(), &asset, name, &options).expect("attached");
            let document = document(&asset);
            let own = &document["extensions"][NAME];
            let errors = against(&format!("glTF.{NAME}.schema.json"), own);
            assert_eq!(errors, None, "{name}");
            for node in document["nodes"].as_array().expect("nodes") {
                let own = &node["extensions"][NAME];
                let errors = against(&format!("node.{NAME}.schema.json"), own);
                assert_eq!(errors, None, "{name}");
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
    assert_eq!(own(&good), None);
    let mut extended = good.clone();
    field(&mut extended)["extras"] = json!([1, { "a": null }]);
    field(&mut extended)["extensions"] = json!({ "EXT_x": {} });
    field(&mut extended)["levels"][0]["extras"] = json!("x");
    assert_eq!(own(&extended), None);
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
        assert!(own(&document).is_some(), "{case} was taken");
    }
    assert!(
        against(&format!("node.{NAME}.schema.json"), &json!({ "radianceField": -1 })).is_some()
    );
}

#[test]
fn the_page_has_a_row_for_every_property() {
    let page = include_str!("../../../formats/MIPVOG_radiance_field/README.md");
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
