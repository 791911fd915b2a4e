//! Assets of others as `attach`, `detach` and `validate` meet them: numbers as floats, marks before
//! the text, things that glTF lets a document leave out.

use std::path::Path;
use std::process::Output;

use crate::common::{fixture, folder, program};
use serde_json::{Value, json};

fn run(here: &Path, arguments: &[&str]) -> Output {
    program().current_dir(here).args(arguments).output().expect("starts")
}

fn succeed(here: &Path, arguments: &[&str]) {
    let output = run(here, arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {errors}");
}

/// The findings of a file that is valid or not.
fn findings(here: &Path, name: &str) -> Vec<Value> {
    let output = run(here, &["validate", name, "--format", "json"]);
    let report: Value = serde_json::from_slice(&output.stdout).expect("a report");
    report["findings"].as_array().expect("findings").clone()
}

/// A triangle; `number` makes the text of whole numbers.
fn triangle(number: impl Fn(u32) -> String, more: &str) -> String {
    let n = |value| number(value);
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":{zero},"scenes":[{{"nodes":[{zero}]}}],
"nodes":[{{"mesh":{zero}}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":{zero}}}}}]}}],
"accessors":[{{"bufferView":{zero},"byteOffset":{zero},"componentType":{float},"count":{three},
"type":"VEC3","min":[0,0,0],"max":[0,0,0]}}],
"bufferViews":[{{"buffer":{zero},"byteOffset":{zero},"byteLength":{bytes}}}],
"buffers":[{{"byteLength":{bytes},"uri":"data:application/octet-stream;base64,{data}"}}]{more}}}"#,
        zero = n(0),
        three = n(3),
        float = n(5126),
        bytes = n(36),
        data = "A".repeat(48),
    )
}

#[test]
fn what_attach_takes_detach_takes_apart() {
    let folder = folder();
    let here = folder.path();
    std::fs::copy(fixture("baked/tiny.rate.mipvog"), here.join("a.mipvog")).expect("copied");
    let whole = |value: u32| value.to_string();
    let float = |value: u32| format!("{value}.0");
    let documents = [
        triangle(whole, ""),
        triangle(float, ""),
        triangle(float, r#","extras":{"far":1e400,"bufferView":0.5}"#),
        format!("\u{feff}{}", triangle(whole, "")),
    ];
    for document in documents {
        std::fs::write(here.join("asset.gltf"), &document).expect("writable");
        assert_eq!(findings(here, "asset.gltf"), Vec::<Value>::new(), "{document}");
        succeed(here, &["attach", "asset.gltf", "a.mipvog", "-o", "with.gltf", "--force"]);
        succeed(here, &["detach", "with.gltf", "-o", "without.gltf", "--force"]);
        let text = std::fs::read_to_string(here.join("without.gltf")).expect("an asset");
        // The numbers are spelled as they were.
        let spelled = |text: &str| text.matches("5126.0").count();
        assert_eq!(spelled(&text), spelled(&document));
        assert!(!text.contains("MIPVOG_radiance_field"), "{text}");
    }
}

#[test]
fn sound_assets_have_no_findings() {
    let folder = folder();
    let here = folder.path();
    let asset = json!({ "version": "2.0" });
    let sound = [
        // Zeros.
        json!({ "asset": asset, "accessors": [{ "componentType": 5126, "count": 2, "type": "VEC3" }] }),
        // A picture that an extension names.
        json!({ "asset": asset, "textures": [{ "extensions": { "EXT_texture_webp": { "source": 0 } } }],
                "images": [{ "uri": "a.webp" }], "extensionsUsed": ["EXT_texture_webp"] }),
        json!({ "asset": asset, "textures": [{}] }),
        // A scene without nodes.
        json!({ "asset": asset, "scene": 0, "scenes": [{ "name": "empty" }] }),
        // A channel whose target is an extension's.
        json!({ "asset": asset,
                "accessors": [{ "componentType": 5126, "count": 1, "type": "SCALAR", "min": [0], "max": [0] },
                              { "componentType": 5126, "count": 1, "type": "VEC3" }],
                "animations": [{ "samplers": [{ "input": 0, "output": 1 }], "channels": [{ "sampler": 0,
                    "target": { "path": "pointer", "extensions": { "KHR_animation_pointer":
                        { "pointer": "/nodes/0/translation" } } } }] }],
                "extensionsUsed": ["KHR_animation_pointer"] }),
    ];
    for document in sound {
        std::fs::write(here.join("asset.gltf"), document.to_string()).expect("writable");
        assert_eq!(findings(here, "asset.gltf"), Vec::<Value>::new(), "{document}");
    }
    let broken = [
        (
            json!({ "asset": asset, "nodes": [{ "children": [1] }, { "children": [2] }, { "children": [1] }] }),
            "/nodes/1/children",
        ),
        (json!({ "asset": asset, "extensionsRequired": ["KHR_x"] }), "/extensionsUsed"),
        (
            json!({ "asset": asset, "buffers": [{ "byteLength": 3, "uri": "data:;base64,AAA" }] }),
            "/buffers/0/uri",
        ),
        (
            json!({ "asset": asset, "buffers": [{ "byteLength": 4, "uri": "data:;base64,AAAA" }] }),
            "/buffers/0/uri",
        ),
    ];
    for (document, place) in broken {
        std::fs::write(here.join("asset.gltf"), document.to_string()).expect("writable");
        let found = findings(here, "asset.gltf");
        assert!(found.len() == 1 && found[0]["place"] == format!("JSON {place}"), "{found:?}");
    }
    // What is wrong is still found, in words that say what is expected.
    let wrong = json!({ "asset": asset, "scene": 3, "scenes": [{ "nodes": [7] }] });
    std::fs::write(here.join("asset.gltf"), wrong.to_string()).expect("writable");
    let found = findings(here, "asset.gltf");
    assert_eq!(found.len(), 2, "{found:?}");
    let message = found[0]["message"].as_str().expect("words");
    assert!(message.contains("an index in range"), "{message}");
}
