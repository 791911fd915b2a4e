//! The slow twin of filtering matter, in float64: see the module docs of `mips::matter`.

use mipvog_bake::unstable::levels::mips::{Kernel, Matter, Settled};
use mipvog_bake::unstable::model::field::{Activation, Scene};
use mipvog_bake::unstable::model::grid::Bounds;

use super::plain::{all_nodes, halved, index, next_level, opacity, sigmoid, softplus, trilinear};

/// How much of each node is seen, in a box whose edges are `extent` intervals long: see the module docs
/// of `mips::visibility`.
pub fn visibility(
    nodes: [usize; 3],
    matter: &Matter,
    kernel: Kernel,
    raw: &[f64],
    extent: [f64; 3],
) -> Vec<f64> {
    let Activation { shift, interval, .. } = matter.activation;
    let depth = |raw: &f64| softplus(raw + f64::from(shift)) * f64::from(interval);
    let mut depths: Vec<f64> = raw.iter().map(depth).collect();
    let mut coarse = nodes;
    let reach = f64::from(matter.reach);
    let amount = |(depth, &raw): (&f64, &f64)| match is_empty(matter, raw) {
        true => 0.0,
        false => -(-depth * reach).exp_m1(),
    };
    let mut amounts: Vec<f64> = depths.iter().zip(raw).map(amount).collect();
    while coarse.iter().any(|&size| size > 160) {
        amounts = next_level(coarse, &amounts, kernel);
        coarse = halved(coarse);
        depths = amounts.iter().map(|&amount| optical_depth(matter, amount)).collect();
    }
    let spacing = [0, 1, 2].map(|axis| extent[axis] / (coarse[axis] - 1) as f64);
    let seen = seen_past(coarse, &depths, spacing);
    let interpolated = |at: [usize; 3]| {
        let u = [0, 1, 2]
            .map(|axis| at[axis] as f64 * (coarse[axis] - 1) as f64 / (nodes[axis] - 1) as f64);
        trilinear(coarse, &seen, u)
    };
    all_nodes(nodes).map(interpolated).collect()
}

/// Whether a raw density is no matter.
fn is_empty(matter: &Matter, raw: f64) -> bool {
    raw <= f64::from(matter.empty_up_to())
}

/// The optical depth over one interval of an amount.
fn optical_depth(matter: &Matter, amount: f64) -> f64 {
    -(-amount.min(1.0 - 1e-7)).ln_1p() / f64::from(matter.reach)
}

/// How much of each node is seen past the optical depths of all others.
fn seen_past(nodes: [usize; 3], depths: &[f64], spacing: [f64; 3]) -> Vec<f64> {
    let directions = all_nodes([3; 3]).map(|at| at.map(|i| i as isize - 1));
    let directions: Vec<_> = directions.filter(|&direction| direction != [0; 3]).collect();
    let light = |at: [usize; 3], direction: [isize; 3]| {
        let length = (0..3).map(|a| (direction[a] as f64 * spacing[a]).powi(2)).sum::<f64>().sqrt();
        let (mut at, mut passed) = (at.map(|i| i as isize), 0.0);
        loop {
            at = [0, 1, 2].map(|axis| at[axis] + direction[axis]);
            let outside = (0..3).any(|axis| at[axis] < 0 || at[axis] >= nodes[axis] as isize);
            // Nobody sees what e^-60 is left of.
            if outside || passed * length > 60.0 {
                return (-passed * length).exp();
            }
            passed += depths[index(nodes, at.map(|i| i as usize))];
        }
    };
    let seen = |at: [usize; 3]| {
        let sum: f64 = directions.iter().map(|&direction| light(at, direction)).sum();
        (sum / directions.len() as f64).powi(2) + 1e-4
    };
    all_nodes(nodes).map(seen).collect()
}

/// The lengths of the box's edges in intervals.
pub fn extent(scene: &Scene) -> [f64; 3] {
    let step = f64::from(scene.march.stepsize) * f64::from(scene.march.voxel_size);
    let Bounds { min, max } = scene.bounds;
    [0, 1, 2].map(|axis| (f64::from(max[axis]) - f64::from(min[axis])) / step)
}

/// Amounts, their part that is `seen`, and colours weighted by it, of level 0's channels, the first of
/// them raw density.
pub fn lift(matter: &Matter, channels: &[Vec<f64>], seen: &[f64]) -> Vec<Vec<f64>> {
    let shift = f64::from(matter.activation.shift);
    let reach = f64::from(matter.activation.interval) * f64::from(matter.reach);
    let amount = |&raw: &f64| if is_empty(matter, raw) { 0.0 } else { opacity(raw, shift, reach) };
    let amounts: Vec<f64> = channels[0].iter().map(amount).collect();
    let weights: Vec<f64> = amounts.iter().zip(seen).map(|(amount, seen)| amount * seen).collect();
    let weighted = |color: &Vec<f64>| {
        color.iter().zip(&weights).map(|(&raw, weight)| sigmoid(raw) * weight).collect()
    };
    let colors: Vec<Vec<f64>> = channels[1..].iter().map(weighted).collect();
    [vec![amounts, weights.clone()], colors].concat()
}

/// What a level of `nodes` stores of lifted channels.
pub fn settle(nodes: [usize; 3], matter: &Matter, lifted: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let density = |&amount: &f64| {
        let depth = optical_depth(matter, amount);
        match matter.settled {
            Settled::SqrtOpticalDepth => depth.sqrt(),
            Settled::Opacity => -(-depth).exp_m1(),
        }
    };
    let total = |values: &[f64], at: [usize; 3]| {
        let range = |axis: usize| at[axis].saturating_sub(1)..=(at[axis] + 1).min(nodes[axis] - 1);
        let mut near = 0.0;
        for x in range(0) {
            for y in range(1) {
                near += range(2).map(|z| values[index(nodes, [x, y, z])]).sum::<f64>();
            }
        }
        values[index(nodes, at)] + 1e-4 * near
    };
    let color = |weighted: &Vec<f64>| {
        let color = |at| {
            let color = total(weighted, at) / total(&lifted[1], at).max(f64::MIN_POSITIVE);
            let color = color.clamp(1e-7, 1.0 - 1e-7);
            (color / (1.0 - color)).ln()
        };
        all_nodes(nodes).map(color).collect()
    };
    let colors: Vec<Vec<f64>> = lifted[2..].iter().map(color).collect();
    [vec![lifted[0].iter().map(density).collect()], colors].concat()
}
