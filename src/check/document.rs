//! Rules of glTF 2.0 that the library does not check: required extensions that are not used, cycles
//! of nodes, URIs without data.

use serde_json::Value;

use crate::base::error::{Error, Place, Result};
use crate::base::finding::{Code, Finding, Report};
use mipvog_outputs::gltf::asset::{Asset, uri};

/// Reports violations of these rules.
pub fn check(asset: &Asset, document: &Value, report: &mut Report) -> Result<()> {
    let mut broken = |error| report(Finding { code: Code::AssetRule, error });
    let names = |key: &str| elements(document, key).filter_map(Value::as_str).collect::<Vec<_>>();
    let used = names("extensionsUsed");
    for name in names("extensionsRequired") {
        if !used.contains(&name) {
            let place = Place::Pointer("/extensionsUsed".to_owned());
            let found = "other names than extensionsRequired";
            broken(Error::malformed(place, found, format!("{name} among them")))?;
        }
    }
    for node in below_themselves(document) {
        let place = Place::Pointer(format!("/nodes/{node}/children"));
        broken(Error::malformed(place, "a node below itself", "a tree of nodes"))?;
    }
    for (number, buffer) in elements(document, "buffers").enumerate() {
        let Some(text) = buffer["uri"].as_str().filter(|text| uri::is_data(text)) else { continue };
        let place = Place::Pointer(format!("/buffers/{number}/uri"));
        let stated = buffer["byteLength"].as_u64().unwrap_or(0);
        match uri::open(text, asset.file().path(), &place) {
            Err(error) => broken(error)?,
            Ok(file) if file.length() < stated => {
                let found = format!("{} bytes", file.length());
                broken(Error::malformed(place, found, format!("the {stated} of byteLength")))?;
            }
            Ok(_) => {}
        }
    }
    Ok(())
}

fn elements<'a>(document: &'a Value, key: &str) -> impl Iterator<Item = &'a Value> {
    document.get(key).and_then(Value::as_array).into_iter().flatten()
}

/// One node of each cycle.
fn below_themselves(document: &Value) -> Vec<usize> {
    let index = |value: &Value| value.as_u64().and_then(|index| usize::try_from(index).ok());
    let children: Vec<Vec<usize>> = elements(document, "nodes")
        .map(|node| elements(node, "children").filter_map(index).collect())
        .collect();
    // Nodes that are started but not done are ancestors of the current one.
    let (mut is_begun, mut is_done) = (vec![false; children.len()], vec![false; children.len()]);
    let mut found = Vec::new();
    for root in 0..children.len() {
        let mut path = vec![(root, 0)];
        while let Some((node, next)) = path.pop() {
            if is_done[node] {
                continue;
            }
            is_begun[node] = true;
            let Some(&child) = children[node].get(next) else {
                is_done[node] = true;
                continue;
            };
            path.push((node, next + 1));
            match is_begun.get(child) {
                Some(true) if !is_done[child] => found.push(child),
                Some(false) => path.push((child, 0)),
                _ => {}
            }
        }
    }
    found
}
