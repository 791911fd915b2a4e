//! SNeRG folders: what they show by the viewer's rules, and what a bake makes of them, held against
//! float64 rules that are written from the description of the format alone.

use super::lies::{malformed, unsupported};
use super::shown::{baked, rays_see};
use std::path::Path;

use crate::common::models::renderer;
use crate::common::snerg::{SmallSnerg, small_snerg};
use crate::common::{Random, folder};
use glam::DVec3;
use mipvog::base::error::{Error, ErrorKind};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::model::camera::Ray;
use mipvog::model::trained_model::RayColor;
use mipvog::picture;
use mipvog::view::render::Renderer;
use mipvog_inputs::{Family, Source, SourceOptions, ViewChoice};
use mipvog_inputs::{inspect, open_with};

fn open(path: &Path) -> Result<Source, Error> {
    open_with(path, &SourceOptions::default(), &Limits::default())
}

/// Rays from all around towards the scene.
fn rays(scene: &SmallSnerg, count: usize) -> Vec<Ray> {
    let mut random = Random::new(5);
    let mut number = |reach: f32| f64::from(random.between(-reach, reach));
    let middle = scene.middle([4, 5, 3]);
    let rays = (0..count).map(|_| {
        let out = DVec3::new(number(1.0), number(1.0), number(1.0)).normalize();
        let aim = DVec3::from_array(middle) + DVec3::new(number(0.4), number(0.4), number(0.4));
        let origin = DVec3::from_array(middle) + 2.5 * out;
        Ray { origin, direction: (aim - origin).normalize() }
    });
    rays.collect()
}

#[test]
fn a_folder_shows_what_its_viewer_shows() {
    let (scene, here) = (small_snerg(), folder());
    scene.write(here.path());
    let rays = rays(&scene, 400);
    for path in [here.path().to_owned(), here.path().join("scene_params.json")] {
        let source = open(&path).expect("a folder");
        assert_eq!(source.family, Family::Snerg);
        rays_see(&renderer(&source), &rays, |origin, direction| scene.ray(origin, direction));
    }
}

#[test]
fn nodes_of_the_field_are_voxels() {
    let (scene, here) = (small_snerg(), folder());
    scene.write(here.path());
    let source = open(here.path()).expect("a folder");
    assert_eq!(source.field.scene.nodes.0, [15, 10, 12]);
    let nodes = Renderer::of_field(&source.field).expect("nodes");
    let model = renderer(&source);
    let mut seen = 0;
    for (at, texel) in scene.texels.iter().enumerate() {
        let [x, y, _] = scene.grid;
        let middle = scene.middle([at % x, at / x % y, at / x / y]);
        let found = nodes.sample(middle, 0).expect("inside");
        let alpha = f64::from(texel[3]) / 255.0;
        assert!((f64::from(found.opacity) - alpha).abs() < 2e-3, "{} {alpha}", found.opacity);
        let density = f64::from(model.sample(middle, 0).expect("inside").density);
        assert!((density * scene.voxel_size + (1.0 - alpha).ln()).abs() < 1e-5);
        if texel[3] < 64 {
            continue;
        }
        seen += 1;
        let values = found.color.iter().chain(&found.features);
        let stored = [0, 1, 2, 4, 5, 6, 7].map(|i| f64::from(texel[i]) / f64::from(texel[3]));
        for (found, stored) in values.zip(stored) {
            assert!((f64::from(*found) - stored).abs() < 2e-3, "{found} {stored}");
        }
    }
    assert!(seen > 50);
}

#[test]
fn a_bake_is_near_its_folder() {
    let (scene, here) = (small_snerg(), folder());
    scene.write(here.path());
    let source = open(here.path()).expect("a folder");
    let baked = baked(&source);
    let rays = rays(&scene, 2000);
    let [own, seen] = [&renderer(&source), &baked]
        .map(|field| field.ray_colors(&rays, 0, &Silent).expect("rays"));
    let shown = |value: f32| f64::from(value.clamp(0.0, 1.0));
    let off = |(own, seen): (&RayColor, &RayColor)| -> f64 {
        let channels = own.color.into_iter().zip(seen.color);
        channels.map(|(own, seen)| (shown(own) - shown(seen)).powi(2)).sum()
    };
    let error = own.iter().zip(&seen).map(off).sum::<f64>() / (3 * rays.len()) as f64;
    let psnr = -10.0 * error.log10();
    eprintln!("baked against unbaked: {psnr:.2} dB");
    assert!(psnr > 38.0, "{psnr}");
}

#[test]
fn a_folder_without_a_network_is_diffuse() {
    let (mut scene, here) = (small_snerg(), folder());
    scene.layers.clear();
    scene.write(here.path());
    std::fs::remove_file(here.path().join("feature_000.png")).expect("it was there");
    let source = open(here.path()).expect("a folder");
    assert!(source.field.view.is_none() && source.field.color_channels() == 3);
    renderer(&source);
    small_snerg().write(here.path());
    let options = SourceOptions { view: ViewChoice::None, ..SourceOptions::default() };
    let source = open_with(here.path(), &options, &Limits::default()).expect("a folder");
    assert!(source.field.view.is_none());
    let options = SourceOptions { view: ViewChoice::Harmonics(2), ..SourceOptions::default() };
    let error = open_with(here.path(), &options, &Limits::default()).expect_err("no harmonics");
    assert!(matches!(error.kind(), ErrorKind::Usage { .. }), "{error}");
}

/// Writes the folder, breaks it, and tells the error of opening it and of reading all of it.
fn broken(change: impl FnOnce(&Path)) -> Error {
    let (scene, here) = (small_snerg(), folder());
    scene.write(here.path());
    change(here.path());
    let read = open(here.path()).and_then(|source| {
        source.renderer(None, &Limits::default())?;
        let mut plane = vec![0.0; 120];
        source.field.density.read_plane(0, 7, &mut plane, |_| {})
    });
    read.expect_err("a lie")
}

fn with(key: &str, value: serde_json::Value) -> Error {
    broken(|folder| {
        let mut parameters = small_snerg().parameters();
        parameters[key] = value;
        std::fs::write(folder.join("scene_params.json"), parameters.to_string()).expect("writable");
    })
}

#[test]
fn lies_are_found() {
    use serde_json::json;
    malformed(with("num_slices", json!(5)), "5 slices");
    malformed(with("atlas_depth", json!(20)), "4 slices");
    malformed(with("atlas_width", json!(32)), "24 x 64 pixels");
    malformed(with("grid_width", json!(19)), "pixels");
    malformed(with("grid_width", json!(-3)), "-3");
    malformed(with("voxel_size", json!(0)), "voxel_size");
    malformed(with("voxel_size", json!("small")), "small");
    malformed(with("0_weights", json!([[1, 2], [3]])), "0_weights");
    malformed(with("0_bias", json!([1, 2, 3])), "layers");
    malformed(with("2_weights", json!(vec![[1e300; 3]; 16])), "finite");
    unsupported(with("ndc", json!(true)), "normalised device coordinates");
    unsupported(with("block_size", json!(7)), "7");
    unsupported(with("format", json!("jpg")), "jpg");
    let turned = json!([[0.5, 0.5, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]);
    unsupported(with("worldspace_T_opengl", turned), "worldspace_T_opengl");
    let error = with("grid_depth", json!(1u64 << 40));
    malformed(error, "1 to 65536");
    let nan = broken(|folder| {
        let text = small_snerg().parameters().to_string().replacen("[[", "[[NaN,", 1);
        std::fs::write(folder.join("scene_params.json"), text).expect("writable");
    });
    malformed(nan, "worldspace_T_opengl");
    let missing = broken(|folder| {
        std::fs::remove_file(folder.join("feature_002.png")).expect("it was there");
    });
    assert!(matches!(missing.kind(), ErrorKind::Io(_)), "{missing}");
    assert!(missing.to_string().contains("feature_002.png"), "{missing}");
    let cut = |length: u64| {
        broken(|folder| {
            let path = folder.join("rgba_001.png");
            let file = std::fs::File::options().write(true).open(path).expect("a file");
            file.set_len(file.metadata().expect("a file").len() - length).expect("shorter");
        })
    };
    for length in [1, 12, 40] {
        let error = cut(length);
        assert!(matches!(error.kind(), ErrorKind::Truncated { .. }), "{error}");
    }
    let pixels = |folder: &Path, bytes: &[u8]| {
        let [x, y] = [3, bytes.len() / 9];
        let picture = picture::png(x, y, bytes).expect("a PNG");
        std::fs::write(folder.join("atlas_indices.png"), picture).expect("writable");
    };
    // 3 x 2 x 2 blocks.
    malformed(broken(|folder| pixels(folder, &[0, 0, 2].repeat(12))), "block [0, 0, 2]");
    malformed(broken(|folder| pixels(folder, &[254, 0, 0].repeat(12))), "block [254, 0, 0]");
    malformed(broken(|folder| pixels(folder, &[0, 0, 0].repeat(9))), "3 x 3 pixels");
    let damaged = broken(|folder| {
        let path = folder.join("rgba_000.png");
        let mut bytes = std::fs::read(&path).expect("a file");
        bytes[60] ^= 0x55;
        std::fs::write(path, bytes).expect("writable");
    });
    malformed(damaged, "rgba_000.png");
}

#[test]
fn inspection_lists_a_folder() {
    let (scene, here) = (small_snerg(), folder());
    scene.write(here.path());
    let found = inspect(here.path(), &SourceOptions::default(), &Limits::default());
    let found = found.expect("listed");
    assert_eq!(found.model, Some(Family::Snerg));
    let content = found.scene.expect("a scene");
    assert_eq!((content.dimensions, content.mlp), ([15, 10, 12], Some(vec![34, 16, 16, 3])));
}
