//! Reading flipbooks back.

use std::collections::HashMap;

use super::description::{Description, SCHEMA};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::srgb::linear;
use crate::export_files::WrittenFiles;
use crate::picture;
use crate::volume::{Extinction, POINTS, SIDE, VolumePoints};

/// The points of a sheet, as in an engine's texture: colours are decoded before interpolation,
/// opacity is not.
///
/// # Errors
///
/// Errors of reading, and a description that does not fit the picture.
pub fn read(files: &WrittenFiles, limits: &Limits) -> Result<VolumePoints> {
    let text = files.with_extension("json")?;
    let bytes = text.read(0, text.length(), limits.header_bytes)?;
    let malformed = |found: String, expected: &str| {
        Error::malformed(Place::File, found, expected).in_file(text.path())
    };
    let described: Description = serde_json::from_slice(&bytes)
        .map_err(|error| malformed(error.to_string(), "a flipbook's description"))?;
    if described.schema != SCHEMA {
        return Err(malformed(described.schema, SCHEMA));
    }
    let place = files.named(&described.sheet);
    let place = place.ok_or_else(|| malformed(described.sheet.clone(), "a sheet beside it"))?;
    let [width, height, slices] = described.dims;
    let (columns, rows) = (described.columns, described.rows);
    let (sides, pixels) = match described.step {
        Some(_) => png_pixels(place, limits)?,
        None => exr_pixels(place, limits)?,
    };
    if sides != [columns * width, rows * height] || columns * rows < slices || columns == 0 {
        return Err(malformed(format!("{sides:?} pixels"), "the sheet that dims and tiles make"));
    }
    let mut leaves: HashMap<[i32; 3], Vec<[f32; 4]>> = HashMap::new();
    let mut budget = Budget::new(limits);
    for (number, value) in pixels.into_iter().enumerate() {
        let [across, down] = [number % sides[0], number / sides[0]];
        let [x, y] = [across % width, down % height];
        let z = down / height * columns + across / width;
        if z >= slices || value == [0.0; 4] {
            continue;
        }
        for [x, y, z] in copies([x, y, z], described.dims) {
            let at = [x, y, z].map(|at| at.div_euclid(SIDE as i32));
            if !leaves.contains_key(&at) {
                budget.spend((POINTS * 16) as u64, "bytes of a volume", &Place::File)?;
            }
            let leaf = leaves.entry(at).or_insert_with(|| vec![[0.0; 4]; POINTS]);
            let [x, y, z] = [x, y, z].map(|at| at.rem_euclid(SIDE as i32) as usize);
            leaf[(x * SIDE + y) * SIDE + z] = value;
        }
    }
    let half = described.spacing.map(|spacing| 0.5 * spacing);
    Ok(VolumePoints {
        first: std::array::from_fn(|axis| described.bounds[0][axis] + half[axis]),
        spacing: described.spacing,
        extinction: described.step.map_or(Extinction::Density, Extinction::Opacity),
        // The box of the description, which extends half a step beyond the points.
        faces: Some(described.dims.map(|count| [-0.5, count as f64 - 0.5])),
        leaves,
    })
}

/// A point and its copies beyond its faces, because engines clamp textures.
fn copies(at: [usize; 3], counts: [usize; 3]) -> impl Iterator<Item = [i32; 3]> {
    let [xs, ys, zs] = [0, 1, 2].map(|axis| {
        let place = at[axis] as i32;
        let is_last = at[axis] + 1 == counts[axis];
        place - i32::from(place == 0)..=place + i32::from(is_last)
    });
    let rows = xs.flat_map(move |x| ys.clone().map(move |y| (x, y)));
    rows.flat_map(move |(x, y)| zs.clone().map(move |z| [x, y, z]))
}

/// Sides of a picture, and its pixels: opacity or density, and linear light.
type Pixels = ([usize; 2], Vec<[f32; 4]>);

fn png_pixels(path: &std::path::Path, limits: &Limits) -> Result<Pixels> {
    let file = picture::read(path, limits.memory)?;
    let light = |byte: u8| linear(f64::from(byte) / 255.0) as f32;
    let pixels = file.bytes.as_chunks::<4>().0.iter();
    let value = |&[red, green, blue, alpha]: &[u8; 4]| {
        [f32::from(alpha) / 255.0, light(red), light(green), light(blue)]
    };
    Ok(([file.width, file.height], pixels.map(value).collect()))
}

fn exr_pixels(path: &std::path::Path, limits: &Limits) -> Result<Pixels> {
    let file = picture::read_exr(path, limits.memory)?;
    let channel = |name: &str| {
        let found = file.channels.iter().find(|(own, _)| own == name);
        found.map(|(_, values)| values.as_slice()).ok_or_else(|| {
            Error::malformed(Place::File, format!("no channel {name}"), "one").in_file(path)
        })
    };
    let [red, green, blue, alpha] = [channel("R")?, channel("G")?, channel("B")?, channel("A")?];
    let pixels = (0..file.width * file.height).map(|i| [alpha[i], red[i], green[i], blue[i]]);
    Ok(([file.width, file.height], pixels.collect()))
}
