//! A triangle mesh of a baked field, for viewers that cannot march it.
//!
//! 1. **Matter** ([`matter`]): the nodes of one level, each with its opacity over a cell of the level and
//!    its diffuse colour. Emptiness that no path from outside reaches counts as filled.
//! 2. **Surface** ([`surface`]): where half the light passes a cell, by surface nets: one vertex for
//!    each cell that the surface goes through, at the mean of its crossings, and a quad around each edge
//!    that it crosses. Its vertices lie in the box, and it has no border.
//! 3. **Simplify** ([`simplify`]): edges collapse, the one first whose loss is least, by the quadric error
//!    of Garland and Heckbert (1997), down to the triangles that were asked for.
//!
//! All in float64 and in a fixed order. Colours leave display-referred sRGB for linear values, as glTF
//! wants them, at the end alone.

mod matter;
mod simplify;
mod surface;

use matter::Matter;

use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::parallel;
use crate::codec::container::Container;
use crate::model::grid::Bounds;

/// Nodes along the longest axis that a surface is made of, at most; finer levels are averaged.
const MOST_NODES: usize = 128;
/// A level is fine enough whose surface has this many times the triangles that are asked for.
const SPARE: usize = 2;
/// The fewest triangles of a closed surface.
pub const FEWEST_TRIANGLES: usize = 4;

/// Triangles in training axes, counter-clockwise as seen from outside.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// World units.
    pub positions: Vec<[f32; 3]>,
    /// Linear RGB, 0 to 1, one for each position.
    pub colors: Vec<[f64; 3]>,
    /// Numbers of positions; no triangle is degenerate.
    pub triangles: Vec<[u32; 3]>,
    /// Whether it shows anything: the mesh of an empty field is its box, not to be drawn.
    pub visible: bool,
}

/// Vertices and triangles while they are worked on.
#[derive(Debug, Clone, Default)]
struct Draft {
    positions: Vec<[f64; 3]>,
    /// As the field has them: display-referred sRGB.
    colors: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

/// The mesh of a field, of at most `triangles` triangles (but 12 for an empty field).
///
/// # Errors
/// Fewer than [`FEWEST_TRIANGLES`]; a container that cannot be read.
pub fn mesh(container: &Container, triangles: usize) -> Result<Mesh> {
    if triangles < FEWEST_TRIANGLES {
        let message = format!("a mesh needs at least {FEWEST_TRIANGLES} triangles");
        return Err(Error::usage(message));
    }
    let metadata = container.metadata();
    let (_, free_space) = container.read_head()?;
    let own = |level: &usize| metadata.levels.get(*level).is_some_and(|l| l.density.is_some());
    let mut best = Draft::default();
    let mut cell = 0.0;
    for level in (0..metadata.levels.len()).rev().filter(own) {
        // Each thread holds a plane of density and three of colour.
        let [_, ny, nz] = metadata.levels[level].dimensions.map(|size| size as u64);
        let planes = 16 * parallel::threads() as u64 * ny * nz;
        Budget::new(&Limits::default()).spend(planes, "bytes of planes", &Place::File)?;
        let codes = container.read_level(level)?;
        let matter = Matter::of_level(metadata, level, &codes, free_space.as_ref(), MOST_NODES)?;
        (best, cell) = (surface::surface(&matter), matter.cell);
        if best.triangles.len() >= SPARE * triangles || matter.averaged {
            break;
        }
    }
    let draft = simplify::simplify(best, triangles, cell);
    let mesh = Mesh::of_draft(&draft);
    if mesh.triangles.is_empty() { Ok(Mesh::of_box(&metadata.bounds)) } else { Ok(mesh) }
}

impl Mesh {
    fn of_draft(draft: &Draft) -> Self {
        let rounded: Vec<[f32; 3]> = draft.positions.iter().map(|p| p.map(|v| v as f32)).collect();
        // Rounding can flatten a sliver.
        let area = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|corner| rounded[corner as usize].map(f64::from));
            length(cross(minus(b, a), minus(c, a))) > 0.0
        };
        let mut mesh = Self {
            positions: Vec::new(),
            colors: Vec::new(),
            triangles: Vec::new(),
            visible: true,
        };
        let mut numbers = vec![u32::MAX; rounded.len()];
        for corners in draft.triangles.iter().filter(|corners| area(corners)) {
            mesh.triangles.push(corners.map(|corner| {
                let number = &mut numbers[corner as usize];
                if *number == u32::MAX {
                    *number = mesh.positions.len() as u32;
                    mesh.positions.push(rounded[corner as usize]);
                    mesh.colors.push(draft.colors[corner as usize].map(linear));
                }
                *number
            }));
        }
        mesh
    }

    /// The box of a field in which nothing is to be seen, so that viewers know where it lies.
    fn of_box(bounds: &Bounds) -> Self {
        let corner = |i: u32| {
            let side = |axis: usize| {
                if i >> axis & 1 == 1 { bounds.max[axis] } else { bounds.min[axis] }
            };
            [side(0), side(1), side(2)]
        };
        // Two triangles a face; bit 0 of a corner's number is its side along x, bit 2 along z.
        let triangles = vec![
            [0, 2, 3],
            [0, 3, 1],
            [4, 5, 7],
            [4, 7, 6],
            [0, 1, 5],
            [0, 5, 4],
            [2, 6, 7],
            [2, 7, 3],
            [0, 4, 6],
            [0, 6, 2],
            [1, 3, 7],
            [1, 7, 5],
        ];
        Self {
            positions: (0..8).map(corner).collect(),
            colors: vec![[0.0; 3]; 8],
            triangles,
            visible: false,
        }
    }

    /// The smallest coordinates along each axis, and the largest.
    pub fn extent(&self) -> [[f32; 3]; 2] {
        let fold = |start: f32, pick: fn(f32, f32) -> f32| {
            self.positions.iter().fold([start; 3], |bound, position| {
                std::array::from_fn(|axis| pick(bound[axis], position[axis]))
            })
        };
        [fold(f32::INFINITY, f32::min), fold(f32::NEG_INFINITY, f32::max)]
    }
}

/// Display-referred sRGB to linear (IEC 61966-2-1).
fn linear(value: f64) -> f64 {
    let value = value.clamp(0.0, 1.0);
    if value <= 0.040_45 { value / 12.92 } else { libm::pow((value + 0.055) / 1.055, 2.4) }
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}
