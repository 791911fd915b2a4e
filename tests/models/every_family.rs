//! What holds for models of every family alike: the same bytes from any number of threads, and rays
//! from anywhere that come to an end.

use std::path::{Path, PathBuf};

use crate::common::factored::{nerfstudio, tensorf_cp};
use crate::common::grids::{lightning, sampled, sampled_blocks};
use crate::common::merf::small_merf;
use crate::common::models::renderer;
use crate::common::ngp::{CELLS, small_ngp};
use crate::common::snerg::small_snerg;
use crate::common::{baked_bytes, fixture, folder, open_bytes, with_threads};
use glam::DVec3;
use mipvog_bake::unstable::bake::BakeOptions;
use mipvog_bake::unstable::base::limits::Limits;
use mipvog_bake::unstable::base::progress::Silent;
use mipvog_bake::unstable::input::{Family, Source, SourceOptions, open_with};
use mipvog_bake::unstable::model::camera::Ray;
use mipvog_bake::unstable::view::compare::compare_directions;
use mipvog_bake::unstable::view::render::Renderer;

/// Threads beyond the processors of small machines; others read while one prepares.
const THREADS: [usize; 3] = [1, 2, 16];
/// Bakes by each number of threads.
const BAKES: usize = 20;
/// Distances from which rays come.
const DISTANCES: [f64; 5] = [0.0, 1e6, 1e12, 1e16, 1e25];

/// A model of every family, and of each layout that is read by code of its own.
fn models(here: &Path) -> Vec<(Family, PathBuf)> {
    let written = |name: &str, bytes: Vec<u8>| {
        let path = here.join(name);
        std::fs::write(&path, bytes).expect("writable");
        path
    };
    let grid = |name: &str| fixture("grids").join(name);
    small_snerg().write(&made(here, "snerg"));
    small_merf().write(&made(here, "merf"), true);
    vec![
        (Family::MipVog, fixture("trained/tiny/fine_last.tar")),
        (Family::Dvgo, fixture("trained/dvgo/flat.safetensors")),
        (Family::Dvgo, grid("dvgo_default.tar")),
        (Family::Dvgo, grid("dvgo_tensorf_grid.tar")),
        (Family::Plenoxels, grid("plenoxels_cubic.npz")),
        (Family::Plenoxels, written("lightning.npz", lightning().to_bytes())),
        (Family::PlenOctree, grid("plenoctree.npz")),
        (Family::PlenOctree, grid("plenoctree_compressed.npz")),
        (Family::Tensorf, grid("tensorf_vm.th")),
        (Family::Tensorf, grid("tensorf_vm_sh.th")),
        (Family::Tensorf, written("cp.th", tensorf_cp().to_bytes())),
        (Family::Tensorf, written("nerfstudio.ckpt", nerfstudio().to_bytes())),
        (
            Family::InstantNgp,
            written(
                "model.msgpack",
                small_ngp(2.0, false, CELLS, 3).snapshot(Some(2.0), true).bytes(),
            ),
        ),
        (Family::Snerg, here.join("snerg")),
        (Family::Merf, here.join("merf")),
        (Family::Vdb, fixture("vdb/full.vdb")),
        (Family::Sampled, written("sampled.npz", sampled().to_bytes())),
        (Family::Sampled, written("blocks.npz", sampled_blocks().to_bytes())),
    ]
}

fn made(here: &Path, name: &str) -> PathBuf {
    let path = here.join(name);
    std::fs::create_dir(&path).expect("a folder");
    path
}

fn open(family: Family, path: &Path) -> Source {
    let options = SourceOptions {
        drop_background: family == Family::Merf,
        resolution: family.is_sampled().then_some(8),
        ..SourceOptions::default()
    };
    let source = open_with(path, &options, &Limits::default());
    source.unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[test]
fn bytes_do_not_depend_on_threads_and_no_bake_waits_for_itself() {
    let here = folder();
    for (family, path) in models(here.path()) {
        let mut first = None;
        for threads in THREADS {
            for _ in 0..BAKES {
                // Opened anew, so that its values are prepared anew.
                let source = open(family, &path);
                let bytes = with_threads(threads, || {
                    baked_bytes(&source.field, &BakeOptions::default()).expect("a bake")
                });
                let first = first.get_or_insert_with(|| bytes.clone());
                assert!(*first == bytes, "{}: {threads} threads", path.display());
            }
        }
    }
}

#[test]
fn rays_from_anywhere_come_to_an_end() {
    let here = folder();
    for (family, path) in models(here.path()) {
        let model = renderer(&open(family, &path));
        let bounds = model.view().bounds;
        let middle = DVec3::from(
            [0, 1, 2].map(|axis| 0.5 * (f64::from(bounds.min[axis]) + f64::from(bounds.max[axis]))),
        );
        let ways = [
            DVec3::new(1.0, 1.0, 1.0),
            DVec3::new(1.0, 0.0, 0.0),
            DVec3::new(0.0, -1.0, 1e-9),
            DVec3::new(-0.3, 0.8, 0.5),
        ];
        let rays = DISTANCES.iter().flat_map(|&distance| {
            ways.iter().map(move |way| {
                let direction = way.normalize();
                Ray { origin: middle - distance * direction, direction }
            })
        });
        let rays: Vec<Ray> = rays.collect();
        let light = model.ray_colors(&rays, 0, &Silent).expect("rays");
        for (ray, light) in rays.iter().zip(light) {
            assert!(
                light.color.iter().all(|value| value.is_finite())
                    && (0.0..=1.0).contains(&light.transmittance),
                "{}: {light:?} along {ray:?}",
                path.display()
            );
        }
    }
}

#[test]
fn an_eye_in_the_middle_of_the_box_looks_nowhere_and_ends() {
    let here = folder();
    for (family, path) in models(here.path()) {
        let source = open(family, &path);
        let bounds = source.field.scene.bounds;
        let middle =
            [0, 1, 2].map(|axis| 0.5 * (f64::from(bounds.min[axis]) + f64::from(bounds.max[axis])));
        let bytes = baked_bytes(&source.field, &BakeOptions::default()).expect("a bake");
        let baked = open_bytes(&bytes).expect("a container");
        let baked = Renderer::of_container(&baked).expect("a field");
        // The first ray aims at the very middle.
        let errors = compare_directions(&renderer(&source), &baked, &[middle], &Silent);
        let psnr = errors.expect("errors").psnr;
        assert!(psnr.is_none_or(|psnr| !psnr.is_nan()), "{}: {psnr:?}", path.display());
    }
}
