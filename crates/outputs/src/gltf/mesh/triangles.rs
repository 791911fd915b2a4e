//! Triangles with coloured vertices, in editable and in final form.

use super::vector::{cross, length, minus};
use crate::base::srgb::linear;
use crate::model::grid::Bounds;

/// Cells of a Z-order curve along an axis.
const Z_ORDER_CELLS: f64 = 2097151.0;

/// Triangles in training axes, counter-clockwise as seen from outside.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// World units.
    pub positions: Vec<[f32; 3]>,
    /// Unit vectors outwards, one for each position.
    pub normals: Vec<[f32; 3]>,
    /// Linear RGB, 0 to 1, one for each position.
    pub colors: Vec<[f64; 3]>,
    /// Numbers of positions; no triangle is degenerate.
    pub triangles: Vec<[u32; 3]>,
    /// True if it is visible: the mesh of an empty field is its box, and is not drawn.
    pub visible: bool,
}

/// Vertices and triangles in editable form.
#[derive(Debug, Clone, Default)]
pub(super) struct TriangleSoup {
    pub(super) positions: Vec<[f64; 3]>,
    /// Display-referred sRGB, as in the field.
    pub(super) colors: Vec<[f64; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl TriangleSoup {
    /// Adds those of another one.
    pub(super) fn add(&mut self, other: &Self) {
        let first = u32::try_from(self.positions.len()).unwrap_or(u32::MAX);
        self.positions.extend(&other.positions);
        self.colors.extend(&other.colors);
        let moved = other.triangles.iter().map(|corners| corners.map(|corner| corner + first));
        self.triangles.extend(moved);
    }

    /// Drops triangles whose middle lies within a box.
    pub(super) fn drop_within(&mut self, bounds: &Bounds) {
        let positions = &self.positions;
        self.triangles.retain(|corners| {
            let [a, b, c] = corners.map(|corner| positions[corner as usize]);
            (0..3).any(|axis| {
                let middle = (a[axis] + b[axis] + c[axis]) / 3.0;
                middle < f64::from(bounds.min[axis]) || middle > f64::from(bounds.max[axis])
            })
        });
    }

    /// The same with vertices along a Z-order curve, and triangles in the order of their lowest
    /// vertices: neighbours are then near in memory.
    pub(super) fn in_spatial_order(self) -> Self {
        let bound = |pick: fn(f64, f64) -> f64, start: f64| {
            let join = |a: [f64; 3], b: &[f64; 3]| std::array::from_fn(|i| pick(a[i], b[i]));
            self.positions.iter().fold([start; 3], join)
        };
        let (lowest, highest) = (bound(f64::min, f64::MAX), bound(f64::max, f64::MIN));
        let side = minus(highest, lowest).into_iter().fold(f64::MIN_POSITIVE, f64::max);
        let key = |position: &[f64; 3]| {
            let at = minus(*position, lowest).map(|at| (at / side * Z_ORDER_CELLS) as u64);
            at.into_iter().fold(0, |key, at| key << 1 | spread(at))
        };
        let mut order: Vec<(u64, u32)> = self.positions.iter().map(key).zip(0..).collect();
        order.sort_unstable();
        let mut numbers = vec![0; order.len()];
        for (number, (_, old)) in (0..).zip(&order) {
            numbers[*old as usize] = number;
        }
        let reordered =
            |values: &[[f64; 3]]| order.iter().map(|(_, old)| values[*old as usize]).collect();
        let mut triangles: Vec<[u32; 3]> =
            self.triangles.iter().map(|corners| corners.map(|old| numbers[old as usize])).collect();
        triangles.sort_by_key(|corners| corners.iter().min().copied());
        Self { positions: reordered(&self.positions), colors: reordered(&self.colors), triangles }
    }

    /// Unit normals of the vertices, outwards: means over their triangles, weighted by area. Along
    /// z if they cancel.
    pub(super) fn normals(&self) -> Vec<[f64; 3]> {
        let mut sums = vec![[0.0; 3]; self.positions.len()];
        for corners in &self.triangles {
            let [a, b, c] = corners.map(|corner| self.positions[corner as usize]);
            let normal = cross(minus(b, a), minus(c, a));
            for &corner in corners {
                let sum = &mut sums[corner as usize];
                *sum = [0, 1, 2].map(|axis| sum[axis] + normal[axis]);
            }
        }
        let unit = |sum: [f64; 3]| {
            // Scaled by its largest component first, so that squares of tiny triangles do not
            // underflow.
            let most = sum.iter().fold(0.0f64, |most, along| most.max(along.abs()));
            match most > 0.0 && most.is_finite() {
                true => {
                    let sum = sum.map(|along| along / most);
                    sum.map(|along| along / length(sum))
                }
                false => [0.0, 0.0, 1.0],
            }
        };
        sums.into_iter().map(unit).collect()
    }
}

impl Mesh {
    pub(super) fn of_soup(soup: &TriangleSoup) -> Self {
        let rounded: Vec<[f32; 3]> = soup.positions.iter().map(|p| p.map(|v| v as f32)).collect();
        // Rounding can make a sliver degenerate.
        let area = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|corner| rounded[corner as usize].map(f64::from));
            length(cross(minus(b, a), minus(c, a))) > 0.0
        };
        let mut mesh = Self {
            positions: Vec::new(),
            normals: Vec::new(),
            colors: Vec::new(),
            triangles: Vec::new(),
            visible: true,
        };
        let normals = soup.normals();
        let mut numbers = vec![u32::MAX; rounded.len()];
        for corners in soup.triangles.iter().filter(|corners| area(corners)) {
            mesh.triangles.push(corners.map(|corner| {
                let number = &mut numbers[corner as usize];
                if *number == u32::MAX {
                    *number = mesh.positions.len() as u32;
                    mesh.positions.push(rounded[corner as usize]);
                    mesh.normals.push(normals[corner as usize].map(|v| v as f32));
                    mesh.colors.push(soup.colors[corner as usize].map(linear));
                }
                *number
            }));
        }
        mesh
    }

    /// The box of a field without visible nodes, to give viewers its place.
    pub(super) fn of_box(bounds: &Bounds) -> Self {
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
        // Away from the box's middle.
        let away = |i: u32| {
            let side = |axis: u32| if i >> axis & 1 == 1 { 1.0 } else { -1.0 };
            [side(0), side(1), side(2)].map(|side: f64| (side / 3.0f64.sqrt()) as f32)
        };
        Self {
            positions: (0..8).map(corner).collect(),
            normals: (0..8).map(away).collect(),
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
        // `f32::min` and `f32::max` may return either zero of two, depending on the machine.
        [
            fold(f32::INFINITY, |bound, value| if value < bound { value } else { bound }),
            fold(f32::NEG_INFINITY, |bound, value| if value > bound { value } else { bound }),
        ]
    }
}

/// The lowest 21 bits of a number, each followed by two zeros.
fn spread(number: u64) -> u64 {
    let steps = [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ];
    let start = number & 0x1f_ffff;
    steps.into_iter().fold(start, |bits, (shift, mask)| (bits | bits << shift) & mask)
}
