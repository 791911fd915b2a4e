//! Findings in the radiance fields of a glTF asset and in their containers, which general glTF
//! validators cannot check.

use std::sync::Arc;

use gltf::json::mesh::Semantic;
use gltf::json::validation::{Checked, Error as RuleError, Validate};
use gltf::json::{Index, Root};
use serde_json::{Value, json};

use super::document;
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::finding::{Code, Finding, Report, checked};
use crate::base::limits::Limits;
use mipvog_outputs::gltf::asset::{Asset, Fields, rules};

/// Reports all faults of an asset.
pub fn check(file: Arc<SourceFile>, limits: &Limits, report: &mut Report) -> Result<()> {
    let Some(asset) = checked(Asset::open(file, limits), Code::Asset, report)? else {
        return Ok(());
    };
    general_rules(&asset, report)?;
    let root = asset.document().and_then(|root| root.members());
    let Some(root) = checked(root, Code::Asset, report)? else { return Ok(()) };
    let fields = Fields::read(&asset, &root);
    let Some(fields) = checked(fields, Code::Asset, report)? else { return Ok(()) };
    // An unreadable rule is a fault of the document.
    checked(rules::document(&asset, &root, &fields, report), Code::Asset, report)?;
    for object in &fields.objects {
        let opened = checked(rules::field(&asset, &root, object, report), Code::Asset, report)?;
        let Some((container, offset)) = opened.flatten() else { continue };
        checked(rules::digest(object, &container, report), Code::Asset, report)?;
        rules::within(object, offset, report, |report| {
            checked(container.check_contents(report), Code::File, report).map(|_| ())
        })?;
    }
    Ok(())
}

/// Reports and replaces invalid references to vertex positions: the library's rules follow
/// references unchecked.
fn positions(root: &mut Root, report: &mut Report) -> Result<()> {
    let accessors = root.accessors.len();
    let name = Checked::Valid(Semantic::Positions);
    for (i, mesh) in root.meshes.iter_mut().enumerate() {
        for (j, primitive) in mesh.primitives.iter_mut().enumerate() {
            let Some(index) = primitive.attributes.get_mut(&name) else { continue };
            if index.value() < accessors {
                continue;
            }
            let pointer = format!("/meshes/{i}/primitives/{j}/attributes/POSITION");
            let found = format!("accessor {}", index.value());
            let expected = format!("one of {accessors} from 0");
            let error = Error::malformed(Place::Pointer(pointer), found, expected);
            report(Finding { code: Code::AssetRule, error })?;
            *index = Index::new(0);
            if accessors == 0 {
                primitive.attributes.remove(&name);
            }
        }
    }
    Ok(())
}

/// True for values that glTF makes optional and the library requires: an accessor without a view is
/// all zeros, and a texture's source can be in an extension.
fn may_be_missing(pointer: &str) -> bool {
    let parts: Vec<&str> = pointer.split('/').skip(1).collect();
    matches!(*parts, ["accessors", _, "bufferView"] | ["textures", _, "source"])
}

/// Rewrites a document for the library, which requires integers written as integers, node lists in
/// scenes and nodes in channel targets. glTF 2.0 allows other forms. A target without a node
/// belongs to an extension.
fn in_plain_words(value: &mut Value) {
    let has_nodes = value.pointer("/nodes/0").is_some();
    let animations = value.get_mut("animations").and_then(Value::as_array_mut);
    for animation in animations.into_iter().flatten() {
        let Some(channels) = animation.get_mut("channels").and_then(Value::as_array_mut) else {
            continue;
        };
        let others = |channel: &Value| channel.pointer("/target/node").is_none();
        if has_nodes {
            for channel in channels.iter_mut().filter(|channel| others(channel)) {
                channel["target"] = json!({ "node": 0, "path": "translation" });
            }
        } else {
            channels.retain(|channel| !others(channel));
        }
    }
    let scenes = value.get_mut("scenes").and_then(Value::as_array_mut);
    for scene in scenes.into_iter().flatten().filter_map(Value::as_object_mut) {
        scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
    }
    whole_numbers(value);
}

fn whole_numbers(value: &mut Value) {
    match value {
        Value::Array(elements) => elements.iter_mut().for_each(whole_numbers),
        Value::Object(members) => members.values_mut().for_each(whole_numbers),
        Value::Number(number) if number.is_f64() => {
            let whole = number.as_f64().filter(|float| float.fract() == 0.0 && float.abs() < 1e15);
            if let Some(whole) = whole {
                #[expect(clippy::cast_possible_truncation, reason = "a whole number in range")]
                let whole = whole as i64;
                *value = whole.into();
            }
        }
        _ => {}
    }
}

/// Checks those rules of glTF 2.0 that do not depend on extensions.
fn general_rules(asset: &Asset, report: &mut Report) -> Result<()> {
    let broken = |pointer: String, found: String, expected: &str, report: &mut Report| {
        let error = Error::malformed(Place::Pointer(pointer), found, expected);
        report(Finding { code: Code::AssetRule, error })
    };
    if let Some(behind) = asset.chunks().map(|chunks| chunks.behind).filter(|behind| *behind > 0) {
        let found = format!("{behind} bytes after the stated end");
        broken(String::new(), found, "none: they belong to nothing", report)?;
    }
    // Numbers that no type can represent, such as 1e400, are not faults of references.
    let Ok(mut document) = serde_json::from_str::<Value>(asset.text()) else { return Ok(()) };
    document::check(asset, &document, report)?;
    in_plain_words(&mut document);
    let mut root = match serde_json::from_value::<Root>(document) {
        Ok(root) => root,
        Err(error) => {
            let found = format!("invalid properties: {error}");
            return broken(String::new(), found, "valid glTF 2.0 JSON", report);
        }
    };
    positions(&mut root, report)?;
    let mut reported = Ok(());
    let mut add = |path: &dyn Fn() -> gltf::json::Path, rule| {
        let pointer = path().to_string().replace(['.', '['], "/").replace(']', "");
        let pointer = format!("/{pointer}");
        let (found, expected) = match rule {
            // Viewers check required extensions.
            RuleError::Unsupported => return,
            RuleError::Missing if may_be_missing(&pointer) => return,
            RuleError::Missing => ("no value", "one"),
            RuleError::IndexOutOfBounds => ("an index out of range", "an index in range"),
            _ => ("a value that glTF 2.0 does not know", "one of those in its specification"),
        };
        if reported.is_ok() {
            let error = Error::malformed(Place::Pointer(pointer), found, expected);
            reported = report(Finding { code: Code::AssetRule, error });
        }
    };
    root.validate(&root, gltf::json::Path::new, &mut add);
    reported
}
