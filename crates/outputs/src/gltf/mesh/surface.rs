//! Surface nets (Gibson 1998): one vertex per cell.

use super::opacity_grid::{INSIDE, OpacityGrid};
use super::triangles::TriangleSoup;
use super::vector::{length, minus};

/// Marks cells without a surface.
const NO_VERTEX: u32 = u32::MAX;

/// The surface around the opaque nodes. Each crossed edge of the grid gives two triangles.
pub fn surface(grid: &OpacityGrid) -> TriangleSoup {
    let mut soup = TriangleSoup::default();
    let strides = grid.strides();
    let vertices = vertices(grid, &mut soup);
    let inside = |node: usize| grid.opacity[node] >= INSIDE;
    for node in 0..grid.opacity.len() {
        for axis in 0..3 {
            let along = node / strides[axis] % grid.sizes[axis];
            if along + 1 == grid.sizes[axis] {
                continue;
            }
            let other = node + strides[axis];
            if inside(node) == inside(other) {
                continue;
            }
            // The four cells around the edge, counter-clockwise as seen from its upper end. The
            // layer around the grid is outside, so none of them is beyond it.
            let (u, v) = (strides[(axis + 1) % 3], strides[(axis + 2) % 3]);
            let quad = [node - u - v, node - v, node, node - u].map(|cell| vertices[cell]);
            push_quad(
                &mut soup,
                if inside(node) { quad } else { [quad[3], quad[2], quad[1], quad[0]] },
            );
        }
    }
    soup
}

/// A vertex for each cell, by the number of the cell's lowest node.
fn vertices(grid: &OpacityGrid, soup: &mut TriangleSoup) -> Vec<u32> {
    let mut vertices = vec![NO_VERTEX; grid.opacity.len()];
    let [nx, ny, nz] = grid.sizes;
    let strides = grid.strides();
    for x in 0..nx - 1 {
        for y in 0..ny - 1 {
            for z in 0..nz - 1 {
                let lowest = x * strides[0] + y * strides[1] + z;
                let corner = |i: usize| {
                    let [a, b, c] = [i >> 2 & 1, i >> 1 & 1, i & 1];
                    let position = [grid.at[0][x + a], grid.at[1][y + b], grid.at[2][z + c]];
                    (lowest + a * strides[0] + b * strides[1] + c, position)
                };
                let corners: [(usize, [f64; 3]); 8] = std::array::from_fn(corner);
                if let Some(position) = crossing(grid, &corners) {
                    vertices[lowest] = soup.positions.len() as u32;
                    soup.positions.push(position);
                    soup.colors.push(color(grid, &corners));
                }
            }
        }
    }
    vertices
}

/// The mean of the surface's crossings with a cell's edges, if any.
fn crossing(grid: &OpacityGrid, corners: &[(usize, [f64; 3]); 8]) -> Option<[f64; 3]> {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for low in 0..8 {
        for bit in [1, 2, 4] {
            if low & bit != 0 {
                continue;
            }
            let ((a, from), (b, to)) = (corners[low], corners[low | bit]);
            let [a, b] = [a, b].map(|node| grid.opacity[node]);
            if (a >= INSIDE) == (b >= INSIDE) {
                continue;
            }
            let share = (INSIDE - a) / (b - a);
            for axis in 0..3 {
                sum[axis] += from[axis] + (to[axis] - from[axis]) * share;
            }
            count += 1.0;
        }
    }
    (count > 0.0).then(|| sum.map(|sum| sum / count))
}

/// The colour of a cell's grid.
fn color(grid: &OpacityGrid, corners: &[(usize, [f64; 3]); 8]) -> [f64; 3] {
    let (mut sum, mut total) = ([0.0; 3], 0.0);
    for &(node, _) in corners {
        let (color, weight) = grid.color[node];
        for (sum, channel) in sum.iter_mut().zip(color) {
            *sum += weight * channel;
        }
        total += weight;
    }
    // Filled cavities have no colour, but never touch the outside.
    if total > 0.0 { sum.map(|sum| sum / total) } else { sum }
}

/// Two triangles along the shorter diagonal.
fn push_quad(soup: &mut TriangleSoup, [a, b, c, d]: [u32; 4]) {
    let at = |vertex: u32| soup.positions[vertex as usize];
    let diagonal = |from: u32, to: u32| length(minus(at(from), at(to)));
    let triangles = if diagonal(a, c) <= diagonal(b, d) {
        [[a, b, c], [a, c, d]]
    } else {
        [[a, b, d], [b, c, d]]
    };
    soup.triangles.extend(triangles);
}
