//! Importance of nodes to viewers nearby: a plain reference implementation in float64, scenes whose
//! answer is known, and bakes that move colours by it.

use crate::common::plain::{all_nodes, density, index};
use crate::common::{Random, baked_bytes, field, open_bytes, plain, unpack};
use mipvog::bake::{BakeOptions, Filter};
use mipvog::levels::importance::NodeImportance;
use mipvog::levels::sizes::level_sizes;
use mipvog::levels::{LevelFilter, Light, OpticalDepthGrid};
use mipvog::model::baked::Group;
use mipvog::model::field::{Activation, RadianceField};
use mipvog::model::grid::Nodes;

/// Lengths of the box's edges in intervals.
const EXTENT: [f64; 3] = [20.0, 30.0, 25.0];

fn activation() -> Activation {
    Activation::logits(-2.0, 0.5)
}

/// Importance of a grid of raw densities that is small enough for light to be followed on it.
fn measured(nodes: [usize; 3], raw: &[f32]) -> NodeImportance {
    let filter: &dyn LevelFilter = &Filter::RateTent;
    let domain = filter.alpha(&activation()).expect("a filter of alpha");
    let sizes = level_sizes(Nodes(nodes), usize::MAX);
    let depths = OpticalDepthGrid::new(domain, &sizes, EXTENT)
        .with_light(Light { importance: true, from_inside: false });
    for (x, plane) in raw.chunks(nodes[1] * nodes[2]).enumerate() {
        depths.take(0, x, plane);
    }
    depths.visibility().expect("visibility").importance.expect("importance")
}

/// The same, node by node and direction by direction: see the module docs of `levels::importance`.
fn plain_importance(nodes: [usize; 3], raw: &[f32]) -> Vec<f64> {
    let activation = activation();
    let depth = |&raw: &f32| density(raw.into(), &activation) * f64::from(activation.interval);
    // Smaller depths are none.
    let depths = raw.iter().map(depth).map(|depth| if depth > 1e-9 { depth } else { 0.0 });
    let depths: Vec<f64> = depths.collect();
    let spacing = [0, 1, 2].map(|axis| EXTENT[axis] / (nodes[axis] - 1) as f64);
    let directions = all_nodes([3; 3]).map(|at| at.map(|i| i as isize - 1));
    let directions: Vec<_> = directions.filter(|&direction| direction != [0; 3]).collect();
    let light = |at: [usize; 3], direction: [isize; 3]| {
        let way = [0, 1, 2].map(|axis| direction[axis] as f64 * spacing[axis]);
        let length = way.iter().map(|part| part * part).sum::<f64>().sqrt();
        let mut behind = Vec::new();
        let mut place = at.map(|i| i as isize);
        loop {
            place = [0, 1, 2].map(|axis| place[axis] + direction[axis]);
            if (0..3).any(|axis| place[axis] < 0 || place[axis] >= nodes[axis] as isize) {
                break;
            }
            behind.push(depths[index(nodes, place.map(|i| i as usize))]);
        }
        // The farthest comes first: there the light enters the box.
        behind.iter().rev().fold(1.0, |light, depth| {
            let through = (-depth * length).exp();
            let passed = light * through;
            passed + (1.0 - passed) * 0.25 * through.powi(4)
        })
    };
    let reflected: Vec<f64> = all_nodes(nodes)
        .map(|at| {
            let sum: f64 = directions.iter().map(|&direction| light(at, direction)).sum();
            sum / 26.0 * -(-depths[index(nodes, at)]).exp_m1()
        })
        .collect();
    let spread = all_nodes(nodes).map(|at| {
        let mut sum = 0.0;
        for step in all_nodes([3; 3]) {
            let place = [0, 1, 2].map(|axis| (at[axis] + step[axis]).wrapping_sub(1));
            if (0..3).all(|axis| place[axis] < nodes[axis]) {
                let weight = |axis: usize| [0.25, 0.5, 0.25][step[axis]];
                sum += weight(0) * weight(1) * weight(2) * reflected[index(nodes, place)];
            }
        }
        sum
    });
    let spread: Vec<f64> = spread.collect();
    let unit = spread.iter().map(|value| value * value).sum::<f64>() / spread.iter().sum::<f64>();
    spread.iter().map(|value| if unit > 0.0 { value / unit } else { 0.0 }).collect()
}

#[test]
fn importance_is_that_of_the_plain_twin() {
    let sizes = [[3, 2, 2], [2, 7, 33], [8, 9, 10], [2, 2, 150], [31, 2, 4], [12, 13, 9]];
    let mut telling = 0;
    for (seed, nodes) in sizes.into_iter().enumerate() {
        let count: usize = nodes.iter().product();
        let mut random = Random::new(seed as u64);
        let mut single = vec![-100.0; count];
        single[count / 2] = 9.0;
        let scenes = [
            (0..count).map(|_| random.between(-9.0, 6.0)).collect(),
            (0..count).map(|_| random.between(-40.0, 40.0)).collect(),
            vec![-100.0; count],
            vec![30.0; count],
            single,
        ];
        for raw in scenes {
            let got = measured(nodes, &raw);
            let want = plain_importance(nodes, &raw);
            for (node, (&got, &want)) in got.values.iter().zip(&want).enumerate() {
                // Sums of 26 f32 numbers, and exponentials of f32.
                let bound = 2e-5 * (1.0 + want);
                assert!((f64::from(got) - want).abs() <= bound, "{nodes:?} {node}: {got}, {want}");
                telling += usize::from(want > 0.1);
            }
        }
    }
    assert!(telling > 2000, "{telling} values tell");
}

#[test]
fn walls_of_a_closed_room_count_like_walls_outside_and_what_is_inside_them_does_not() {
    let nodes = [40; 3];
    let wall = |at: [usize; 3]| {
        let near = at.into_iter().map(|i| i.min(39 - i)).min();
        near.is_some_and(|near| (4..12).contains(&near))
    };
    let raw: Vec<f32> = all_nodes(nodes).map(|at| if wall(at) { 20.0 } else { -100.0 }).collect();
    let importance = measured(nodes, &raw);
    let at = |x: usize| importance.values[index(nodes, [x, 20, 20])];
    let (outside, inside) = (at(4), at(11));
    assert!(inside > 0.8 * outside, "{inside} inside, {outside} outside");
    assert!(at(7) < 1e-4 * outside && at(8) < 1e-4 * outside, "the middle of the wall");
    assert_eq!(at(1), 0.0, "empty space");
}

#[test]
fn fog_counts_everywhere() {
    let nodes = [24; 3];
    let importance = measured(nodes, &[-1.0; 24 * 24 * 24]);
    let inner = all_nodes(nodes).filter(|at| at.iter().all(|&i| (1..23).contains(&i)));
    let least = inner.map(|at| importance.values[index(nodes, at)]).fold(f32::INFINITY, f32::min);
    assert!(least > 0.7, "the least is {least}");
}

/// A bake's colours of level 0 and the error that they state.
fn diffuse(field: &RadianceField, options: &BakeOptions) -> (Vec<f32>, f32, usize) {
    let bytes = baked_bytes(field, options).expect("a bake");
    let container = open_bytes(&bytes).expect("valid");
    let stated = container.metadata().levels[0].diffuse.as_ref().expect("colours").max_error;
    let values = unpack(&container).expect("unpacks").level(0, Group::Diffuse);
    (values, stated, bytes.len())
}

/// Matter with a surface, and most of it inside. Colours are noise.
fn matter(nodes: [usize; 3]) -> (Vec<f32>, RadianceField) {
    let mut random = Random::new(4);
    let raw = |at: [usize; 3]| if at[0] < 3 || at[1] < 4 { -30.0 } else { 12.0 };
    let raw: Vec<f32> = all_nodes(nodes).map(raw).collect();
    let colors: Vec<f32> = (0..3 * raw.len()).map(|_| random.between(-2.0, 2.0)).collect();
    let field = field(nodes, &raw, &colors);
    (raw, field)
}

#[test]
fn a_bound_on_bytes_moves_colors_in_place_of_longer_steps() {
    let (_, field) = matter([24, 20, 22]);
    let (_, _, whole) = diffuse(&field, &BakeOptions::default());
    let step = |fill_error: Option<f32>| {
        let options = BakeOptions {
            max_bytes: Some(whole as u64 * 3 / 4),
            fill_error,
            ..BakeOptions::default()
        };
        let bytes = baked_bytes(&field, &options).expect("a bake");
        assert!(bytes.len() <= whole * 3 / 4);
        let container = open_bytes(&bytes).expect("valid");
        container.metadata().levels[0].diffuse.as_ref().expect("colours").step
    };
    // With an error of inherited colours, which holds at every node, none moves.
    let (moved, still) = (step(None), step(Some(1e-6)));
    assert!(moved < 0.9 * still, "{moved} {still}");
}

#[test]
fn only_colors_of_nodes_of_little_importance_move() {
    // The second is longer than the level on which light is followed.
    for nodes in [[24, 20, 22], [40, 36, 170]] {
        let (raw, field) = matter(nodes);
        let mut options =
            BakeOptions { bits: "4".parse().expect("bits"), ..BakeOptions::default() };
        let (exact, _, plain_bytes) = diffuse(&field, &options);
        options.nearby_coarseness = 0.6;
        let (moved, stated, bytes) = diffuse(&field, &options);
        assert!(bytes < plain_bytes, "{nodes:?}: {bytes} of {plain_bytes}");
        let count = raw.len();
        let mut changed = 0;
        for (node, at) in all_nodes(nodes).enumerate() {
            let is_surface = at[0] == 3 || at[1] == 4;
            for i in [node, count + node, 2 * count + node] {
                let error = plain::sigmoid(moved[i].into()) - plain::sigmoid(exact[i].into());
                if raw[node] > 0.0 {
                    assert!(error.abs() <= stated.into(), "{at:?}: {error} of {stated}");
                    assert!(error == 0.0 || !is_surface, "{nodes:?} {at:?} is seen");
                    changed += usize::from(error != 0.0);
                }
            }
        }
        assert!(changed > count / 4, "{changed} of {count} nodes");
    }
}
