//! Models of other systems: what they show by their own rules, and what a bake makes of them, held
//! against references that other programs rendered.

use std::path::Path;

use crate::common::grids::{self, Values};
use crate::common::models::{Reference, agrees, farthest, open, renderer, small};
use crate::common::{fixture, folder, others};
use mipvog::bake::{BakeOptions, Baker};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::container::Container;
use mipvog::model::camera::Ray;
use mipvog::model::harmonics::Evaluation;
use mipvog::model::trained_model::RayColor;
use mipvog::model::view_dependence::ViewDependence;
use mipvog::quantize::Bits;
use mipvog::view::render::Renderer;
use mipvog_inputs::{Family, SourceOptions, ViewChoice};
use mipvog_inputs::{inspect, open_with};

#[test]
fn models_by_their_own_rules_agree_with_other_programs() {
    let plain = SourceOptions::default();
    agrees("plenoxels_cubic.npz", "plenoxels_cubic", &plain);
    agrees("plenoxels_anisotropic.npz", "plenoxels_anisotropic", &plain);
    let grey = SourceOptions { background: Some([0.7; 3]), ..plain.clone() };
    agrees("plenoxels_legacy.npz", "plenoxels_anisotropic", &grey);
    agrees("plenoctree.npz", "plenoctree", &plain);
    agrees("plenoctree_compressed.npz", "plenoctree_compressed", &plain);
    agrees("plenoctree_sh16.npz", "plenoctree_sh16", &plain);
}

#[test]
fn a_field_holds_the_values_of_its_model() {
    for name in ["plenoxels_cubic", "plenoxels_anisotropic"] {
        let source = open(&format!("{name}.npz"), &SourceOptions::default()).expect(name);
        let nodes = Renderer::of_field(&source.field).expect("nodes");
        let reference = Reference::of(name);
        let directions = reference.points("color_directions");
        let (densities, colors) = (reference.values("density"), reference.values("color"));
        let colors: Vec<&[f32]> = colors.chunks_exact(3 * directions.len()).collect();
        for (number, position) in reference.points("positions").into_iter().enumerate() {
            let (found, expected) = (nodes.sample(position, 0).expect("inside"), densities[number]);
            let off = (found.density - expected).abs();
            // Positions between nodes are float32 here.
            assert!(off <= 1e-3 * expected.abs() + 1e-3, "{name}: {} {expected}", found.density);
            if let Some(expected) = colors.get(number) {
                let found = nodes.point_colors(position, &directions, 0).expect("inside");
                let off = farthest(found.into_iter().flatten(), expected);
                assert!(off < 1e-4, "{name}: colours {off} off");
            }
        }
    }
}

#[test]
fn a_baked_container_shows_what_its_model_shows() {
    // Clamped once a ray and not at each sample: few rays see a sample that clamps.
    assert!(changed_share("plenoxels_cubic", Evaluation::Ray) <= 1e-3);
    for name in ["plenoxels_cubic", "plenoxels_anisotropic"] {
        assert!(changed_share(name, Evaluation::Sample) == 0.0, "{name}");
    }
}

/// The share of a reference's rays whose colour a float32 container moves by more than 1e-3.
fn changed_share(name: &str, evaluation: Evaluation) -> f64 {
    let mut source = open(&format!("{name}.npz"), &SourceOptions::default()).expect("a model");
    let Some(ViewDependence::Harmonics(harmonics)) = &mut source.field.view else {
        panic!("{name} has harmonics")
    };
    harmonics.evaluation = evaluation;
    let mut options = BakeOptions::default();
    (options.bits, options.levels) = (Bits::F32, Some(1));
    options.alpha_threshold = 1e-7;
    let here = folder();
    let path = here.path().join("baked.mipvog");
    Baker::new(options).to_file(&source, &path, false).expect("a bake");
    let baked = Container::open_path(&path, &Limits::default()).expect("a container");
    let baked = Renderer::of_container(&baked).expect("a field");
    let rays = Reference::of(name).rays();
    let [own, seen] = [&renderer(&source), &baked]
        .map(|field| field.ray_colors(&rays, 0, &Silent).expect("rays"));
    let left: Vec<f32> = own.iter().map(|ray| ray.transmittance).collect();
    let off = farthest(seen.iter().map(|ray| ray.transmittance), &left);
    assert!(off < 1e-4, "{name}: transmittance {off}");
    let off = |(own, seen): (&RayColor, &RayColor)| {
        (0..3).map(|c| (own.color[c] - seen.color[c]).abs()).fold(0.0, f32::max)
    };
    let errors: Vec<f32> = own.iter().zip(&seen).map(off).collect();
    let large = errors.iter().filter(|error| **error > 1e-3).count();
    large as f64 / errors.len() as f64
}

#[test]
fn inspection_names_the_family_and_states_the_scene() {
    for (name, family) in [
        ("plenoxels_cubic.npz", Family::Plenoxels),
        ("plenoctree.npz", Family::PlenOctree),
        ("plenoxels_background.npz", Family::Plenoxels),
        ("tensorf_vm.th", Family::Tensorf),
        ("tensorf_cp.th", Family::Tensorf),
        ("tensorf_vm_relu_rgb.th", Family::Tensorf),
    ] {
        let path = fixture("grids").join(name);
        let found = inspect(&path, &SourceOptions::default(), &Limits::default()).expect("listed");
        assert_eq!(found.model, Some(family), "{name}");
        assert!(found.scene.is_some(), "{:?}", found.problem);
    }
}

#[test]
fn a_scale_moves_the_scene_and_keeps_the_picture() {
    let scale = 2.0 / 3.0;
    let options = SourceOptions { scene_scale: Some(scale), ..SourceOptions::default() };
    let scaled = open("plenoxels_cubic.npz", &options).expect("a model");
    let own = open("plenoxels_cubic.npz", &SourceOptions::default()).expect("a model");
    let ratio = own.field.scene.bounds.max[0] / scaled.field.scene.bounds.max[0];
    assert!((ratio - scale).abs() < 1e-6, "{ratio}");
    let reference = Reference::of("plenoxels_cubic");
    let factor = 1.0 / f64::from(scale);
    let rays: Vec<Ray> =
        reference.rays().iter().map(|ray| Ray { origin: factor * ray.origin, ..*ray }).collect();
    let model = renderer(&scaled);
    let light = model.ray_colors(&rays, 0, &Silent).expect("rays");
    let off = farthest(light.iter().flat_map(|ray| ray.color), &reference.values("rgb"));
    assert!(off < 2e-5, "{off}");
    let position = reference.points("positions")[3];
    let found = model.sample(position.map(|value| value * factor), 0).expect("inside").density;
    let expected = scale * reference.values("density")[3];
    assert!((found - expected).abs() < 1e-4 * expected.abs() + 1e-5, "{found} {expected}");
    let nodes = Renderer::of_field(&scaled.field).expect("nodes");
    let found = nodes.sample(position.map(|value| value * factor), 0).expect("inside").density;
    assert!((found - expected).abs() < 1e-3 * expected.abs() + 1e-3, "{found} {expected}");
}

#[test]
fn bands_are_cut_on_request() {
    let cut = |view| {
        let options = SourceOptions { view, ..SourceOptions::default() };
        open("plenoxels_cubic.npz", &options).expect("a model")
    };
    let first = cut(ViewChoice::Harmonics(1));
    assert_eq!(
        (first.field.color_channels(), first.field.harmonics().map(|h| h.degree)),
        (12, Some(1))
    );
    let none = cut(ViewChoice::None);
    assert!(none.field.view.is_none() && none.field.color_channels() == 3);
    let directions = [[0.0, 0.0, 1.0], [0.6, 0.0, -0.8]];
    for source in [&none, &cut(ViewChoice::Harmonics(0))] {
        for seen in [renderer(source), Renderer::of_field(&source.field).expect("nodes")] {
            let position = Reference::of("plenoxels_cubic").points("positions")[5];
            let colors = seen.point_colors(position, &directions, 0).expect("inside");
            assert_eq!(colors[0], colors[1], "no view dependence is left");
        }
    }
}

#[test]
fn what_no_container_can_hold_is_refused_by_name() {
    let here = folder();
    for (settings, expected) in [
        (r#"{"renderer_backend": "nvol"}"#, "nvol"),
        (r#"{"renderer_backend": "svox1"}"#, "svox1"),
        (r#"{"dataset_type": "llff"}"#, "normalised device coordinates"),
    ] {
        let copy = here.path().join("ckpt.npz");
        std::fs::copy(fixture("grids/plenoxels_cubic.npz"), &copy).expect("writable");
        std::fs::write(here.path().join("args.json"), settings).expect("writable");
        let error = open_with(&copy, &SourceOptions::default(), &Limits::default());
        let error = error.expect_err(expected);
        assert!(error.to_string().contains(expected), "{error}");
    }
}

#[test]
fn sampled_blocks_and_dense_arrays_are_the_same_scene() {
    let dense = grids::sampled();
    let density = match &dense.arrays[0].2 {
        Values::F32(values) => values.clone(),
        _ => panic!("float32"),
    };
    let sh = match &dense.arrays[1].2 {
        Values::F32(values) => values.clone(),
        _ => panic!("float32"),
    };
    // Blocks of 3 nodes a side: 2 x 2 x 1, the last ones half outside.
    let (mut blocks, mut densities, mut coefficients) = (Vec::new(), Vec::new(), Vec::new());
    for block in [[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0]] {
        blocks.extend(block.map(|at: usize| at as i32));
        for local in 0..27 {
            let [x, y, z] = [local / 9, local / 3 % 3, local % 3];
            let node = [3 * block[0] + x, 3 * block[1] + y, z];
            let inside = node[0] < 5 && node[1] < 4;
            let at = (node[0] * 4 + node[1]) * 3 + node[2];
            densities.push(if inside { density[at] } else { 9.0 });
            let row = if inside { sh[12 * at..12 * at + 12].to_vec() } else { vec![1.0; 12] };
            coefficients.extend(row);
        }
    }
    let mut sparse = dense.clone();
    sparse.arrays[0] = ("density", vec![4, 3, 3, 3], Values::F32(densities));
    sparse.arrays[1] = ("sh", vec![4, 3, 3, 3, 3, 4], Values::F32(coefficients));
    sparse.arrays.push(("blocks", vec![4, 3], Values::I32(blocks)));
    sparse.arrays.push(("dimensions", vec![3], Values::I32(vec![5, 4, 3])));
    sparse.settings.push(("block_size", "3"));
    let [dense, sparse] = [dense, sparse].map(|grid| small(&grid).expect("sound"));
    assert_eq!(dense.field.scene, sparse.field.scene);
    let [a, b] = [&dense, &sparse].map(renderer);
    let rays = Reference::of("plenoxels_cubic").rays();
    assert_eq!(
        a.ray_colors(&rays, 0, &Silent).expect("rays"),
        b.ray_colors(&rays, 0, &Silent).expect("rays")
    );
    // By its own rules it is what its field shows: colours are logits, clamped at each sample.
    let nodes = Renderer::of_field(&dense.field).expect("nodes");
    let own = a.ray_colors(&rays, 0, &Silent).expect("rays");
    let field = nodes.ray_colors(&rays, 0, &Silent).expect("rays");
    let colors: Vec<f32> = own.iter().flat_map(|ray| ray.color).collect();
    let off = farthest(field.iter().flat_map(|ray| ray.color), &colors);
    assert!(off < 1e-4, "{off}");
}

#[test]
fn forty_lines_of_numpy_write_what_the_door_reads() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/sample_field.py");
    let here = folder();
    let out = here.path().join("ball.npz");
    let Some(mut python) = others::python() else { return };
    let ran = python.arg(&script).arg(&out).output().expect("starts");
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let source = open_with(&out, &SourceOptions::default(), &Limits::default()).expect("a scene");
    assert_eq!(source.family, Family::Sampled);
    let model = renderer(&source);
    assert!(model.sample([0.0; 3], 0).expect("inside").density > 1.0);
    let toward = model.point_colors([0.0, 0.0, 0.5], &[[0.0, 0.0, -1.0]], 0).expect("inside");
    let away = model.point_colors([0.0, 0.0, 0.5], &[[0.0, 0.0, 1.0]], 0).expect("inside");
    assert!(toward[0][0] > away[0][0] + 0.1, "{toward:?} {away:?}");
}
