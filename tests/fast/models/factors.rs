//! TensoRF's factors and networks that run for each sample, held against references that other
//! programs rendered.

use crate::common::models::{Reference, farthest, is_typed, open, points_agree, renderer};
use crate::common::{fixture, folder};
use mipvog::bake::{BakeOptions, Baker};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::container::Container;
use mipvog::view::render::Renderer;
use mipvog_inputs::tensor::{self, Value};
use mipvog_inputs::{Family, SourceOptions, ViewChoice};
use mipvog_inputs::{inspect, open_tensors, open_with};

/// Of 2000 rays two may be farther off than the limit: samples on one or the other side of a
/// threshold, or of the first face.
fn nearly_agrees(file: &str, options: &SourceOptions, most: f32) {
    let source = open(file, options).expect(file);
    let name = file.split('.').next().expect("a name");
    let (model, reference) = (renderer(&source), Reference::of(name));
    let light = model.ray_colors(&reference.rays(), 0, &Silent).expect("rays");
    let (rgb, left) = (reference.values("rgb"), reference.values("transmittance"));
    let mut off: Vec<f32> = (0..light.len())
        .map(|ray| {
            let color = farthest(light[ray].color, &rgb[3 * ray..3 * ray + 3]);
            color.max((light[ray].transmittance - left[ray]).abs())
        })
        .collect();
    off.sort_by(f32::total_cmp);
    let within = off[off.len() - 1 - off.len() / 1000];
    let [median, most_off] = [off.len() / 2, off.len() - 1].map(|at| off[at]);
    println!("{name}: median {median:e}, all but two {within:e}, farthest {most_off:e}");
    assert!(within <= most, "{name}: {within}");
    points_agree(name, &model, &reference);
}

#[test]
fn tensorf_by_its_own_rules_agrees_with_another_program() {
    let plain = SourceOptions::default();
    nearly_agrees("tensorf_vm_sh.th", &plain, 2e-4);
    nearly_agrees("tensorf_cp.th", &plain, 2e-4);
    nearly_agrees("tensorf_vm_relu_rgb.th", &plain, 4e-4);
    nearly_agrees("tensorf_vm.th", &plain, 2e-4);
}

#[test]
fn a_network_for_each_sample_agrees_with_another_program() {
    let near = SourceOptions { near: Some(2.0), ..SourceOptions::default() };
    nearly_agrees("dvgo_tensorf_grid.tar", &near, 1e-4);
    // The network adds to colours of the grid.
    nearly_agrees("dvgo_residual.tar", &near, 1e-5);
    // `trained.rs` holds the pictures of the dense grid with a network against DirectVoxGO's own.
    let dense = fixture("lego/dvgo.tar");
    let open =
        |options: &SourceOptions| open_with(&dense, options, &Limits::default()).expect("a model");
    let source = open(&near);
    assert_eq!(source.family, Family::Dvgo);
    assert_eq!(source.field.harmonics().map(|rules| rules.degree), Some(2));
    let source = open(&SourceOptions { view: ViewChoice::None, ..near });
    assert!(source.model.is_none() && source.field.color_channels() == 3, "as it is stored");
}

/// Rays of a field's nodes against its reference, in decibels.
fn field_decibels(file: &str, options: &SourceOptions) -> f64 {
    let source = open(file, options).expect(file);
    decibels(file, &Renderer::of_field(&source.field).expect("nodes"))
}

/// Rays against a reference, in decibels.
fn decibels(file: &str, nodes: &Renderer) -> f64 {
    let name = file.split('.').next().expect("a name");
    let reference = Reference::of(name);
    let light = nodes.ray_colors(&reference.rays(), 0, &Silent).expect("rays");
    let rgb = reference.values("rgb");
    let found = light.iter().flat_map(|ray| ray.color);
    let squares: f64 =
        found.zip(&rgb).map(|(a, b)| f64::from((a.clamp(0.0, 1.0) - b).powi(2))).sum();
    let decibels = -10.0 * (squares / rgb.len() as f64).log10();
    println!("{name}: {decibels:.1} dB");
    decibels
}

#[test]
fn a_field_of_factors_shows_what_its_model_shows() {
    let plain = SourceOptions::default();
    assert!(field_decibels("tensorf_vm_sh.th", &plain) > 60.0);
    assert!(field_decibels("tensorf_vm_relu_rgb.th", &plain) > 60.0);
    // A network is fitted at nodes.
    let near = SourceOptions { near: Some(2.0), ..SourceOptions::default() };
    for (name, plain) in [
        ("tensorf_vm.th", plain.clone()),
        ("tensorf_cp.th", plain),
        ("dvgo_tensorf_grid.tar", near),
    ] {
        let decibels = [
            field_decibels(
                name,
                &SourceOptions { view: ViewChoice::Harmonics(0), ..plain.clone() },
            ),
            field_decibels(
                name,
                &SourceOptions { view: ViewChoice::Harmonics(1), ..plain.clone() },
            ),
            field_decibels(name, &plain),
        ];
        assert!(decibels.is_sorted() && decibels[2] > 40.0, "{name}: {decibels:?}");
        let source = open(name, &plain).expect(name);
        assert_eq!(source.field.harmonics().map(|rules| rules.degree), Some(2));
        assert!(source.assumptions.iter().any(|assumption| assumption.key == "view"));
    }
}

/// The value that keys lead to, to be changed.
fn entry<'a>(value: &'a mut Value, keys: &[&str]) -> &'a mut Value {
    keys.iter().fold(value, |value, key| match value {
        Value::Dict(entries) => {
            &mut entries.iter_mut().find(|entry| entry.0 == *key).expect("such a key").1
        }
        other => panic!("{key} of {other:?}"),
    })
}

#[test]
fn lies_about_factors_are_refused() {
    let lie = |name: &str, keys: &[&str], change: &dyn Fn(&Value) -> Value| {
        let path = fixture("grids/tensorf_vm.th");
        let mut file = tensor::open(&path, &Limits::default()).expect("a file");
        let other = entry(&mut file.root, &["state_dict", "app_plane.1"]).clone();
        let changed = entry(&mut file.root, keys);
        let value = change(&other);
        *changed = value;
        let opened = open_tensors(&file, &SourceOptions::default(), &Limits::default());
        let loaded = opened.and_then(|source| source.renderer(None, &Limits::default()));
        let error = loaded.err().unwrap_or_else(|| panic!("{name} passes"));
        assert!(is_typed(&error), "{name}: {error}");
    };
    let list = |numbers: &[f64]| Value::List(numbers.iter().map(|&n| Value::Float(n)).collect());
    let settings: [(&str, &str, Value); 15] = [
        ("no corners", "aabb", list(&[1.0, 2.0])),
        ("a box inside out", "aabb", list(&[1.0, 1.0, 1.0, 0.0, 0.0, 0.0])),
        ("other nodes", "gridSize", list(&[19.0, 19.0, 17.0])),
        ("half a node", "gridSize", list(&[18.5, 19.0, 17.0])),
        ("one node", "gridSize", list(&[1.0, 19.0, 17.0])),
        ("too many nodes", "gridSize", list(&[1e6, 1e6, 1e6])),
        ("no step", "step_ratio", Value::Float(0.0)),
        ("a step that is no number", "step_ratio", Value::Float(f64::NAN)),
        ("a scale below 0", "distance_scale", Value::Float(-25.0)),
        ("no activation", "fea2denseAct", Value::Text("exp".to_owned())),
        ("device coordinates", "near_far", list(&[0.0, 1.0])),
        ("far before near", "near_far", list(&[6.0, 2.0])),
        ("a threshold above 1", "rayMarch_weight_thres", Value::Float(2.0)),
        ("an unknown shading", "shadingMode", Value::Text("MLP_Sea".to_owned())),
        ("more octaves than inputs", "fea_pe", Value::Int(3)),
    ];
    for (name, key, value) in settings {
        lie(name, &["kwargs", key], &|_| value.clone());
    }
    for key in [
        "density_plane.0",
        "density_line.2",
        "app_line.1",
        "basis_mat.weight",
        "renderModule.mlp.0.weight",
        "renderModule.mlp.4.bias",
    ] {
        lie("another array", &["state_dict", key], &|other| other.clone());
        lie("no array", &["state_dict", key], &|_| Value::None);
    }
    lie("bits of another mask", &["alphaMask.mask"], &|other| other.clone());
    lie("a mask without shape", &["alphaMask.shape"], &|_| list(&[1.0, 1.0, 29.0, 31.0]));
    lie("a larger mask", &["alphaMask.shape"], &|_| list(&[1.0, 1.0, 28.0, 29.0, 31.0]));
    lie("a mask without a box", &["alphaMask.aabb"], &|_| Value::None);
}

#[test]
fn a_bake_of_factors_shows_what_their_model_shows() {
    let near = SourceOptions { near: Some(2.0), ..SourceOptions::default() };
    let here = folder();
    for (name, options, least) in [
        ("dvgo_tensorf_grid.tar", near, 43.0),
        ("tensorf_cp.th", SourceOptions::default(), 41.5),
        // At 8 bits a step of a coefficient moves a colour by 0.003.
        ("tensorf_vm_sh.th", SourceOptions::default(), 56.0),
    ] {
        let source = open(name, &options).expect(name);
        let path = here.path().join("baked.mipvog");
        Baker::new(BakeOptions::default()).to_file(&source, &path, true).expect("a bake");
        let baked = Container::open_path(&path, &Limits::default()).expect("a container");
        let found = decibels(name, &Renderer::of_container(&baked).expect("a field"));
        assert!(found > least, "{name}: {found} dB");
    }
}

#[test]
fn masks_of_models_are_listed() {
    for (name, expected) in
        [("tensorf_vm.th", Some([33, 31, 29])), ("tensorf_vm_relu_rgb.th", None)]
    {
        let path = fixture("grids").join(name);
        let found = inspect(&path, &SourceOptions::default(), &Limits::default()).expect(name);
        assert_eq!(found.scene.expect("a scene").free_space, expected, "{name}");
    }
    let path = fixture("lego/dvgo.tar");
    let found = inspect(&path, &SourceOptions::default(), &Limits::default()).expect("a model");
    assert!(found.scene.expect("a scene").free_space.is_some());
}
