//! The stages that make levels: filters, weighted averages, quantization, against their reference
//! implementations.

use mipvog::bake::Filter;
use mipvog::levels::sizes::level_sizes;
use mipvog::levels::taps::AxisTaps;
use mipvog::levels::{
    AlphaDomain, Content, Kernel, LevelFilter, OpticalDepthGrid, RequiredNodes, Visibility,
};
use mipvog::model::baked::DensityDomain;
use mipvog::model::field::ColorDomain;
use mipvog::model::grid::{NodeMask, Nodes};

use std::sync::OnceLock;

use super::plain::{all_nodes, halved, next_level, sigmoid};
use super::planes::{Channels, levels};
use super::stress::Worst;
use super::stress_scalar::{INTERVALS, SHIFTS, activation, raws};
use super::{Random, plain_alpha};

/// All levels of some channels under a low-pass; every node is required.
fn all_levels(
    nodes: [usize; 3],
    channels: &[Vec<f32>],
    weights: &[f64],
    content: Content,
) -> Vec<Channels> {
    levels(channels, &everything(nodes, weights), content)
}

fn everything(nodes: [usize; 3], weights: &[f64]) -> RequiredNodes {
    let sizes = level_sizes(Nodes(nodes), usize::MAX);
    let whole = sizes.iter().map(|&size| NodeMask::full(size)).collect();
    RequiredNodes::new(whole, None, weights).expect("required nodes")
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| value.into()).collect()
}

fn checkerboard(nodes: [usize; 3], values: [f32; 2]) -> Vec<f32> {
    all_nodes(nodes).map(|[x, y, z]| values[(x + y + z) % 2]).collect()
}

/// Fields that hurt, with their names.
fn fields(nodes: [usize; 3], seed: u64) -> Vec<(&'static str, Vec<f32>)> {
    let count: usize = nodes.iter().product();
    let mut random = Random::new(seed);
    let all: Vec<f32> = raws().chain([f32::MAX, f32::MIN]).collect();
    let single = |at: usize, value: f32| {
        let mut values = vec![-100.0; count];
        values[at] = value;
        values
    };
    vec![
        ("checkerboard of 1e30", checkerboard(nodes, [1e30, -1e30])),
        ("checkerboard", checkerboard(nodes, [80.1, -100.0])),
        ("first voxel", single(0, 1e30)),
        ("single voxel", single(count / 2, 9.7)),
        ("subnormals", (0..count).map(|_| random.between(-1.0, 1.0) * 1e-40).collect()),
        ("f16 extremes", (0..count).map(|i| [65504.0, -6e-8, -65504.0][i % 3]).collect()),
        ("every raw value", (0..count).map(|_| all[random.below(all.len())]).collect()),
        ("chance", (0..count).map(|_| random.between(-100.0, 80.0)).collect()),
    ]
}

const SIZES: [[usize; 3]; 6] =
    [[3, 2, 2], [2, 7, 33], [8, 9, 10], [2, 2, 2000], [31, 2, 4], [5, 40, 3]];

/// One step against the reference's; relative to the weighted sum of magnitudes.
fn take_step(worst: &mut Worst, nodes: [usize; 3], values: &[f32], kernel: Kernel, name: &str) {
    let weights = &kernel.weights();
    let levels = all_levels(nodes, &[values.to_vec()], weights, Content::Logits(0..1));
    let want = next_level(nodes, &wide(values), weights);
    let scale =
        next_level(nodes, &wide(values).iter().map(|v| v.abs()).collect::<Vec<_>>(), weights);
    for (i, ((got, want), scale)) in levels[1][0].iter().zip(want).zip(scale).enumerate() {
        let at = || format!("{name}, {nodes:?}, {}, node {i}", kernel.name());
        worst.take((*got).into(), want, scale, &at);
    }
}

fn kernels() -> impl Iterator<Item = Kernel> {
    Kernel::ALL.into_iter().chain([Kernel::Tent])
}

pub fn filters() -> Worst {
    let mut worst = Worst::default();
    for (seed, nodes) in SIZES.into_iter().enumerate() {
        for (name, values) in fields(nodes, seed as u64) {
            kernels().for_each(|kernel| take_step(&mut worst, nodes, &values, kernel, name));
        }
    }
    worst
}

pub fn resize() -> Worst {
    let mut worst = Worst::default();
    for size in 3..=70 {
        for nodes in [[2, 3, size], [size, 2, 2]] {
            for (name, values) in fields(nodes, size as u64) {
                take_step(&mut worst, nodes, &values, Kernel::None, name);
            }
        }
    }
    worst
}

pub fn exact() -> Worst {
    let mut worst = Worst::default();
    for nodes in SIZES {
        for value in raws().step_by(37).chain([1e30, -1e30, -0.0, 1e-45, f32::MAX]) {
            for kernel in kernels() {
                let values = vec![value; nodes.iter().product()];
                for level in all_levels(
                    nodes,
                    std::slice::from_ref(&values),
                    &kernel.weights(),
                    Content::Logits(0..1),
                ) {
                    for got in &level[0] {
                        let at = || format!("{value}, {}", kernel.name());
                        worst.take((*got).into(), value.into(), value.abs().into(), &at);
                    }
                }
            }
        }
    }
    for nodes in SIZES {
        // Slopes of as many units as the coarser axis has voxels: all its values are whole numbers.
        let coarse = halved(nodes);
        let slope = coarse.map(|size| size - 1);
        let value = |at: [usize; 3], by: [usize; 3]| (0..3).map(|a| at[a] * by[a]).sum::<usize>();
        let values = all_nodes(nodes).map(|at| value(at, slope) as f32).collect();
        let whole = nodes.map(|size| size - 1);
        for kernel in kernels() {
            let content = Content::Logits(0..1);
            let got = &all_levels(nodes, &[Vec::clone(&values)], &kernel.weights(), content)[1][0];
            // Windows that no mirror touches.
            let weights = kernel.weights();
            let (width, radius) = (weights.len() + 1, weights.len() / 2);
            let inner = |axis: usize, at: usize| {
                let taps = AxisTaps::new(nodes[axis], coarse[axis], &weights);
                let low = at * whole[axis] / slope[axis];
                kernel == Kernel::None
                    || (taps.window(at).1.len() == width
                        && low >= radius
                        && low + radius + 1 < nodes[axis])
            };
            for (at, got) in all_nodes(coarse).zip(got) {
                if (0..3).all(|axis| inner(axis, at[axis])) {
                    let want = value(at, whole) as f64;
                    let name = || format!("linear, {nodes:?}, {}, {at:?}", kernel.name());
                    worst.take((*got).into(), want, want, &name);
                }
            }
        }
    }
    worst
}

pub fn twenty_levels() -> Worst {
    let mut worst = Worst::default();
    let mut nodes = [2, 2, 1 << 20];
    let mut random = Random::new(20);
    let values: Vec<f32> =
        (0..4 << 20).map(|_| [1e30, -1e30, 7e29, 1.0][random.below(4)]).collect();
    let levels = all_levels(
        nodes,
        std::slice::from_ref(&values),
        &Kernel::Tent.weights(),
        Content::Logits(0..1),
    );
    assert_eq!(levels.len(), 20);
    let mut want = wide(&values);
    let mut scale: Vec<f64> = want.iter().map(|value| value.abs()).collect();
    for (level, got) in levels.iter().enumerate().skip(1) {
        want = next_level(nodes, &want, &Kernel::Tent.weights());
        scale = next_level(nodes, &scale, &Kernel::Tent.weights());
        nodes = halved(nodes);
        for ((got, want), scale) in got[0].iter().zip(&want).zip(&scale) {
            worst.take((*got).into(), *want, *scale, &|| format!("level {level}"));
        }
    }
    worst
}

/// Edge of the box in intervals.
const EXTENT: f64 = 20.0;

/// The visibility of each node as the program finds it.
fn visibility(nodes: [usize; 3], domain: &AlphaDomain, weights: &[f64], raw: &[f32]) -> Visibility {
    let sizes = level_sizes(Nodes(nodes), usize::MAX);
    let depths = OpticalDepthGrid::new(*domain, &sizes, [EXTENT; 3]);
    for (x, plane) in raw.chunks(nodes[1] * nodes[2]).enumerate() {
        depths.take(0, x, plane);
    }
    let alphas = all_levels(nodes, &[raw.to_vec()], weights, Content::Alpha(*domain));
    for (level, (alphas, size)) in alphas.iter().zip(&sizes).enumerate().skip(1) {
        for (x, plane) in alphas[0].chunks(size.0[1] * size.0[2]).enumerate() {
            depths.take(level, x, plane);
        }
    }
    depths.visibility().expect("a visibility")
}

/// Hurtful fields through all levels: `take(level, domain, got, want, alphas)`, the channels being
/// density and two colours.
fn premultiplied(mut take: impl FnMut(usize, &AlphaDomain, &Channels, &[Vec<f64>], &[f64])) {
    let filters = [Filter::RateTent, Filter::Coverage];
    for (seed, (nodes, shift)) in
        SIZES.into_iter().flat_map(|nodes| SHIFTS.map(|shift| (nodes, shift))).enumerate()
    {
        for (filter, interval) in filters.into_iter().flat_map(|f| INTERVALS.map(|i| (f, i))) {
            let filter: &dyn LevelFilter = &filter;
            let domain = filter.alpha(&activation(shift, interval)).expect("a filter of alpha");
            let weights = &filter.weights();
            let mut all = fields(nodes, seed as u64);
            let count: usize = nodes.iter().product();
            // Constants around the greatest alpha that counts: 1 - 1e-7.
            for depth in [12.2, 13.4, 14.0, 14.6, 15.0, 15.3, 15.6, 15.8, 15.9, 16.0, 16.3] {
                let raw = depth / (interval * domain.span) - shift;
                all.push(("nearly opaque", vec![raw; count]));
            }
            let color = all[6].1.clone();
            let other = all[7].1.iter().map(|value| value * 0.1).collect::<Vec<f32>>();
            for (_, density) in all {
                let mut size = nodes;
                let channels = vec![density, color.clone(), other.clone()];
                let channels: Channels =
                    channels.into_iter().map(|c| c.into_iter().map(moderate).collect()).collect();
                let visibility = visibility(nodes, &domain, weights, &channels[0]);
                let required = everything(nodes, weights);
                let retained = required.levels().iter().collect();
                let colors = ColorDomain::Logit;
                let visibility = &visibility;
                let content =
                    Content::Colors { domain, colors, visibility, retained, direction: None };
                let levels = levels(&channels, &required, content);
                let wide: Vec<Vec<f64>> = channels.iter().map(|c| wide(c)).collect();
                let extent = [EXTENT; 3];
                let seen = plain_alpha::visibility(nodes, &domain, weights, &wide[0], extent);
                let mut linear = plain_alpha::premultiply(&domain, colors, &wide, &seen);
                for (level, got) in levels.iter().enumerate().skip(1) {
                    for channel in &mut linear {
                        *channel = next_level(size, channel, weights);
                    }
                    size = halved(size);
                    let want = plain_alpha::unpremultiply(size, &domain, colors, &linear);
                    take(level, &domain, got, &want, &linear[0]);
                }
            }
        }
    }
}

fn moderate(value: f32) -> f32 {
    value.clamp(-1e30, 1e30)
}

pub fn density_of_levels() -> Worst {
    of_levels().0.clone()
}

pub fn color_of_levels() -> Worst {
    of_levels().1.clone()
}

/// Of densities and of colours, which one pass measures.
fn of_levels() -> &'static (Worst, Worst) {
    static MEASURED: OnceLock<(Worst, Worst)> = OnceLock::new();
    MEASURED.get_or_init(measure_levels)
}

fn measure_levels() -> (Worst, Worst) {
    let (mut densities, mut colors) = (Worst::default(), Worst::default());
    premultiplied(|level, domain, got, want, alphas| {
        for (&got, &want) in got[0].iter().zip(&want[0]) {
            let opacity = |value: f64| {
                let depth = match domain.stored {
                    DensityDomain::SqrtOpticalDepth => value * value,
                    _ => -(-value).ln_1p(),
                };
                -(-depth * 2f64.powi(level as i32)).exp_m1()
            };
            let at = || format!("level {level}, {domain:?}, {got} for {want}");
            densities.take(opacity(got.into()), opacity(want), 0.0, &at);
        }
        for channel in 1..3 {
            let pairs = got[channel].iter().zip(&want[channel]);
            for ((&got, &want), &alpha) in pairs.zip(alphas).filter(|(_, a)| **a > 0.0) {
                let at = || format!("level {level}, {domain:?}, alpha {alpha}, {got} for {want}");
                colors.take(sigmoid(got.into()), sigmoid(want), 0.0, &at);
            }
        }
    });
    (densities, colors)
}
