//! Opens a file as a field, and as a model with its own rules.

use std::sync::Arc;

use super::config::{Config, ConfigFile};
use super::even::SCALE;
use super::grids::{BoxColors, BoxDensity};
use super::keys::Stored;
use super::loaded::{Places, VoxelFile, check_count};
use super::model::{ModelFile, NEAR};
use super::octree::{Cube, SIDE};
use super::plan::{BoxPlan, Plan, doublings};
use super::settings::Settings;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::lazy::Lazy;
use crate::model::field::{
    Activation, ColorDomain, FreeSpace, Grid, Lookup, March, RadianceField, Scene, Shell,
};
use crate::model::grid::Nodes;
use crate::model::harmonics::{Clamp, Evaluation, Harmonics};
use crate::model::view_dependence::ViewDependence;
use crate::options::{SourceOptions, ViewChoice};
use crate::source::{Assumption, Family, SideFile, Source};
use crate::tensor::TensorFile;

/// Step length in voxels of the field, and of one with a world around it. There, densities rise so
/// steeply towards voxels of the sky that half a voxel would show rings.
const STEPSIZE: [f32; 2] = [0.5, 0.25];
/// Added to the sum of harmonics.
const OFFSET: f32 = 0.5;
/// Cells of a free-space mask along an edge, at most: finer masks take more memory than they save.
const MASK_CELLS: usize = 512;

/// Opens a file. Densities and colours stay in it.
///
/// # Errors
/// `Malformed` for arrays that do not fit and settings out of range.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    let settings = Settings::read(file)?;
    let stored = Stored::find(file, limits)?;
    check_count(stored.voxels())?;
    let functions = stored.functions();
    let (mut assumptions, mut recorded, mut side_files) = (Vec::new(), Vec::new(), Vec::new());
    let mut config = Config::default();
    match ConfigFile::beside(file.file.path(), limits)? {
        Some(ConfigFile { path, digest, config: read }) => {
            side_files.push(SideFile { role: "args", path, digest });
            recorded = vec!["background"];
            config = read;
            if config.background.is_none() && options.background.is_none() {
                assumptions.push(mean_background());
            }
        }
        None => {
            config.background = Some(1.0);
            config.supersampling = 1.0;
            assumptions.push(no_config(options));
        }
    }
    if let Some(times) =
        settings.supersampling.or(Some(config.supersampling)).filter(|by| *by != 1.0)
    {
        assumptions.push(Assumption {
            key: "ss",
            value: "1".to_owned(),
            message: format!(
                "the model's own pictures are rendered {times} times as large and then reduced: \
                 here, rays are pixels; render's option supersample takes more"
            ),
        });
    }
    let most = functions.isqrt() - 1;
    let degree = match (settings.degree, options.view) {
        (active, ViewChoice::Keep) => active.unwrap_or(most).min(most),
        (active, ViewChoice::Harmonics(wanted)) => active.unwrap_or(most).min(most).min(wanted),
        (_, ViewChoice::None) => 0,
    };
    let (evaluation, clamp) = (Evaluation::Sample, Clamp::Zero);
    let harmonics = Harmonics { degree, evaluation, offset: OFFSET, clamp };
    let (places, cubes) = places(&stored, &settings, limits)?;
    let doublings = doublings(&settings, config.outside_level, &cubes)?;
    let extent = match options.drop_background {
        true => 1.0,
        false => options.extent.map_or(f64::INFINITY, f64::from),
    };
    let plan = Plan::new(&cubes, doublings, extent, options.resolution, limits)?;
    if plan.averaged > 0 {
        assumptions.push(averaged(&plan, cubes.len()));
    }
    let Some((first, around)) = plan.boxes.split_first() else {
        return Err(Error::malformed(Place::File, "no box", "one"));
    };
    let width = 3 * harmonics.functions();
    let voxels = Arc::new(VoxelFile {
        stored,
        settings,
        places,
        width,
        limits: limits.clone(),
        samples: config.samples,
        loaded: Lazy::default(),
        cells: [first, around.last().unwrap_or(first)].map(|plan| plan.edge),
        even: Lazy::default(),
    });
    let is_plain = options.view == ViewChoice::None;
    let density = |plan: &BoxPlan| {
        Grid::Values(Arc::new(BoxDensity { file: Arc::clone(&voxels), plan: *plan }))
    };
    let color = |plan: &BoxPlan| {
        let plain = is_plain.then_some(harmonics);
        vec![Grid::Values(Arc::new(BoxColors::new(Arc::clone(&voxels), *plan, plain)))]
    };
    let shell = |plan: &BoxPlan| Shell {
        lattice: plan.lattice(&settings),
        density: density(plan),
        color: color(plan),
    };
    let field = RadianceField {
        scene: scene(first, &settings, &config, options, !around.is_empty())?,
        density: density(first),
        color: color(first),
        color_domain: ColorDomain::Linear,
        view: (!is_plain).then_some(ViewDependence::Harmonics(harmonics)),
        free_space: Some(free_space(&cubes, first, &settings)),
        shells: around.iter().map(shell).collect(),
    };
    field.check()?;
    let model = ModelFile { file: Arc::clone(&voxels), harmonics };
    Ok(Source {
        field,
        model: Some(Arc::new(model)),
        family: Family::SvRaster,
        kind: file.kind,
        has_checksums: file.has_checksums,
        is_unbounded: doublings > 0 && !options.drop_background,
        scene_scale: 1.0,
        assumptions,
        recorded,
        digest: file.digest,
        file: Arc::clone(&file.file),
        side_files,
    })
}

/// The places of voxels, as paths and as cubes.
fn places(stored: &Stored, settings: &Settings, limits: &Limits) -> Result<(Places, Vec<Cube>)> {
    let mut budget = Budget::new(limits);
    let place = Place::Tensor("octpath".to_owned());
    match stored {
        Stored::Checkpoint(arrays) => {
            let (paths, levels) = arrays.places(&mut budget)?;
            let places = Places { paths, levels };
            budget.spend(size_of::<Cube>() as u64 * places.paths.len() as u64, "bytes", &place)?;
            let cubes = places.cubes();
            Ok((places, cubes))
        }
        Stored::Ply(rows) => {
            let found = rows.voxels(settings, &mut budget)?;
            let paths = found.cubes.iter().map(Cube::path).collect();
            Ok((Places { paths, levels: found.levels }, found.cubes))
        }
    }
}

fn scene(
    first: &BoxPlan,
    settings: &Settings,
    config: &Config,
    options: &SourceOptions,
    has_shells: bool,
) -> Result<Scene> {
    let lattice = first.lattice(settings);
    #[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
    let voxel = (settings.extent * f64::from(first.edge) / f64::from(SIDE)) as f32;
    let [alone, with_shells] = STEPSIZE;
    let stepsize = options.stepsize.unwrap_or(if has_shells { with_shells } else { alone });
    let march = March {
        near: options.near.unwrap_or(NEAR),
        far: options.far,
        color_threshold: options.color_threshold.unwrap_or(0.0),
        ..March::new(stepsize, voxel)
    };
    march.check(lattice.nodes)?;
    #[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
    let interval = (SCALE * march.interval_length()) as f32;
    let background = config.background.unwrap_or(0.0);
    Ok(Scene {
        bounds: lattice.bounds,
        nodes: lattice.nodes,
        activation: Activation::logits(0.0, interval),
        march,
        background: options.background.unwrap_or([background; 3]),
    })
}

/// The cells of the inner box that voxels fill or touch, as a mask of their middles.
fn free_space(cubes: &[Cube], plan: &BoxPlan, settings: &Settings) -> FreeSpace {
    let mut cells = plan.nodes - 1;
    let mut edge = plan.edge;
    while cells > MASK_CELLS && cells.is_multiple_of(2) {
        (cells, edge) = (cells / 2, 2 * edge);
    }
    // Masks have two nodes or more along each axis.
    while cells < 2 && edge > 1 {
        (cells, edge) = (2 * cells, edge / 2);
    }
    let mut inside = vec![false; cells * cells * cells];
    for cube in cubes {
        let ends = |low: u32| {
            let from = low.max(plan.first);
            let to = (low + cube.edge).min(plan.last());
            (from < to).then(|| {
                let cell = |at: u32| ((at - plan.first) / edge) as usize;
                cell(from)..cell(to - 1) + 1
            })
        };
        let [x, y, z] = cube.corner.map(ends);
        let (Some(x), Some(y), Some(z)) = (x, y, z) else { continue };
        for x in x {
            for y in y.clone() {
                let row = (x * cells + y) * cells;
                inside.get_mut(row + z.start..row + z.end).unwrap_or_default().fill(true);
            }
        }
    }
    let length = settings.extent * f64::from(edge) / f64::from(SIDE);
    let lowest = settings.extent * (f64::from(plan.first) / f64::from(SIDE) - 0.5);
    let shift = settings.center.map(|center| -(center + lowest) / length - 0.5);
    let scale = [1.0 / length; 3];
    FreeSpace { nodes: Nodes([cells; 3]), scale, shift, lookup: Lookup::Nearest(inside) }
}

fn mean_background() -> Assumption {
    Assumption {
        key: "background",
        value: "0".to_owned(),
        message: "the training lays each picture over its own mean color, which no ray knows: \
                  assuming black; option background sets another"
            .to_owned(),
    }
}

fn no_config(options: &SourceOptions) -> Assumption {
    let background = match options.background {
        None => " and a white background; option background sets another",
        Some(_) => "",
    };
    Assumption {
        key: "config.yaml",
        value: "defaults".to_owned(),
        message: format!(
            "the training's config.yaml is not beside the file: assuming one sample in each \
             voxel{background}"
        ),
    }
}

fn averaged(plan: &Plan, voxels: usize) -> Assumption {
    let nodes = plan.boxes.first().map_or(0, |plan| plan.nodes);
    let percent = 100.0 * plan.averaged as f64 / voxels as f64;
    Assumption {
        key: "resolution",
        value: nodes.to_string(),
        message: format!(
            "{percent:.1} % of the voxels are smaller than the cells of the box that holds them, \
             which has {nodes} nodes along an edge: they are averaged; option resolution sets more"
        ),
    }
}
