//! Instant-NGP's snapshots.
//!
//! | key | meaning |
//! |---|---|
//! | `encoding`, `network`, `rgb_network`, `dir_encoding` | the configuration of the training |
//! | `snapshot.params_binary`, `params_type`, `n_params` | matrices of both networks, then the table |
//! | `snapshot.density_grid_binary`, `density_grid_size` | float16, Morton order, cubes of growing size |
//! | `snapshot.nerf.aabb_scale`, `snapshot.nerf.dataset` | the size of the scene, and its place in the world |
//! | `snapshot.render_aabb`, `snapshot.render_aabb_to_local` | the part of the cube that is shown, and its rotation |

use super::file::{Growth, NgpFile, Rules, check_network};
use super::frame::Frame;
use super::keys::Keys;
use super::occupancy::{Crop, Occupancy};
use super::ratio::ratio;
use crate::base::error::{Error, NEWER, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::lazy::Lazy;
use crate::model::grid::Element;
use crate::model::harmonics::FUNCTIONS;
use crate::model::ray_march::GrowingSteps;
use crate::options::SourceOptions;
use crate::packets::{Levels, Matrix, Sizes, Values};
use crate::tensor::{TensorFile, Value};

/// Nodes along an axis of the finest level, for each unit cube.
const FINEST: f64 = 2048.0;
/// Widths of layers are multiples of this.
const MULTIPLE: usize = 16;
/// Outputs of the density network.
const GEOMETRY: usize = 16;
/// Neurons and layers of a network, at most.
const MOST_NEURONS: i64 = 256;
const MOST_LAYERS: i64 = 16;
/// Cells along an edge, at most.
const MOST_CELLS: i64 = 256;
/// Densities above this, or above the mean, are occupied.
const OCCUPIED: f64 = 0.01;
/// Steps grow by this share of the distance in scenes of several unit cubes, up to this many of the
/// least ones.
const GROWTH: f64 = 1.0 / 256.0;
const LONGEST: f64 = 1024.0;
/// The supported version. Earlier snapshots, of July 2022, state none: their cells are float32.
const VERSION: i64 = 1;
/// The rendered box in the unit cube's axes, and its rotation.
const CROP: &str = "snapshot.render_aabb";
const CROP_TURN: &str = "snapshot.render_aabb_to_local";

/// Reads everything but the parameters.
pub(super) fn read(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<NgpFile> {
    let keys = Keys(&file.root);
    refuse_others(&keys)?;
    let place = |path: &str| Place::Key(path.to_owned());
    check_version(&keys)?;
    let aabb = match keys.find("snapshot.nerf.aabb_scale") {
        Some(_) => keys.integer("snapshot.nerf.aabb_scale", None, 128)?,
        None => keys.integer("snapshot.nerf.dataset.aabb_scale", Some(1), 128)?,
    };
    let reach = aabb.max(1) as f64;
    let span = if options.drop_background { 1.0 } else { reach };
    let sizes = Sizes {
        levels: unsigned(keys.integer("encoding.n_levels", Some(16), i64::MAX)?),
        features: unsigned(keys.integer("encoding.n_features_per_level", Some(2), i64::MAX)?),
        log2_entries: unsigned(keys.integer("encoding.log2_hashmap_size", Some(19), i64::MAX)?),
        base: unsigned(keys.integer("encoding.base_resolution", Some(16), i64::MAX)?),
        more: 0,
    };
    sizes.check(&place("encoding"))?;
    let stated = match keys.find("encoding.per_level_scale") {
        #[expect(clippy::cast_possible_truncation, reason = "trained in float32")]
        Some(value) => Some(value.number("encoding.per_level_scale")? as f32),
        None => None,
    };
    let width = usize::try_from(sizes.levels * sizes.features).unwrap_or(0);
    // A network behind a table takes zeros as padding.
    let width = width.next_multiple_of(MULTIPLE);
    let density = shapes(&keys, "network", width, GEOMETRY)?;
    let color = shapes(&keys, "rgb_network", GEOMETRY + FUNCTIONS, MULTIPLE)?;
    let own =
        |shapes: &[[usize; 2]]| shapes.iter().map(|[rows, columns]| (rows * columns) as u64).sum();
    let networks: [u64; 2] = [own(&density), own(&color)];
    let count = unsigned(keys.integer("snapshot.n_params", None, i64::MAX)?);
    let levels = levels(&sizes, stated, FINEST * reach, networks.iter().sum(), count)?;
    let tensor = keys.tensor("snapshot.params_binary")?;
    keys.text("snapshot.params_type", &["__half", "half", "float"])?;
    let half = !matches!(keys.find("snapshot.params_type"), Some(Value::Text(t)) if t == "float");
    let element = if half { Element::F16 } else { Element::F32 };
    let bytes = count.saturating_mul(element.size() as u64);
    if tensor.element() != Element::U8 || tensor.count() != bytes {
        let found = format!("{} bytes for {count} parameters", tensor.bytes());
        return Err(Error::malformed(tensor.place(), found, format!("{bytes} bytes")));
    }
    let mut first = 0;
    let mut values = |count: u64| {
        let values = Values { tensor: tensor.clone(), element, first, count };
        first += count;
        values
    };
    let mut matrices = |shapes: &[[usize; 2]]| -> Vec<Matrix> {
        let matrix = |&[outputs, inputs]: &[usize; 2]| Matrix {
            values: values((outputs * inputs) as u64),
            outputs,
            inputs,
        };
        shapes.iter().map(matrix).collect()
    };
    let (density, color) = (matrices(&density), matrices(&color));
    check_network(&density, width, GEOMETRY, &place("network"))?;
    check_network(&color, GEOMETRY + FUNCTIONS, 3, &place("rgb_network"))?;
    let table = values(levels.entries() * sizes.features);
    let step = libm::sqrt(3.0) / 1024.0;
    let growth = match span > 1.0 {
        true => Growth::Ratio(GrowingSteps::new(step, step * LONGEST, GROWTH)),
        false => Growth::None,
    };
    let cubes = [cascades(aabb), if span > 1.0 { cascades(aabb) } else { 1 }];
    Ok(NgpFile {
        levels,
        table,
        density,
        color,
        direction_first: false,
        reach,
        span,
        per_edge: 1.0,
        frame: frame(&keys)?,
        occupancy: occupancy(&keys, cubes, crop(&keys, span)?, limits)?,
        rules: Rules { step, growth, min_transmittance: 0.01, divides: true },
        limits: limits.clone(),
        loaded: Lazy::default(),
    })
}

/// Refuses snapshots of other versions, and older ones, which state none.
fn check_version(keys: &Keys<'_>) -> Result<()> {
    let place = Place::Key("snapshot.version".to_owned());
    let found = match keys.find("snapshot.version") {
        None => "no version, as before July 2022".to_owned(),
        Some(_) => match keys.integer("snapshot.version", None, i64::MAX)? {
            VERSION => return Ok(()),
            newer @ 2.. => {
                let found = format!("version {newer}");
                let error = Error::unsupported(place, found, VERSION.to_string());
                return Err(error.advise(NEWER));
            }
            older => format!("version {older}"),
        },
    };
    let error = Error::unsupported(place, found, VERSION.to_string());
    Err(error
        .advise("train the scene again with an Instant-NGP since July 2022, and save it there"))
}

/// Cubes of cells, each twice as large as the one before, up to that of the whole scene.
fn cascades(aabb: i64) -> u32 {
    (0..7u32).find(|&number| 1i64 << number >= aabb).map_or(8, |larger| larger + 1)
}

/// The rendered part of a scene, unless it is the whole cube of `span` unit cubes along an edge.
fn crop(keys: &Keys<'_>, span: f64) -> Result<Crop> {
    let corner = |name: &str| -> Result<Option<[f64; 3]>> {
        let path = format!("{CROP}.{name}");
        keys.find(&path).map(|value| value.vector3(&path)).transpose()
    };
    let (Some(min), Some(max)) = (corner("min")?, corner("max")?) else { return Ok(Crop::None) };
    let axes = || min.into_iter().zip(max);
    let [low, high] = [0.5 - 0.5 * span, 0.5 + 0.5 * span];
    if axes().all(|(min, max)| min <= low && max >= high) {
        return Ok(Crop::None);
    }
    if is_turned(keys)? {
        return Ok(Crop::LeftOut);
    }
    let mut within = [[low, high]; 3];
    within
        .iter_mut()
        .zip(axes())
        .for_each(|(own, (min, max))| *own = [min.max(low), max.min(high)]);
    if !within.iter().all(|[low, high]| low < high) {
        let place = Place::Key(CROP.to_owned());
        let found = format!("a box from {min:?} to {max:?}");
        return Err(Error::malformed(place, found, "a part of the scene"));
    }
    Ok(Crop::Box(within))
}

/// True if the rendered box is rotated.
fn is_turned(keys: &Keys<'_>) -> Result<bool> {
    const UNIT: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let Some(value) = keys.find(CROP_TURN) else { return Ok(false) };
    let numbers = value.numbers(CROP_TURN)?;
    // 3 x 3 numbers, of older versions 3 x 4.
    let rotation: Vec<f64> = match numbers.len() {
        12 => numbers.chunks_exact(4).flat_map(|row| row.iter().take(3)).copied().collect(),
        _ => numbers,
    };
    let is_unit = rotation.len() == UNIT.len()
        && rotation.iter().zip(UNIT).all(|(found, unit)| (found - unit).abs() < 1e-6);
    Ok(!is_unit)
}

fn unsigned(value: i64) -> u64 {
    value.max(0).cast_unsigned()
}

/// Refuses models that are not a radiance field of a hash grid.
fn refuse_others(keys: &Keys<'_>) -> Result<()> {
    keys.text("snapshot.mode", &["nerf"])?;
    keys.text("encoding.otype", &["HashGrid", "Grid"])?;
    keys.text("encoding.type", &["Hash"])?;
    keys.text("encoding.interpolation", &["Linear"])?;
    for network in ["network", "rgb_network"] {
        keys.text(&format!("{network}.otype"), &["FullyFusedMLP", "CutlassMLP"])?;
        keys.text(&format!("{network}.activation"), &["ReLU"])?;
        keys.text(&format!("{network}.output_activation"), &["None"])?;
    }
    let directions = match keys.find("dir_encoding.nested") {
        Some(Value::List(nested)) => nested.first().map(Keys),
        _ => keys.find("dir_encoding").map(Keys),
    };
    if let Some(directions) = directions {
        directions.text("otype", &["SphericalHarmonics"])?;
        let degree = directions.integer("degree", Some(4), i64::MAX)?;
        if degree != 4 {
            let place = Place::Key("dir_encoding.degree".to_owned());
            return Err(Error::unsupported(place, degree.to_string(), "4"));
        }
    }
    for (path, found) in [
        ("snapshot.nerf.dataset.from_mitsuba", "a scene of Mitsuba, with other axes"),
        ("snapshot.nerf.dataset.is_hdr", "colours without an upper bound"),
        ("snapshot.nerf.dataset.n_extra_learnable_dims", "colours that depend on the picture"),
    ] {
        let is_set = match keys.find(path) {
            Some(Value::Bool(set)) => *set,
            Some(value) => value.number(path)? != 0.0,
            None => false,
        };
        if is_set {
            let place = Place::Key(path.to_owned());
            return Err(Error::unsupported(place, found, "none"));
        }
    }
    Ok(())
}

/// Outputs and inputs of a network's matrices.
fn shapes(keys: &Keys<'_>, name: &str, inputs: usize, outputs: usize) -> Result<Vec<[usize; 2]>> {
    let count = |key: &str, default: i64, most: i64| -> Result<usize> {
        let path = format!("{name}.{key}");
        let found = keys.integer(&path, Some(default), most)?;
        let refuse = || Error::malformed(Place::Key(path.clone()), "0", format!("1 to {most}"));
        usize::try_from(found).ok().filter(|&found| found > 0).ok_or_else(refuse)
    };
    let hidden = keys.integer(&format!("{name}.n_hidden_layers"), Some(1), MOST_LAYERS)?;
    let hidden = usize::try_from(hidden).unwrap_or(0);
    if hidden == 0 {
        // One matrix, without a relu before it or behind it.
        return Ok(vec![[outputs, inputs]]);
    }
    let neurons = count("n_neurons", 64, MOST_NEURONS)?;
    let mut shapes = vec![[neurons, inputs]];
    shapes.resize(hidden, [neurons, neurons]);
    shapes.push([outputs, neurons]);
    Ok(shapes)
}

/// The levels for which tables and networks have `count` parameters. The ratio of levels is not in
/// the file, and adjacent floats give different sizes.
fn levels(
    sizes: &Sizes,
    stated: Option<f32>,
    finest: f64,
    networks: u64,
    count: u64,
) -> Result<Levels> {
    let place = Place::Key("snapshot.n_params".to_owned());
    let ratio = stated.unwrap_or_else(|| ratio(sizes.levels, sizes.base, finest));
    let mut expected = Vec::new();
    for ratio in [ratio, ratio.next_up(), ratio.next_down()] {
        let place = Place::Key("encoding".to_owned());
        #[expect(clippy::cast_possible_truncation, reason = "float32")]
        let log2_ratio = libm::log2(f64::from(ratio)) as f32;
        let levels = sizes.levels(log2_ratio, &place)?;
        let parameters = networks + levels.entries() * sizes.features;
        if parameters == count {
            return Ok(levels);
        }
        expected.push(parameters.to_string());
    }
    let expected =
        format!("{} for this configuration", expected.first().map_or("", String::as_str));
    Err(Error::malformed(place, count.to_string(), expected))
}

/// The place of the unit cube in the world.
fn frame(keys: &Keys<'_>) -> Result<Frame> {
    const SCALE: &str = "snapshot.nerf.dataset.scale";
    const OFFSET: &str = "snapshot.nerf.dataset.offset";
    let scale = keys.number(SCALE, 0.33)?;
    if !(scale > 0.0 && scale.is_finite()) {
        let place = Place::Key(SCALE.to_owned());
        return Err(Error::malformed(place, scale.to_string(), "a number above 0"));
    }
    let offset = keys.find(OFFSET).map_or(Ok([0.5; 3]), |value| value.vector3(OFFSET))?;
    if offset.iter().any(|value| !value.is_finite()) {
        let place = Place::Key(OFFSET.to_owned());
        return Err(Error::malformed(place, format!("{offset:?}"), "finite numbers"));
    }
    Ok(Frame { scale, offset })
}

/// The cells whose density is above a threshold, in the first of the stored cubes.
fn occupancy(
    keys: &Keys<'_>,
    [stored, used]: [u32; 2],
    crop: Crop,
    limits: &Limits,
) -> Result<Occupancy> {
    let size = keys.integer("snapshot.density_grid_size", Some(128), MOST_CELLS)?;
    let side = usize::try_from(size).unwrap_or(0);
    if !side.is_power_of_two() {
        let place = Place::Key("snapshot.density_grid_size".to_owned());
        return Err(Error::unsupported(place, size.to_string(), "a power of 2"));
    }
    let tensor = keys.tensor("snapshot.density_grid_binary")?;
    let cells = side.pow(3);
    let bytes = 2 * cells as u64 * u64::from(stored);
    if tensor.element() != Element::U8 || tensor.count() != bytes {
        let found = format!("{} bytes", tensor.bytes());
        let expected = format!("{bytes}, two for each of {cells} cells of each of {stored} cubes");
        return Err(Error::malformed(tensor.place(), found, expected));
    }
    let mut budget = Budget::new(limits);
    let storage = tensor.storage(&mut budget)?;
    let mut bytes: Vec<u8> = budget.zeroed(2 * cells, "bytes of cells", &tensor.place())?;
    let mut densities: Vec<f32> = budget.zeroed(cells, "bytes of cells", &tensor.place())?;
    let (mut cubes, mut least) = (Vec::new(), None);
    for number in 0..u64::from(used) {
        budget.spend(cells as u64, "bytes of cells", &tensor.place())?;
        storage.read_into(number * 2 * cells as u64, &mut bytes)?;
        Element::F16.decode(&bytes, &mut densities);
        // The mean of the unit cube.
        let least = *least.get_or_insert_with(|| {
            let sum: f64 = densities.iter().map(|density| f64::from(density.max(0.0))).sum();
            OCCUPIED.min(sum / cells as f64)
        });
        cubes.push(densities.iter().map(|density| f64::from(*density) > least).collect());
    }
    let span = libm::exp2(cubes.len().saturating_sub(1) as f64);
    Ok(Occupancy::new(side, span, cubes).cropped(crop))
}
