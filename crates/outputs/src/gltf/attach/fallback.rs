//! A new asset: a field, and a mesh in its place for other viewers.

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use super::insert::{AttachOptions, Attached, NodeChoice, Z_UP_TO_Y_UP, attach};
use crate::base::bytes::Output;
use crate::base::error::{Error, Place, Result};
use crate::container::Container;
use crate::gltf::asset::{Asset, Piece, padded, write_glb};
use crate::gltf::mesh::Mesh;

/// Component types of accessors.
const U16: u32 = 5123;
const U32: u32 = 5125;
const F32: u32 = 5126;
/// Targets of buffer views.
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;

/// Minimum screen coverage of the finest mesh; each coarser one has a quarter of the one before.
const FINEST_COVERAGE: f64 = 0.25;

/// Writes an asset of one node to `output`, complete but not yet finished: the mesh, and the field
/// in `container`. Coarser meshes follow the finest one, as levels of detail by `MSFT_lod`. With
/// `glb`, a GLB, which embeds the container unless `external`; else a `.gltf`, which links the
/// container by URI and embeds the meshes.
pub fn write_fallback(
    meshes: &[Mesh],
    container: &Container,
    container_path: &Path,
    output_path: &Path,
    glb: bool,
    external: bool,
    output: &mut Output,
) -> Result<Attached> {
    let (mut document, mut bytes) = document_of(meshes)?;
    if !glb {
        let data = STANDARD.encode(&bytes);
        document["buffers"][0]["uri"] =
            format!("data:application/octet-stream;base64,{data}").into();
    }
    bytes.resize(padded(bytes.len() as u64) as usize, 0);
    let bin = glb.then_some(bytes);
    let asset = Asset::in_memory(document.to_string(), bin, output_path, container.limits());
    let options = AttachOptions { node: Some(NodeChoice::Index(0)), external };
    attach(&asset, container, container_path, output_path, &options, output)
}

/// Writes a GLB of a mesh alone to `output`, complete but not yet finished.
///
/// # Errors
/// Errors of writing; `Malformed` for a mesh that is not finite.
pub fn write_mesh(mesh: &Mesh, output: &mut Output) -> Result<()> {
    let (document, bytes) = document_of(std::slice::from_ref(mesh))?;
    write_glb(&document.to_string(), &[Piece::Bytes(bytes)], None, output)
}

/// The document of an asset of one node with a mesh, and the bytes of its buffer. Coarser meshes
/// follow the finest one.
fn document_of(meshes: &[Mesh]) -> Result<(Value, Vec<u8>)> {
    let mut arrays = Arrays::default();
    let primitives: Vec<Value> =
        meshes.iter().map(|mesh| arrays.add(mesh)).collect::<Result<_>>()?;
    let Arrays { views, accessors, bytes } = arrays;
    let buffer = json!({ "byteLength": bytes.len() });
    let mesh = |primitive| json!({ "name": "fallback", "primitives": [primitive] });
    let mut document = json!({
        "asset": { "version": "2.0", "generator": generator() },
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "radiance field", "rotation": Z_UP_TO_Y_UP, "mesh": 0 }],
        "meshes": primitives.into_iter().map(mesh).collect::<Vec<_>>(),
        "materials": [material(meshes.iter().all(|mesh| mesh.visible))],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [buffer],
    });
    if meshes.len() > 1 {
        add_levels_of_detail(&mut document, meshes.len());
    }
    Ok((document, bytes))
}

/// Lists a node per coarser mesh on the first node; these nodes are in no scene.
fn add_levels_of_detail(document: &mut Value, count: usize) {
    let coarser: Vec<usize> = (1..count).collect();
    let coverage = |level: usize| FINEST_COVERAGE / 4f64.powi(level as i32);
    // The coarsest mesh is shown at any size.
    let shares: Vec<f64> = (0..count - 1).map(coverage).chain([0.0]).collect();
    document["nodes"][0]["extensions"] = json!({ "MSFT_lod": { "ids": coarser } });
    document["nodes"][0]["extras"] = json!({ "MSFT_screencoverage": shares });
    if let Some(nodes) = document["nodes"].as_array_mut() {
        nodes.extend(
            coarser
                .iter()
                .map(|level| json!({ "name": "coarser", "rotation": Z_UP_TO_Y_UP, "mesh": level })),
        );
    }
    document["extensionsUsed"] = json!(["KHR_materials_unlit", "MSFT_lod"]);
}

fn generator() -> &'static str {
    concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION"))
}

/// Colours are as trained, so the material is unlit. The box of an empty field is fully
/// transparent.
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

/// Arrays of meshes as glTF stores them.
#[derive(Default)]
struct Arrays {
    views: Vec<Value>,
    accessors: Vec<Value>,
    bytes: Vec<u8>,
}

impl Arrays {
    /// Adds positions, normals, colours and indices of a mesh. Returns its only primitive.
    fn add(&mut self, mesh: &Mesh) -> Result<Value> {
        let [min, max] = mesh.extent();
        if !min.iter().chain(&max).all(|value| value.is_finite()) {
            let found = "a mesh that is not finite";
            return Err(Error::malformed(Place::File, found, "finite positions"));
        }
        let count = mesh.positions.len();
        let floats = |vectors: &[[f32; 3]]| -> Vec<u8> {
            vectors.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect()
        };
        let position = self.array(
            floats(&mesh.positions),
            json!({ "target": VERTICES }),
            json!({ "componentType": F32, "count": count, "type": "VEC3", "min": min, "max": max }),
        );
        let normal = self.array(
            floats(&mesh.normals),
            json!({ "target": VERTICES }),
            json!({ "componentType": F32, "count": count, "type": "VEC3" }),
        );
        let colors = mesh.colors.iter().flat_map(|color| {
            // Halves round up; a fourth number keeps the stride a multiple of 4.
            let color = color.map(|channel| (channel * 65535.0 + 0.5) as u16);
            color.into_iter().chain([0]).flat_map(u16::to_le_bytes)
        });
        let color = self.array(
            colors.collect(),
            json!({ "byteStride": 8, "target": VERTICES }),
            json!({ "componentType": U16, "normalized": true, "count": count, "type": "VEC3" }),
        );
        // The highest number of a type restarts a strip, so it is not a valid index.
        let narrow = count <= usize::from(u16::MAX);
        let mut bytes = Vec::new();
        for index in mesh.triangles.as_flattened() {
            match u16::try_from(*index) {
                Ok(short) if narrow => bytes.extend(short.to_le_bytes()),
                _ => bytes.extend(index.to_le_bytes()),
            }
        }
        let index_type = if narrow { U16 } else { U32 };
        let indices = 3 * mesh.triangles.len();
        let indices = self.array(
            bytes,
            json!({ "target": INDICES }),
            json!({ "componentType": index_type, "count": indices, "type": "SCALAR" }),
        );
        Ok(json!({
            "attributes": { "POSITION": position, "NORMAL": normal, "COLOR_0": color },
            "indices": indices,
            "material": 0,
        }))
    }

    /// Adds an array with its own view, and returns its accessor's number.
    fn array(&mut self, array: Vec<u8>, mut view: Value, mut accessor: Value) -> usize {
        self.bytes.resize(padded(self.bytes.len() as u64) as usize, 0);
        view["buffer"] = 0.into();
        view["byteOffset"] = self.bytes.len().into();
        view["byteLength"] = array.len().into();
        accessor["bufferView"] = self.views.len().into();
        self.bytes.extend(array);
        self.views.push(view);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }
}
