//! A model of every family, and of each layout that is read by code of its own.

use std::path::{Path, PathBuf};

use super::factored::{nerfstudio, tensorf_cp};
use super::grids::{lightning, sampled, sampled_blocks};
use super::merf::small_merf;
use super::nerfacto::nerfacto;
use super::ngp::{CELLS, small_ngp};
use super::snerg::small_snerg;
use super::voxels::Voxels;
use super::{baked_bytes, fixture, folder, with_threads};
use mipvog::bake::BakeOptions;
use mipvog::base::limits::Limits;
use mipvog_inputs::{Family, Source, SourceOptions, open_with};

/// The models, some of them written to a folder.
pub fn models(here: &Path) -> Vec<(Family, PathBuf)> {
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
        (Family::Dvgo, fixture("lego/dvgo.tar")),
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
        (Family::SvRaster, fixture("voxels/svraster_quantized.pt")),
        (Family::SvRaster, written("voxels.ply", Voxels::small().ply())),
        (Family::Nerfacto, written("nerfacto.ckpt", nerfacto(false).to_bytes())),
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

/// Opens one of them.
pub fn open(family: Family, path: &Path) -> Source {
    let options = SourceOptions {
        drop_background: family == Family::Merf,
        resolution: family.is_sampled().then_some(8),
        ..SourceOptions::default()
    };
    let source = open_with(path, &options, &Limits::default());
    source.unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Bakes every model so many times by each number of threads. Some are beyond the processors of
/// small machines: others read while one prepares.
///
/// # Panics
///
/// Bytes differ.
pub fn bytes_do_not_depend_on_threads(threads: &[usize], bakes: usize) {
    let here = folder();
    for (family, path) in models(here.path()) {
        let mut first = None;
        for &threads in threads {
            for _ in 0..bakes {
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
