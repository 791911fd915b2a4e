//! Broken files: one for each finding of the catalogue, made of sound ones by one change each.

use std::path::Path;
use std::sync::Arc;

use mipvog::bake::{BakeOptions, Filter};
use mipvog::base::bytes::{Output, SourceFile};
use mipvog::base::limits::Limits;
use mipvog::container::Container;
use mipvog::container::json::to_canonical;
use mipvog::model::baked::Metadata;
use mipvog::model::field::{FreeSpace, Lookup};
use mipvog::model::grid::Nodes;
use mipvog_inputs::SourceOptions;
use mipvog_outputs::gltf::asset::Asset;
use mipvog_outputs::gltf::attach::{AttachOptions, NodeChoice, attach};
use serde_json::{Value, json};

use super::asset::{NAME, changed};
use super::checkpoint::Checkpoint;
use super::chunks::{self, Chunk, with_chunk};
use super::{baked_bytes, fixture, folder, masked, mend_checksums};

/// The sound container that broken assets name.
pub const SOUND: &str = "sound.mipvog";

/// Name and bytes of each broken file, under the code that its name starts with; and the sound
/// container.
pub fn files() -> Vec<(String, Vec<u8>)> {
    let sound = sound_container();
    let mut files = vec![(SOUND.to_owned(), sound.clone())];
    files.push(("file.txt".to_owned(), b"Neither a container nor anything else.\n".to_vec()));
    let named = |extension: &str, files: Vec<(&str, Vec<u8>)>| -> Vec<(String, Vec<u8>)> {
        let name = |code: &str| format!("{code}.{extension}");
        files.into_iter().map(|(code, bytes)| (name(code), bytes)).collect()
    };
    files.extend(named("mipvog", containers(&sound)));
    files.extend(named("gltf", assets(&sound)));
    files.extend(named("safetensors", checkpoints()));
    files.push(("values-checksum.tar".to_owned(), flipped_value()));
    files
}

/// Settings that the user must give, because the inputs lack them.
pub fn said() -> SourceOptions {
    SourceOptions { stepsize: Some(0.5), ..SourceOptions::default() }
}

/// A container with every kind of chunk and two levels.
fn sound_container() -> Vec<u8> {
    let folder = folder();
    let path = folder.path().join("sound.safetensors");
    std::fs::write(&path, Checkpoint::sound().to_bytes()).expect("writable");
    let field =
        mipvog_inputs::open_with(&path, &said(), &Limits::default()).expect("a checkpoint").field;
    // Half of the opaque nodes are outside, so that the mask shows and stays.
    let inside = (0..8).map(|node| node >= 4).collect();
    let lookup = Lookup::Nearest(inside);
    let mask = FreeSpace { nodes: Nodes([2; 3]), scale: [0.5; 3], shift: [0.5; 3], lookup };
    let options = BakeOptions {
        filter: Filter::Paper.into(),
        levels: Some(2),
        block_size: 4,
        ..BakeOptions::default()
    };
    baked_bytes(&masked(field, mask), &options).expect("a bake")
}

fn containers(sound: &[u8]) -> Vec<(&'static str, Vec<u8>)> {
    let parts = chunks::chunks(sound);
    let flipped = |at: usize| {
        let mut bytes = sound.to_vec();
        bytes[at] ^= 1;
        bytes
    };
    let mended = |at: usize| {
        let mut bytes = flipped(at);
        mend_checksums(&mut bytes);
        bytes
    };
    let entries = chunks::entries(&parts);
    let last = entries.len() - 1;
    let mut apart = entries.clone();
    apart[last].offset += 64;
    for entry in apart.iter_mut().filter(|entry| entry.level == Some(0)) {
        entry.prefix += 64;
    }
    let mut prefix = entries.clone();
    prefix[last].prefix += 64;
    let unknown = Chunk { kind: *b"NEXT", level: None, bytes: b"to come".to_vec() };
    let find = |kind: &[u8; 4]| parts.iter().position(|chunk| chunk.kind == *kind).expect("it");
    let provenance = find(b"prov");
    let padded = entries.iter().find(|entry| entry.length % 64 != 0).expect("a padded chunk");
    let metadata = |change: fn(&mut Metadata)| {
        with_chunk(&parts, b"META", None, |bytes| {
            let mut metadata: Metadata = serde_json::from_slice(bytes).expect("metadata");
            change(&mut metadata);
            *bytes = to_canonical(&metadata).expect("JSON").into_bytes();
        })
    };
    vec![
        ("header", flipped(12)),
        // A bit that no version defines.
        ("feature", mended(17)),
        ("length", [sound, &[0; 64]].concat()),
        ("directory", flipped(48)),
        ("chunk-bounds", chunks::file(&apart, &parts)),
        ("chunk-unknown", chunks::container(&[&parts[..], &[unknown]].concat())),
        ("chunk-unexpected", {
            chunks::container(&[&parts[..], &parts[provenance..=provenance]].concat())
        }),
        ("chunk-missing", chunks::container(&parts[..last])),
        ("chunk-checksum", flipped(entries[provenance].offset as usize + 2)),
        ("padding", flipped(padded.padded_end() as usize - 1)),
        ("prefix", chunks::file(&prefix, &parts)),
        ("metadata", with_chunk(&parts, b"META", None, |bytes| bytes.push(b' '))),
        ("metadata-value", metadata(|metadata| metadata.march.stepsize = 0.0)),
        ("ray-samples", metadata(|metadata| metadata.march.stepsize = 1e-7)),
        ("nested-boxes", {
            let world = std::fs::read(fixture("baked/world.mipvog")).expect("the golden world");
            with_chunk(&chunks::chunks(&world), b"META", None, |bytes| {
                let mut metadata: Metadata = serde_json::from_slice(bytes).expect("metadata");
                metadata.shells[1].bounds = metadata.shells[0].bounds;
                *bytes = to_canonical(&metadata).expect("JSON").into_bytes();
            })
        }),
        ("network", with_chunk(&parts, b"VMLP", None, |bytes| bytes.truncate(bytes.len() - 4))),
        ("free-space", with_chunk(&parts, b"MASK", None, |bytes| bytes[0] = 9)),
        ("provenance", with_chunk(&parts, b"prov", None, |bytes| bytes.push(b' '))),
        ("thumbnail", {
            let bytes = b"GIF89a".to_vec();
            let picture = Chunk { kind: *b"thmb", level: None, bytes };
            chunks::container(
                &[&parts[..=provenance], &[picture], &parts[provenance + 1..]].concat(),
            )
        }),
        ("table", with_chunk(&parts, b"TABL", Some(0), |bytes| bytes.push(0))),
        ("atlas", with_chunk(&parts, b"DENS", Some(0), |bytes| bytes.truncate(bytes.len() - 1))),
    ]
}

/// A document of one triangle on a node with a field.
fn sound_asset(here: &Path, sound: &[u8]) -> Vec<u8> {
    let zeros = "A".repeat(48);
    let text = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                        "min": [0.0, 0.0, 0.0], "max": [0.0, 0.0, 0.0] }],
        "buffers": [{ "byteLength": 36, "uri": format!("data:application/octet-stream;base64,{zeros}") }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
    });
    let [container, plain, path] = [SOUND, "plain.gltf", "sound.gltf"].map(|name| here.join(name));
    std::fs::write(&container, sound).expect("writable");
    std::fs::write(&plain, text.to_string()).expect("writable");
    let limits = Limits::default();
    let file = |path: &Path| Arc::new(SourceFile::open(path).expect("written"));
    let asset = Asset::open(file(&plain), &limits).expect("an asset");
    let opened = Container::open(file(&container), &limits).expect("a container");
    let options = AttachOptions { node: Some(NodeChoice::Index(0)), external: true };
    let mut output = Output::create(&path, false).expect("writable");
    attach(&asset, &opened, &container, &path, &options, &mut output).expect("attached");
    output.finish().expect("written");
    std::fs::read(path).expect("written")
}

fn assets(sound: &[u8]) -> Vec<(&'static str, Vec<u8>)> {
    let folder = folder();
    let asset = sound_asset(folder.path(), sound);
    let edit = |change: fn(&mut Value)| changed(&asset, change);
    vec![
        ("asset", edit(|d| drop(d.as_object_mut().map(|root| root.remove("asset"))))),
        ("asset-rule", edit(|d| d["scenes"][0]["nodes"] = json!([0, 7]))),
        ("extension-used", edit(|d| d["extensionsUsed"] = json!(["EXT_other"]))),
        ("extension-required", edit(|d| d["extensionsRequired"] = json!([NAME]))),
        ("field-property", edit(|d| field(d)["mimeType"] = json!("model/other"))),
        ("field-source", edit(|d| field(d)["bufferView"] = json!(0))),
        ("field-missing", edit(|d| field(d)["uri"] = json!("missing.mipvog"))),
        ("field-metadata", edit(|d| field(d)["featureCount"] = json!(9))),
        ("field-hash", edit(|d| field(d)["sha256"] = json!("0".repeat(64)))),
        ("field-node", {
            edit(|d| {
                let mut other = d["nodes"][0].clone();
                other["extensions"][NAME]["radianceField"] = json!(5);
                d["nodes"].as_array_mut().expect("nodes").push(other);
            })
        }),
        ("field-unused", edit(|d| drop(node(d).map(|node| node.remove("extensions"))))),
        ("field-fallback", edit(|d| drop(node(d).map(|node| node.remove("mesh"))))),
    ]
}

fn field(document: &mut Value) -> &mut Value {
    &mut document["extensions"][NAME]["radianceFields"][0]
}

fn node(document: &mut Value) -> Option<&mut serde_json::Map<String, Value>> {
    document["nodes"][0].as_object_mut()
}

fn checkpoints() -> Vec<(&'static str, Vec<u8>)> {
    let edit = |change: &dyn Fn(&mut Checkpoint)| {
        let mut checkpoint = Checkpoint::sound();
        change(&mut checkpoint);
        checkpoint.to_bytes()
    };
    let sound = Checkpoint::sound().to_bytes();
    let nodes = sound_nodes();
    vec![
        ("input", sound[..sound.len() - 8].to_vec()),
        ("scene", edit(&|c| c.arrays.retain(|array| array.0 != "k0.grid"))),
        ("unstated", edit(&|c| c.settings.retain(|setting| setting.0 != "num_voxels_base"))),
        ("values-nonfinite", edit(&|c| c.values("k0.grid")[17] = f32::NAN)),
        ("values-range", edit(&|c| c.values("density.grid")[3] = 1e6)),
        ("space-empty", edit(&|c| c.values("density.grid").fill(-50.0))),
        ("space-full", edit(&|c| c.values("density.grid").fill(3.0))),
        ("channel-dead", edit(&|c| c.values("k0.grid")[6 * nodes..].fill(0.25))),
        ("network-unused", {
            edit(&|c| {
                c.values("rgbnet.0.weight").iter_mut().skip(9).step_by(10).for_each(|w| *w = 0.0)
            })
        }),
    ]
}

fn sound_nodes() -> usize {
    super::checkpoint::NODES.iter().product()
}

/// A checkpoint with a checksum that a value does not fit.
fn flipped_value() -> Vec<u8> {
    let path = fixture("trained/dvgo/protocol2.tar");
    let listed =
        mipvog_inputs::inspect(&path, &said(), &Limits::default()).expect("a checkpoint").values;
    let density = listed.iter().find(|value| value.key.ends_with("density.grid"));
    let offset = density.and_then(|value| value.offset).expect("stored as it is") as usize;
    let mut bytes = std::fs::read(&path).expect("a checkpoint");
    bytes[offset] ^= 1;
    bytes
}
