//! The reference implementation: every stage as its definition says, in float64, one node at a
//! time.

use mipvog::model::field::{Activation, DensityFunction};

/// Every node of a grid, z fastest.
pub fn all_nodes([nx, ny, nz]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..nx * ny * nz).map(move |i| [i / nz / ny, i / nz % ny, i % nz])
}

/// A node's number.
pub fn index(nodes: [usize; 3], [x, y, z]: [usize; 3]) -> usize {
    (x * nodes[1] + y) * nodes[2] + z
}

/// The size of the next level.
pub fn halved(nodes: [usize; 3]) -> [usize; 3] {
    nodes.map(|size| (size / 2).max(2))
}

/// One level step: low-pass with mirrored faces, then trilinear resize with corners aligned.
pub fn next_level(nodes: [usize; 3], values: &[f64], weights: &[f64]) -> Vec<f64> {
    let mut low = values.to_vec();
    for axis in 0..3 {
        low = lowpass(nodes, &low, weights, axis);
    }
    let coarse = halved(nodes);
    all_nodes(coarse)
        .map(|at| {
            let u = std::array::from_fn(|axis| {
                at[axis] as f64 * (nodes[axis] - 1) as f64 / (coarse[axis] - 1) as f64
            });
            trilinear(nodes, &low, u)
        })
        .collect()
}

fn lowpass(nodes: [usize; 3], values: &[f64], weights: &[f64], axis: usize) -> Vec<f64> {
    let radius = (weights.len() / 2) as isize;
    all_nodes(nodes)
        .map(|at| {
            let mut sum = 0.0;
            for (tap, weight) in weights.iter().enumerate() {
                let mut from = at;
                from[axis] = mirror(at[axis] as isize + tap as isize - radius, nodes[axis]);
                sum += weight * values[index(nodes, from)];
            }
            sum
        })
        .collect()
}

fn mirror(mut node: isize, count: usize) -> usize {
    let last = count as isize - 1;
    while node < 0 || node > last {
        node = if node < 0 { -node } else { 2 * last - node };
    }
    node as usize
}

/// Trilinear interpolation at a position in index space.
pub fn trilinear(nodes: [usize; 3], values: &[f64], u: [f64; 3]) -> f64 {
    shares(nodes, u).map(|(node, share)| share * values[node]).iter().sum()
}

/// The corners of the cell of `u`, in index space, and their trilinear shares.
pub fn shares(nodes: [usize; 3], u: [f64; 3]) -> [(usize, f64); 8] {
    std::array::from_fn(|corner| {
        let (mut weight, mut at) = (1.0, [0; 3]);
        for axis in 0..3 {
            let low = (u[axis] as usize).min(nodes[axis] - 2);
            let fraction = u[axis] - low as f64;
            let high = corner >> axis & 1;
            weight *= if high == 1 { fraction } else { 1.0 - fraction };
            at[axis] = low + high;
        }
        (index(nodes, at), weight)
    })
}

/// `ln(1 + exp(x))`.
pub fn softplus(x: f64) -> f64 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

/// Opacity over an interval.
pub fn opacity(raw: f64, shift: f64, interval: f64) -> f64 {
    -(-softplus(raw + shift) * interval).exp_m1()
}

/// Density of a raw density.
pub fn density(raw: f64, activation: &Activation) -> f64 {
    match activation.function {
        DensityFunction::Softplus => softplus(raw + f64::from(activation.shift)),
        DensityFunction::Relu => raw.max(0.0),
    }
}

/// The sigmoid.
pub fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// Corners of cells in `cells`, a set of cells by their lowest nodes.
pub fn corners(nodes: [usize; 3], cells: &[bool]) -> Vec<bool> {
    all_nodes(nodes)
        .map(|at| {
            (0..8usize).any(|corner| {
                let lower: [Option<usize>; 3] =
                    std::array::from_fn(|axis| at[axis].checked_sub(corner >> axis & 1));
                match lower {
                    [Some(x), Some(y), Some(z)] => cells[index(nodes, [x, y, z])],
                    _ => false,
                }
            })
        })
        .collect()
}

/// Cells, by their lowest nodes, that have a corner in `marked`.
pub fn cells(nodes: [usize; 3], marked: &[bool]) -> Vec<bool> {
    all_nodes(nodes)
        .map(|at| {
            let is_cell = (0..3).all(|axis| at[axis] + 1 < nodes[axis]);
            is_cell
                && (0..8usize).any(|corner| {
                    let node = std::array::from_fn(|axis| at[axis] + (corner >> axis & 1));
                    marked[index(nodes, node)]
                })
        })
        .collect()
}

/// Cells of `coarse` that overlap one of `cells` of `fine`, as fractions of the same box.
pub fn overlapping(fine: [usize; 3], cells: &[bool], coarse: [usize; 3]) -> Vec<bool> {
    let overlaps = |a: usize, a_nodes: usize, b: usize, b_nodes: usize| {
        // [a, a + 1] / (a_nodes - 1) and [b, b + 1] / (b_nodes - 1) share more than a point.
        a * (b_nodes - 1) < (b + 1) * (a_nodes - 1) && b * (a_nodes - 1) < (a + 1) * (b_nodes - 1)
    };
    let mut found = vec![false; coarse.iter().product()];
    for at in all_nodes(fine).filter(|&at| cells[index(fine, at)]) {
        let ranges: [Vec<usize>; 3] = std::array::from_fn(|axis| {
            let inside = |&b: &usize| overlaps(at[axis], fine[axis], b, coarse[axis]);
            (0..coarse[axis] - 1).filter(inside).collect()
        });
        for &x in &ranges[0] {
            for &y in &ranges[1] {
                for &z in &ranges[2] {
                    found[index(coarse, [x, y, z])] = true;
                }
            }
        }
    }
    found
}
