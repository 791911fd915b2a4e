//! Models that the systems' own programs trained on pictures of "lego", held against rays that these
//! programs rendered.

use crate::common::fixture;
use crate::common::models::{Reference, renderer};
use mipvog::bake::{BakeOptions, Baker};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::container::Container;
use mipvog::view::render::Renderer;
use mipvog_inputs::{Family, Source, SourceOptions, open_with};

/// Colours are so near to those of the program.
const NEAR: f32 = 2e-4;
/// The share of rays that must be near where samples are left out by thresholds: float32 puts a few
/// on the other side.
const MOST: f64 = 0.995;

fn open(file: &str, options: &SourceOptions) -> Source {
    let source = open_with(&fixture("lego").join(file), options, &Limits::default());
    source.unwrap_or_else(|error| panic!("{file}: {error}"))
}

/// The share of rays near to an array of the file's reference, and the largest difference.
fn share(file: &str, options: &SourceOptions, array: &str) -> (f64, f32) {
    let reference = Reference::within("lego", file.split('.').next().expect("a name"));
    let source = open(file, options);
    let light = renderer(&source).ray_colors(&reference.rays(), 0, &Silent).expect("rays");
    let expected = reference.values(array);
    let off = light.iter().zip(expected.as_chunks::<3>().0).map(|(ray, expected)| {
        let differences = ray.color.iter().zip(expected).map(|(a, b)| (a - b).abs());
        differences.fold(0.0, f32::max)
    });
    let off: Vec<f32> = off.collect();
    let near = off.iter().filter(|off| **off <= NEAR).count() as f64 / off.len() as f64;
    let farthest = off.into_iter().fold(0.0, f32::max);
    println!("{file}, {array}: {near} near, farthest {farthest:e}");
    (near, farthest)
}

/// Rays over white, or over black.
fn agrees(file: &str, family: Family, options: &SourceOptions, arrays: &[&str], least: f64) {
    assert_eq!(open(file, options).family, family, "{file}");
    for array in arrays {
        let background = (*array == "black").then_some([0.0; 3]);
        let options = SourceOptions { background, ..options.clone() };
        let (near, farthest) = share(file, &options, array);
        assert!(near >= least, "{file}, {array}: {near} near, farthest {farthest:e}");
    }
}

#[test]
fn models_of_real_trainings_show_what_their_programs_show() {
    let plain = SourceOptions::default();
    let near = SourceOptions { near: Some(2.0), ..plain.clone() };
    let scaled = |scale| SourceOptions { scene_scale: Some(scale), ..plain.clone() };
    let both = ["rgb", "black"];
    agrees("tensorf.th", Family::Tensorf, &plain, &both, MOST);
    agrees("dvgo.tar", Family::Dvgo, &near, &both, MOST);
    agrees("dvgo_unbounded.tar", Family::Dvgo, &plain, &both, MOST);
    agrees("plenoxels.npz", Family::Plenoxels, &plain, &both, 1.0);
    agrees("plenoctree.npz", Family::PlenOctree, &plain, &both, 1.0);
    // What is left of a ray takes the colour of its last sample. Proposals move samples by float32.
    agrees("nerfacto", Family::Nerfacto, &plain, &["rgb"], MOST);
    agrees("ns_tensorf", Family::Tensorf, &plain, &["rgb"], 1.0);
    agrees("torch_ngp_whole.pth", Family::TorchNgp, &plain, &both, MOST);
    agrees("torch_ngp.pth", Family::TorchNgp, &scaled(0.8), &both, MOST);
}

/// Networks that run per sample are not linear between nodes: fitted at nodes alone, rays of these
/// files are 23.1, 34.3 and 24.8 dB from the unbaked ones; between nodes 28.2, 41.2 and 29.5 dB.
#[test]
fn networks_of_real_trainings_are_fitted_between_nodes() {
    let near = SourceOptions { near: Some(2.0), ..SourceOptions::default() };
    let plain = SourceOptions::default();
    for (file, options, least) in
        [("dvgo.tar", &near, 27.5), ("tensorf.th", &plain, 40.0), ("ns_tensorf", &plain, 28.5)]
    {
        let source = open(file, options);
        let bytes = Baker::new(BakeOptions::default()).to_vec(&source).expect("a container");
        let container = Container::from_bytes(bytes, &Limits::default()).expect("it is valid");
        let baked = Renderer::of_container(&container).expect("a renderer");
        let reference = Reference::within("lego", file.split('.').next().expect("a name"));
        let colors = |renderer: &Renderer| {
            let light = renderer.ray_colors(&reference.rays(), 0, &Silent).expect("rays");
            light.into_iter().flat_map(|ray| ray.color).collect::<Vec<f32>>()
        };
        let (own, shown) = (colors(&renderer(&source)), colors(&baked));
        let squares = own.iter().zip(&shown).map(|(a, b)| f64::from(a - b).powi(2));
        let psnr = -10.0 * (squares.sum::<f64>() / own.len() as f64).log10();
        println!("{file}: {psnr:.2} dB");
        assert!(psnr >= least, "{file}: {psnr} dB");
    }
}
