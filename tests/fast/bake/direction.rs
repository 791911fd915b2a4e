//! What levels show otherwise from each side, against a plain reference implementation in float64
//! and against scenes whose answer is known.

use crate::common::plain::{all_nodes, halved, index, next_level, sigmoid, trilinear};
use crate::common::planes::levels;
use crate::common::{Random, plain_alpha};
use mipvog::bake::Filter;
use mipvog::levels::sizes::level_sizes;
use mipvog::levels::{Content, Direction, LevelFilter, OpticalDepthGrid, RequiredNodes};
use mipvog::model::anisotropy::{ANISOTROPY, functions};
use mipvog::model::directional::DIRECTIONAL;
use mipvog::model::field::{Activation, ColorDomain};
use mipvog::model::grid::{NodeMask, Nodes};

const SIZES: [[usize; 3]; 7] =
    [[3, 2, 2], [2, 7, 33], [8, 9, 10], [2, 2, 150], [31, 2, 4], [5, 40, 3], [24, 23, 20]];
/// Lengths of the box's edges, in world units and in intervals.
const EDGES: [f32; 3] = [2.0, 3.0, 2.5];
const EXTENT: [f64; 3] = [20.0, 30.0, 25.0];
/// Largest error of anisotropy: sums of f32 numbers of at most 2.
const ANISOTROPY_BOUND: f64 = 2e-5;
/// Largest error of brightness where all light gets out, in logits: the same.
const BRIGHTNESS_BOUND: f64 = 1e-4;
/// Largest error of a part of a bent normal: 16-bit numbers, rounded twice.
const BENT_BOUND: f64 = 2.0 / 65534.0;

/// Densities that are hard: chance, nothing, everything full, one node, a wall a node thick.
fn densities(nodes: [usize; 3], random: &mut Random) -> Vec<Vec<f32>> {
    let count: usize = nodes.iter().product();
    let mut single = vec![-100.0; count];
    single[count / 2] = 9.0;
    let wall = all_nodes(nodes).map(|[_, y, _]| if y == nodes[1] / 2 { 8.0 } else { -90.0 });
    vec![
        (0..count).map(|_| random.between(-9.0, 6.0)).collect(),
        vec![-100.0; count],
        vec![30.0; count],
        single,
        wall.collect(),
    ]
}

/// The values of direction of all levels from 1 on, `[channel][node]`, with moments of the nodes of
/// level `moments`.
fn made(
    nodes: [usize; 3],
    channels: &[Vec<f32>],
    activation: Activation,
    moments: usize,
) -> Vec<Vec<Vec<f32>>> {
    let filter: &dyn LevelFilter = &Filter::RateTent;
    let domain = filter.alpha(&activation).expect("a filter of alpha");
    let sizes = level_sizes(Nodes(nodes), usize::MAX);
    let depths = OpticalDepthGrid::new(domain, &sizes, EXTENT).with_bent_normals(true);
    for (x, plane) in channels[0].chunks(nodes[1] * nodes[2]).enumerate() {
        depths.take(0, x, plane);
    }
    let visibility = &depths.visibility().expect("visibility");
    let whole: Vec<NodeMask> = sizes.iter().map(|&size| NodeMask::full(size)).collect();
    let required = RequiredNodes::new(whole.clone(), None, &filter.weights()).expect("nodes");
    let content = Content::Colors {
        domain,
        colors: ColorDomain::Logit,
        visibility,
        retained: whole.iter().collect(),
        direction: Some(Direction::new(EDGES, Some(moments))),
    };
    let levels = levels(channels, &required, content).into_iter().skip(1);
    levels.map(|level| level[channels.len()..].to_vec()).collect()
}

/// Bent normals of a grid of `nodes`, between the nodes of a grid of `size`.
fn bent_at(size: [usize; 3], nodes: [usize; 3], bent: &[Vec<f64>; 3]) -> [Vec<f64>; 3] {
    bent.each_ref().map(|bent| {
        let between = |at: [usize; 3]| {
            let place = |a: usize| at[a] as f64 * (nodes[a] - 1) as f64 / (size[a] - 1) as f64;
            trilinear(nodes, bent, [0, 1, 2].map(place))
        };
        all_nodes(size).map(between).collect()
    })
}

/// Moments of brightness, from alpha, visible alpha and premultiplied colours.
fn moments(sums: &[Vec<f64>], bent: &[Vec<f64>; 3]) -> Vec<Vec<f64>> {
    let mean = |i: usize| match sums[1][i] {
        0.0 => 0.0,
        visible => (sums[2][i] + sums[3][i] + sums[4][i]) / 3.0 / visible,
    };
    let plain = bent.iter().map(|bent| (0..bent.len()).map(|i| sums[0][i] * bent[i]).collect());
    let plain: Vec<Vec<f64>> = plain.collect();
    let bright = plain.iter().map(|of| (0..of.len()).map(|i| of[i] * mean(i)).collect());
    let bright: Vec<Vec<f64>> = bright.collect();
    [plain, bright].concat()
}

/// Brightness along an axis and its bound, from the sums of alpha, of visible alpha, of alpha times
/// bent normals, and of that times brightness: see the module docs of `levels::brightness`.
fn brightness(mean: f64, [alpha, visible, bent, bright]: [f64; 4]) -> [f64; 2] {
    let weight = 1.05 * (alpha * visible).sqrt() + 1e-6;
    let middle = mean.clamp(0.05, 0.95);
    let by = 3.0 / (weight * middle * (1.0 - middle));
    let bound = BRIGHTNESS_BOUND * (1.0 + by * alpha) + by * alpha * 2.0 * BENT_BOUND;
    [(by * (mean * bent - bright)).clamp(-6.0, 6.0), bound]
}

/// Anisotropy of a node: see the module docs of `levels::anisotropy`.
fn anisotropy(nodes: [usize; 3], alpha: &[f64], at: [usize; 3], density: f64) -> [f64; ANISOTROPY] {
    let spacing = [0, 1, 2].map(|axis| f64::from(EDGES[axis]) / (nodes[axis] - 1) as f64);
    let mean = spacing.iter().sum::<f64>() / 3.0;
    let (mut sums, mut squares) = ([0.0; ANISOTROPY], 0.01);
    for cell in all_nodes([2; 3]) {
        // The cell's lowest node.
        let low = [0, 1, 2].map(|axis| (at[axis] + cell[axis]).checked_sub(1));
        let [Some(x), Some(y), Some(z)] = low else { continue };
        if [x, y, z].iter().zip(nodes).any(|(low, size)| low + 1 >= size) {
            continue;
        }
        let value = |up: [usize; 3]| alpha[index(nodes, [x + up[0], y + up[1], z + up[2]])];
        let gradient = [0, 1, 2].map(|axis| {
            let sum = |side: usize| {
                let face = all_nodes([2; 3]).filter(|up| up[axis] == side);
                face.map(value).sum::<f64>()
            };
            (sum(1) - sum(0)) / 4.0 * mean / spacing[axis]
        });
        let square: f64 = gradient.iter().map(|part| part * part).sum();
        if square > 0.0 {
            let unit = gradient.map(|part| part / square.sqrt());
            let functions = functions(unit).map(f64::from);
            sums.iter_mut().zip(functions).for_each(|(sum, value)| *sum += square * value);
            squares += square;
        }
    }
    sums.map(|sum| density * sum / squares)
}

#[test]
fn levels_have_the_direction_of_the_plain_twin() {
    let activation = Activation::logits(-2.0, 0.5);
    let filter: &dyn LevelFilter = &Filter::RateTent;
    let domain = filter.alpha(&activation).expect("a filter of alpha");
    let weights = &filter.weights();
    let (mut bright, mut shaped) = (0, 0);
    for (seed, nodes) in SIZES.into_iter().enumerate() {
        let mut random = Random::new(seed as u64);
        for density in densities(nodes, &mut random) {
            let color = || (0..density.len()).map(|_| random.between(-4.0, 4.0)).collect();
            let colors: [Vec<f32>; 3] = [(); 3].map({
                let mut color = color;
                move |()| color()
            });
            let channels: Vec<Vec<f32>> = [vec![density], colors.to_vec()].concat();
            let first = seed % 3;
            let got = made(nodes, &channels, activation, first);
            let wide = |values: &Vec<f32>| values.iter().map(|&value| value.into()).collect();
            let channels: Vec<Vec<f64>> = channels.iter().map(wide).collect();
            let light = plain_alpha::light(nodes, &domain, weights, &channels[0], EXTENT);
            let mut sums =
                plain_alpha::premultiply(&domain, ColorDomain::Logit, &channels, &light.seen);
            let mut size = nodes;
            for (level, got) in got.iter().enumerate() {
                if level == first {
                    sums.extend(moments(&sums, &bent_at(size, nodes, &light.bent)));
                }
                sums = sums.iter().map(|sum| next_level(size, sum, weights)).collect();
                size = halved(size);
                let colors = &sums[..5];
                let stored = plain_alpha::unpremultiply(size, &domain, ColorDomain::Logit, colors);
                for at in all_nodes(size) {
                    let i = index(size, at);
                    let place = format!("{nodes:?}, level {}, {at:?}", level + 1);
                    let mean = stored[1..].iter().map(|c| sigmoid(c[i])).sum::<f64>() / 3.0;
                    let parts = if level >= first { DIRECTIONAL } else { 0 };
                    for axis in 0..parts {
                        let own = [0, 1, 5 + axis, 8 + axis].map(|channel| sums[channel][i]);
                        let [want, bound] = brightness(mean, own);
                        let got = f64::from(got[axis][i]);
                        assert!((got - want).abs() <= bound, "{place}: {got} for {want}");
                        bright += usize::from(want.abs() > 0.2);
                    }
                    let want = anisotropy(size, &sums[0], at, stored[0][i]);
                    for (got, want) in got[parts..].iter().zip(want) {
                        let got = f64::from(got[i]);
                        assert!((got - want).abs() <= ANISOTROPY_BOUND, "{place}: {got}, {want}");
                        shaped += usize::from(want.abs() > 0.1);
                    }
                }
            }
        }
    }
    assert!(bright > 500 && shaped > 1000, "{bright} and {shaped} values tell");
}

#[test]
fn a_wall_is_bright_from_its_bright_side_and_hides_more_across() {
    let nodes = [33; 3];
    // Two nodes thick, bright at high y and dark at low y.
    let inside = |y: usize| y == 16 || y == 17;
    let density = all_nodes(nodes).map(|[_, y, _]| if inside(y) { 6.0 } else { -100.0 }).collect();
    let color: Vec<f32> =
        all_nodes(nodes).map(|[_, y, _]| if y >= 17 { 2.0 } else { -2.0 }).collect();
    let channels = [density, color.clone(), color.clone(), color];
    let levels = made(nodes, &channels, Activation::logits(-2.0, 0.5), 0);
    let middle = index([16; 3], [8, 8, 8]);
    let [x, y, z] = [0, 1, 2].map(|axis| levels[0][axis][middle]);
    // A ray towards low y comes from the bright side.
    assert!(y < -1.0 && x.abs() < 0.05 && z.abs() < 0.05, "{x}, {y}, {z}");
    let along = |direction: [f64; 3]| {
        let values = levels[0][DIRECTIONAL..].iter().zip(functions(direction));
        values.map(|(value, function)| value[middle] * function).sum::<f32>()
    };
    let [across, beside] = [along([0.0, 1.0, 0.0]), along([1.0, 0.0, 0.0])];
    assert!(across > 0.1 && beside < -0.05, "{across} across, {beside} along");
}
