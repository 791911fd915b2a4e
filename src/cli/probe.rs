//! `probe`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use glam::DVec3;
use serde::Serialize;

use super::common::Common;
use super::field::FieldArguments;
use super::folders::input_path;
use super::outcome::{Outcome, counted, readable};
use super::output::{STANDARD_STREAM, create as create_output, digest};
use super::progress::Bar;
use super::scene::SceneArguments;
use super::stdin;
use crate::base::bytes::ByteSink;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, Budget, Limits};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::model::camera::Ray;
use crate::view::render::Renderer;
use mipvog_inputs::tensor::{self, Row, TensorFile, Value, safetensors_header};

/// Tolerance of the length of a unit direction.
const UNIT_TOLERANCE: f64 = 1e-3;
/// Points per thread and batch.
const CHUNK: usize = 64;

/// Compute colours of rays and values at points
///
/// The input file has float32 arrays `origins` and `directions`, n x 3; directions have unit length
/// and point into the scene. With --positions it also has `positions`, m x 3, and
/// `view_directions`, d x 3. The output has `rgb`, n x 3, over the background and not clamped, and
/// `transmittance` and `depth` of each ray; with --positions also `density` of each position, in
/// optical depth per world unit, and `color`, m x d x 3.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mipvog-bake probe scene.mipvog --rays rays.safetensors -o colors.safetensors
  mipvog-bake probe fine_last.tar --rays rays.safetensors --positions -o values.safetensors")]
pub struct Arguments {
    /// A container, a glTF asset with one, or anything that can be baked; - means standard input
    #[arg(value_parser = input_path())]
    field: PathBuf,
    /// The file of rays, .safetensors or .npz
    #[arg(long, value_name = "FILE")]
    rays: PathBuf,
    /// The .safetensors file to write; - means standard output
    #[arg(short, long, value_name = "OUT.safetensors")]
    output: PathBuf,
    /// Also compute density and colours at the file's positions
    #[arg(long)]
    positions: bool,
    /// The level to read: off (level 0) or a number
    #[arg(long, value_name = "off|K", default_value = "off", value_parser = parse_level)]
    level_of_detail: usize,
    #[command(flatten)]
    which: FieldArguments,
    /// Overwrite the output if it exists
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    scene: SceneArguments,
}

fn parse_level(text: &str) -> std::result::Result<usize, String> {
    match text {
        "off" => Ok(0),
        _ => text.parse().map_err(|_| "expected off or a level's number".to_owned()),
    }
}

/// The report of `probe`.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct ProbeReport {
    /// Path of the probed field.
    input: String,
    /// Path of the file of rays.
    rays_file: String,
    /// Path of the written file.
    output: String,
    /// Size of the written file in bytes.
    output_bytes: u64,
    /// SHA-256 of the written file in hexadecimal.
    sha256: String,
    /// Total wall-clock time in seconds.
    seconds: f64,
    /// Number of rays.
    rays: usize,
    /// Number of positions; 0 without `--positions`.
    positions: usize,
    /// Level that samples read; 0 is the finest.
    level: usize,
}

/// Rows of three numbers.
type Points = Vec<[f32; 3]>;

/// Probes a field.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    let clock = Instant::now();
    let limits = common.limits();
    check_name(&arguments.output)?;
    if [&arguments.field, &arguments.rays].iter().all(|input| *input == Path::new(STANDARD_STREAM))
    {
        let message = "the field and --rays cannot both be the standard input";
        return Err(Error::usage(message));
    }
    let bar = Bar::new(common);
    bar.plan(vec![(Step::Render, 1.0)]);
    let scene = &arguments.scene;
    arguments.which.check(&[&arguments.field])?;
    let field = scene.open(&arguments.field, arguments.which, None, None, common)?;
    let level = arguments.level_of_detail;
    if level >= field.levels() {
        let (levels, last) = (field.levels(), field.levels() - 1);
        let message = format!("--level-of-detail {level}: there are {levels} levels, 0 to {last}");
        return Err(Error::usage(message));
    }
    let file =
        tensor::open(&stdin::resolve(&arguments.rays)?, &limits).map_err(|error| {
            match error.kind() {
                ErrorKind::WrongKind { .. } => error.advise(
                    "--rays takes .safetensors or .npz with arrays origins and directions, n x 3",
                ),
                _ => error,
            }
        })?;
    let input = Input::read(&file, arguments.positions, &limits)
        .map_err(|error| error.in_file(&arguments.rays))?;
    let mut output = create_output(&arguments.output, arguments.force)?;
    let (rows, bytes) = probe(&field, &input, level, &bar)?;
    let header = safetensors_header(&BTreeMap::new(), &rows);
    output.append(&(header.len() as u64).to_le_bytes())?;
    output.append(header.as_bytes())?;
    output.append(&bytes)?;
    drop(bar);
    let written = output.length();
    let sha256 = digest(output.written())?;
    output.finish()?;
    let (rays, positions) = (input.rays.len(), input.positions.len());
    let report = ProbeReport {
        input: arguments.field.to_string_lossy().into_owned(),
        rays_file: arguments.rays.to_string_lossy().into_owned(),
        output: arguments.output.to_string_lossy().into_owned(),
        output_bytes: written,
        sha256,
        seconds: clock.elapsed().as_secs_f64(),
        rays,
        positions,
        level,
    };
    let mut text = format!(
        "{}: {}, {} at level {level}",
        arguments.output.display(),
        readable(written),
        counted(rays, "ray")
    );
    if arguments.positions {
        text += &format!(", {}", counted(positions, "position"));
    }
    Outcome::new("probe", &report, text + "\n")
}

fn check_name(path: &Path) -> Result<()> {
    let extension = path.extension().and_then(|extension| extension.to_str());
    match extension.is_none_or(|extension| extension == "safetensors") {
        true => Ok(()),
        false => {
            let message = format!("-o {}: probe writes a .safetensors file", path.display());
            Err(Error::usage(message))
        }
    }
}

/// The rays and points of a file.
struct Input {
    rays: Vec<Ray>,
    /// Points, and the directions that they are seen along.
    positions: Points,
    directions: Vec<[f64; 3]>,
}

impl Input {
    fn read(file: &TensorFile, positions: bool, limits: &Limits) -> Result<Self> {
        let mut budget = Budget::new(limits);
        let origins = points(file, "origins", &mut budget)?;
        let directions = units(file, "directions", &mut budget)?;
        if origins.len() != directions.len() {
            let found = format!("{} origins and {} directions", origins.len(), directions.len());
            return Err(Error::malformed(Place::File, found, "as many of each"));
        }
        let vector = |point: [f32; 3]| DVec3::from_array(point.map(f64::from));
        let rays = origins.into_iter().zip(directions);
        let rays = rays.map(|(origin, direction)| Ray {
            origin: vector(origin),
            direction: DVec3::from_array(direction),
        });
        let rays = rays.collect();
        if !positions {
            return Ok(Self { rays, positions: Vec::new(), directions: Vec::new() });
        }
        let positions = points(file, "positions", &mut budget)?;
        let directions = units(file, "view_directions", &mut budget)?;
        let values = [positions.len() as u64, directions.len() as u64, 3, 4];
        let bytes = limits::product(&values, "colours", &Place::File)?;
        budget.spend(bytes as u64, "bytes of colours", &Place::File)?;
        Ok(Self { rays, positions, directions })
    }
}

/// A tensor of rows of three finite numbers.
fn points(file: &TensorFile, name: &str, budget: &mut Budget) -> Result<Points> {
    let place = || Place::Tensor(name.to_owned());
    let found = file.root.get(name).and_then(Value::tensor);
    let tensor = found.ok_or_else(|| {
        let error = Error::malformed(place(), "no such array", "float32 numbers, n x 3");
        error.advise(format!("add an array {name} to the file of rays"))
    })?;
    if !matches!(tensor.shape(), [_, 3]) {
        let found = format!("shape {:?}", tensor.shape());
        return Err(Error::malformed(place(), found, "[n, 3]"));
    }
    let values = tensor.read_f32(budget)?;
    if let Some(at) = values.iter().position(|value| !value.is_finite()) {
        let found = format!("{} in row {}", values[at], at / 3);
        return Err(Error::malformed(place(), found, "finite numbers"));
    }
    Ok(values.as_chunks().0.to_vec())
}

/// A tensor of unit vectors, normalized exactly.
fn units(file: &TensorFile, name: &str, budget: &mut Budget) -> Result<Vec<[f64; 3]>> {
    let rows = points(file, name, budget)?.into_iter().enumerate();
    let unit = rows.map(|(row, direction)| {
        let direction = DVec3::from_array(direction.map(f64::from));
        let length = direction.length();
        match (length - 1.0).abs() <= UNIT_TOLERANCE {
            true => Ok((direction / length).to_array()),
            false => {
                let found = format!("a length of {length} in row {row}");
                let error = Error::malformed(
                    Place::Tensor(name.to_owned()),
                    found,
                    "directions of length 1",
                );
                Err(error.advise("normalize the directions"))
            }
        }
    });
    unit.collect()
}

/// The tensors of the output and their bytes.
fn probe(field: &Renderer, input: &Input, level: usize, bar: &Bar) -> Result<(Vec<Row>, Vec<u8>)> {
    bar.begin(Step::Render, (input.rays.len() + input.positions.len()) as u64);
    let count = input.rays.len();
    let colors = field.ray_colors(&input.rays, level, bar)?;
    let mut rows = vec![
        Row::new("rgb".to_owned(), "F32", &[count, 3])?,
        Row::new("transmittance".to_owned(), "F32", &[count])?,
        Row::new("depth".to_owned(), "F32", &[count])?,
    ];
    let mut values: Vec<f32> = colors.iter().flat_map(|ray| ray.color).collect();
    values.extend(colors.iter().map(|ray| ray.transmittance));
    values.extend(colors.iter().map(|ray| ray.distance));
    if !input.positions.is_empty() {
        let (points, directions) = (input.positions.len(), input.directions.len());
        rows.push(Row::new("density".to_owned(), "F32", &[points])?);
        rows.push(Row::new("color".to_owned(), "F32", &[points, directions, 3])?);
        let chunks: Vec<&[[f32; 3]]> = input.positions.chunks(CHUNK).collect();
        let found = parallel::map(chunks.len(), |number| {
            if bar.cancelled() {
                return Err(Error::cancelled());
            }
            let points = chunks[number].iter().map(|position| {
                let position = position.map(f64::from);
                let density = field.sample(position, level)?.density;
                Ok((density, field.point_colors(position, &input.directions, level)?))
            });
            let points: Result<Vec<_>> = points.collect();
            bar.advance(Step::Render, chunks[number].len() as u64);
            points
        })?;
        values.extend(found.iter().flatten().map(|(density, _)| density));
        values.extend(found.iter().flatten().flat_map(|(_, colors)| colors.as_flattened()));
    }
    Ok((rows, values.iter().flat_map(|value| value.to_le_bytes()).collect()))
}
