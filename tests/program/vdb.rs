//! OpenVDB files: those that `export` writes, and fog volumes as inputs.

use crate::common;
use std::path::Path;
use std::process::Command;

use crate::common::{assert_schema, fixture, folder, program};
use mipvog::base::error::ErrorKind;
use mipvog::base::limits::{Budget, Limits};
use mipvog::base::srgb::{display, linear};
use mipvog::container::Container;
use mipvog::model::baked::Group;
use mipvog::model::field::Grid;
use mipvog::view::render::Renderer;
use mipvog_inputs::tensor::{self, Value};
use mipvog_inputs::vdb::{LEAF_VOXELS, VdbGrid, read_grid};
use mipvog_inputs::{SourceOptions, open_with};
use serde_json::Value as Json;

/// Runs a verb that must work; its report.
fn done(here: &Path, arguments: &[&str]) -> Json {
    let mut command = program();
    let output = command.current_dir(here).args(arguments).args(["--format", "json"]).output();
    let output = output.expect("starts");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {errors}");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// Cameras of small pictures: one, of few pixels.
const SMALL: [&str; 4] = ["--turntable", "1", "--size", "24"];

fn exported(here: &Path, arguments: &[&str]) -> Json {
    let report = done(here, &[&["export"], arguments, &SMALL].concat());
    assert_schema("export", &report);
    report
}

fn grid(path: &Path, name: &str) -> VdbGrid {
    let limits = Limits::default();
    let file = tensor::open(path, &limits).expect("an OpenVDB file");
    read_grid(&file, name, &limits, &mut Budget::new(&limits)).expect("a grid")
}

/// Active voxels with their values.
fn voxels(grid: &VdbGrid) -> Vec<([i32; 3], Vec<f32>)> {
    let mut voxels = Vec::new();
    for leaf in &grid.tree.leaves {
        for voxel in 0..LEAF_VOXELS {
            if leaf.active[voxel / 64] >> (voxel % 64) & 1 == 1 {
                let inside = [voxel >> 6, voxel >> 3 & 7, voxel & 7];
                let at = std::array::from_fn(|axis| leaf.origin[axis] + inside[axis] as i32);
                let values = leaf.values[voxel * grid.width..][..grid.width].to_vec();
                voxels.push((at, values));
            }
        }
    }
    voxels
}

fn renderer(path: &Path) -> Renderer {
    let container = Container::open_path(path, &Limits::default()).expect("a container");
    Renderer::of_container(&container).expect("a field")
}

#[test]
fn written_voxels_are_the_values_at_nodes() {
    let folder = folder();
    let here = folder.path();
    let path = fixture("baked/linear.mipvog");
    let name = path.display().to_string();
    let line = [&name, "--to", "vdb", "--supersample", "1", "--float32", "-o", "a.vdb"];
    let report = exported(here, &line);
    let field = renderer(&path);
    let file = here.join("a.vdb");
    let (density, color) = (grid(&file, "density"), grid(&file, "Cd"));
    let found = voxels(&density);
    assert_eq!(report["details"]["voxels"], found.len());
    assert!(found.len() > 100, "{}", found.len());
    let extent = field.view().bounds.extent();
    let place = |voxel: [i32; 3]| -> [f64; 3] {
        std::array::from_fn(|axis| {
            let cells = (field.view().nodes.0[axis] - 1) as f64;
            let min = f64::from(field.view().bounds.min[axis]);
            min + f64::from(voxel[axis]) / cells * extent[axis]
        })
    };
    for (voxel, value) in &found {
        let sample = field.sample(place(*voxel), 0).expect("inside");
        let off = (value[0] - sample.density).abs();
        assert!(off <= 1e-4 * sample.density.abs().max(1e-3), "{voxel:?}: {value:?} {sample:?}");
    }
    let colors = voxels(&color);
    let own: std::collections::HashMap<_, _> = colors.iter().cloned().collect();
    for (voxel, _) in &found {
        let sample = field.sample(place(*voxel), 0).expect("inside");
        for (light, color) in own[voxel].iter().zip(sample.color) {
            assert!((f64::from(*light) - linear(color.into())).abs() < 1e-5, "{voxel:?}");
        }
    }
    assert!(colors.len() > found.len(), "neighbours have colours too");
}

#[test]
fn axes_scales_features_and_threads() {
    let folder = folder();
    let here = folder.path();
    let tiny = fixture("baked/tiny.rate.f16.mipvog").display().to_string();
    let base = [tiny.as_str(), "--to", "vdb", "--resolution", "20"];
    let first = exported(here, &[&base[..], &["-o", "z.vdb"]].concat());
    let again =
        exported(here, &[&base[..], &["-o", "z.vdb", "--force", "--threads", "1"]].concat());
    assert_eq!(first["files"], again["files"], "the same bytes for any number of threads");
    let turned = exported(here, &[&base[..], &["-o", "y.vdb", "--up", "y"]].concat());
    assert_eq!(first["psnr"], turned["psnr"]);
    let [z, y] = ["z.vdb", "y.vdb"].map(|name| grid(&here.join(name), "density"));
    assert_eq!(z.tree, y.tree, "the map alone turns");
    assert_eq!(z.placed, y.placed.with_z_up());
    assert_eq!(y.placed.axis, [0, 2, 1]);

    let line = [&base[..], &["-o", "n.vdb", "--normalize-density", "--features"]].concat();
    let report = exported(here, &line);
    let normal = grid(&here.join("n.vdb"), "density");
    let scale = normal.number("mipvog_density_scale").expect("it is stated");
    assert_eq!(
        report["details"]["density_scale"].as_f64().map(|stated| stated as f32),
        Some(scale)
    );
    let most = voxels(&normal).iter().map(|(_, value)| value[0]).fold(0.0, f32::max);
    assert_eq!(most, 1.0);
    assert_eq!(grid(&here.join("n.vdb"), "feature_3").width, 1);
    let file = tensor::open(&here.join("n.vdb"), &Limits::default()).expect("a file");
    let Some(Value::Text(source)) = file.root.get("mipvog_source") else { panic!("no source") };
    assert_eq!(source, "tiny.rate.f16.mipvog");
}

#[test]
fn usd_names_the_file_beside_it() {
    let folder = folder();
    let here = folder.path();
    let tiny = fixture("baked/tiny.rate.f16.mipvog").display().to_string();
    let line = [&tiny, "--to", "usd", "--resolution", "16", "-o", "s.usda", "--up", "y"];
    let report = exported(here, &line);
    assert_eq!(report["files"].as_array().map(Vec::len), Some(2));
    let text = std::fs::read_to_string(here.join("s.usda")).expect("a text");
    for part in ["#usda 1.0", "upAxis = \"Y\"", "asset filePath = @./s.vdb@", "rel field:Cd"] {
        assert!(text.contains(part), "no {part} in {text}");
    }
    assert_eq!(text.matches('{').count(), text.matches('}').count());
    assert!(grid(&here.join("s.vdb"), "density").text("class") == Some("fog volume"));
}

/// The density that `tests/generate/vdb.py` gives a voxel.
fn formula([x, y, z]: [i32; 3]) -> f32 {
    let inside = (-5..15).contains(&x) && (0..12).contains(&y) && (3..12).contains(&z);
    match inside && (x + y + z).rem_euclid(3) != 0 {
        true => ((7 * x + 5 * y + 3 * z).rem_euclid(64) + 1) as f32 / 16.0,
        false if (32..40).contains(&x) && (0..8).contains(&y) && (0..8).contains(&z) => 2.5,
        false => 0.0,
    }
}

#[test]
fn files_of_openvdb_itself_are_fields() {
    for name in ["full", "half"] {
        let path = fixture("vdb").join(format!("{name}.vdb"));
        let source = open_with(&path, &SourceOptions::default(), &Limits::default());
        let field = source.expect("a fog volume").field;
        let nodes = field.scene.nodes.0;
        let (Grid::Values(density), Grid::Values(color)) = (&field.density, &field.color[0]) else {
            panic!("values at nodes");
        };
        let whole = mipvog::model::grid::NodeMask::full(field.scene.nodes);
        let mut plane = vec![0.0; nodes[1] * nodes[2]];
        let low = [-6, -1, -1];
        for x in 0..nodes[0] {
            density.read(0, x, whole.plane(x), &mut plane).expect("values");
            for (i, value) in plane.iter().enumerate() {
                let node = [x, i / nodes[2], i % nodes[2]];
                let voxel: [i32; 3] = std::array::from_fn(|axis| low[axis] + node[axis] as i32);
                assert_eq!(*value, formula(voxel), "{name}: {voxel:?}");
            }
            color.read(1, x, whole.plane(x), &mut plane).expect("values");
            for (i, value) in plane.iter().enumerate() {
                let node = [x, i / nodes[2], i % nodes[2]];
                let voxel: [i32; 3] = std::array::from_fn(|axis| low[axis] + node[axis] as i32);
                let is_matter = voxel[0] < 15 && formula(voxel) > 0.0;
                let light = if is_matter { f64::from(voxel[1].rem_euclid(4)) / 4.0 } else { 0.0 };
                assert_eq!(*value, display(light) as f32, "{name}: {voxel:?}");
            }
        }
        let bounds = field.scene.bounds;
        assert_eq!((bounds.min, bounds.max[0]), ([-0.5, -2.5, 0.375], 11.0));
    }
}

#[test]
fn fog_volumes_go_through_every_verb() {
    let folder = folder();
    let here = folder.path();
    let fog = fixture("vdb/full.vdb").display().to_string();
    let report = done(here, &["inspect", &fog]);
    assert_schema("inspect", &report);
    assert_eq!((&report["model"], &report["kind"]), (&"vdb".into(), &"vdb".into()));
    done(here, &["validate", &fog]);
    let bake = [
        "bake",
        &fog,
        "-o",
        "fog.mipvog",
        "--bits",
        "f16",
        "--alpha-threshold",
        "1e-9",
        "--levels",
        "1",
    ];
    done(here, &bake);
    done(here, &["render", &fog, "-o", "fog.png", "--size", "24"]);
    let compared =
        done(here, &[&["compare", &fog, "fog.mipvog", "--scales", "1"][..], &SMALL].concat());
    let psnr = compared["scales"][0]["psnr"].as_f64().expect("a number");
    assert!(psnr > 50.0, "{psnr}");
    exported(here, &[&fog, "--to", "vdb", "--supersample", "1", "--float32", "-o", "b.vdb"]);
    let written = voxels(&grid(&here.join("b.vdb"), "density"));
    // Node 0 is one voxel before the first active one.
    for (voxel, value) in written {
        let own = [voxel[0] - 6, voxel[1] - 1, voxel[2] - 1];
        assert!((value[0] - formula(own)).abs() < 1e-5, "{own:?}");
    }
}

#[test]
fn files_that_cannot_be_taken_are_refused_by_a_sentence() {
    let open = |path: &Path, limits: &Limits| {
        open_with(path, &SourceOptions::default(), limits).map(|_| ()).expect_err("refused")
    };
    let limits = Limits::default();
    let turned = open(&fixture("vdb/turned.vdb"), &limits);
    assert!(turned.to_string().contains("turned or sheared"), "{turned}");
    let surface = open(&fixture("vdb/surface.vdb"), &limits);
    assert!(surface.to_string().contains("a grid named density"), "{surface}");
    let little = Limits { memory: 100_000, ..Limits::default() };
    let large = open(&fixture("vdb/full.vdb"), &little);
    assert!(matches!(large.kind(), ErrorKind::OverLimit { .. }), "{large}");
    // Every prefix, some bytes apart.
    let folder = folder();
    let (path, whole) = (folder.path().join("cut.vdb"), std::fs::read(fixture("vdb/full.vdb")));
    let whole = whole.expect("a fixture");
    for end in (9..whole.len()).step_by(397) {
        std::fs::write(&path, &whole[..end]).expect("writable");
        let error = open(&path, &limits);
        let kind = error.kind();
        let is_told = matches!(kind, ErrorKind::Truncated { .. } | ErrorKind::Malformed { .. });
        assert!(is_told, "{end}: {error}");
    }
}

/// Debian's Python, if it has OpenVDB's module.
fn openvdb() -> Option<Command> {
    let mut python = Command::new("/usr/bin/python3");
    let has = Command::new("/usr/bin/python3").args(["-c", "import pyopenvdb"]).output();
    let has = has.is_ok_and(|output| output.status.success());
    if !has {
        eprintln!("note: no python3-openvdb here; its reader was not asked");
    }
    python.arg("-c");
    has.then_some(python)
}

#[test]
fn the_library_of_openvdb_reads_what_unpack_gives() {
    let folder = folder();
    let here = folder.path();
    let input = fixture("trained/lego64/fine_last.tar").display().to_string();
    done(here, &["bake", &input, "-o", "lego.mipvog"]);
    let report =
        exported(here, &["lego.mipvog", "--to", "vdb", "--supersample", "1", "-o", "lego.vdb"]);
    let bytes = report["output_bytes"].as_u64().expect("a number");
    assert!(bytes <= 600_000, "{bytes}");
    let path = here.join("lego.mipvog");
    let container = Container::open_path(&path, &Limits::default()).expect("a container");
    let raw = common::unpack(&container).expect("tensors").level(0, Group::Density);
    let field = renderer(&path);
    let (view, Some(count)) = (field.view(), report["details"]["voxels"].as_u64()) else {
        panic!("a count of voxels")
    };
    // Unpacked densities are raw. Space that the free-space mask closes is empty.
    let nodes = view.nodes.0;
    let extent = view.bounds.extent();
    let expected = raw.iter().enumerate().flat_map(|(i, raw)| {
        let node = [i / nodes[2] / nodes[1], i / nodes[2] % nodes[1], i % nodes[2]];
        let world = std::array::from_fn(|axis| {
            let share = node[axis] as f64 / (nodes[axis] - 1) as f64;
            f64::from(view.bounds.min[axis]) + share * extent[axis]
        });
        let is_free = view.free_space.as_ref().is_none_or(|mask| mask.contains(world));
        let activation = &view.activation;
        let depth = activation.density(f64::from(*raw)) * f64::from(activation.interval);
        let density = if is_free { depth / view.march.interval_length() } else { 0.0 };
        (density as f32).to_le_bytes()
    });
    std::fs::write(here.join("expected"), expected.collect::<Vec<u8>>()).expect("writable");
    let script = "
import sys
import numpy as np
import pyopenvdb as vdb
shape = tuple(map(int, sys.argv[1:4]))
grids, metadata = vdb.readAll('lego.vdb')
grids = {grid.name: grid for grid in grids}
assert set(grids) == {'density', 'Cd'}, grids
density = np.zeros(shape, np.float32)
grids['density'].copyToArray(density)
assert grids['density'].activeVoxelCount() == int(sys.argv[4])
assert grids['density'].gridClass == 'fog volume'
want = np.fromfile('expected', '<f4').reshape(shape)
active = density > 0
assert active.sum() == int(sys.argv[4]), active.sum()
half = want.astype(np.float16).astype(np.float32)
ulp = np.spacing(half.astype(np.float16)).astype(np.float32)
off = np.abs(density - half)[active]
assert (off <= ulp[active]).all(), off.max()
assert (off == 0).mean() > 0.999, (off == 0).mean()
assert want[~active].max() * 0.0217 < 4e-4, want[~active].max()
color = np.zeros(shape + (3,), np.float32)
grids['Cd'].copyToArray(color)
assert (color[active].max(axis=-1) > 0).mean() > 0.99 and color.max() <= 1
assert metadata['mipvog_source'] == 'lego.mipvog'
";
    let Some(mut python) = openvdb() else { return };
    let numbers = nodes.map(|count| count.to_string());
    let output = python.current_dir(here).arg(script).args(numbers).arg(count.to_string()).output();
    let output = output.expect("python");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let Ok(print) = Command::new("vdb_print").current_dir(here).args(["-l", "lego.vdb"]).output()
    else {
        eprintln!("note: no libopenvdb-tools here; vdb_print was not asked");
        return;
    };
    let text = String::from_utf8_lossy(&print.stdout);
    for part in ["Tree_float_5_4_3", "Tree_vec3s_5_4_3", "zip + active values", "fog volume"] {
        assert!(print.status.success() && text.contains(part), "no {part} in {text}");
    }
}
