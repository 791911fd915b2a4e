//! The meaning of names: every spelling of one scene gives the same field.

use crate::common;
use std::path::{Path, PathBuf};

use crate::common::checkpoint::Checkpoint;

use mipvog::base::error::ErrorKind;
use mipvog::base::limits::Limits;
use mipvog::model::field::Volume;
use mipvog::model::field::{ActivationOrder, Lookup};
use mipvog::model::grid::{Element, Nodes};
use mipvog::model::view_mlp::ViewInput;
use mipvog_inputs::{Family, MlpChoice, Source, SourceOptions};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/trained").join(name)
}

fn open(name: &str) -> Source {
    mipvog_inputs::open_with(&fixture(name), &SourceOptions::default(), &Limits::default())
        .unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn refuse(name: &str) -> mipvog::base::error::Error {
    mipvog_inputs::open_with(&fixture(name), &SourceOptions::default(), &Limits::default())
        .expect_err(name)
}

fn keys(source: &Source) -> Vec<&str> {
    source.assumptions.iter().map(|assumption| assumption.key).collect()
}

/// The rule of `tests/generate/checkpoints.py`.
fn expected(count: u64, seed: u64) -> Vec<f32> {
    let value = |i: u64| (((i + seed * 7919).wrapping_mul(2_654_435_761) >> 7) & 63) as f32;
    (0..count).map(|i| value(i) / 8.0 - 4.0).collect()
}

#[test]
fn every_spelling_gives_one_scene() {
    let names = [
        "protocol2.tar",
        "protocol3.tar",
        "protocol4.tar",
        "protocol5.tar",
        "float16.tar",
        "bfloat16.tar",
        "float64.tar",
        "deflated.tar",
        "untyped.tar",
        "strided.tar",
        "flat.npz",
        "flat_compressed.npz",
        "flat_fortran.npz",
        "flat.safetensors",
        "flat_bfloat16.safetensors",
    ];
    let first = open("dvgo/protocol2.tar");
    for name in names {
        let found = open(&format!("dvgo/{name}"));
        assert_eq!(found.field.density.nodes(), Nodes([9, 7, 5]), "{name}");
        assert_eq!(common::grid_values(&found.field.density), expected(315, 1), "{name}");
        assert_eq!(common::grid_values(&found.field.color[0]), expected(7 * 315, 2), "{name}");
        assert_eq!(found.field.scene, first.field.scene, "{name}");
        assert_eq!(found.field.view, first.field.view, "{name}");
        assert_eq!(found.field.free_space, first.field.free_space, "{name}");
        assert_eq!((found.family, keys(&found)), (Family::Dvgo, vec!["stepsize"]), "{name}");
    }
    assert_eq!(
        open("dvgo/bfloat16.tar").field.color[0].array().expect("an array").element,
        Element::BF16
    );
}

#[test]
fn settings_become_the_scene() {
    let source = open("dvgo/protocol2.tar");
    let scene = &source.field.scene;
    assert_eq!((scene.bounds.min, scene.bounds.max), ([-1.0, -2.0, -0.5], [1.5, 1.0, 0.75]));
    assert_eq!(scene.activation.shift, -6.5, "as stored, not from alpha_init");
    assert_eq!(scene.activation.order, ActivationOrder::Raw);
    let voxel_size = (2.5f64 * 3.0 * 1.25 / 300.0).cbrt();
    assert!((f64::from(scene.march.voxel_size) - voxel_size).abs() < 1e-7);
    assert!((scene.activation.interval - 0.5 * 2.0).abs() < 1e-6, "ratio cbrt(2400/300)");
    assert_eq!((scene.march.stepsize, scene.march.near, scene.march.far), (0.5, 0.0, None));
    let dropped = 1.0 / 1024.0;
    assert_eq!((scene.march.alpha_threshold, scene.march.color_threshold), (dropped, dropped));
    assert_eq!(scene.background, [1.0; 3]);
    let mlp = source.field.network().expect("rgbnet");
    assert_eq!((mlp.widths(), mlp.frequencies), (vec![34, 16, 16, 3], 4));
    assert_eq!(mlp.input, ViewInput::DiffuseAndFeatures);
    assert_eq!(mlp.layers[1].weights, expected(256, 11));
    let mask = source.field.free_space.as_ref().expect("mask");
    assert_eq!(mask.nodes, Nodes([4, 3, 2]));
    let Lookup::Nearest(inside) = &mask.lookup else { panic!("{mask:?}") };
    let wanted: Vec<bool> = expected(24, 5).iter().map(|&value| value > -2.0).collect();
    assert_eq!(inside, &wanted);
    let corner = |p: [f32; 3]| {
        std::array::from_fn(|axis| f64::from(p[axis]) * mask.scale[axis] + mask.shift[axis])
    };
    let near = |found: [f64; 3], wanted: [f64; 3]| {
        found.iter().zip(wanted).all(|(found, wanted)| (found - wanted).abs() < 1e-5)
    };
    assert!(
        near(corner(scene.bounds.min), [0.0; 3]) && near(corner(scene.bounds.max), [3., 2., 1.])
    );
}

#[test]
fn options_win() {
    let options = SourceOptions {
        stepsize: Some(0.25),
        near: Some(2.0),
        far: Some(6.0),
        background: Some([0.0; 3]),
        color_threshold: Some(0.0),
        mlp: MlpChoice::None,
        ..SourceOptions::default()
    };
    let source =
        mipvog_inputs::open_with(&fixture("dvgo/protocol2.tar"), &options, &Limits::default());
    let source = source.expect("a scene");
    let march = &source.field.scene.march;
    assert_eq!((march.stepsize, march.near, march.far), (0.25, 2.0, Some(6.0)));
    assert_eq!((march.color_threshold, march.alpha_threshold), (0.0, 1.0 / 1024.0));
    assert!(source.field.view.is_none());
    assert_eq!((source.field.color_channels(), keys(&source)), (3, vec!["mlp"]));
    for broken in [
        SourceOptions { stepsize: Some(0.0), ..SourceOptions::default() },
        SourceOptions { stepsize: Some(f32::NAN), ..SourceOptions::default() },
        SourceOptions { near: Some(-1.0), ..SourceOptions::default() },
        SourceOptions { near: Some(2.0), far: Some(2.0), ..SourceOptions::default() },
        SourceOptions { background: Some([0.0, 2.0, 0.0]), ..SourceOptions::default() },
        SourceOptions { color_threshold: Some(1.0), ..SourceOptions::default() },
    ] {
        let error =
            mipvog_inputs::open_with(&fixture("dvgo/protocol2.tar"), &broken, &Limits::default());
        let error = error.expect_err("out of range");
        assert!(matches!(error.kind(), ErrorKind::InvalidOption { .. }), "{error}");
    }
}

#[test]
fn a_mip_vog_checkpoint_is_understood() {
    let source = open("tiny/fine_last.tar");
    assert_eq!(source.family, Family::MipVog);
    assert_eq!(keys(&source), ["stepsize", "coarse"]);
    let scene = &source.field.scene;
    assert_eq!(scene.nodes, Nodes([32; 3]));
    assert!((scene.activation.shift + 4.595_12).abs() < 1e-5);
    assert_eq!((scene.activation.interval, scene.march.alpha_threshold), (0.5, 0.0));
    assert_eq!(scene.march.color_threshold, 1e-4);
    assert!(source.field.grids().all(|grid| grid.array().is_some_and(Volume::fills_storage)));
    let mask = source.field.free_space.expect("mask");
    let Lookup::Trilinear { values, threshold } = &mask.lookup else { panic!("{:?}", mask.nodes) };
    assert_eq!((mask.nodes, values.len()), (Nodes([16; 3]), 4096));
    // softplus(raw - 13.8155) = 1.0005e-3
    assert!((threshold - 6.9078).abs() < 1e-3, "{threshold}");
    // The grids and the optimizer's state are untouched.
    assert!(source.file.bytes_read() < 120_000, "{}", source.file.bytes_read());
}

#[test]
fn the_coarse_checkpoint_is_found_beside_the_fine_one() {
    let beside = open("old/fine_last.tar");
    assert_eq!(keys(&beside), ["stepsize"]);
    assert_eq!(beside.side_files.len(), 1);
    let threshold = |source: &Source| match &source.field.free_space.as_ref().expect("mask").lookup
    {
        Lookup::Trilinear { threshold, .. } => f64::from(*threshold),
        Lookup::Nearest(_) => panic!("density expected"),
    };
    // Opacity 1e-3 over two base voxels, alpha_init 1e-4.
    let shift = (1e-4f64 / (1.0 - 1e-4)).ln();
    let wanted = ((-(1.0f64 - 1e-3).ln() / 2.0).exp_m1()).ln() - shift;
    assert!((threshold(&beside) - wanted).abs() < 1e-6, "{} {wanted}", threshold(&beside));
    let orphan = open("orphan/fine_last.tar");
    assert_eq!(keys(&orphan), ["stepsize", "coarse"]);
    assert!((threshold(&orphan) - 6.9078).abs() < 1e-3);
    let options =
        SourceOptions { coarse: Some(fixture("old/coarse_last.tar")), ..SourceOptions::default() };
    let told =
        mipvog_inputs::open_with(&fixture("orphan/fine_last.tar"), &options, &Limits::default());
    let told = told.expect("a scene");
    assert_eq!((keys(&told), threshold(&told)), (vec!["stepsize"], threshold(&beside)));
    let mask = told.field.free_space.expect("mask");
    let low: [f64; 3] = std::array::from_fn(|axis| {
        f64::from([-2.0f32, -3.0, -1.5][axis]) * mask.scale[axis] + mask.shift[axis]
    });
    assert!(low.iter().all(|u| u.abs() < 1e-9), "the mask has its own box: {low:?}");
    let options = SourceOptions { coarse: Some(fixture("nowhere")), ..SourceOptions::default() };
    let error =
        mipvog_inputs::open_with(&fixture("orphan/fine_last.tar"), &options, &Limits::default());
    assert!(matches!(error.expect_err("missing").kind(), ErrorKind::Io(_)));
}

#[test]
fn other_models_are_refused_with_the_reason() {
    for (name, reason) in [("multiplane.tar", "multiplane"), ("nearest.tar", "nearest-neighbour")] {
        let error = refuse(&format!("refused/{name}"));
        assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
        assert!(error.to_string().contains(reason), "{error}");
    }
    for name in ["two_channels.tar", "zero_axis.tar", "sizes_differ.tar"] {
        let error = refuse(&format!("refused/{name}"));
        assert!(matches!(error.kind(), ErrorKind::Malformed { .. }), "{error}");
    }
    let fitted = open("refused/per_sample.tar");
    assert!(fitted.model.is_some() && fitted.field.harmonics().is_some(), "fitted");
    let options = SourceOptions { mlp: MlpChoice::None, ..SourceOptions::default() };
    let asked =
        mipvog_inputs::open_with(&fixture("refused/per_sample.tar"), &options, &Limits::default());
    assert_eq!(asked.expect("diffuse only").field.color_channels(), 3);
    let borrowed = SourceOptions {
        mlp: MlpChoice::File(fixture("tiny/fine_last.tar")),
        ..SourceOptions::default()
    };
    let borrowed =
        mipvog_inputs::open_with(&fixture("refused/diffuse.tar"), &borrowed, &Limits::default());
    assert!(borrowed.expect("a network").field.view.is_some());
    let diffuse = open("refused/diffuse.tar");
    assert_eq!((diffuse.field.color_channels(), keys(&diffuse)), (3, vec!["stepsize", "mlp"]));
    assert_eq!(common::grid_values(&diffuse.field.color[0]), expected(7 * 315, 2)[..3 * 315]);
}

#[test]
fn a_checkpoint_lists_everything() {
    let options = SourceOptions::default();
    let found =
        mipvog_inputs::inspect(&fixture("tiny/fine_last.tar"), &options, &Limits::default());
    let found = found.expect("a checkpoint");
    assert_eq!(found.optimizer_bytes, 2 * 131_072);
    assert!(found.model_bytes > 1_048_576 && found.model_bytes < found.file_bytes);
    let value = |key: &str| found.values.iter().find(|value| value.key == key).expect(key);
    let grid = value("model_state_dict.k0");
    assert_eq!((grid.dtype, grid.bytes), (Some("float32"), Some(917_504)));
    assert_eq!(grid.shape.as_deref(), Some(&[1, 7, 32, 32, 32][..]));
    assert!(grid.offset.is_some_and(|offset| offset % 64 == 0));
    assert_eq!(value("model_kwargs.alpha_init").value, Some(0.01.into()));
    assert_eq!(value("model_state_dict.viewfreq").value, Some(vec![1.0, 2.0, 4.0, 8.0].into()));
    assert_eq!(value("optimizer_state_dict.param_groups.0.lr").kind, "float");
    assert_eq!(found.scene.as_ref().and_then(|scene| scene.mlp.clone()), Some(vec![34, 16, 16, 3]));
    let refused = fixture("refused/multiplane.tar");
    let refused =
        mipvog_inputs::inspect(&refused, &options, &Limits::default()).expect("still listed");
    assert!(refused.problem.is_some_and(|problem| problem.contains("multiplane")));
    assert!(refused.values.len() > 30);
}

/// A checkpoint with the coarse stage's density as its mask, over a part of the box.
fn masked(settings: &[(&'static str, &'static str)]) -> Checkpoint {
    let mut checkpoint = Checkpoint::sound();
    let density = checkpoint.values("density.grid").clone();
    let shape = common::checkpoint::NODES.to_vec();
    checkpoint.arrays.push(("mask_cache.density", shape, density));
    checkpoint.arrays.push(("mask_cache.xyz_min", vec![3], vec![-0.9, -0.9, -0.9]));
    checkpoint.arrays.push(("mask_cache.xyz_max", vec![3], vec![0.0, 0.0, 0.0]));
    checkpoint.settings.extend(settings);
    checkpoint
}

#[test]
fn a_path_out_of_a_checkpoint_is_not_opened() {
    let folder = common::folder();
    let elsewhere = folder.path().join("elsewhere");
    std::fs::create_dir(&elsewhere).expect("writable");
    let coarse = elsewhere.join("of_training.safetensors");
    let mut stated = Checkpoint::sound();
    stated.settings.push(("alpha_init", "0.01"));
    std::fs::write(&coarse, stated.to_bytes()).expect("writable");
    let text: &'static str = Box::leak(coarse.display().to_string().into_boxed_str());
    let checkpoint = masked(&[("mask_cache_path", text), ("mask_cache_thres", "0.001")]);
    let path = folder.path().join("fine.safetensors");
    std::fs::write(&path, checkpoint.to_bytes()).expect("writable");
    let open = || {
        mipvog_inputs::open_with(&path, &SourceOptions::default(), &Limits::default())
            .expect("a scene")
    };
    let source = open();
    assert!(source.side_files.is_empty(), "{:?}", source.side_files);
    assert!(keys(&source).contains(&"coarse"), "{:?}", source.assumptions);
    // The same name beside the checkpoint is taken, as if the path were of another machine.
    let beside = folder.path().join("of_training.safetensors");
    std::fs::copy(&coarse, &beside).expect("copied");
    let source = open();
    assert_eq!(source.side_files.len(), 1, "{:?}", source.assumptions);
    assert_eq!(source.side_files[0].path, beside);
}

#[test]
fn a_mask_without_a_threshold_can_be_stored() {
    let folder = common::folder();
    let path = folder.path().join("fine.safetensors");
    let open = |checkpoint: Checkpoint| {
        std::fs::write(&path, checkpoint.to_bytes()).expect("writable");
        mipvog_inputs::open_with(&path, &SourceOptions::default(), &Limits::default())
    };
    let source = open(masked(&[("mask_cache_thres", "0")])).expect("a scene");
    match source.field.free_space.expect("a mask").lookup {
        Lookup::Trilinear { threshold, .. } => assert_eq!(threshold, f32::MIN),
        other => panic!("{other:?}"),
    }
    // Numbers that no container holds are refused before the work.
    let mut checkpoint = masked(&[("mask_cache_thres", "0")]);
    checkpoint.values("mask_cache.density")[5] = f32::NAN;
    let error = open(checkpoint).expect_err("not finite");
    assert!(error.to_string().contains("mask_cache.density"), "{error}");
}

#[test]
fn options_of_checkpoints_are_refused_for_other_models() {
    for name in ["tensorf_vm.th", "plenoxels_cubic.npz", "plenoctree.npz"] {
        let path = fixture("../grids").join(name);
        for (options, named) in [
            (SourceOptions { mlp: MlpChoice::None, ..SourceOptions::default() }, "--mlp"),
            (SourceOptions { coarse: Some(path.clone()), ..SourceOptions::default() }, "--coarse"),
        ] {
            let error = mipvog_inputs::open_with(&path, &options, &Limits::default());
            let error = error.expect_err("an option without use");
            assert!(matches!(error.kind(), ErrorKind::Usage { .. }), "{error}");
            assert!(error.to_string().contains(named), "{error}");
        }
    }
}
