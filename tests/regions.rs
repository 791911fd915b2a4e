//! What a cascade leaves out changes nothing.

mod common;

use std::ops::Range;
use std::sync::Mutex;

use common::Random;
use mipvog_bake::unstable::bake::Filter;
use mipvog_bake::unstable::base::error::Result;
use mipvog_bake::unstable::levels::mips::{
    Cascade, Kernel, Lift, Matter, Occluders, Regions, level_sizes,
};
use mipvog_bake::unstable::model::field::{Activation, ActivationOrder};
use mipvog_bake::unstable::model::grid::{NodeMask, Nodes};

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

/// Channels of a level, `[channel][node]`.
type Channels = Vec<Vec<f32>>;

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

/// Coarser levels of what is read in regions: everywhere else level 0 is no number.
fn levels(field: &Channels, regions: &Regions, sizes: &[Nodes], lift: Lift) -> Vec<Channels> {
    let channels = if matches!(lift, Lift::Amounts(_)) { 1 } else { field.len() };
    let [_, ny, nz] = sizes[0].0;
    let above = match lift {
        Lift::Raw(ref range) => range.len(),
        Lift::Amounts(_) => 1,
        Lift::Seen(..) => channels + 1,
    };
    let levels: Vec<Vec<Mutex<Vec<f32>>>> = sizes
        .iter()
        .map(|size| (0..above).map(|_| Mutex::new(vec![0.0; size.count()])).collect())
        .collect();
    let read = |x: usize, channel: usize, _: &[u64], plane: &mut [f32]| -> Result<()> {
        for (i, value) in plane.iter_mut().enumerate() {
            let inside = regions.level(0).contains([x, i / nz, i % nz]);
            *value = if inside { field[channel][x * ny * nz + i] } else { f32::NAN };
        }
        Ok(())
    };
    let pass = |level: usize, x: usize, channel: usize, plane: &mut Vec<f32>| {
        let mut values = levels[level][channel].lock().expect("a level");
        values[x * plane.len()..][..plane.len()].copy_from_slice(plane);
        Ok(())
    };
    // Planes of each level are told about in order, all of them.
    let mut told = vec![0; sizes.len()];
    let take = |level: usize, planes: Range<usize>| {
        assert_eq!(planes.start, told[level]);
        told[level] = planes.end;
        Ok(())
    };
    Cascade::new(regions, channels, lift, 3).run(read, pass, take).expect("levels");
    assert!(told.iter().zip(sizes).all(|(&told, size)| told == size.0[0]));
    let values = |values: Mutex<Vec<f32>>| values.into_inner().expect("a level");
    levels.into_iter().map(|level| level.into_iter().map(values).collect()).collect()
}

/// Holds levels from 1 on to those of everything: the same bits in their regions, and 0 elsewhere.
fn hold(got: &[Channels], want: &[Channels], regions: &Regions, sizes: &[Nodes]) {
    for (level, nodes) in sizes.iter().enumerate().skip(1) {
        let [_, ny, nz] = nodes.0;
        for (channel, (got, want)) in got[level].iter().zip(&want[level]).enumerate() {
            for (i, (got, want)) in got.iter().zip(want).enumerate() {
                let at = [i / (ny * nz), i / nz % ny, i % nz];
                let inside = regions.level(level).contains(at);
                let want = if inside { want.to_bits() } else { 0 };
                assert_eq!(got.to_bits(), want, "level {level}, channel {channel}, {at:?}");
            }
        }
    }
}

#[test]
fn empty_nodes_are_left_out_of_matter() {
    let activation = Activation { shift: -4.6, interval: 0.5, order: ActivationOrder::Raw };
    let matter: Matter = Filter::RateTent.matter(&activation).expect("a filter of matter");
    let kernel = Kernel::Tent;
    for (seed, size) in SIZES.into_iter().enumerate() {
        // One node of so many holds matter: all, some, hardly any, none.
        for of in [1, 4, 60, usize::MAX] {
            let mut random = Random::new(seed as u64);
            let sizes = level_sizes(Nodes(size), usize::MAX);
            let filled = some_nodes(sizes[0], of, &mut random);
            let [_, ny, nz] = size;
            let density = (0..sizes[0].count()).map(|i| {
                let inside = filled.contains([i / (ny * nz), i / nz % ny, i % nz]);
                if inside { random.between(-8.0, 20.0) } else { random.between(-100.0, -40.0) }
            });
            let density: Vec<f32> = density.collect();
            let colors = [(); 2].map(|()| {
                (0..density.len()).map(|_| random.between(-5.0, 5.0)).collect::<Vec<f32>>()
            });
            let field: Channels = std::iter::once(density).chain(colors).collect();
            let full = || sizes.iter().map(|&nodes| NodeMask::full(nodes)).collect();
            let everything = Regions::new(full(), None, kernel).expect("regions");

            let amounts = Lift::Amounts(matter);
            let regions = Regions::of_matter(filled.clone(), &sizes, kernel).expect("regions");
            let want = levels(&field, &everything, &sizes, amounts.clone());
            hold(&levels(&field, &regions, &sizes, amounts), &want, &regions, &sizes);
            // What lies outside the regions of matter is 0 by itself.
            for (level, nodes) in sizes.iter().enumerate().skip(1) {
                let outside = |&i: &usize| {
                    let [_, ny, nz] = nodes.0;
                    !regions.level(level).contains([i / (ny * nz), i / nz % ny, i % nz])
                };
                assert!((0..nodes.count()).filter(outside).all(|i| want[level][0][i] == 0.0));
            }

            let occluders = Occluders::new(matter, &sizes, EXTENT);
            for (x, plane) in field[0].chunks(ny * nz).enumerate() {
                occluders.take(0, x, plane);
            }
            if Occluders::level(&sizes) > 0 {
                continue;
            }
            let visibility = occluders.visibility().expect("a visibility");
            let seen = Lift::Seen(matter, &visibility);
            let needed: Vec<NodeMask> =
                sizes.iter().map(|&nodes| some_nodes(nodes, 7, &mut random)).collect();
            let regions = Regions::new(needed, Some(&filled), kernel).expect("regions");
            let want = levels(&field, &everything, &sizes, seen.clone());
            hold(&levels(&field, &regions, &sizes, seen), &want, &regions, &sizes);
        }
    }
}
