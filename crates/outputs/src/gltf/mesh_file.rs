//! A mesh alone, as a GLB, for programs that only draw triangles.

use std::path::Path;

use glam::{DVec2, DVec3};
use serde_json::{Map, Value};

use super::attach::write_mesh;
use super::mesh::{FEWEST_TRIANGLES, Mesh, meshes};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{LimitName, Limits};
use crate::base::progress::{Progress, Step};
use crate::base::srgb::display;
use crate::container::Container;
use crate::export_files::{ExportFiles, WrittenFiles};
use crate::format::{ExportFormat, ExportOptions, ExportSource, Exported, Shown};
use crate::model::camera::Camera;
use crate::view::render::tiles;

/// Default maximum number of triangles.
const TRIANGLES: usize = 100_000;
/// Bytes of the headers of a GLB and of its first chunk, and of a chunk's header.
const HEADERS: usize = 20;
const CHUNK_HEADER: usize = 8;

/// A mesh with colours at its vertices, as a GLB.
#[derive(Debug)]
pub struct Glb;

impl ExportFormat for Glb {
    fn name(&self) -> &'static str {
        "glb"
    }

    fn options(&self) -> &'static [&'static str] {
        &["triangles"]
    }

    fn takes_container(&self) -> bool {
        true
    }

    fn check(&self, _source: &ExportSource, options: &ExportOptions, output: &Path) -> Result<()> {
        if output.extension().is_none_or(|extension| extension != "glb") {
            return Err(Error::usage(format!(
                "-o {}: the name of a mesh must end in .glb",
                output.display()
            )));
        }
        let triangles = options.triangles.unwrap_or(TRIANGLES);
        let expected = format!("{FEWEST_TRIANGLES} to 10000000");
        let is_range = (FEWEST_TRIANGLES..=10_000_000).contains(&triangles);
        Error::require_option(is_range, "triangles", triangles, &expected)?;
        let expected = "0: a mesh is made of the coarsest level that has enough triangles";
        Error::require_option(options.level == 0, "level", options.level, expected)
    }

    fn write(
        &self,
        source: &ExportSource,
        options: &ExportOptions,
        files: &mut ExportFiles,
        progress: &dyn Progress,
    ) -> Result<Exported> {
        progress.begin(Step::Encode, 1);
        let bytes = source.container.clone().unwrap_or_default();
        let container = Container::from_bytes(bytes, &options.limits)?;
        let mut made = meshes(&container, options.triangles.unwrap_or(TRIANGLES), 0)?;
        let mesh = made.swap_remove(0);
        let path = files.output().to_owned();
        write_mesh(&mesh, files.create(path)?)?;
        progress.advance(Step::Encode, 1);
        let mut lost = vec![
            "transparency: the surface is opaque, and nothing is inside".to_owned(),
            "details smaller than a triangle".to_owned(),
        ];
        if container.metadata().view.is_some() {
            lost.push(
                "view-dependent colour: vertices have the mean colour around them".to_owned(),
            );
        }
        let mut details = Map::new();
        details.insert("triangles".to_owned(), mesh.triangles.len().into());
        details.insert("vertices".to_owned(), mesh.positions.len().into());
        Ok(Exported { lost, details })
    }

    fn read_back(
        &self,
        source: &ExportSource,
        files: &WrittenFiles,
        limits: &Limits,
    ) -> Result<Box<dyn Shown>> {
        let file = files.with_extension("glb")?;
        let mesh = read(&file, limits)?;
        Ok(Box::new(ShownMesh { mesh, background: source.field.view().background }))
    }
}

/// The mesh of a file that [`write_mesh`] wrote, in training axes.
fn read(file: &SourceFile, limits: &Limits) -> Result<Mesh> {
    let what = (LimitName::Memory, "bytes of a mesh");
    let bytes = file.read_bounded(0, file.length(), what, limits.memory)?;
    let wrong = || Error::malformed(Place::File, "another GLB", "one of a mesh");
    let length = bytes.get(12..16).and_then(|bytes| <[u8; 4]>::try_from(bytes).ok());
    let end = HEADERS + u32::from_le_bytes(length.ok_or_else(wrong)?) as usize;
    let text = bytes.get(HEADERS..end).ok_or_else(wrong)?;
    let bin = bytes.get(end + CHUNK_HEADER..).ok_or_else(wrong)?;
    let document: Value = serde_json::from_slice(text).map_err(|_| wrong())?;
    let primitive = &document["meshes"][0]["primitives"][0];
    let array = |number: &Value| {
        let accessor = &document["accessors"][number.as_u64()? as usize];
        let view = &document["bufferViews"][accessor["bufferView"].as_u64()? as usize];
        let start = view["byteOffset"].as_u64()? as usize;
        let bytes = bin.get(start..start + view["byteLength"].as_u64()? as usize)?;
        Some((bytes, accessor["componentType"].as_u64()?))
    };
    let attribute = |name: &str| array(&primitive["attributes"][name]).ok_or_else(wrong);
    let floats = |bytes: &[u8]| -> Vec<[f32; 3]> {
        let values: Vec<f32> =
            bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        values.as_chunks().0.to_vec()
    };
    let (colors, _) = attribute("COLOR_0")?;
    let colors = colors.as_chunks::<8>().0.iter().map(|bytes| {
        [0, 2, 4].map(|at| f64::from(u16::from_le_bytes([bytes[at], bytes[at + 1]])) / 65535.0)
    });
    let (indices, kind) = array(&primitive["indices"]).ok_or_else(wrong)?;
    let indices: Vec<u32> = match kind {
        5123 => indices.as_chunks().0.iter().map(|two| u16::from_le_bytes(*two).into()).collect(),
        _ => indices.as_chunks().0.iter().map(|four| u32::from_le_bytes(*four)).collect(),
    };
    Ok(Mesh {
        positions: floats(attribute("POSITION")?.0),
        normals: floats(attribute("NORMAL")?.0),
        colors: colors.collect(),
        triangles: indices.as_chunks().0.to_vec(),
        visible: document["materials"][0]["alphaMode"] != "MASK",
    })
}

/// A mesh, rendered unlit.
struct ShownMesh {
    mesh: Mesh,
    background: [f32; 3],
}

/// A corner of a triangle on the picture.
#[derive(Clone, Copy)]
struct Corner {
    /// In pixels.
    at: DVec2,
    /// One over the distance along the optical axis, which is linear on the picture.
    nearness: f64,
    color: DVec3,
}

impl ShownMesh {
    /// A vertex on the picture; none behind the camera. Triangles with such a vertex are skipped;
    /// they occur only for cameras inside the mesh.
    fn corner(&self, vertex: u32, camera: &Camera, to_camera: &glam::DMat4) -> Option<Corner> {
        let position = self.mesh.positions.get(vertex as usize)?.map(f64::from);
        let place = to_camera.transform_point3(DVec3::from_array(position));
        let nearness = 1.0 / -place.z;
        if !(nearness > 0.0 && nearness.is_finite()) {
            return None;
        }
        let lens = &camera.lens;
        let at = DVec2::new(
            lens.center[0] + lens.focal[0] * place.x * nearness,
            lens.center[1] - lens.focal[1] * place.y * nearness,
        );
        let color = DVec3::from_array(*self.mesh.colors.get(vertex as usize)?);
        Some(Corner { at, nearness, color })
    }
}

impl Shown for ShownMesh {
    fn picture(&self, camera: &Camera, progress: &dyn Progress) -> Result<Vec<[f32; 3]>> {
        let (width, height) = (camera.lens.width, camera.lens.height);
        let mut picture = vec![self.background; width * height];
        let mut nearest = vec![0.0; width * height];
        let to_camera = camera.to_world.inverse();
        let triangles: &[[u32; 3]] = if self.mesh.visible { &self.mesh.triangles } else { &[] };
        for (number, corners) in triangles.iter().enumerate() {
            if number % 4096 == 0 && progress.cancelled() {
                return Err(Error::cancelled());
            }
            let corner = |index: usize| self.corner(corners[index], camera, &to_camera);
            if let (Some(a), Some(b), Some(c)) = (corner(0), corner(1), corner(2)) {
                draw([a, b, c], [width, height], &mut picture, &mut nearest);
            }
        }
        progress.advance(Step::Render, tiles(&camera.lens, 1));
        Ok(picture)
    }
}

/// Draws a triangle at pixel centres, with a depth test.
fn draw(
    corners: [Corner; 3],
    [width, height]: [usize; 2],
    picture: &mut [[f32; 3]],
    nearest: &mut [f64],
) {
    let [a, b, c] = corners.map(|corner| corner.at);
    let area = (b - a).perp_dot(c - a);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    // Centres of pixels lie at halves.
    let range = |low: f64, high: f64, side: usize| {
        let start = (low - 0.5).ceil().clamp(0.0, side as f64) as usize;
        start..((high - 0.5).floor() + 1.0).clamp(start as f64, side as f64) as usize
    };
    for y in range(low.y, high.y, height) {
        for x in range(low.x, high.x, width) {
            let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let shares =
                [(b, c), (c, a), (a, b)].map(|(from, to)| (to - from).perp_dot(at - from) / area);
            if shares.iter().any(|share| *share < 0.0) {
                continue;
            }
            let near: f64 =
                corners.iter().zip(shares).map(|(own, share)| share * own.nearness).sum();
            let pixel = y * width + x;
            if near <= nearest[pixel] {
                continue;
            }
            nearest[pixel] = near;
            let light = corners
                .iter()
                .zip(shares)
                .map(|(own, share)| own.color * (share * own.nearness / near))
                .sum::<DVec3>();
            picture[pixel] = light.to_array().map(|light| display(light) as f32);
        }
    }
}
