//! The reference implementation of filtering alpha and premultiplied colours, in float64: see the
//! module docs of `levels::alpha`.

use mipvog::levels::AlphaDomain;
use mipvog::model::baked::DensityDomain;
use mipvog::model::field::{ColorDomain, Scene};
use mipvog::model::grid::Bounds;

use super::plain::{all_nodes, density, halved, index, next_level, sigmoid, trilinear};

/// The light that reaches each node.
pub struct Light {
    /// Visibility.
    pub seen: Vec<f64>,
    /// Bent normals by axis.
    pub bent: [Vec<f64>; 3],
}

/// The visibility of each node, in a box whose edges are `extent` intervals long: see the module
/// docs of `levels::visibility`.
pub fn visibility(
    nodes: [usize; 3],
    domain: &AlphaDomain,
    weights: &[f64],
    raw: &[f64],
    extent: [f64; 3],
) -> Vec<f64> {
    light(nodes, domain, weights, raw, extent).seen
}

/// The same with bent normals.
pub fn light(
    nodes: [usize; 3],
    domain: &AlphaDomain,
    weights: &[f64],
    raw: &[f64],
    extent: [f64; 3],
) -> Light {
    let activation = &domain.activation;
    let depth = |raw: &f64| density(*raw, activation) * f64::from(activation.interval);
    let mut depths: Vec<f64> = raw.iter().map(depth).collect();
    let mut coarse = nodes;
    let span = f64::from(domain.span);
    let alpha = |(depth, &raw): (&f64, &f64)| match is_empty(domain, raw) {
        true => 0.0,
        false => -(-depth * span).exp_m1(),
    };
    let mut alphas: Vec<f64> = depths.iter().zip(raw).map(alpha).collect();
    while coarse.iter().any(|&size| size > 160) {
        alphas = next_level(coarse, &alphas, weights);
        coarse = halved(coarse);
        depths = alphas.iter().map(|&alpha| optical_depth(domain, alpha)).collect();
    }
    let spacing = [0, 1, 2].map(|axis| extent[axis] / (coarse[axis] - 1) as f64);
    let Light { seen, bent } = light_past(coarse, &depths, spacing);
    let interpolated = |values: &[f64]| {
        let at = |at: [usize; 3]| {
            let u = [0, 1, 2]
                .map(|axis| at[axis] as f64 * (coarse[axis] - 1) as f64 / (nodes[axis] - 1) as f64);
            trilinear(coarse, values, u)
        };
        all_nodes(nodes).map(at).collect()
    };
    Light { seen: interpolated(&seen), bent: bent.map(|part| interpolated(&part)) }
}

/// True if a raw density has alpha 0.
fn is_empty(domain: &AlphaDomain, raw: f64) -> bool {
    raw <= f64::from(domain.empty_up_to())
}

/// The optical depth over one interval of an alpha.
fn optical_depth(domain: &AlphaDomain, alpha: f64) -> f64 {
    -(-alpha.min(1.0 - 1e-7)).ln_1p() / f64::from(domain.span)
}

/// The light that reaches each node past the optical depths of all others.
fn light_past(nodes: [usize; 3], depths: &[f64], spacing: [f64; 3]) -> Light {
    let directions = all_nodes([3; 3]).map(|at| at.map(|i| i as isize - 1));
    let directions: Vec<_> = directions.filter(|&direction| direction != [0; 3]).collect();
    let way = |direction: [isize; 3]| [0, 1, 2].map(|a| direction[a] as f64 * spacing[a]);
    let length = |way: [f64; 3]| way.iter().map(|part| part * part).sum::<f64>().sqrt();
    let transmittance = |at: [usize; 3], direction: [isize; 3]| {
        let (mut at, mut passed) = (at.map(|i| i as isize), 0.0);
        loop {
            at = [0, 1, 2].map(|axis| at[axis] + direction[axis]);
            let outside = (0..3).any(|axis| at[axis] < 0 || at[axis] >= nodes[axis] as isize);
            // e^-60 is nothing.
            if outside || passed * length(way(direction)) > 60.0 {
                return (-passed * length(way(direction))).exp();
            }
            passed += depths[index(nodes, at.map(|i| i as usize))];
        }
    };
    let (mut seen, mut bent) = (Vec::new(), [(); 3].map(|()| Vec::new()));
    for at in all_nodes(nodes) {
        let light = directions.iter().map(|&direction| (direction, transmittance(at, direction)));
        let light: Vec<_> = light.collect();
        let count = directions.len() as f64;
        let sum: f64 = light.iter().map(|(_, light)| light).sum();
        seen.push((sum / count).powi(2) + 1e-4);
        for (axis, bent) in bent.iter_mut().enumerate() {
            let part = |&(direction, light): &([isize; 3], f64)| {
                let way = way(direction);
                light * way[axis] / length(way)
            };
            bent.push(light.iter().map(part).sum::<f64>() / count);
        }
    }
    Light { seen, bent }
}

/// The lengths of the box's edges in intervals.
pub fn extent(scene: &Scene) -> [f64; 3] {
    let step = f64::from(scene.march.stepsize) * f64::from(scene.march.voxel_size);
    let Bounds { min, max } = scene.bounds;
    [0, 1, 2].map(|axis| (f64::from(max[axis]) - f64::from(min[axis])) / step)
}

/// Alpha, visible alpha, and colours premultiplied by it, of level 0's channels. The first of them
/// is raw density.
pub fn premultiply(
    domain: &AlphaDomain,
    colors: ColorDomain,
    channels: &[Vec<f64>],
    seen: &[f64],
) -> Vec<Vec<f64>> {
    let span = f64::from(domain.activation.interval) * f64::from(domain.span);
    let alpha = |&raw: &f64| match is_empty(domain, raw) {
        true => 0.0,
        false => -(-density(raw, &domain.activation) * span).exp_m1(),
    };
    let activated = |raw: f64| if colors == ColorDomain::Logit { sigmoid(raw) } else { raw };
    let alphas: Vec<f64> = channels[0].iter().map(alpha).collect();
    let weights: Vec<f64> = alphas.iter().zip(seen).map(|(alpha, seen)| alpha * seen).collect();
    let weighted = |color: &Vec<f64>| {
        color.iter().zip(&weights).map(|(&raw, weight)| activated(raw) * weight).collect()
    };
    let colors: Vec<Vec<f64>> = channels[1..].iter().map(weighted).collect();
    [vec![alphas, weights.clone()], colors].concat()
}

/// The values that a level of `nodes` stores of premultiplied channels.
pub fn unpremultiply(
    nodes: [usize; 3],
    domain: &AlphaDomain,
    colors: ColorDomain,
    premultiplied: &[Vec<f64>],
) -> Vec<Vec<f64>> {
    let density = |&alpha: &f64| {
        let depth = optical_depth(domain, alpha);
        match domain.stored {
            DensityDomain::SqrtOpticalDepth => depth.sqrt(),
            _ => -(-depth).exp_m1(),
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
            let color = total(weighted, at) / total(&premultiplied[1], at).max(f64::MIN_POSITIVE);
            let inner = color.clamp(1e-7, 1.0 - 1e-7);
            if colors == ColorDomain::Logit { (inner / (1.0 - inner)).ln() } else { color }
        };
        all_nodes(nodes).map(color).collect()
    };
    let colors: Vec<Vec<f64>> = premultiplied[2..].iter().map(color).collect();
    [vec![premultiplied[0].iter().map(density).collect()], colors].concat()
}
