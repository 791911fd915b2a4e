//! Fallback meshes: closed, valid, where the field is, and the same for any number of threads.

use crate::common;
use std::collections::BTreeMap;

use crate::common::{Random, baked_bytes, field, open_bytes, random_field};
use mipvog::bake::{BakeOptions, Filter};
use mipvog::base::error::Result;
use mipvog::container::Container;
use mipvog_outputs::gltf::mesh::{Mesh, meshes};

fn options(filter: Filter) -> BakeOptions {
    BakeOptions { filter: filter.into(), ..BakeOptions::default() }
}

fn corner(mesh: &Mesh, index: u32) -> [f64; 3] {
    mesh.positions[index as usize].map(f64::from)
}

/// Twice the area of a triangle, as a vector.
fn normal(mesh: &Mesh, triangle: &[u32; 3]) -> [f64; 3] {
    let [a, b, c] = triangle.map(|index| corner(mesh, index));
    let [u, v] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1], p[2] - a[2]]);
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

/// The finest mesh.
fn mesh(container: &Container, triangles: usize) -> Result<Mesh> {
    meshes(container, triangles, 0).map(|mut meshes| meshes.remove(0))
}

/// The volume inside, positive where triangles face outwards.
fn volume(mesh: &Mesh) -> f64 {
    let of = |triangle: &[u32; 3]| {
        let (n, a) = (normal(mesh, triangle), corner(mesh, triangle[0]));
        (n[0] * a[0] + n[1] * a[1] + n[2] * a[2]) / 6.0
    };
    mesh.triangles.iter().map(of).sum()
}

/// Checks the rules of every mesh.
fn assert_sound(mesh: &Mesh, min: [f32; 3], max: [f32; 3], case: &str) {
    assert_eq!(mesh.positions.len(), mesh.colors.len());
    assert!(!mesh.triangles.is_empty(), "{case}");
    let mut used = vec![false; mesh.positions.len()];
    for triangle in &mesh.triangles {
        triangle.iter().for_each(|&index| used[index as usize] = true);
        assert!(normal(mesh, triangle).iter().any(|n| *n != 0.0), "{case}: {triangle:?} is flat");
    }
    assert!(used.into_iter().all(|used| used), "{case}: a position without a triangle");
    for position in &mesh.positions {
        for axis in 0..3 {
            let inside = (min[axis]..=max[axis]).contains(&position[axis]);
            assert!(inside, "{case}: {position:?} outside the box");
        }
    }
    let colors = mesh.colors.as_flattened();
    assert!(colors.iter().all(|channel| (0.0..=1.0).contains(channel)), "{case}");
}

/// Every edge of a closed surface has as many triangles on one side as on the other.
fn assert_closed(mesh: &Mesh, case: &str) {
    let mut edges: BTreeMap<[u32; 2], i32> = BTreeMap::new();
    for &[a, b, c] in &mesh.triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let (edge, side) = if from < to { ([from, to], 1) } else { ([to, from], -1) };
            *edges.entry(edge).or_default() += side;
        }
    }
    assert!(edges.values().all(|&balance| balance == 0), "{case}: a border");
}

/// An opaque ball of one colour a half space, in the box of `common::field`.
fn ball(size: usize, radius: f32) -> mipvog::model::field::RadianceField {
    let nodes = [size; 3];
    let middle = (size - 1) as f32 / 2.0;
    let (mut density, mut color) = (Vec::new(), vec![Vec::new(); 3]);
    for x in 0..size {
        for y in 0..size {
            for z in 0..size {
                let at = [x, y, z].map(|i| i as f32 - middle);
                let distance = at.iter().map(|v| v * v).sum::<f32>().sqrt();
                density.push((radius - distance) * 20.0);
                let red = if at[0] < 0.0 { 8.0 } else { -8.0 };
                [red, -red, 0.0].iter().zip(&mut color).for_each(|(v, channel)| channel.push(*v));
            }
        }
    }
    field(nodes, &density, &color.concat())
}

#[test]
fn a_ball_becomes_a_ball() {
    let radius = 12.0;
    let scene = ball(33, radius);
    let container = open_bytes(&baked_bytes(&scene, &options(Filter::RateTent)).expect("baked"));
    let container = container.expect("a container");
    let extent = scene.scene.bounds.extent();
    let scale = extent.map(|length| length / 32.0);
    let exact = 4.0 / 3.0 * std::f64::consts::PI * f64::from(radius).powi(3);
    let exact = exact * scale.iter().product::<f64>();
    // An icosahedron in the ball, of 20 triangles, has 0.61 of its volume; meshes of few triangles
    // are made of coarse levels, whose cells round the ball off further.
    for (triangles, least) in [(20, 0.5), (200, 0.75), (2000, 0.9)] {
        let mesh = mesh(&container, triangles).expect("a mesh");
        assert!(mesh.visible && mesh.triangles.len() <= triangles);
        let case = format!("{triangles} triangles");
        let bounds = scene.scene.bounds;
        assert_sound(&mesh, bounds.min, bounds.max, &case);
        assert_closed(&mesh, &case);
        let share = volume(&mesh) / exact;
        // Half the light passes a cell a little outside of where raw density is 0.
        assert!(share > least && share < 1.2, "{case}: {share}");
        let middle = f64::from(bounds.min[0] + bounds.max[0]) / 2.0;
        for (position, color) in mesh.positions.iter().zip(&mesh.colors) {
            let side = f64::from(position[0]) - middle;
            if side.abs() > extent[0] / 5.0 && triangles == 2000 {
                assert_eq!(color[0] > color[1], side < 0.0, "{position:?} is {color:?}");
                // A half as trained, in linear values (IEC 61966-2-1).
                assert!((color[2] - 0.2140).abs() < 0.01, "{color:?}");
            }
        }
    }
}

#[test]
fn meshes_of_any_field_are_sound() {
    let mut visible = 0;
    for seed in 0..60 {
        let mut random = Random::new(seed);
        let nodes = std::array::from_fn(|_| 2 + random.below(19));
        let channels = 3 + random.below(5);
        let field = random_field(&mut random, nodes, channels);
        let filter = [Filter::RateTent, Filter::Code, Filter::Coverage][random.below(3)];
        let bytes = baked_bytes(&field, &options(filter)).expect("baked");
        let container = open_bytes(&bytes).expect("a container");
        let most = [4, 12, 100, 3000][random.below(4)];
        let mesh = mesh(&container, most).expect("a mesh");
        let bounds = field.scene.bounds;
        let case = format!("seed {seed}, {nodes:?}");
        assert_sound(&mesh, bounds.min, bounds.max, &case);
        assert!(mesh.triangles.len() <= most.max(12), "{case}: {}", mesh.triangles.len());
        visible += usize::from(mesh.visible);
        if mesh.triangles.len() < most {
            assert_closed(&mesh, &case);
            assert!(volume(&mesh) > 0.0, "{case}");
        }
    }
    assert!(visible > 20, "{visible}");
}

#[test]
fn full_and_empty_fields_have_their_boxes() {
    for (raw, visible) in [(30.0, true), (-100.0, false)] {
        for nodes in [[2, 2, 2], [9, 5, 2], [17, 17, 17]] {
            let count: usize = nodes.iter().product();
            let scene = field(nodes, &vec![raw; count], &vec![0.5; 3 * count]);
            let bytes = baked_bytes(&scene, &BakeOptions::default()).expect("baked");
            let container = open_bytes(&bytes).expect("a container");
            let mesh = mesh(&container, 2000).expect("a mesh");
            let bounds = scene.scene.bounds;
            let case = format!("{raw} in {nodes:?}");
            assert_sound(&mesh, bounds.min, bounds.max, &case);
            assert_closed(&mesh, &case);
            assert_eq!(mesh.visible, visible, "{case}");
            let share = volume(&mesh) / bounds.extent().iter().product::<f64>();
            assert!(share > 0.8 && share < 1.0001, "{case}: {share}");
        }
    }
}

#[test]
fn hidden_cavities_have_no_surface() {
    let size: usize = 17;
    let shell = |hollow: bool| {
        let mut density = Vec::new();
        for i in 0..size * size * size {
            let at = [i / size / size, i / size % size, i % size].map(|v: usize| v.abs_diff(8));
            let inside = at.iter().all(|&v| v <= 6);
            let cavity = hollow && at.iter().all(|&v| v <= 3);
            density.push(if inside && !cavity { 30.0 } else { -100.0 });
        }
        let scene = field([size; 3], &density, &vec![0.5; 3 * density.len()]);
        let mut options = options(Filter::RateTent);
        options.levels = Some(1);
        let bytes = baked_bytes(&scene, &options).expect("baked");
        mesh(&open_bytes(&bytes).expect("a container"), 100_000).expect("a mesh").positions
    };
    assert_eq!(shell(true), shell(false));
}

#[test]
fn thread_count_never_shows() {
    let scene = random_field(&mut Random::new(3), [23, 19, 31], 7);
    let bytes = baked_bytes(&scene, &options(Filter::RateTent)).expect("baked");
    let meshes = [1, 2, 3, 8].map(|threads| {
        common::with_threads(threads, || {
            mesh(&open_bytes(&bytes).expect("a container"), 500).expect("a mesh")
        })
    });
    assert!(meshes.iter().all(|mesh| *mesh == meshes[0]));
    assert!(mesh(&open_bytes(&bytes).expect("a container"), 3).is_err());
}
