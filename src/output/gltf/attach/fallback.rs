//! A new asset: a mesh, and the field that it stands for.

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use super::insert::{AttachOptions, Attached, NodeChoice, Z_UP_TO_Y_UP, attach};
use crate::base::bytes::Output;
use crate::base::error::{Error, Place, Result};
use crate::codec::container::Container;
use crate::output::gltf::asset::{Asset, padded};
use crate::output::gltf::mesh::Mesh;

/// Component types of accessors.
const U16: u32 = 5123;
const U32: u32 = 5125;
const F32: u32 = 5126;
/// Targets of buffer views.
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;

/// Writes an asset of one node to `output`, complete but not yet finished: the mesh, and the field
/// in `container` in its place. A GLB where `glb` says so, which embeds the container unless
/// `external`; else a `.gltf`, which names the container by a URI and holds the mesh itself.
pub fn write_fallback(
    mesh: &Mesh,
    container: &Container,
    container_path: &Path,
    output_path: &Path,
    glb: bool,
    external: bool,
    output: &mut Output,
) -> Result<Attached> {
    let (views, accessors, mut bytes) = arrays(mesh)?;
    let mut buffer = json!({ "byteLength": bytes.len() });
    if !glb {
        let data = STANDARD.encode(&bytes);
        buffer["uri"] = format!("data:application/octet-stream;base64,{data}").into();
    }
    let document = json!({
        "asset": { "version": "2.0", "generator": generator() },
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "radiance field", "rotation": Z_UP_TO_Y_UP, "mesh": 0 }],
        "meshes": [{
            "name": "fallback",
            "primitives": [{
                "attributes": { "POSITION": 0, "NORMAL": 1, "COLOR_0": 2 },
                "indices": 3,
                "material": 0,
            }],
        }],
        "materials": [material(mesh.visible)],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [buffer],
    });
    bytes.resize(padded(bytes.len() as u64) as usize, 0);
    let bin = glb.then_some(bytes);
    let asset = Asset::in_memory(document.to_string(), bin, output_path, container.limits());
    let options = AttachOptions { node: Some(NodeChoice::Index(0)), external };
    attach(&asset, container, container_path, output_path, &options, output)
}

fn generator() -> &'static str {
    concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION"))
}

/// Colours are as trained: no light falls on them. The box of an empty field is cut away
/// altogether.
fn material(visible: bool) -> Value {
    let mut rules = json!({ "metallicFactor": 0.0, "roughnessFactor": 1.0 });
    let mut material = json!({ "name": "as trained" });
    if !visible {
        rules["baseColorFactor"] = json!([1.0, 1.0, 1.0, 0.0]);
        material["alphaMode"] = "MASK".into();
    }
    material["pbrMetallicRoughness"] = rules;
    material["extensions"] = json!({ "KHR_materials_unlit": {} });
    material
}

/// Buffer views, accessors (positions, normals, colours, indices) and their bytes.
fn arrays(mesh: &Mesh) -> Result<(Value, Value, Vec<u8>)> {
    let count = mesh.positions.len();
    let mut bytes = Vec::new();
    bytes.extend(mesh.positions.as_flattened().iter().flat_map(|value| value.to_le_bytes()));
    let normals = bytes.len();
    bytes.extend(mesh.normals.as_flattened().iter().flat_map(|value| value.to_le_bytes()));
    let colors = bytes.len();
    for color in &mesh.colors {
        // Halves round up; a fourth number keeps the stride a multiple of 4.
        let color = color.map(|channel| (channel * 65535.0 + 0.5) as u16);
        bytes.extend(color.into_iter().chain([0]).flat_map(u16::to_le_bytes));
    }
    let indices = bytes.len();
    // The highest number of a type starts a new strip and is no index.
    let narrow = count <= usize::from(u16::MAX);
    for index in mesh.triangles.as_flattened() {
        match u16::try_from(*index) {
            Ok(short) if narrow => bytes.extend(short.to_le_bytes()),
            _ => bytes.extend(index.to_le_bytes()),
        }
    }
    let [min, max] = mesh.extent();
    if !min.iter().chain(&max).all(|value| value.is_finite()) {
        return Err(Error::malformed(Place::File, "a mesh that is not finite", "finite positions"));
    }
    let views = json!([
        { "buffer": 0, "byteOffset": 0, "byteLength": normals, "target": VERTICES },
        { "buffer": 0, "byteOffset": normals, "byteLength": colors - normals, "target": VERTICES },
        { "buffer": 0, "byteOffset": colors, "byteLength": indices - colors, "byteStride": 8,
          "target": VERTICES },
        { "buffer": 0, "byteOffset": indices, "byteLength": bytes.len() - indices,
          "target": INDICES },
    ]);
    let index_type = if narrow { U16 } else { U32 };
    let accessors = json!([
        { "bufferView": 0, "componentType": F32, "count": count, "type": "VEC3",
          "min": min, "max": max },
        { "bufferView": 1, "componentType": F32, "count": count, "type": "VEC3" },
        { "bufferView": 2, "componentType": U16, "normalized": true, "count": count,
          "type": "VEC3" },
        { "bufferView": 3, "componentType": index_type, "count": 3 * mesh.triangles.len(),
          "type": "SCALAR" },
    ]);
    Ok((views, accessors, bytes))
}
