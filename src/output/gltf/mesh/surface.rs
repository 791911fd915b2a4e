//! Surface nets (Gibson 1998): one vertex a cell.

use super::matter::{INSIDE, Matter};
use super::triangles::Draft;
use super::vector::{length, minus};

/// Marks cells that the surface does not go through.
const NO_VERTEX: u32 = u32::MAX;

/// The surface around what is inside. Each edge of the grid that it crosses gives two triangles.
pub fn surface(matter: &Matter) -> Draft {
    let mut draft = Draft::default();
    let strides = matter.strides();
    let vertices = vertices(matter, &mut draft);
    let inside = |node: usize| matter.opacity[node] >= INSIDE;
    for node in 0..matter.opacity.len() {
        for axis in 0..3 {
            let along = node / strides[axis] % matter.sizes[axis];
            if along + 1 == matter.sizes[axis] {
                continue;
            }
            let other = node + strides[axis];
            if inside(node) == inside(other) {
                continue;
            }
            // The four cells around the edge, counter-clockwise as seen from its upper end. The layer
            // around the grid is outside, so none of them is beyond it.
            let (u, v) = (strides[(axis + 1) % 3], strides[(axis + 2) % 3]);
            let quad = [node - u - v, node - v, node, node - u].map(|cell| vertices[cell]);
            push_quad(
                &mut draft,
                if inside(node) { quad } else { [quad[3], quad[2], quad[1], quad[0]] },
            );
        }
    }
    draft
}

/// A vertex for each cell, by the number of the cell's lowest node.
fn vertices(matter: &Matter, draft: &mut Draft) -> Vec<u32> {
    let mut vertices = vec![NO_VERTEX; matter.opacity.len()];
    let [nx, ny, nz] = matter.sizes;
    let strides = matter.strides();
    for x in 0..nx - 1 {
        for y in 0..ny - 1 {
            for z in 0..nz - 1 {
                let lowest = x * strides[0] + y * strides[1] + z;
                let corner = |i: usize| {
                    let [a, b, c] = [i >> 2 & 1, i >> 1 & 1, i & 1];
                    let position = [matter.at[0][x + a], matter.at[1][y + b], matter.at[2][z + c]];
                    (lowest + a * strides[0] + b * strides[1] + c, position)
                };
                let corners: [(usize, [f64; 3]); 8] = std::array::from_fn(corner);
                if let Some(position) = crossing(matter, &corners) {
                    vertices[lowest] = draft.positions.len() as u32;
                    draft.positions.push(position);
                    draft.colors.push(color(matter, &corners));
                }
            }
        }
    }
    vertices
}

/// The mean of where the surface crosses a cell's edges, if it does.
fn crossing(matter: &Matter, corners: &[(usize, [f64; 3]); 8]) -> Option<[f64; 3]> {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for low in 0..8 {
        for bit in [1, 2, 4] {
            if low & bit != 0 {
                continue;
            }
            let ((a, from), (b, to)) = (corners[low], corners[low | bit]);
            let [a, b] = [a, b].map(|node| matter.opacity[node]);
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

/// The colour of a cell's matter.
fn color(matter: &Matter, corners: &[(usize, [f64; 3]); 8]) -> [f64; 3] {
    let (mut sum, mut total) = ([0.0; 3], 0.0);
    for &(node, _) in corners {
        let (color, weight) = matter.color[node];
        for (sum, channel) in sum.iter_mut().zip(color) {
            *sum += weight * channel;
        }
        total += weight;
    }
    // Filled cavities have no colour, but never touch the outside.
    if total > 0.0 { sum.map(|sum| sum / total) } else { sum }
}

/// Two triangles along the shorter diagonal.
fn push_quad(draft: &mut Draft, [a, b, c, d]: [u32; 4]) {
    let at = |vertex: u32| draft.positions[vertex as usize];
    let diagonal = |from: u32, to: u32| length(minus(at(from), at(to)));
    let triangles = if diagonal(a, c) <= diagonal(b, d) {
        [[a, b, c], [a, c, d]]
    } else {
        [[a, b, d], [b, c, d]]
    };
    draft.triangles.extend(triangles);
}
