//! Models of other systems: what they show by their own rules, and what a bake makes of them, held
//! against references that other programs rendered.

mod common;

use std::path::Path;
use std::sync::Arc;

use common::grids::{self, SMALL_GRIDS, SmallGrid, Values};
use common::{assert_schema, fixture, folder, program, python};
use glam::DVec3;
use mipvog_bake::unstable::bake::{BakeOptions, Baker};
use mipvog_bake::unstable::base::bytes::SourceFile;
use mipvog_bake::unstable::base::error::{Error, ErrorKind};
use mipvog_bake::unstable::base::limits::{Budget, Limits};
use mipvog_bake::unstable::base::progress::Silent;
use mipvog_bake::unstable::codec::container::Container;
use mipvog_bake::unstable::codec::quantize::Bits;
use mipvog_bake::unstable::input::checkpoint::{Family, Source, SourceOptions, ViewChoice};
use mipvog_bake::unstable::input::tensor::{self, Value};
use mipvog_bake::unstable::input::{inspect, open_tensors, open_with};
use mipvog_bake::unstable::model::camera::Ray;
use mipvog_bake::unstable::model::field::Grid;
use mipvog_bake::unstable::model::trained_model::RayColor;
use mipvog_bake::unstable::view::render::Renderer;

fn open(name: &str, options: &SourceOptions) -> Result<Source, Error> {
    open_with(&fixture("grids").join(name), options, &Limits::default())
}

fn renderer(source: &Source) -> Renderer {
    Renderer::of_source(source, None, &Limits::default()).expect("a model")
}

/// The tensors of a reference.
struct Reference(tensor::TensorFile);

impl Reference {
    fn of(name: &str) -> Self {
        let path = fixture("grids").join(format!("{name}.rays.safetensors"));
        Self(tensor::open(&path, &Limits::default()).expect("a reference"))
    }

    fn values(&self, name: &str) -> Vec<f32> {
        let found = self.0.root.get(name).and_then(Value::tensor).expect("a tensor");
        found.read_f32(&mut Budget::new(&Limits::default())).expect("values")
    }

    fn points(&self, name: &str) -> Vec<[f64; 3]> {
        self.values(name).as_chunks::<3>().0.iter().map(|point| point.map(f64::from)).collect()
    }

    fn rays(&self) -> Vec<Ray> {
        let rays = self.points("origins").into_iter().zip(self.points("directions"));
        rays.map(|(origin, direction)| Ray {
            origin: DVec3::from_array(origin),
            direction: DVec3::from_array(direction).normalize(),
        })
        .collect()
    }
}

/// Largest difference of two lists of the same length.
fn farthest(found: impl IntoIterator<Item = f32>, expected: &[f32]) -> f32 {
    let found: Vec<f32> = found.into_iter().collect();
    assert_eq!(found.len(), expected.len());
    found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Rays within 2e-5 of the reference, densities within 1e-5 of theirs, colours within 1e-5.
fn agrees(name: &str, reference: &str, options: &SourceOptions) {
    let (model, reference) =
        (renderer(&open(name, options).expect(name)), Reference::of(reference));
    let light = model.ray_colors(&reference.rays(), 0, &Silent).expect("rays");
    let rgb = farthest(light.iter().flat_map(|ray| ray.color), &reference.values("rgb"));
    let left = farthest(light.iter().map(|r| r.transmittance), &reference.values("transmittance"));
    assert!(rgb < 2e-5 && left < 2e-5, "{name}: colours {rgb}, transmittance {left}");
    let (positions, densities) = (reference.points("positions"), reference.values("density"));
    for (position, expected) in positions.iter().zip(densities) {
        let found = model.sample(*position, 0).expect("a point").density;
        let off = (found - expected).abs();
        assert!(off <= 1e-5 * expected.abs() + 1e-6, "{name}: {found} for {expected}");
    }
    let directions = reference.points("color_directions");
    let colors = reference.values("color");
    for (position, expected) in positions.iter().zip(colors.chunks_exact(3 * directions.len())) {
        let found = model.point_colors(*position, &directions, 0).expect("a point");
        let off = farthest(found.into_iter().flatten(), expected);
        assert!(off < 1e-5, "{name}: colours {off} off at {position:?}");
    }
}

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
    println!("{name}: median {:e}, all but two {within:e}, farthest {:e}", off[1000], off[1999]);
    assert!(within <= most, "{name}: {within}");
    let (positions, densities) = (reference.points("positions"), reference.values("density"));
    for (position, expected) in positions.iter().zip(densities) {
        let found = model.sample(*position, 0).expect("a point").density;
        let off = (found - expected).abs();
        assert!(off <= 1e-5 * expected.abs() + 1e-6, "{name}: {found} for {expected}");
    }
    let directions = reference.points("color_directions");
    let colors = reference.values("color");
    for (position, expected) in positions.iter().zip(colors.chunks_exact(3 * directions.len())) {
        let found = model.point_colors(*position, &directions, 0).expect("a point");
        let off = farthest(found.into_iter().flatten(), expected);
        assert!(off < 1e-5, "{name}: colours {off} off at {position:?}");
    }
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
    nearly_agrees("dvgo_default.tar", &near, 1e-4);
    let source = open("dvgo_default.tar", &near).expect("a model");
    assert_eq!(source.family, Family::Dvgo);
    assert_eq!(source.field.harmonics().map(|rules| rules.degree), Some(2));
    let plain = SourceOptions { view: ViewChoice::None, ..near };
    let source = open("dvgo_default.tar", &plain).expect("a model");
    assert!(source.model.is_none() && source.field.color_channels() == 3, "as it is stored");
}

/// Rays of a field's nodes against its reference, in decibels.
fn field_decibels(name: &str, options: &SourceOptions) -> f64 {
    let source = open(&format!("{name}.th"), options).expect(name);
    let nodes = Renderer::of_field(&source.field).expect("nodes");
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
    assert!(field_decibels("tensorf_vm_sh", &plain) > 60.0);
    assert!(field_decibels("tensorf_vm_relu_rgb", &plain) > 60.0);
    // A network is fitted at nodes.
    for name in ["tensorf_vm", "tensorf_cp"] {
        let decibels = [
            field_decibels(name, &SourceOptions { view: ViewChoice::None, ..plain.clone() }),
            field_decibels(
                name,
                &SourceOptions { view: ViewChoice::Harmonics(1), ..plain.clone() },
            ),
            field_decibels(name, &plain),
        ];
        assert!(decibels.is_sorted() && decibels[2] > 40.0, "{name}: {decibels:?}");
        let source = open(&format!("{name}.th"), &plain).expect(name);
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
        let loaded =
            opened.and_then(|source| Renderer::of_source(&source, None, &Limits::default()));
        let error = loaded.err().unwrap_or_else(|| panic!("{name} passes"));
        let kind = error.kind();
        let typed = matches!(
            kind,
            ErrorKind::Malformed { .. }
                | ErrorKind::Unsupported { .. }
                | ErrorKind::OverLimit { .. }
        );
        assert!(typed, "{name}: {error}");
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
    let source = open("plenoxels_cubic.npz", &SourceOptions::default()).expect("a model");
    let mut options = BakeOptions::default();
    (options.bits, options.levels) = (Bits::F32, Some(1));
    options.alpha_threshold = 1e-7;
    let here = folder();
    let path = here.path().join("cubic.mipvog");
    Baker::new(options).to_file(&source, &path, false).expect("a bake");
    let baked = Container::open_path(&path, &Limits::default()).expect("a container");
    let baked = Renderer::of_container(&baked).expect("a field");
    let rays = Reference::of("plenoxels_cubic").rays();
    let [own, seen] = [&renderer(&source), &baked]
        .map(|field| field.ray_colors(&rays, 0, &Silent).expect("rays"));
    let left: Vec<f32> = own.iter().map(|ray| ray.transmittance).collect();
    let off = farthest(seen.iter().map(|ray| ray.transmittance), &left);
    assert!(off < 1e-4, "transmittance {off}");
    // The container clamps once a ray and not at each sample: few rays see a sample that clamps.
    let off = |(own, seen): (&RayColor, &RayColor)| {
        (0..3).map(|c| (own.color[c] - seen.color[c]).abs()).fold(0.0, f32::max)
    };
    let errors: Vec<f32> = own.iter().zip(&seen).map(off).collect();
    let large = errors.iter().filter(|error| **error > 1e-3).count();
    assert!(large * 1000 <= errors.len(), "{large} rays are off by more than 1e-3");
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
        assert_eq!(found.scene.is_none(), name.contains("background"), "{:?}", found.problem);
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
    let refused = |name: &str, expected: &str| {
        let error = open(name, &SourceOptions::default()).expect_err(name);
        assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
        assert!(error.to_string().contains(expected), "{error}");
    };
    refused("plenoxels_background.npz", "spheres behind the box");
    let options = SourceOptions { drop_background: true, ..SourceOptions::default() };
    let source = open("plenoxels_background.npz", &options).expect("the box alone");
    assert!(source.assumptions.iter().any(|assumption| assumption.key == "background_data"));
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

fn small(grid: &SmallGrid) -> Result<Source, Error> {
    let file = Arc::new(SourceFile::decoded(grid.to_bytes(), Path::new("/nowhere/grid")));
    let limits = Limits::default();
    open_tensors(&tensor::open_file(&file, &limits)?, &SourceOptions::default(), &limits)
}

/// Opens a model, loads it, and reads its field.
fn used(grid: &SmallGrid) -> Result<(), Error> {
    let source = small(grid)?;
    Renderer::of_source(&source, None, &Limits::default())?;
    let [nx, ny, nz] = source.field.scene.nodes.0;
    for grid in source.field.grids() {
        let mut plane = vec![0.0; ny * nz];
        for channel in 0..grid.channels() {
            (0..nx).try_for_each(|x| grid.read_plane(channel, x, &mut plane, |_| {}))?;
        }
    }
    Ok(())
}

/// A grid, the part that lies, and the lie.
type LieCase = (fn() -> SmallGrid, &'static str, fn(&mut SmallGrid));

#[test]
fn small_models_of_every_kind_are_read_and_lies_are_refused() {
    for make in SMALL_GRIDS {
        used(&make()).expect("sound");
    }
    let lies: [LieCase; 16] = [
        (grids::plenoxels, "a link beyond the rows", |grid| {
            if let Values::I32(links) = &mut grid.array("links").2 {
                links[4] = 30;
            }
        }),
        (grids::plenoxels, "fewer rows of colour", |grid| {
            *grid.array("sh_data") = ("sh_data", vec![29, 12], Values::F32(vec![0.0; 348]));
        }),
        (grids::plenoxels, "no number of functions", |grid| {
            *grid.array("sh_data") = ("sh_data", vec![30, 15], Values::F32(vec![0.0; 450]));
        }),
        (grids::plenoxels, "a density that is no number", |grid| {
            if let Values::F32(values) = &mut grid.array("density_data").2 {
                values[3] = f32::NAN;
            }
        }),
        (grids::plenoxels, "a box without extent", |grid| {
            *grid.array("radius") = ("radius", vec![3], Values::F32(vec![1.0, 0.0, 1.0]));
        }),
        (grids::plenoxels, "a texture as basis", |grid| {
            grid.arrays.push(("basis_type", Vec::new(), Values::I32(vec![4])));
        }),
        (grids::lightning, "a cell beyond any grid", |grid| {
            *grid.array("state_dict.model.links_idx") =
                ("state_dict.model.links_idx", vec![30], Values::I32(vec![-5; 30]));
        }),
        (grids::lightning, "scales of other columns", |grid| {
            *grid.array("model.sh_data_min") =
                ("model.sh_data_min", vec![2], Values::F32(vec![0.0; 2]));
        }),
        (grids::sampled, "a box inside out", |grid| {
            if let Values::F32(corners) = &mut grid.array("aabb").2 {
                corners[0] = 7.0;
            }
        }),
        (grids::sampled, "an unknown clamp", |grid| grid.settings[0] = ("clamp", "tanh")),
        (grids::sampled_blocks, "a block twice", |grid| {
            *grid.array("blocks") = ("blocks", vec![2, 3], Values::I32(vec![0; 6]));
        }),
        (grids::sampled_blocks, "a block before the first", |grid| {
            *grid.array("blocks") = ("blocks", vec![2, 3], Values::I32(vec![0, 0, 0, 0, -1, 0]));
        }),
        (grids::plenoctree, "a node that is its own child", |grid| {
            if let Values::I32(children) = &mut grid.array("child").2 {
                children[9] = 0;
                children[10] = -1;
            }
        }),
        (grids::plenoctree, "a node as a child twice", |grid| {
            if let Values::I32(children) = &mut grid.array("child").2 {
                children[2] = 1;
            }
        }),
        (grids::plenoctree, "a child beyond the nodes", |grid| {
            if let Values::I32(children) = &mut grid.array("child").2 {
                children[2] = 3;
            }
        }),
        (grids::quantized, "an entry beyond the code book", |grid| {
            if let Values::U16(entries) = &mut grid.array("quant_map").2 {
                entries.fill(5);
            }
        }),
    ];
    for (make, name, lie) in lies {
        let mut grid = make();
        lie(&mut grid);
        let error = match used(&grid) {
            Ok(()) => panic!("{name} passes"),
            Err(error) => error,
        };
        let kind = error.kind();
        let typed = matches!(
            kind,
            ErrorKind::Malformed { .. }
                | ErrorKind::Unsupported { .. }
                | ErrorKind::NonFinite { .. }
        );
        // Values that are no numbers are refused by a bake, which reads nodes.
        assert!(typed, "{name}: {error}");
    }
}

#[test]
fn quantized_checkpoints_hold_the_values_that_their_codes_stand_for() {
    let grid = grids::lightning();
    let (Values::U8(codes), Values::F32(density)) = (&grid.arrays[2].2, &grid.arrays[1].2) else {
        panic!("codes and densities")
    };
    let field = small(&grid).expect("sound").field;
    assert_eq!(field.scene.nodes.0, [18; 3], "16 cells and a border");
    let plane = |grid: &Grid, channel, x| {
        let mut plane = vec![0.0; 18 * 18];
        grid.read_plane(channel, x, &mut plane, |_| {}).expect("a plane");
        plane
    };
    for row in 0..30 {
        let cell = 4000 - 97 * row;
        let [x, y, z] = [cell / 256, cell / 16 % 16, cell % 16].map(|at| at + 1);
        assert_eq!(plane(&field.density, 0, x)[y * 18 + z], density[row]);
        for channel in 0..12 {
            // Function by function here, colour by colour there.
            let column = channel % 3 * 4 + channel / 3;
            let expected = f32::from(codes[12 * row + column]) / 128.0 - 1.0;
            assert_eq!(plane(&field.color[0], channel, x)[y * 18 + z], expected);
        }
    }
    let empty = plane(&field.color[0], 0, 1);
    assert!(empty.iter().filter(|value| **value == 0.0).count() > 300, "empty cells hold zeros");
}

#[test]
fn blocks_and_dense_arrays_of_the_open_door_are_the_same_scene() {
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
    let ran = std::process::Command::new(python()).arg(&script).arg(&out).output();
    let Ok(ran) = ran else { return };
    if String::from_utf8_lossy(&ran.stderr).contains("No module named 'numpy'") {
        return;
    }
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let source = open_with(&out, &SourceOptions::default(), &Limits::default()).expect("a scene");
    assert_eq!(source.family, Family::Sampled);
    let model = renderer(&source);
    assert!(model.sample([0.0; 3], 0).expect("inside").density > 1.0);
    let toward = model.point_colors([0.0, 0.0, 0.5], &[[0.0, 0.0, -1.0]], 0).expect("inside");
    let away = model.point_colors([0.0, 0.0, 0.5], &[[0.0, 0.0, 1.0]], 0).expect("inside");
    assert!(toward[0][0] > away[0][0] + 0.1, "{toward:?} {away:?}");
}

/// Runs the program; its exit code and its JSON.
fn run(line: &[&str]) -> (Option<i32>, serde_json::Value, String) {
    let output = program().args(line).args(["--format", "json"]).output().expect("starts");
    let json = serde_json::from_slice(&output.stdout).unwrap_or_default();
    (output.status.code(), json, String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn verbs_take_models_and_refuse_what_they_cannot_do() {
    let here = folder();
    let path = |name: &str| here.path().join(name).to_string_lossy().into_owned();
    let fixture = |name: &str| fixture("grids").join(name).to_string_lossy().into_owned();
    let tree = fixture("plenoctree.npz");
    let (code, inspected, _) = run(&["inspect", &tree]);
    assert_eq!((code, inspected["model"].as_str()), (Some(0), Some("plenoctree")));
    assert_schema("inspect", &inspected);
    let out = path("tree.mipvog");
    let (code, report, _) = run(&["bake", &tree, "-o", &out]);
    assert_eq!(code, Some(0));
    assert_schema("bake", &report);
    let psnr = report["quality"]["errors"][0]["psnr"].as_f64().expect("the loss of resampling");
    assert!((26.0..60.0).contains(&psnr), "{psnr} dB");
    let model = fixture("plenoxels_cubic.npz");
    let picture = path("picture.png");
    for (options, expected) in [
        (["--filter", "rate-tent"], "its own rules"),
        (["--level-of-detail", "2"], "0 to 0"),
        (["--view", "sh:4"], "sh:D"),
        (["--scene-scale", "0"], "scene"),
    ] {
        let line = ["render", &model, "-o", &picture, options[0], options[1]];
        let (code, _, message) = run(&line);
        assert_eq!(code, Some(2), "{options:?}: {message}");
        assert!(message.contains(expected), "{options:?}: {message}");
    }
    let (code, _, message) = run(&["render", &out, "-o", &picture, "--view", "none"]);
    assert_eq!(code, Some(2), "{message}");
    let compared = ["compare", &model, &model, "--turntable", "2", "--size", "24x24"];
    let (code, report, _) = run(&compared);
    assert_eq!(code, Some(0));
    assert!(report["scales"][0]["psnr"].as_f64().is_some_and(|psnr| psnr > 150.0), "{report}");
}
