//! nerfacto: what a model shows by its own rules, and the boxes that a bake takes.

use crate::common::boxes::{Boxes, psnr};
use crate::common::models::{Reference, farthest, is_typed, of_bytes, renderer};
use crate::common::nerfacto::{APPEARANCES, nerfacto, point};
use crate::common::torch::Item;
use crate::common::{fixture, folder};
use mipvog::base::error::{Error, ErrorKind};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog_inputs::{AppearanceChoice, Family, Source, SourceOptions, file_of, open_with};

const RUNS: [&str; 2] = ["nerfacto_tiny", "nerfacto_tcnn"];

fn open(name: &str, options: &SourceOptions) -> Result<Source, Error> {
    let run = fixture("worlds").join(name);
    open_with(&run, options, &Limits::default())
}

/// Colours at the reference's points are those of one of its arrays.
fn colors_agree(name: &str, source: &Source, array: &str) {
    let (model, reference) = (renderer(source), Reference::within("worlds", name));
    let directions = reference.points("color_directions");
    let (positions, colors) = (reference.points("positions"), reference.values(array));
    for (position, expected) in positions.iter().zip(colors.chunks_exact(3 * directions.len())) {
        let found = model.point_colors(*position, &directions, 0).expect("a point");
        let off = farthest(found.into_iter().flatten(), expected);
        assert!(off < 1e-5, "{name}: colours {off} off at {position:?}");
    }
}

#[test]
fn rays_and_points_follow_nerfstudios_rules() {
    for name in RUNS {
        let source = open(name, &SourceOptions::default()).expect(name);
        assert_eq!(source.family, Family::Nerfacto);
        let (model, reference) = (renderer(&source), Reference::within("worlds", name));
        let light = model.ray_colors(&reference.rays(), 0, &Silent).expect("rays");
        let rgb = farthest(light.iter().flat_map(|ray| ray.color), &reference.values("rgb"));
        let left = reference.values("transmittance");
        let left = farthest(light.iter().map(|ray| ray.transmittance), &left);
        // Directions are float32, and a long step in dense matter makes much of their rounding.
        assert!(rgb < 2e-5 && left < 1e-4, "{name}: {rgb}, {left}");
        colors_agree(name, &source, "color");
        let points = reference.points("positions").into_iter().zip(reference.values("density"));
        for (position, expected) in points {
            let found = model.sample(position, 0).expect("a point").density;
            assert!((found - expected).abs() <= 1e-6 * expected, "{name}: {found} for {expected}");
        }
    }
}

#[test]
fn colours_are_taken_with_the_appearance_that_is_asked_for() {
    let with = |appearance| SourceOptions { appearance, ..SourceOptions::default() };
    for name in RUNS {
        let zero = open(name, &with(AppearanceChoice::Zero)).expect(name);
        colors_agree(name, &zero, "color_zero_appearance");
        let mean = open(name, &with(AppearanceChoice::Mean)).expect(name);
        colors_agree(name, &mean, "color");
        let picture = |number| open(name, &with(AppearanceChoice::Picture(number)));
        let color = |source: &Source| {
            renderer(source).point_colors([0.1, 0.2, -0.4], &[[0.0, 0.0, 1.0]], 0).expect("a point")
        };
        assert_ne!(color(&picture(0).expect("the first")), color(&picture(6).expect("the last")));
        let error = picture(7).expect_err("seven pictures");
        assert!(matches!(error.kind(), ErrorKind::InvalidOption { .. }), "{error}");
    }
    let other = open_with(
        &fixture("trained/tiny/fine_last.tar"),
        &with(AppearanceChoice::Mean),
        &Limits::default(),
    );
    assert!(matches!(other.expect_err("no appearances").kind(), ErrorKind::Usage { .. }));
}

#[test]
fn the_newest_checkpoint_of_a_run_is_read() {
    let (run, here) = (fixture("worlds/nerfacto_tiny"), folder());
    let models = here.path().join("nerfstudio_models");
    std::fs::create_dir(&models).expect("a folder");
    let config = here.path().join("config.yml");
    std::fs::copy(run.join("config.yml"), &config).expect("a copy");
    let empty = open_with(here.path(), &SourceOptions::default(), &Limits::default());
    let empty = empty.expect_err("no checkpoint");
    assert!(matches!(empty.kind(), ErrorKind::Io(_)), "{empty}");
    for step in ["step-000001999.ckpt", "step-000000100.ckpt", "step-oops.ckpt", "notes.txt"] {
        std::fs::copy(file_of(&run), models.join(step)).expect("a copy");
    }
    assert_eq!(file_of(here.path()), models.join("step-000001999.ckpt"));
    let told = |path: &std::path::Path| {
        let source = open_with(path, &SourceOptions::default(), &Limits::default());
        let source = source.expect("a model");
        source.assumptions.iter().any(|assumption| assumption.key == "config.yml")
    };
    assert!(!told(here.path()) && !told(&models.join("step-000000100.ckpt")));
    // The settings of another method.
    let text = std::fs::read_to_string(&config).expect("a text");
    let text = text.replace("models.nerfacto.NerfactoModel ''", "models.tensorf.TensoRFModel ''");
    let text = text.replace("method_name: nerfacto", "method_name: mine");
    std::fs::write(&config, text).expect("writable");
    let error = open_with(here.path(), &SourceOptions::default(), &Limits::default());
    let error = error.expect_err("another method");
    assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
    assert!(error.to_string().contains("mine") && error.remedy().contains("nerfstudio"), "{error}");
    std::fs::remove_file(&config).expect("removable");
    assert!(told(&models.join("step-000001999.ckpt")));
}

#[test]
fn boxes_reach_as_far_as_they_are_told_to() {
    let with = |extent, resolution| SourceOptions {
        extent,
        resolution: Some(resolution),
        ..SourceOptions::default()
    };
    for (extent, resolution, boxes) in
        [(None, 16, 2), (None, 64, 4), (Some(8.0), 16, 3), (Some(1.0), 20, 1)]
    {
        let source = open("nerfacto_tiny", &with(extent, resolution)).expect("a scene");
        source.field.check().expect("boxes fit around each other");
        let lattices = source.field.lattices();
        assert_eq!(lattices.len(), boxes, "{extent:?}, {resolution}");
        assert_eq!(lattices[0].nodes.0, [resolution | 1; 3]);
        assert!(source.is_unbounded);
    }
    let inner = SourceOptions { drop_background: true, ..with(None, 16) };
    let source = open("nerfacto_tiny", &inner).expect("a scene");
    assert!(source.field.shells.is_empty());
    assert_eq!(
        (source.field.scene.bounds.min, source.field.scene.bounds.max),
        ([-1.0; 3], [1.0; 3])
    );
}

#[test]
fn nodes_have_the_models_densities() {
    // As fine as the model is read.
    let options =
        SourceOptions { extent: Some(2.0), resolution: Some(257), ..SourceOptions::default() };
    for name in RUNS {
        let source = open(name, &options).expect(name);
        let (model, scene) = (renderer(&source), &source.field.scene);
        let per_unit = f64::from(scene.activation.interval) / scene.march.interval_length();
        let lattice = source.field.lattices()[0];
        let [_, ny, nz] = lattice.nodes.0;
        let mut plane = vec![0.0; ny * nz];
        let (mut compared, mut dense) = (0, 0);
        for x in (0..lattice.nodes.0[0]).step_by(67) {
            source.field.density.read_plane(0, x, &mut plane, |_| {}).expect("a plane");
            for (at, raw) in plane.iter().enumerate().step_by(331) {
                let position = lattice.position([x, at / nz, at % nz]);
                let expected = f64::from(model.sample(position, 0).expect("a point").density);
                let found = scene.activation.density(f64::from(*raw)) * per_unit;
                // Networks of a bake are float32, and densities are cut off where nothing is seen.
                let expected = expected.min(60.0 / (4.0 / 256.0));
                compared += 1;
                if found < 1e-20 {
                    // Far from all that probes met.
                    assert!(expected * 4.0 / 256.0 < 1e-3, "{name}: {expected} is missing");
                    continue;
                }
                dense += 1;
                let off = (found - expected).abs();
                assert!(off <= 1e-3 * expected, "{name}: {found} for {expected}");
            }
        }
        assert!(dense > 100 && dense < compared, "{name}: {dense} of {compared}");
    }
}

#[test]
fn boxes_show_what_the_scene_shows() {
    let options = SourceOptions { resolution: Some(64), ..SourceOptions::default() };
    let source = open("nerfacto_tiny", &options).expect("a scene");
    let rays = Reference::within("worlds", "nerfacto_tiny").rays();
    let model = renderer(&source);
    let own = model.ray_colors(&rays, 0, &Silent).expect("rays");
    let own: Vec<[f64; 3]> = own.iter().map(|ray| ray.color.map(f64::from)).collect();
    let boxes = Boxes::read(&source.field, false);
    let seen = rays.iter().map(|ray| {
        let along = ray.direction.to_array();
        let color = |at| model.point_colors(at, &[along], 0).expect("a point")[0].map(f64::from);
        boxes.follow_colors(ray, color).0
    });
    let [all, most] = psnr(&seen.collect::<Vec<_>>(), &own);
    eprintln!("boxes against the scene's own rules: {all:.1} dB, {most:.1} without the worst");
    assert!(all > 20.0, "{all}");
}

#[test]
fn packets_agree_with_the_plain_model() {
    let directions = [[0.0, 0.0, 1.0], [0.6, -0.8, 0.0], [-0.48, 0.6, 0.64]];
    let options =
        SourceOptions { extent: Some(4.0), resolution: Some(33), ..SourceOptions::default() };
    for by_tcnn in [false, true] {
        let file = nerfacto(by_tcnn);
        let source = of_bytes(file.to_bytes(), &options).expect("a model");
        let model = renderer(&source);
        for position in [[0.1, -0.2, 0.3], [-0.99, 0.5, 0.0], [3.0, 1.0, -2.0], [90.0, 7.0, 40.0]] {
            let (density, colors) = point(&file, by_tcnn, position, &directions);
            let found = f64::from(model.sample(position, 0).expect("a point").density);
            assert!((found / density - 1.0).abs() < 1e-6, "{by_tcnn}: {found} for {density}");
            let found = model.point_colors(position, &directions, 0).expect("a point");
            for (found, expected) in found.iter().flatten().zip(colors.iter().flatten()) {
                assert!((f64::from(*found) - expected).abs() < 1e-6, "{by_tcnn}: {position:?}");
            }
        }
        // A bake asks in float32, here for the mean of eight points of a cell.
        let shell = &source.field.shells[0];
        let lattice = shell.lattice;
        let spacing = lattice.nodes.spacing(&lattice.bounds)[0];
        let nz = lattice.nodes.0[2];
        let scene = &source.field.scene;
        let per_unit = f64::from(scene.activation.interval) / scene.march.interval_length();
        let mut plane = vec![0.0; lattice.nodes.0[1] * nz];
        shell.density.read_plane(0, 2, &mut plane, |_| {}).expect("a plane");
        let mut compared = 0;
        for (at, raw) in plane.iter().enumerate().step_by(31) {
            let middle = lattice.position([2, at / nz, at % nz]);
            let most = middle.iter().fold(0.0, |most: f64, at| most.max(at.abs()));
            let detail = 4.0 / 256.0 * most / (2.0 - 1.0 / most);
            let apart = 0.25 * (spacing * spacing - detail * detail).sqrt();
            let signs = (0..8).map(|corner| [0, 1, 2].map(|axis| f64::from(corner >> axis & 1)));
            let densities = signs.map(|signs| {
                let mut position = middle;
                for (at, sign) in position.iter_mut().zip(signs) {
                    *at += (2.0 * sign - 1.0) * apart;
                }
                point(&file, by_tcnn, position, &[]).0
            });
            let expected = densities.sum::<f64>() / 8.0;
            let found = scene.activation.density(f64::from(*raw)) * per_unit;
            if found < 1e-20 {
                assert!(expected * spacing < 1e-3, "{by_tcnn}: {expected} is missing");
                continue;
            }
            compared += 1;
            assert!((found / expected - 1.0).abs() < 1e-4, "{by_tcnn}: {found} {expected}");
        }
        assert!(compared > 10, "{by_tcnn}: {compared}");
    }
}

#[test]
fn lies_have_typed_errors() {
    let plain = SourceOptions { resolution: Some(5), ..SourceOptions::default() };
    for by_tcnn in [false, true] {
        let source = of_bytes(nerfacto(by_tcnn).to_bytes(), &plain).expect("a model");
        assert_eq!(source.family, Family::Nerfacto);
        assert!(source.assumptions.iter().any(|assumption| assumption.key == "config.yml"));
        source.model.as_ref().expect("a model").load(&Limits::default()).expect("its values");
        let keys: Vec<String> = nerfacto(by_tcnn).items.into_iter().map(|(key, _)| key).collect();
        for key in keys.iter().filter(|key| key.as_str() != "step") {
            let mut lies = vec![Item::Floats(vec![0], vec![]), Item::Floats(vec![7], vec![0.5; 7])];
            lies.extend([Item::Int(-1), Item::Int(1 << 40), Item::Text("two")]);
            if let Item::Floats(shape, values) = nerfacto(by_tcnn).item(key) {
                let mut broken = values.clone();
                *broken.last_mut().expect("a value") = f32::NAN;
                lies.push(Item::Floats(shape.clone(), broken));
            }
            for lie in lies {
                let mut file = nerfacto(by_tcnn);
                let told = format!("{key}: {lie:?}");
                *file.item(key) = lie;
                let outcome = of_bytes(file.to_bytes(), &plain).and_then(|source| {
                    let model = source.model.as_ref().expect("a model");
                    model.load(&Limits::default()).map(drop)
                });
                let error = match outcome {
                    Err(error) => error,
                    // Boxes of proposals are not needed, nor the finest of one level.
                    Ok(()) if key.ends_with("s.0.aabb") || key.ends_with("s.1.aabb") => continue,
                    Ok(()) if key.contains("proposal") && key.ends_with("max_res") => continue,
                    Ok(()) => panic!("{told} passes"),
                };
                assert!(is_typed(&error), "{told}: {error}");
            }
        }
    }
    assert_eq!(APPEARANCES, [3, 4]);
}
