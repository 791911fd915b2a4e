//! glTF with the extension `KHR_gaussian_splatting`: points whose attributes are those of splats.
//!
//! Programs that do not know it draw points with the colours of band 0. All arrays except these
//! colours are float32. Positions and harmonics are rotated, so that the node needs no rotation.

use serde_json::{Value, json};

use super::axes::Turn;
use super::project::{COLOR, GaussianSplat, OPACITY, PARAMETERS, SIZE};
use crate::base::error::{Error, Place, Result};
use crate::base::srgb::linear;
use crate::model::activate::lanes;
use crate::model::harmonics::{BAND_0, FUNCTIONS};

/// The extension's name, and the prefix of its attributes.
pub(super) const EXTENSION: &str = "KHR_gaussian_splatting";
/// Component types of accessors.
const U16: u32 = 5123;
const F32: u32 = 5126;
/// Target of buffer views.
const VERTICES: u32 = 34962;

/// A document without the buffer's place, and the buffer's bytes, for splats in training axes.
/// `extras` state their source.
pub(super) fn document(splats: &[GaussianSplat], extras: &Value) -> (Value, Vec<u8>) {
    let turn = Turn::z_up_to_y_up();
    let turned: Vec<GaussianSplat> = splats.iter().map(|splat| turn.splat(splat)).collect();
    let mut arrays = Arrays { count: splats.len(), ..Arrays::default() };
    arrays.add("POSITION", "VEC3", turned.iter().flat_map(|splat| [splat[0], splat[1], splat[2]]));
    let bound = |start: f32, beyond: fn(&f32, &f32) -> bool| {
        turned.iter().fold([start; 3], |bound, splat| {
            [0, 1, 2].map(|i| if beyond(&splat[i], &bound[i]) { splat[i] } else { bound[i] })
        })
    };
    arrays.accessors[0]["min"] = json!(bound(f32::INFINITY, f32::lt));
    arrays.accessors[0]["max"] = json!(bound(f32::NEG_INFINITY, f32::gt));
    arrays.add_colors(&turned);
    let own = |name: &str| format!("{EXTENSION}:{name}");
    let opacity = |splat: &GaussianSplat| lanes::sigmoid(splat[OPACITY]).clamp(0.0, 1.0);
    let size = |splat: &GaussianSplat| [lanes::exp(splat[SIZE]); 3];
    arrays.add(&own("ROTATION"), "VEC4", turned.iter().flat_map(|_| [0.0, 0.0, 0.0, 1.0]));
    arrays.add(&own("SCALE"), "VEC3", turned.iter().flat_map(size));
    arrays.add(&own("OPACITY"), "SCALAR", turned.iter().map(opacity));
    for function in 0..FUNCTIONS {
        let first = COLOR + 3 * function;
        let values =
            turned.iter().flat_map(|splat| [0, 1, 2].map(|channel| splat[first + channel]));
        arrays.add(&own(&harmonic(function)), "VEC3", values);
    }
    let Arrays { attributes, accessors, views, bytes, .. } = arrays;
    let document = json!({
        "asset": { "version": "2.0", "generator": concat!("mipvog-bake ", env!("CARGO_PKG_VERSION")),
                   "extras": extras },
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "splats", "mesh": 0 }],
        "meshes": [{ "name": "splats", "primitives": [{
            "attributes": attributes,
            "mode": 0,
            "extensions": { EXTENSION: {
                "kernel": "ellipse",
                "colorSpace": "srgb_rec709_display",
                "projection": "perspective",
                "sortingMethod": "cameraDistance",
            } },
        }] }],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": bytes.len() }],
    });
    (document, bytes)
}

/// The attribute of a function, without its prefix.
fn harmonic(function: usize) -> String {
    let band = function.isqrt();
    format!("SH_DEGREE_{band}_COEF_{}", function - band * band)
}

/// Arrays of a primitive as stored in glTF, each with its own view.
#[derive(Default)]
struct Arrays {
    count: usize,
    attributes: serde_json::Map<String, Value>,
    accessors: Vec<Value>,
    views: Vec<Value>,
    bytes: Vec<u8>,
}

impl Arrays {
    fn add(&mut self, name: &str, kind: &str, values: impl Iterator<Item = f32>) {
        let accessor = json!({ "componentType": F32, "type": kind });
        self.put(name, accessor, values.flat_map(f32::to_le_bytes));
    }

    /// Band 0 as linear light, with opacity, for programs without the extension.
    fn add_colors(&mut self, splats: &[GaussianSplat]) {
        let short = |share: f64| (share * 65535.0 + 0.5) as u16;
        let color = |splat: &GaussianSplat| {
            let [red, green, blue] = [0, 1, 2].map(|channel| {
                let shown = (0.5 + BAND_0 * splat[COLOR + channel]).clamp(0.0, 1.0);
                short(linear(shown.into()))
            });
            [red, green, blue, short(lanes::sigmoid(splat[OPACITY]).into())]
        };
        let accessor = json!({ "componentType": U16, "normalized": true, "type": "VEC4" });
        self.put("COLOR_0", accessor, splats.iter().flat_map(color).flat_map(u16::to_le_bytes));
    }

    fn put(&mut self, name: &str, mut accessor: Value, bytes: impl Iterator<Item = u8>) {
        let start = self.bytes.len();
        self.bytes.extend(bytes);
        let length = self.bytes.len() - start;
        let view =
            json!({ "buffer": 0, "byteOffset": start, "byteLength": length, "target": VERTICES });
        accessor["bufferView"] = self.views.len().into();
        accessor["count"] = self.count.into();
        self.attributes.insert(name.to_owned(), self.accessors.len().into());
        self.views.push(view);
        self.accessors.push(accessor);
    }
}

/// Reads a document that [`document`] made back, into training axes.
///
/// # Errors
/// `Malformed` for any other one.
pub(super) fn read(document: &Value, buffer: &[u8]) -> Result<Vec<GaussianSplat>> {
    let wrong = || Error::malformed(Place::File, "another glTF document", "splats of float32");
    let primitive = &document["meshes"][0]["primitives"][0];
    if primitive["extensions"][EXTENSION]["kernel"] != "ellipse" {
        return Err(wrong());
    }
    let floats = |name: &str, width: usize| {
        let accessor = primitive["attributes"][name].as_u64();
        let accessor = &document["accessors"][accessor.ok_or_else(wrong)? as usize];
        let view = accessor["bufferView"].as_u64().ok_or_else(wrong)?;
        let view = &document["bufferViews"][view as usize];
        let [count, start, length] =
            [&accessor["count"], &view["byteOffset"], &view["byteLength"]].map(Value::as_u64);
        let (Some(count), Some(start), Some(length)) = (count, start, length) else {
            return Err(wrong());
        };
        let bytes = buffer.get(start as usize..start.saturating_add(length) as usize);
        let bytes = bytes.filter(|bytes| bytes.len() as u64 == 4 * width as u64 * count);
        let values = bytes.ok_or_else(wrong)?.as_chunks::<4>().0.iter();
        Ok(values.map(|bytes| f32::from_le_bytes(*bytes)).collect::<Vec<_>>())
    };
    let own = |name: &str| format!("{EXTENSION}:{name}");
    let positions = floats("POSITION", 3)?;
    let (sizes, opacities) = (floats(&own("SCALE"), 3)?, floats(&own("OPACITY"), 1)?);
    let mut splats = vec![[0.0; PARAMETERS]; opacities.len()];
    for function in 0..FUNCTIONS {
        let values = floats(&own(&harmonic(function)), 3)?;
        for (splat, values) in splats.iter_mut().zip(values.as_chunks::<3>().0) {
            splat[COLOR + 3 * function..][..3].copy_from_slice(values);
        }
    }
    let turn = Turn::y_up_to_z_up();
    let parts = positions.as_chunks::<3>().0.iter().zip(sizes.as_chunks::<3>().0).zip(opacities);
    for (splat, ((position, size), opacity)) in splats.iter_mut().zip(parts) {
        splat[..3].copy_from_slice(position);
        splat[SIZE] = lanes::ln(size[0].into()) as f32;
        let opacity = opacity.clamp(1e-7, 1.0 - 1e-7);
        splat[OPACITY] = lanes::ln(f64::from(opacity / (1.0 - opacity))) as f32;
        *splat = turn.splat(splat);
    }
    Ok(splats)
}
