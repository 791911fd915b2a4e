//! MERF folders: what their core shows by the viewer's rules, and what a bake makes of it, held
//! against float64 rules that are written from the description of the format alone.

use super::lies::{malformed, unsupported};
use super::shown::{baked, rays_see};
use std::path::Path;

use crate::common::merf::small_merf;
use crate::common::models::renderer;
use crate::common::{Random, folder};
use glam::DVec3;
use mipvog::base::error::{Error, ErrorKind};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::model::camera::Ray;
use mipvog::model::trained_model::RayColor;
use mipvog_inputs::{Family, Source, SourceOptions, open_with};

fn core_alone() -> SourceOptions {
    SourceOptions { drop_background: true, ..SourceOptions::default() }
}

fn open(path: &Path) -> Result<Source, Error> {
    open_with(path, &core_alone(), &Limits::default())
}

/// Rays from all around, and from within, towards the ball.
fn rays(count: usize) -> Vec<Ray> {
    let mut random = Random::new(5);
    let mut number = |reach: f32| f64::from(random.between(-reach, reach));
    let rays = (0..count).map(|at| {
        let out = DVec3::new(number(1.0), number(1.0), number(1.0)).normalize();
        let aim = DVec3::new(number(0.6), number(0.6), number(0.6));
        let origin = if at % 4 == 0 { 0.95 * out } else { 2.5 * out };
        Ray { origin, direction: (aim - origin).normalize() }
    });
    rays.collect()
}

#[test]
fn the_core_shows_what_its_viewer_shows() {
    let scene = small_merf();
    let rays = rays(200);
    for release in [true, false] {
        let here = folder();
        scene.write(here.path(), release);
        let source = open(here.path()).expect("a folder");
        assert_eq!((source.family, source.field.scene.nodes.0), (Family::Merf, [34; 3]));
        rays_see(&renderer(&source), &rays, |origin, direction| scene.ray(origin, direction));
    }
}

#[test]
fn positions_have_the_density_of_their_sums() {
    let (scene, here) = (small_merf(), folder());
    scene.write(here.path(), true);
    let model = renderer(&open(here.path()).expect("a folder"));
    let (mut random, mut full) = (Random::new(8), 0);
    for _ in 0..500 {
        let at = [0; 3].map(|_| f64::from(random.between(-0.99, 0.99)));
        let (found, expected) = (model.sample(at, 0).expect("inside").density, scene.density(at));
        full += usize::from(expected > 0.1);
        assert!((f64::from(found) - expected).abs() <= 1e-5 * expected, "{found} {expected}");
    }
    assert!(full > 50, "{full} occupied positions");
}

#[test]
fn a_bake_is_near_its_folder() {
    let (scene, here) = (small_merf(), folder());
    scene.write(here.path(), true);
    let source = open(here.path()).expect("a folder");
    let baked = baked(&source);
    let rays = rays(2000);
    let [own, seen] = [&renderer(&source), &baked]
        .map(|field| field.ray_colors(&rays, 0, &Silent).expect("rays"));
    let shown = |value: f32| f64::from(value.clamp(0.0, 1.0));
    let off = |(own, seen): (&RayColor, &RayColor)| -> f64 {
        let channels = own.color.into_iter().zip(seen.color);
        channels.map(|(own, seen)| (shown(own) - shown(seen)).powi(2)).sum()
    };
    // Rays that hit something: empty ones differ by what the network adds to the background.
    let met = own.iter().zip(&seen).filter(|(own, _)| own.transmittance < 0.02);
    let errors: Vec<f64> = met.map(off).collect();
    assert!(errors.len() > 200, "{} rays hit something", errors.len());
    let psnr = -10.0 * (errors.iter().sum::<f64>() / (3 * errors.len()) as f64).log10();
    eprintln!("baked against unbaked: {psnr:.2} dB");
    assert!(psnr > 30.0, "{psnr}");
}

/// Writes the folder, breaks it, and tells the error of opening it and of reading all of it.
fn broken(options: &SourceOptions, change: impl FnOnce(&Path)) -> Error {
    let (scene, here) = (small_merf(), folder());
    scene.write(here.path(), true);
    change(here.path());
    let read = open_with(here.path(), options, &Limits::default()).and_then(|source| {
        let mut plane = vec![0.0; 34 * 34];
        source.field.density.read_plane(0, 7, &mut plane, |_| {})
    });
    read.expect_err("a lie")
}

#[test]
fn lies_are_found() {
    use serde_json::json;
    let with = |key: &str, value: serde_json::Value| {
        broken(&core_alone(), |folder| {
            let mut text = small_merf().parameters(true);
            text[key] = value;
            std::fs::write(folder.join("scene_params.json"), text.to_string()).expect("writable");
        })
    };
    unsupported(with("triplane_voxel_size", json!(0.1)), "contracted space in 64 voxels");
    unsupported(with("num_submodels", json!(25)), "SMERF");
    unsupported(with("ndc", json!(true)), "normalised device coordinates");
    malformed(with("triplane_resolution", json!(-4)), "-4");
    malformed(with("sparse_grid_resolution", json!(40_000_000)), "1 to 65536");
    malformed(with("data_block_size", json!(0)), "1 to 256");
    malformed(with("data_block_size", json!(16)), "pixels");
    malformed(with("range_density", json!([3, 3])), "a lower, then a higher number");
    malformed(with("range_features", json!([1, 2, 3])), "a lower, then a higher number");
    malformed(with("atlas_width", json!(45)), "36 x 36 pixels");
    malformed(with("0_weights", json!([[1, 2], [3]])), "0_weights");
    for name in ["occupancy_grid_8.png", "plane_features_2.png", "sparse_grid_features_011.png"] {
        let missing = broken(&core_alone(), |folder| {
            std::fs::remove_file(folder.join(name)).expect("it was there");
        });
        assert!(matches!(missing.kind(), ErrorKind::Io(_)), "{missing}");
        assert!(missing.to_string().contains(name), "{missing}");
        let damaged = broken(&core_alone(), |folder| {
            let path = folder.join(name);
            let mut bytes = std::fs::read(&path).expect("a file");
            bytes[55] ^= 0x55;
            std::fs::write(path, bytes).expect("writable");
        });
        malformed(damaged, name);
    }
    let outside = broken(&core_alone(), |folder| {
        let picture = mipvog::picture::png(4, 16, &[0, 0, 3].repeat(64));
        std::fs::write(folder.join("sparse_grid_block_indices.png"), picture.expect("a PNG"))
            .expect("writable");
    });
    malformed(outside, "block [0, 0, 3]");
}

#[test]
fn nodes_of_the_core_are_held_to_the_limit() {
    let here = folder();
    small_merf().write(here.path(), true);
    for (nodes, fits) in [(33 * 33 * 33, true), (33 * 33 * 33 - 1, false)] {
        let limits = Limits { nodes, ..Limits::default() };
        let opened = open_with(here.path(), &core_alone(), &limits);
        assert_eq!(opened.is_ok(), fits);
        let error = opened.err();
        let is_limit = |error: &Error| matches!(error.kind(), ErrorKind::OverLimit { .. });
        assert!(error.as_ref().is_none_or(is_limit), "{error:?}");
    }
}
