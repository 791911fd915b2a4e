//! Small models of TensoRF, nerfstudio and DirectVoxGO, held against their evaluation in float64.

use crate::common::Random;
use crate::common::factored::{
    self, AABB, INNER, NODES, SIDE, contracted, dvgo, first_tensorf, nerfstudio, nerfstudio_cp,
    tensorf, tensorf_cp,
};
use crate::common::factored_values::{self as values, dvgo_color, dvgo_grid, products, softplus};
use crate::common::models::{of_bytes, read, renderer};
use crate::common::torch::{Item, TorchFile};
use glam::DVec3;
use mipvog::base::error::ErrorKind;
use mipvog::base::progress::Silent;
use mipvog::model::camera::Ray;
use mipvog::view::render::Renderer;
use mipvog_inputs::{Family, SourceOptions};

/// A direction and a position in a box, as shares of its edges.
fn place(random: &mut Random) -> ([f64; 3], [f64; 3]) {
    let between = |random: &mut Random, low, high| f64::from(random.between(low, high));
    let direction = [0; 3].map(|_| between(random, -1.0, 1.0));
    let length = direction.iter().map(|at| at * at).sum::<f64>().sqrt();
    ([0; 3].map(|_| between(random, 0.0, 1.0)), direction.map(|at| at / length))
}

fn in_box(share: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|axis| {
        let (low, high) = (f64::from(AABB[axis]), f64::from(AABB[axis + 3]));
        low + share[axis] * (high - low)
    })
}

/// The file's model, and its field's nodes, at 60 places against density and colour by the file.
fn agrees(
    name: &str,
    file: &TorchFile,
    options: &SourceOptions,
    expected: impl Fn([f64; 3], [f64; 3]) -> (f64, [f64; 3]),
) {
    let source = of_bytes(file.to_bytes(), options).expect(name);
    let (model, mut random) = (renderer(&source), Random::new(3));
    for _ in 0..60 {
        let (share, direction) = place(&mut random);
        let (density, color) = expected(share, direction);
        let found = model.sample(in_box(share), 0).expect("inside").density;
        let off = (f64::from(found) - density).abs();
        assert!(off <= 1e-5 * density.abs() + 1e-6, "{name}: {found} for {density} at {share:?}");
        let found = model.point_colors(in_box(share), &[direction], 0).expect("inside")[0];
        for (found, expected) in found.into_iter().zip(color) {
            assert!((f64::from(found) - expected).abs() < 1e-5, "{name}: {found} for {expected}");
        }
    }
    // Nodes of the field have the same density.
    let field = Renderer::of_field(&source.field).expect(name);
    let counts = source.field.scene.nodes.0;
    for node in 0..counts.iter().product() {
        let [_, ny, nz] = counts;
        let at = [node / (ny * nz), node / nz % ny, node % nz];
        let share = [0, 1, 2].map(|axis| at[axis] as f64 / (counts[axis] - 1) as f64);
        // Faces of the mask are neither inside nor outside.
        let inner = share.map(|at| at.clamp(1e-6, 1.0 - 1e-6));
        let (density, _) = expected(inner, [0.0, 0.0, 1.0]);
        let found = f64::from(field.sample(in_box(inner), 0).expect("inside").density);
        assert!(
            (found - density).abs() <= 1e-3 * density.abs() + 1e-4,
            "{name}: {found} {density}"
        );
    }
    read(&source).expect(name);
}

#[test]
fn every_shading_and_layout_of_tensorf_is_evaluated() {
    let state = |name: &str| format!("state_dict/{name}");
    let layouts =
        ["MLP_Fea", "MLP_PE", "MLP", "SH", "RGB"].map(|shading| (shading, tensorf(shading)));
    let models = layouts.into_iter().chain([("MLP", tensorf_cp())]);
    for (shading, file) in models {
        agrees(shading, &file, &SourceOptions::default(), |share, direction| {
            let at = [0, 1, 2].map(|axis| share[axis] * (NODES[axis] - 1) as f64);
            let of = |of: &str| {
                let names = [state(&format!("{of}_plane")), state(&format!("{of}_line"))];
                products(&file, names.each_ref().map(String::as_str), at)
            };
            let raw: f64 = of("density").iter().sum();
            let features = values::matrix(&file, &state("basis_mat.weight"), &of("app"));
            let at = share.map(|share| 2.0 * share - 1.0);
            let color = values::tensorf_color(&file, shading, &features, at, direction);
            // The mask's box is larger; its second node along x is the last free one.
            let is_masked = file.items.iter().any(|item| item.0 == "alphaMask.mask");
            let free = is_masked && in_box(share)[0] <= 1.25 * (-1.0 + 2.0 / 3.0);
            (if free { 0.0 } else { 25.0 * softplus(raw - 1.0) }, color)
        });
    }
}

#[test]
fn the_first_layout_of_tensorf_has_density_after_colours() {
    let file = first_tensorf();
    agrees("first", &file, &SourceOptions::default(), |share, direction| {
        let at = share.map(|share| share * (SIDE - 1) as f64);
        let all = products(&file, ["state_dict/plane_coef", "state_dict/line_coef"], at);
        let raw: f64 = all.chunks(5).flat_map(|term| &term[3..]).sum();
        let app: Vec<f64> = all.chunks(5).flat_map(|term| term[..3].to_vec()).collect();
        let features = values::matrix(&file, "state_dict/basis_mat.weight", &app);
        let at = share.map(|share| 2.0 * share - 1.0);
        let color = values::tensorf_color(&file, "MLP_PE", &features, at, direction);
        (25.0 * softplus(raw - 1.0), color)
    });
}

/// nerfstudio's rendering of a ray in float64: 200 even intervals, then 50.
fn two_passes(file: &TorchFile, origin: [f64; 3], direction: [f64; 3]) -> ([f64; 3], f64) {
    let (mut near, mut far) = (0.0f64, f64::INFINITY);
    for axis in 0..3 {
        let faces = [AABB[axis], AABB[axis + 3]];
        let at = faces.map(|face| (f64::from(face) - origin[axis]) / (direction[axis] + 1e-6));
        near = near.max(at[0].min(at[1]));
        far = far.min(at[0].max(at[1]));
    }
    if far <= near {
        return ([1.0; 3], 1.0);
    }
    let at = |t: f64| {
        let share = [0, 1, 2].map(|axis| {
            let (low, high) = (f64::from(AABB[axis]), f64::from(AABB[axis + 3]));
            (origin[axis] + t * direction[axis] - low) / (high - low)
        });
        values::nerfstudio(file, share, direction)
    };
    let weights = |ends: &[f64]| {
        let mut passes = 1.0;
        let shade = ends.windows(2).map(|ends| {
            let (density, color) = at(0.5 * (ends[0] + ends[1]));
            let left = (-density * (ends[1] - ends[0])).exp();
            let weight = passes * (1.0 - left);
            passes *= left;
            (weight, color)
        });
        shade.collect::<Vec<_>>()
    };
    let even: Vec<f64> = (0..=200).map(|i| near + (far - near) * f64::from(i) / 200.0).collect();
    let first = weights(&even);
    if first.iter().map(|(weight, _)| weight).sum::<f64>() < 1e-4 {
        return ([1.0; 3], 1.0);
    }
    let sum: f64 = first.iter().map(|(weight, _)| weight + 0.01).sum();
    let mut cumulative = vec![0.0];
    for (weight, _) in &first {
        cumulative.push(cumulative.last().expect("one") + (weight + 0.01) / sum);
    }
    let ends = (0..51).map(|bin| {
        let wanted = (f64::from(bin) + 0.5) / 51.0;
        let after = (1..201).find(|&i| cumulative[i] > wanted).expect("the sum is 1");
        let part = (wanted - cumulative[after - 1]) / (cumulative[after] - cumulative[after - 1]);
        even[after - 1] + part * (even[after] - even[after - 1])
    });
    let second = weights(&ends.collect::<Vec<_>>());
    let left = 1.0 - second.iter().map(|(weight, _)| weight).sum::<f64>();
    let color = [0, 1, 2].map(|channel| {
        second.iter().map(|(weight, color)| weight * color[channel]).sum::<f64>() + left
    });
    (color, left)
}

/// Rays from outside and from within a box, towards its middle.
fn rays(center: [f64; 3], distances: [f32; 2]) -> Vec<Ray> {
    let mut random = Random::new(9);
    let ray = |random: &mut Random| {
        let (share, direction) = place(random);
        let direction = DVec3::from_array(direction);
        let target = DVec3::from_array(center) + 0.5 * (DVec3::from_array(share) - 0.5);
        let distance = f64::from(random.between(distances[0], distances[1]));
        Ray { origin: target - distance * direction, direction }
    };
    (0..80).map(|_| ray(&mut random)).collect()
}

#[test]
fn nerfstudio_is_evaluated_and_sampled_in_two_passes() {
    for file in [nerfstudio(), nerfstudio_cp()] {
        let options = SourceOptions::default();
        agrees("nerfstudio", &file, &options, |share, direction| {
            values::nerfstudio(&file, share, direction)
        });
        let source = of_bytes(file.to_bytes(), &options).expect("a model");
        assert_eq!(source.family, Family::Tensorf);
        let told = |key: &str| source.assumptions.iter().any(|told| told.key == key);
        assert!(told("config.yml") && told("view"), "{:?}", source.assumptions);
        let rays = rays([0.0; 3], [0.2, 3.0]);
        let light = renderer(&source).ray_colors(&rays, 0, &Silent).expect("rays");
        let mut seen = 0;
        for (ray, found) in rays.iter().zip(light) {
            let (color, left) = two_passes(&file, ray.origin.to_array(), ray.direction.to_array());
            seen += usize::from(left < 0.7);
            assert!((f64::from(found.transmittance) - left).abs() < 1e-5, "{found:?} for {left}");
            for (found, expected) in found.color.into_iter().zip(color) {
                assert!((f64::from(found) - expected).abs() < 1e-5, "{found} for {expected}");
            }
        }
        assert!(seen > 20, "{seen} rays hit something");
    }
}

#[test]
fn arrays_and_factors_of_directvoxgo_are_evaluated() {
    for (density, features) in [(false, false), (true, false), (false, true), (true, true)] {
        let file = dvgo(density, features);
        agrees("dvgo", &file, &SourceOptions::default(), |share, direction| {
            let at = [0, 1, 2].map(|axis| share[axis] * (NODES[axis] - 1) as f64);
            let edges = [0, 1, 2].map(|axis| f64::from(AABB[axis + 3]) - f64::from(AABB[axis]));
            let count = NODES.iter().product::<usize>() as f64;
            // Density is per length of a base voxel, of which there are eight times as many.
            let voxel = (edges.iter().product::<f64>() / (8.0 * count)).cbrt();
            let raw = dvgo_grid(&file, "density", at)[0];
            let color = dvgo_color(&file, &dvgo_grid(&file, "k0", at), direction);
            (softplus(raw - 2.0) / voxel, color)
        });
    }
}

#[test]
fn a_contracted_scene_shows_its_inner_box_on_request() {
    for norm in ["inf", "l2"] {
        let file = contracted(norm);
        let whole = of_bytes(file.to_bytes(), &SourceOptions::default()).expect("all of space");
        assert!(whole.is_unbounded && !whole.field.shells.is_empty());
        let options = SourceOptions { drop_background: true, ..SourceOptions::default() };
        let source = of_bytes(file.to_bytes(), &options).expect("its inner box");
        let told = source.assumptions.iter().find(|told| told.key == "scene_radius");
        assert!(told.is_some_and(|told| told.message.contains("left out")));
        let rays = rays(INNER.0, [0.0, 1.5]);
        let light = renderer(&source).ray_colors(&rays, 0, &Silent).expect("rays");
        let field = Renderer::of_field(&source.field).expect("nodes");
        let nodes = field.ray_colors(&rays, 0, &Silent).expect("rays");
        let (mut seen, mut near) = (0, 0);
        for ((ray, found), node) in rays.iter().zip(light).zip(nodes) {
            let (color, left) = inner_ray(&file, norm == "l2", ray);
            seen += usize::from(left < 0.7);
            near += usize::from((node.transmittance - found.transmittance).abs() < 0.1);
            assert!((f64::from(found.transmittance) - left).abs() < 1e-5, "{found:?} for {left}");
            for (found, expected) in found.color.into_iter().zip(color) {
                assert!((f64::from(found) - expected).abs() < 1e-5, "{found} for {expected}");
            }
        }
        assert!(seen > 20 && near > 60, "{norm}: {seen} rays hit something, {near} nodes agree");
    }
    let mut other = contracted("inf");
    *other.item("model_state_dict/scene_radius") = Item::Floats(vec![3], vec![1.0, 2.0, 1.0]);
    let options = SourceOptions { drop_background: true, ..SourceOptions::default() };
    let error = of_bytes(other.to_bytes(), &options).expect_err("no cube");
    assert!(matches!(error.kind(), ErrorKind::Malformed { .. }), "{error}");
}

/// A ray through the part of a contracted scene that is not contracted, in float64: samples are
/// counted from the camera, in half sizes of the inner box.
fn inner_ray(file: &TorchFile, is_ball: bool, ray: &Ray) -> ([f64; 3], f64) {
    let (center, radius) = INNER;
    let origin = [0, 1, 2].map(|axis| (ray.origin[axis] - center[axis]) / radius);
    let steps = (2.0f64 / 2.5 * 9.0 / 0.5).floor() + 1.0;
    let (_, mask) = match &file.items.iter().find(|item| item.0.ends_with(".mask")).expect("one").1
    {
        Item::Bytes(shape, mask) => (shape, mask),
        other => panic!("{other:?}"),
    };
    let (mut passes, mut sum, mut number) = (1.0, [0.0; 3], 0.0);
    while passes >= 1e-3 && number < 400.0 {
        let t = (number + 0.5) * 2.0 / steps;
        number += 1.0;
        let at = [0, 1, 2].map(|axis| origin[axis] + t * ray.direction[axis]);
        let node = at.map(|at| (at * 2.4 + 3.0).round());
        let inside = |at: f64| at.abs() <= 1.0;
        if !at.into_iter().all(inside) || !node.iter().all(|at| (0.0..7.0).contains(at)) {
            continue;
        }
        // Nodes of the mask whose surroundings reach beyond the ball are left out with them.
        let farthest = node.map(|node| ((node - 3.0) / 2.4).abs() + 0.5 / 2.4);
        if is_ball && farthest.iter().map(|at| at * at).sum::<f64>() > 1.0 {
            continue;
        }
        let [x, y, z] = node.map(|at| at as usize);
        if mask[(x * 7 + y) * 7 + z] == 0 {
            continue;
        }
        let nodes = at.map(|at| (at + 1.25) / 2.5 * 8.0);
        // An interval is half a voxel; there are eight base voxels in each.
        let depth = softplus(dvgo_grid(file, "density", nodes)[0] - 2.0) * 0.5 * 2.0;
        let alpha = 1.0 - (-depth).exp();
        if alpha <= 1e-4 {
            continue;
        }
        let weight = alpha * passes;
        passes *= 1.0 - alpha;
        if weight > 1e-4 {
            let color = dvgo_color(file, &dvgo_grid(file, "k0", nodes), ray.direction.to_array());
            (0..3).for_each(|channel| sum[channel] += weight * color[channel]);
        }
    }
    (sum.map(|sum| sum + passes), passes)
}

#[test]
fn small_models_are_read() {
    let options = SourceOptions { drop_background: true, ..SourceOptions::default() };
    for make in factored::SMALL_MODELS {
        read(&of_bytes(make().to_bytes(), &options).expect("sound")).expect("sound");
    }
}
