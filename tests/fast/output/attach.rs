//! Fields go into any asset and out again, and nothing else changes.

use crate::ONE_IN;
use crate::common;
use crate::common::asset::{
    NAME, Written, attached, changed, container, detached, document, glb, open, parts,
};
use crate::common::{Random, folder};
use mipvog::base::error::ErrorKind;
use mipvog_outputs::gltf::attach::{AttachOptions, NodeChoice};
use serde_json::json;

const ONE: &str = "dvgo.mask.mipvog";
const TWO: &str = "dvgo.coverage.mipvog";

fn options(node: Option<NodeChoice>, external: bool) -> AttachOptions {
    let mut options = AttachOptions::default();
    (options.node, options.external) = (node, external);
    options
}

/// A small GLB of a node in a scene, with a mesh's bytes.
fn plain_glb() -> Vec<u8> {
    let text = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "a" }], "buffers": [{ "byteLength": 6 }],
        "bufferViews": [{ "buffer": 0, "byteLength": 6 }],
    });
    glb(&text.to_string(), &[(*b"BIN\0", vec![1, 2, 3, 4, 5, 6])])
}

#[test]
fn what_is_attached_and_detached_leaves_no_trace() {
    let folder = folder();
    let here = folder.path();
    for seed in (0..400).step_by(ONE_IN) {
        let mut random = Random::new(seed ^ 0xface);
        let is_glb = seed % 2 == 0;
        let mut written = Written::new(seed, is_glb);
        let asset = written.file(is_glb);
        let node = |random: &mut Random, used: &mut Vec<usize>| {
            let number = random.below(written.nodes + 1);
            if number == written.nodes || used.contains(&number) {
                return None;
            }
            used.push(number);
            let name = NodeChoice::Name(format!("node {number}"));
            let has_name = document(&asset)["nodes"][number]["name"].is_string();
            let by_name = has_name && random.below(2) == 0;
            Some(if by_name { name } else { NodeChoice::Index(number) })
        };
        let (mut longer, mut used) = (asset.clone(), Vec::new());
        let count = 1 + random.below(3);
        for name in [ONE, TWO, ONE].iter().take(count) {
            let options = options(node(&mut random, &mut used), random.below(3) == 0);
            longer = attached(here, &longer, name, &options)
                .unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        }
        let opened = open(&longer, &here.join("longer.asset")).expect("an asset");
        for (field, name) in [ONE, TWO, ONE].into_iter().take(count).enumerate() {
            let got = opened.open_field(field).unwrap_or_else(|e| panic!("seed {seed}: {e}"));
            assert_eq!(got.entries(), container(name).entries(), "seed {seed}");
        }
        // One after the other in any order, or all at once.
        let mut shorter = longer.clone();
        if random.below(2) == 0 {
            for left in (1..=count).rev() {
                shorter = detached(here, &shorter, Some(random.below(left)))
                    .unwrap_or_else(|error| panic!("seed {seed}: {error}"));
            }
        } else {
            shorter = detached(here, &longer, None).expect("fields to take out");
        }
        let (text, mut chunks) = parts(&shorter);
        let (wanted, mut wanted_chunks) = parts(&asset);
        assert_eq!(meaning(&text), meaning(&wanted), "seed {seed}");
        // Padding beyond the buffer's stated length has no meaning.
        let stated = document(&asset)["buffers"][0]["byteLength"].as_u64().unwrap_or(0) as usize;
        for chunks in [&mut chunks, &mut wanted_chunks] {
            for (_, bin) in chunks.iter_mut().filter(|(kind, _)| kind == b"BIN\0") {
                bin.truncate(stated.next_multiple_of(4));
            }
        }
        assert!(chunks == wanted_chunks, "seed {seed}: other chunks");
    }
}

/// A document with its order of keys and spelling of numbers, without white space and without lists
/// and objects that are empty and need not be there.
fn meaning(text: &str) -> String {
    let (mut spelled, mut in_text, mut escaped, mut in_number) =
        (String::new(), false, false, false);
    for letter in text.chars() {
        let is_number = !in_text && (letter.is_ascii_digit() || "+-.eE".contains(letter));
        // Letters of `true` and `false` are no exponents.
        let is_number = is_number && (in_number || letter.is_ascii_digit() || letter == '-');
        if is_number != in_number {
            spelled.push('"');
        }
        in_number = is_number;
        spelled.push(letter);
        in_text ^= letter == '"' && !escaped;
        escaped = in_text && letter == '\\' && !escaped;
    }
    let mut value: serde_json::Value = serde_json::from_str(&spelled).expect("JSON");
    let root = value.as_object_mut().expect("an object");
    for (list, key) in [("nodes", "extensions"), ("scenes", "nodes")] {
        for element in root.get_mut(list).and_then(|l| l.as_array_mut()).into_iter().flatten() {
            remove_empty(element.as_object_mut().expect("an object"), key);
        }
    }
    if let Some(extensions) = root.get_mut("extensions").and_then(|e| e.as_object_mut()) {
        if let Some(own) = extensions.get_mut(NAME).and_then(|own| own.as_object_mut()) {
            remove_empty(own, "radianceFields");
        }
        remove_empty(extensions, NAME);
    }
    if let Some(used) = root.get_mut("extensionsUsed").and_then(|used| used.as_array_mut()) {
        used.retain(|name| *name != NAME);
    }
    for key in ["nodes", "scenes", "buffers", "bufferViews", "extensionsUsed", "extensions"] {
        remove_empty(root, key);
    }
    value.to_string()
}

fn remove_empty(object: &mut serde_json::Map<String, serde_json::Value>, key: &str) {
    if [json!([]), json!({})].iter().any(|empty| object.get(key) == Some(empty)) {
        object.shift_remove(key);
    }
}

#[test]
fn a_compact_asset_comes_back_byte_for_byte() {
    let folder = folder();
    let here = folder.path();
    let of_this_program = std::fs::read(common::fixture("frozen").join("0.1/dvgo.glb"));
    for asset in [plain_glb()].into_iter().chain(of_this_program) {
        for external in [false, true] {
            let longer = attached(here, &asset, ONE, &options(None, external)).expect("attached");
            let document = document(&longer);
            let fields = document["extensions"][NAME]["radianceFields"].as_array();
            let last = fields.expect("fields").len() - 1;
            assert!(detached(here, &longer, Some(last)).expect("detached") == asset);
        }
    }
}

#[test]
fn a_field_that_goes_leaves_the_others_as_if_it_had_never_been() {
    let folder = folder();
    let here = folder.path();
    for seed in (0..60).step_by(ONE_IN) {
        let asset = Written::new(seed, true).file(true);
        let both = [ONE, TWO].iter().try_fold(asset.clone(), |asset, name| {
            attached(here, &asset, name, &AttachOptions::default())
        });
        let both = both.unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        let first = attached(here, &asset, ONE, &AttachOptions::default()).expect("attached");
        let second = attached(here, &asset, TWO, &AttachOptions::default()).expect("attached");
        assert!(detached(here, &both, Some(1)).expect("one left") == first, "seed {seed}");
        assert!(detached(here, &both, Some(0)).expect("one left") == second, "seed {seed}");
    }
}

#[test]
fn everything_else_stays_in_its_place() {
    let folder = folder();
    for seed in (0..200).step_by(ONE_IN) {
        let is_glb = seed % 2 == 0;
        let mut written = Written::new(seed, is_glb);
        let asset = written.file(is_glb);
        let longer = attached(folder.path(), &asset, ONE, &AttachOptions::default());
        let longer = longer.unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        let (before, after) = (document(&asset), document(&longer));
        for (name, value) in before.as_object().expect("an object") {
            match value.as_array().filter(|_| name != "scenes" && name != "buffers") {
                // Lists only grow.
                Some(list) => {
                    let grown = after[name].as_array().expect("a list");
                    assert_eq!(grown[..list.len()], list[..], "seed {seed}: {name}");
                }
                None if ["scenes", "buffers", "extensions"].contains(&name.as_str()) => {}
                None => assert_eq!(&after[name], value, "seed {seed}: {name}"),
            }
        }
        let names: Vec<&String> = before.as_object().expect("an object").keys().collect();
        let kept: Vec<&String> = after.as_object().expect("an object").keys().collect();
        assert_eq!(kept[..names.len()], names[..], "seed {seed}: another order of keys");
        let used = after["extensionsUsed"].as_array().expect("a list");
        assert_eq!(used.iter().filter(|name| **name == NAME).count(), 1);
        let (_, chunks) = parts(&longer);
        for (old, new) in parts(&asset)
            .1
            .iter()
            .filter(|(kind, _)| *kind != *b"BIN\0")
            .zip(chunks.iter().filter(|(kind, _)| *kind != *b"BIN\0"))
        {
            assert_eq!(old, new, "seed {seed}");
        }
    }
}

#[test]
fn an_embedded_container_is_whole_and_aligned() {
    let folder = folder();
    let longer = attached(folder.path(), &plain_glb(), ONE, &AttachOptions::default());
    let longer = longer.expect("attached");
    let document = document(&longer);
    let view = &document["bufferViews"][1];
    assert_eq!(view["byteOffset"], 64);
    let whole = std::fs::read(common::fixture("baked").join(ONE)).expect("a container");
    let (_, chunks) = parts(&longer);
    assert_eq!(chunks[0].1[..6], [1, 2, 3, 4, 5, 6]);
    assert!(chunks[0].1[64..][..whole.len()] == whole);
    assert_eq!(document["buffers"][0]["byteLength"], 64 + whole.len());
    assert_eq!(document["nodes"][1]["extensions"][NAME]["radianceField"], 0);
    assert_eq!(document["scenes"][0]["nodes"], json!([0, 1]));
}

#[test]
fn containers_in_data_uris_are_understood_and_kept() {
    use base64::Engine as _;
    let folder = folder();
    let whole = std::fs::read(common::fixture("baked").join(ONE)).expect("a container");
    let data = base64::engine::general_purpose::STANDARD.encode([&[9; 64], &whole[..]].concat());
    let uri = format!("data:application/octet-stream;base64,{data}");
    let plain = json!({ "asset": { "version": "2.0" }, "nodes": [{}] }).to_string();
    let asset =
        attached(folder.path(), plain.as_bytes(), ONE, &options(Some(NodeChoice::Index(0)), false));
    let inside = changed(&asset.expect("attached"), |document| {
        document["buffers"] = json!([{ "uri": uri, "byteLength": 64 + whole.len() }]);
        document["bufferViews"] =
            json!([{ "buffer": 0, "byteOffset": 64, "byteLength": whole.len() }]);
        let field = document["extensions"][NAME]["radianceFields"][0].as_object_mut();
        let field = field.expect("a field");
        field.remove("uri");
        field.insert("bufferView".to_owned(), 0.into());
    });
    let opened = open(&inside, &folder.path().join("x.gltf")).and_then(|asset| asset.open_field(0));
    assert_eq!(opened.expect("a container").entries(), container(ONE).entries());
    // Another field leaves the buffer's text alone; without the first one nothing needs the buffer.
    let both = attached(folder.path(), &inside, TWO, &AttachOptions::default()).expect("attached");
    assert_eq!(document(&both)["buffers"][0]["uri"], uri.as_str());
    let left = detached(folder.path(), &both, Some(0)).expect("detached");
    assert_eq!(document(&left).get("buffers"), None);
    let itself = changed(&inside, |document| {
        let field = &mut document["extensions"][NAME]["radianceFields"][0];
        field.as_object_mut().expect("a field").remove("bufferView");
        let data = base64::engine::general_purpose::STANDARD.encode(&whole);
        field["uri"] = format!("data:model/vnd.mipvog;base64,{data}").into();
    });
    let opened = open(&itself, &folder.path().join("x.gltf")).and_then(|asset| asset.open_field(0));
    assert_eq!(opened.expect("a container").entries(), container(ONE).entries());
}

#[test]
fn what_others_refer_to_is_not_renumbered() {
    let folder = folder();
    let here = folder.path();
    let asset = attached(here, &plain_glb(), ONE, &AttachOptions::default()).expect("attached");
    let behind = changed(&asset, |document| {
        let views = document["bufferViews"].as_array_mut().expect("views");
        views.push(json!({ "buffer": 0, "byteLength": 4 }));
    });
    let error = detached(here, &behind, None).expect_err("a view behind");
    assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
    assert!(error.to_string().contains("/bufferViews/2"), "{error}");
    let shared = changed(&asset, |document| {
        document["extensions"]["EXT_other"] = json!({ "deep": [{ "bufferView": 1 }] });
    });
    assert!(detached(here, &shared, None).is_err());
    // A node that something was made of stays, without the extension.
    let grown = changed(&asset, |document| {
        document["nodes"][1]["children"] = json!([0]);
    });
    let left = document(&detached(here, &grown, None).expect("detached"));
    assert_eq!(left["nodes"][1]["children"], json!([0]));
    assert_eq!(left["nodes"][1].get("extensions"), None);
    assert_eq!(left["scenes"][0]["nodes"], json!([0, 1]));
    let child = changed(&asset, |document| document["nodes"][0]["children"] = json!([1]));
    let left = document(&detached(here, &child, None).expect("detached"));
    assert_eq!(left["nodes"].as_array().map(Vec::len), Some(2));
}

#[test]
fn fields_that_other_tools_attached_go_too() {
    let folder = folder();
    let here = folder.path();
    let asset = attached(here, &plain_glb(), ONE, &AttachOptions::default()).expect("attached");
    let field = |document: &mut serde_json::Value| {
        document["extensions"][NAME]["radianceFields"][0].as_object_mut().expect("a field").clone()
    };
    let without = |key: &str| {
        changed(&asset, |document| {
            let mut field = field(document);
            field.remove(key);
            document["extensions"][NAME]["radianceFields"][0] = field.into();
        })
    };
    let left = detached(here, &without("extras"), None).expect("detached");
    let (document, (_, chunks)) = (document(&left), parts(&left));
    // The document states neither the buffer's old end nor the origin of the node, so both stay.
    assert_eq!(document["buffers"], json!([{ "byteLength": 64 }]));
    assert_eq!(document["nodes"].as_array().map(Vec::len), Some(2));
    assert_eq!(document.get("extensions"), None);
    assert_eq!(document.get("extensionsUsed"), None);
    assert_eq!((chunks[0].1.len(), &chunks[0].1[..6]), (64, &[1, 2, 3, 4, 5, 6][..]));
    // A record that cannot be true is no reason to panic.
    for (key, value) in
        [("byteLength", json!(u64::MAX)), ("byteLength", json!(-1)), ("node", json!(3))]
    {
        let wrong = changed(&asset, |document| {
            document["extensions"][NAME]["radianceFields"][0]["extras"]["attached"][key] =
                value.clone();
        });
        let error = detached(here, &wrong, None).expect_err(key);
        assert!(matches!(error.kind(), ErrorKind::Malformed { .. }), "{error}");
    }
}

#[test]
fn options_that_do_not_fit_are_refused() {
    let folder = folder();
    let here = folder.path();
    let attach = |asset: &[u8], node: &str| {
        let node = node.parse().map_or(NodeChoice::Name(node.to_owned()), NodeChoice::Index);
        attached(here, asset, ONE, &options(Some(node), false))
    };
    let usage = |result: mipvog::base::error::Result<Vec<u8>>, says: &str| {
        let error = result.expect_err(says);
        let kind = error.kind();
        assert!(
            matches!(kind, ErrorKind::InvalidOption { .. } | ErrorKind::Usage { .. }),
            "{error}"
        );
        assert!(error.to_string().contains(says), "{error}");
    };
    let plain = plain_glb();
    usage(attach(&plain, "1"), "number 0, the only one");
    usage(attach(&plain, "b"), "the name of a node, or its number");
    let twins = changed(&plain, |d| d["nodes"] = json!([{ "name": "a" }, { "name": "a" }]));
    usage(attach(&twins, "a"), "[0, 1]");
    let one = attach(&plain, "a").expect("attached");
    usage(attach(&one, "0"), "already");
    usage(detached(here, &plain, None), "no radiance field");
    usage(detached(here, &one, Some(1)), "a number below 1");
    let outside = changed(&plain, |d| d["buffers"][0]["uri"] = "mesh.bin".into());
    usage(attach(&outside, "a"), "option external");
    let named = attached(here, &outside, ONE, &options(None, true)).expect("by URI");
    assert_eq!(document(&named)["extensions"][NAME]["radianceFields"][0]["uri"], ONE);
}

#[test]
fn every_prefix_of_a_glb_is_refused_and_nothing_panics() {
    let folder = folder();
    let here = folder.path();
    let path = here.join("x.glb");
    let whole = attached(here, &plain_glb(), ONE, &AttachOptions::default()).expect("attached");
    let reads = |bytes: &[u8]| open(bytes, &path).and_then(|asset| asset.open_field(0)).is_ok();
    assert!(reads(&whole));
    for end in (0..whole.len()).filter(|end| *end < 2000 || end % 61 == 0).step_by(ONE_IN) {
        assert!(!reads(&whole[..end]), "the first {end} bytes were taken");
    }
    // Bytes after the file are no part of it; `detach` and `validate` name them.
    assert!(reads(&[&whole[..], &[0; 4]].concat()));
    let json = u32::from_le_bytes(whole[12..16].try_into().expect("four bytes"));
    for (at, value) in [
        (4, 1),
        (4, 3),
        (8, whole.len() as u32 - 4),
        (8, u32::MAX),
        (12, 0),
        (12, json - 1),
        (12, json + 4),
        (12, u32::MAX - 3),
        (16, u32::from_le_bytes(*b"BIN\0")),
        (20 + json as usize, 4),
        (20 + json as usize, u32::MAX),
        (24 + json as usize, u32::from_le_bytes(*b"JSON")),
    ] {
        let mut damaged = whole.clone();
        damaged[at..at + 4].copy_from_slice(&value.to_le_bytes());
        assert!(!reads(&damaged), "{value} at byte {at} was taken");
    }
    let mut random = Random::new(5);
    for _ in 0..1500 / ONE_IN {
        let mut damaged = whole.clone();
        for _ in 0..1 + random.below(3) {
            let at = random.below(json as usize + 120);
            let digits = [b'0' + random.below(10) as u8, b'"', b'{', b']', b',', 0xff];
            damaged[at] = digits[random.below(digits.len())];
        }
        reads(&damaged);
        let report = mipvog_bake::check::check(&path, &Default::default());
        report.expect("a file that can be read");
        detached(here, &damaged, None).ok();
        attached(here, &damaged, TWO, &AttachOptions::default()).ok();
    }
}
