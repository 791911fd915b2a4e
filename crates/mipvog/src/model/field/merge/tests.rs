use super::*;
use crate::model::field::{DensityFunction, FreeSpace, Lookup};
use crate::model::grid::Bounds;
use crate::model::harmonics::{Clamp, Evaluation};

/// Numbers from 0 to 1 without a pattern.
fn number(seed: usize) -> f32 {
    let mixed = (seed as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1 << 24) as f32
}

/// A field of voxels of 1, whose lowest node is at `at`.
fn field(at: [f32; 3], nodes: [usize; 3], seed: usize) -> RadianceField {
    let count: usize = nodes.iter().product();
    let density = (0..count).map(|i| 8.0 * number(seed + i) - 4.0).collect();
    let diffuse = (0..3 * count).map(|i| number(seed + 7 * i) - 0.5).collect();
    let far = [0, 1, 2].map(|axis| at[axis] + (nodes[axis] - 1) as f32);
    let field = RadianceField::builder(nodes, density, diffuse).bounds(at, far).build();
    let mut field = field.expect("arrays fit");
    field.scene.march.voxel_size = 1.0;
    field
}

fn merge(fields: &[RadianceField]) -> RadianceField {
    RadianceField::merge(fields, &Limits::default()).expect("they fit")
}

/// A channel, 0 being density, at the node of a world position; none beside the box.
fn at(field: &RadianceField, channel: usize, world: [f32; 3]) -> Option<f32> {
    let lattice = field.lattice();
    let spacing = lattice.nodes.spacing(&lattice.bounds);
    let node = [0, 1, 2].map(|axis| {
        ((f64::from(world[axis]) - f64::from(lattice.bounds.min[axis])) / spacing[axis]).round()
    });
    let inside = |axis: usize| (0.0..lattice.nodes.0[axis] as f64).contains(&node[axis]);
    if !(0..3).all(inside) {
        return None;
    }
    let [x, y, z] = node.map(|at| at as usize);
    let [_, rows, length] = lattice.nodes.0;
    let (grid, channel) = field.grid_of(channel)?;
    let mut plane = vec![f32::NAN; rows * length];
    grid.read_plane(channel, x, &mut plane, |_| {}).expect("in memory");
    Some(plane[y * length + z])
}

/// True if a position is inside the box, away from its faces.
fn goes_on(field: &RadianceField, world: [f32; 3]) -> bool {
    let Bounds { min, max } = field.scene.bounds;
    (0..3).all(|axis| min[axis] < world[axis] && world[axis] < max[axis])
}

/// World positions of all nodes of a field.
fn positions(field: &RadianceField) -> Vec<[f32; 3]> {
    let lattice = field.lattice();
    let [nx, ny, nz] = lattice.nodes.0;
    let nodes = (0..nx * ny * nz).map(|i| [i / nz / ny, i / nz % ny, i % nz]);
    nodes.map(|node| lattice.position(node).map(|at| at as f32)).collect()
}

#[test]
fn apart_fields_keep_their_values() {
    let fields = [field([0.0; 3], [4, 3, 5], 1), field([6.0, -2.0, 1.0], [3, 2, 4], 2)];
    let merged = merge(&fields);
    assert_eq!(merged.scene.nodes.0, [9, 5, 5]);
    assert_eq!(
        (merged.scene.bounds.min, merged.scene.bounds.max),
        ([0.0, -2.0, 0.0], [8.0, 2.0, 4.0])
    );
    for world in positions(&merged) {
        for channel in 0..4 {
            let own = fields.iter().find_map(|field| at(field, channel, world));
            let empty = if channel == 0 { merged.scene.activation.empty_raw() } else { 0.0 };
            assert_eq!(at(&merged, channel, world), Some(own.unwrap_or(empty)), "{world:?}");
        }
    }
}

#[test]
fn fogs_add_up_and_colours_mix_by_depth() {
    for function in [DensityFunction::Softplus, DensityFunction::Relu] {
        let mut fields = [field([0.0; 3], [5; 3], 1), field([2.0, 1.0, -1.0], [4; 3], 9)];
        fields[0].scene.activation.function = function;
        // The same fog by other numbers: steps of a quarter of a voxel.
        fields[1].scene.march.stepsize = 0.25;
        fields[1].scene.activation.interval = 0.5;
        let merged = merge(&fields);
        let depth = |field: &RadianceField, raw: f32| {
            let factor = f64::from(field.scene.activation.interval)
                / (f64::from(field.scene.march.stepsize) * f64::from(field.scene.march.voxel_size));
            field.scene.activation.density(raw.into()) * factor
        };
        let mut both = 0;
        for world in positions(&merged) {
            let raw = fields.each_ref().map(|field| at(field, 0, world));
            let mut depths = [0, 1].map(|i| raw[i].map_or(0.0, |raw| depth(&fields[i], raw)));
            // Faces of boxes count where the other field does not continue.
            let on = fields.each_ref().map(|field| goes_on(field, world));
            for i in [0, 1] {
                let denser = depths[1 - i] > depths[i] && !on[i];
                if !on[i] && (on[1 - i] || denser) {
                    depths[i] = 0.0;
                }
            }
            let total = depths[0] + depths[1];
            let found = depth(&merged, at(&merged, 0, world).expect("a node"));
            assert!(
                (found - total).abs() <= 2e-6 * total.max(1e-3),
                "{function:?} {found} {total}"
            );
            if raw.iter().any(Option::is_none) || total == 0.0 {
                continue;
            }
            both += 1;
            for channel in 1..4 {
                let own = fields.each_ref().map(|field| at(field, channel, world).expect("inside"));
                let mixed = (depths[0] * f64::from(own[0]) + depths[1] * f64::from(own[1])) / total;
                let found = f64::from(at(&merged, channel, world).expect("a node"));
                assert!((found - mixed).abs() < 1e-6, "{function:?} {found} {mixed}");
            }
        }
        assert!(both > 10, "{function:?} {both}");
    }
}

#[test]
fn finer_fields_are_read_where_nodes_coincide() {
    let coarse = field([0.0; 3], [3; 3], 1);
    let mut fine = field([10.0, 0.0, 0.0], [5; 3], 2);
    fine.scene.bounds.max = [12.0, 2.0, 2.0];
    fine.scene.march.voxel_size = 0.5;
    // As opaque over half the length.
    fine.scene.activation.interval = 0.25;
    let merged = merge(&[coarse, fine.clone()]);
    assert_eq!(merged.scene.nodes.0, [13, 3, 3]);
    for world in positions(&merged).into_iter().filter(|world| world[0] >= 10.0) {
        for channel in 0..4 {
            assert_eq!(at(&merged, channel, world), at(&fine, channel, world), "{world:?}");
        }
    }
}

#[test]
fn what_lies_between_nodes_is_interpolated() {
    let first = field([0.0; 3], [3; 3], 1);
    let other = field([5.5, 0.25, 0.5], [4; 3], 2);
    let merged = merge(&[first, other.clone()]);
    let found = at(&merged, 1, [7.0, 1.0, 2.0]).expect("a node");
    let mut expected = 0.0;
    for (x, of_x) in [(1.0, 0.5), (2.0, 0.5)] {
        for (y, of_y) in [(0.0, 0.25), (1.0, 0.75)] {
            for (z, of_z) in [(1.0, 0.5), (2.0, 0.5)] {
                let world = [5.5 + x, 0.25 + y, 0.5 + z];
                expected += of_x * of_y * of_z * at(&other, 1, world).expect("a node");
            }
        }
    }
    assert!((found - expected).abs() < 1e-6, "{found} {expected}");
}

#[test]
fn masks_and_crops_empty_the_nodes_of_their_field() {
    let mut fields = [field([0.0; 3], [9; 3], 1), field([0.0; 3], [9; 3], 2)];
    // Inside for x of at most 2.5.
    let inside = (0..8).map(|node| node < 4).collect();
    let mask = FreeSpace {
        nodes: Nodes([2; 3]),
        scale: [0.2, 0.125, 0.125],
        shift: [0.0; 3],
        lookup: Lookup::Nearest(inside),
    };
    fields[0].free_space = Some(mask);
    fields[1].scene.march.sampled = Some(Bounds { min: [5.0, 0.0, 0.0], max: [8.0, 8.0, 8.0] });
    let merged = merge(&fields);
    assert_eq!((&merged.free_space, merged.scene.march.sampled), (&None, None));
    for world in positions(&merged) {
        let expected = match world[0] {
            ..=3.0 => at(&fields[0], 0, world),
            5.0.. => at(&fields[1], 0, world),
            _ => Some(merged.scene.activation.empty_raw()),
        };
        assert_eq!(at(&merged, 0, world), expected, "{world:?}");
    }
}

#[test]
fn the_parts_of_a_scene_merge_to_that_scene() {
    let whole = field([0.0; 3], [9, 6, 7], 3);
    let part = |low: f32, high: f32| {
        let mut part = whole.clone();
        let Bounds { mut min, mut max } = whole.scene.bounds;
        (min[0], max[0]) = (low, high);
        part.scene.march.sampled = Some(Bounds { min, max });
        part
    };
    let merged = merge(&[part(0.0, 3.0), part(3.0, 4.0), part(4.0, 8.0)]);
    for world in positions(&whole) {
        for channel in 0..4 {
            assert_eq!(at(&merged, channel, world), at(&whole, channel, world), "{world:?}");
        }
    }
}

#[test]
fn harmonics_of_fewer_bands_have_no_higher_ones() {
    let harmonics = |degree| Harmonics {
        degree,
        evaluation: Evaluation::Sample,
        offset: 0.5,
        clamp: Clamp::Zero,
    };
    let with = |at: [f32; 3], degree| {
        let plain = field(at, [3; 3], 5);
        let features = 3 * ((degree + 1) * (degree + 1) - 1);
        let higher = (0..27 * features).map(number).collect();
        let density = (0..27).map(number).collect();
        let diffuse = (0..81).map(number).collect();
        let Bounds { min, max } = plain.scene.bounds;
        let field = RadianceField::builder([3; 3], density, diffuse);
        field.bounds(min, max).harmonics(higher, harmonics(degree)).build().expect("arrays fit")
    };
    let (first, other) = (with([0.0; 3], 1), with([4.0, 0.0, 0.0], 2));
    let merged = merge(&[first.clone(), other.clone()]);
    assert_eq!(merged.harmonics(), Some(&harmonics(2)));
    assert_eq!(merged.color_channels(), 27);
    for channel in [10, 13, 27] {
        let expected = if channel < 13 { at(&first, channel, [1.0; 3]) } else { Some(0.0) };
        assert_eq!(at(&merged, channel, [1.0; 3]), expected);
        assert_eq!(at(&merged, channel, [5.0, 1.0, 1.0]), at(&other, channel, [5.0, 1.0, 1.0]));
    }
}

#[test]
fn what_does_not_fit_is_refused_by_name() {
    let first = field([0.0; 3], [3; 3], 1);
    let refused = |change: &dyn Fn(&mut RadianceField), words: &str| {
        let mut other = first.clone();
        change(&mut other);
        let merged = RadianceField::merge(&[first.clone(), other], &Limits::default());
        let message = merged.expect_err(words).to_string();
        assert!(message.contains(words), "{message}");
    };
    refused(&|other| other.color_domain = ColorDomain::Linear, "view dependence");
    refused(&|other| other.scene.activation.order = ActivationOrder::Opacity, "interpolated after");
    refused(&|other| other.scene.march.voxel = Some([1.0, 1.0, 2.0]), "depends on the direction");
    refused(&|other| other.scene.bounds.max = [1e9; 3], "nodes of the merged field");
    assert!(RadianceField::merge(&[], &Limits::default()).is_err());
}
