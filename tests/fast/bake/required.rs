//! Nodes that a pyramid leaves out change nothing.

use crate::common::Random;
use crate::common::planes::{Channels, levels};
use mipvog::bake::Filter;
use mipvog::levels::sizes::level_sizes;
use mipvog::levels::{Content, Direction, LevelFilter, OpticalDepthGrid, RequiredNodes};
use mipvog::model::field::{Activation, ColorDomain};
use mipvog::model::grid::{NodeMask, Nodes};

const SIZES: [[usize; 3]; 8] = [
    [2, 2, 2],
    [3, 2, 2],
    [2, 7, 33],
    [8, 9, 10],
    [2, 2, 150],
    [31, 2, 4],
    [5, 40, 3],
    [24, 23, 40],
];
/// Edge of the box in intervals.
const EXTENT: [f64; 3] = [20.0; 3];

/// Random nodes, one of so many.
fn some_nodes(nodes: Nodes, of: usize, random: &mut Random) -> NodeMask {
    let mut some = NodeMask::empty(nodes);
    let [nx, ny, nz] = nodes.0;
    for i in 0..nx * ny * nz {
        if random.below(of) == 0 {
            some.insert([i / (ny * nz), i / nz % ny, i % nz]);
        }
    }
    some
}

/// Holds levels from 1 on to those of everything: the same bits at `nodes`, and elsewhere 0 where
/// `is_zero_elsewhere`.
fn hold(got: &[Channels], want: &[Channels], nodes: &[NodeMask], is_zero_elsewhere: bool) {
    for (level, nodes) in nodes.iter().enumerate().skip(1) {
        let [_, ny, nz] = nodes.nodes().0;
        for (channel, (got, want)) in got[level].iter().zip(&want[level]).enumerate() {
            for (i, (got, want)) in got.iter().zip(want).enumerate() {
                let at = [i / (ny * nz), i / nz % ny, i % nz];
                let inside = nodes.contains(at);
                if !inside && !is_zero_elsewhere {
                    continue;
                }
                let want = if inside { want.to_bits() } else { 0 };
                assert_eq!(got.to_bits(), want, "level {level}, channel {channel}, {at:?}");
            }
        }
    }
}

#[test]
fn empty_nodes_are_left_out_where_alpha_is_averaged() {
    let activation = Activation::logits(-4.6, 0.5);
    let filter: &dyn LevelFilter = &Filter::RateTent;
    let domain = filter.alpha(&activation).expect("a filter of alpha");
    let weights = &filter.weights();
    for (seed, size) in SIZES.into_iter().enumerate() {
        // One node of so many is not empty: all, some, hardly any, none.
        for of in [1, 4, 60, usize::MAX] {
            let mut random = Random::new(seed as u64);
            let sizes = level_sizes(Nodes(size), usize::MAX);
            let occupied = some_nodes(sizes[0], of, &mut random);
            let [_, ny, nz] = size;
            let density = (0..sizes[0].count()).map(|i| {
                let inside = occupied.contains([i / (ny * nz), i / nz % ny, i % nz]);
                if inside { random.between(-8.0, 20.0) } else { random.between(-100.0, -40.0) }
            });
            let density: Vec<f32> = density.collect();
            let colors = [(); 3].map(|()| {
                (0..density.len()).map(|_| random.between(-5.0, 5.0)).collect::<Vec<f32>>()
            });
            let field: Channels = std::iter::once(density).chain(colors).collect();
            let full: Vec<NodeMask> = sizes.iter().map(|&nodes| NodeMask::full(nodes)).collect();
            let everything = RequiredNodes::new(full.clone(), None, weights).expect("nodes");

            let required =
                RequiredNodes::of_occupied(occupied.clone(), &sizes, weights).expect("nodes");
            let (alpha, density) = (Content::Alpha(domain), &field[..1]);
            let want = levels(density, &everything, alpha.clone());
            hold(&levels(density, &required, alpha), &want, required.levels(), true);
            // Nodes outside are 0 by themselves.
            for (level, nodes) in sizes.iter().enumerate().skip(1) {
                let outside = |&i: &usize| {
                    let [_, ny, nz] = nodes.0;
                    !required.level(level).contains([i / (ny * nz), i / nz % ny, i % nz])
                };
                assert!((0..nodes.count()).filter(outside).all(|i| want[level][0][i] == 0.0));
            }

            let direction = Some(Direction::new([2.0, 3.0, 2.5], Some(seed % 2)));
            let depths = OpticalDepthGrid::new(domain, &sizes, EXTENT).with_bent_normals(true);
            for (x, plane) in field[0].chunks(ny * nz).enumerate() {
                depths.take(0, x, plane);
            }
            if OpticalDepthGrid::level(&sizes) > 0 {
                continue;
            }
            let visibility = &depths.visibility().expect("a visibility");
            let colors = |retained: &[NodeMask]| -> Vec<Channels> {
                let around = retained.iter().map(|nodes| {
                    nodes.cells_with_a_corner().and_then(|cells| cells.corners()).expect("nodes")
                });
                let required =
                    RequiredNodes::new(around.collect(), Some(&occupied), weights).expect("nodes");
                let retained = retained.iter().collect();
                levels(
                    &field,
                    &required,
                    Content::Colors {
                        domain,
                        colors: ColorDomain::Logit,
                        visibility,
                        retained,
                        direction,
                    },
                )
            };
            let retained: Vec<NodeMask> =
                sizes.iter().map(|&nodes| some_nodes(nodes, 7, &mut random)).collect();
            let all = full.iter().collect();
            let content = Content::Colors {
                domain,
                colors: ColorDomain::Logit,
                visibility,
                retained: all,
                direction,
            };
            let want = levels(&field, &everything, content);
            hold(&colors(&retained), &want, &retained, false);
        }
    }
}
