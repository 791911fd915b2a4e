//! Writing flipbooks.

use std::path::{Path, PathBuf};

use serde_json::{Map, json};

use super::description::{DescribedSource, Description, ORIGIN, SCHEMA};
use super::read::read;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::base::progress::{Progress, Step};
use crate::base::srgb::display;
use crate::export_files::{ExportFiles, WrittenFiles};
use crate::format::{ExportFormat, ExportOptions, ExportSource, Exported, Shown};
use crate::picture::{self, Samples};
use crate::view::Lattice;
use crate::view::render::Renderer;
use crate::volume::{SparseVolume, VolumeModel, lattice, lost, place_of, points, volume};

/// Maximum pixels along a side of a sheet, the limit of engines.
const LARGEST_SIDE: usize = 16_384;
/// Points for each node along an axis.
const FACTOR: usize = 1;

/// A sheet of slices and its description.
#[derive(Debug)]
pub struct Flipbook;

/// The kind of picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sheet {
    Png,
    Exr,
}

impl Sheet {
    fn of(output: &Path) -> Result<Self> {
        match output.extension().and_then(|extension| extension.to_str()) {
            Some("png") => Ok(Self::Png),
            Some("exr") => Ok(Self::Exr),
            _ => Err(Error::usage(format!(
                "-o {}: a flipbook is a .png or an .exr",
                output.display()
            ))),
        }
    }
}

impl ExportFormat for Flipbook {
    fn name(&self) -> &'static str {
        "flipbook"
    }

    fn options(&self) -> &'static [&'static str] {
        &["supersample", "resolution", "crop"]
    }

    fn check(&self, source: &ExportSource, options: &ExportOptions, output: &Path) -> Result<()> {
        Sheet::of(output)?;
        let lattice = points_of(source, options)?;
        tiles(lattice.counts())?;
        let values: Vec<u64> = lattice.counts().iter().map(|&count| count as u64).collect();
        let count = limits::product(&values, "points", &Place::File)?;
        let bytes = (count as u64).saturating_mul(16);
        limits::check(
            LimitName::Memory,
            "bytes of a sheet",
            bytes,
            options.limits.memory,
            &Place::File,
        )
    }

    fn write(
        &self,
        source: &ExportSource,
        options: &ExportOptions,
        files: &mut ExportFiles,
        progress: &dyn Progress,
    ) -> Result<Exported> {
        let output = files.output().to_owned();
        let sheet = Sheet::of(&output)?;
        let volume = volume(source, options, points_of(source, options)?, false, progress)?;
        let counts = volume.lattice.counts();
        let [columns, rows] = tiles(counts)?;
        let stem = output.file_stem().unwrap_or_default().to_string_lossy();
        let extension = output.extension().unwrap_or_default().to_string_lossy();
        let name = format!("{stem}_{columns}x{rows}.{extension}");
        let [low, high] = volume.lattice.bounds();
        let spacing = volume.lattice.spacing;
        let half = spacing.map(|spacing| 0.5 * spacing);
        let step = spacing.into_iter().fold(f64::INFINITY, f64::min);
        let description = Description {
            schema: SCHEMA.to_owned(),
            sheet: name.clone(),
            columns,
            rows,
            dims: counts,
            bounds: [
                std::array::from_fn(|axis| low[axis] - half[axis]),
                std::array::from_fn(|axis| high[axis] + half[axis]),
            ],
            spacing,
            step: (sheet == Sheet::Png).then_some(step),
            level: options.level,
            color: if sheet == Sheet::Png { "srgb" } else { "linear" }.to_owned(),
            origin: ORIGIN.to_owned(),
            alpha: if sheet == Sheet::Png { "opacity" } else { "density" }.to_owned(),
            largest_density: volume.largest_density(),
            source: DescribedSource { name: source.name.clone(), sha256: source.sha256.clone() },
        };
        progress.begin(Step::Write, 1);
        let bytes = match sheet {
            Sheet::Png => png(&volume, [columns, rows], step)?,
            Sheet::Exr => exr(&volume, [columns, rows])?,
        };
        files.add(beside(&output, &name), &bytes)?;
        let text = serde_json::to_string_pretty(&description)
            .map_err(|error| Error::usage(format!("the description is not JSON: {error}")))?;
        files.add(output.with_extension("json"), (text + "\n").as_bytes())?;
        progress.advance(Step::Write, 1);
        let mut lost = lost(source, options);
        if sheet == Sheet::Png {
            lost.push("digits: colour and opacity have 8 bits".to_owned());
        }
        let mut details = Map::new();
        details.insert("dims".to_owned(), json!(counts));
        details.insert("tiles".to_owned(), json!([columns, rows]));
        Ok(Exported { lost, details })
    }

    fn read_back(
        &self,
        source: &ExportSource,
        files: &WrittenFiles,
        limits: &Limits,
    ) -> Result<Box<dyn Shown>> {
        let model = VolumeModel::new(read(files, limits)?, limits)?;
        Ok(Box::new(Renderer::with_view(source.field.view(), Box::new(model))))
    }
}

fn points_of(source: &ExportSource, options: &ExportOptions) -> Result<Lattice> {
    let mut lattice = lattice(source, options, FACTOR)?;
    if let Some(crop) = &options.crop {
        lattice.crop(crop)?;
    }
    Ok(lattice)
}

fn beside(output: &Path, name: &str) -> PathBuf {
    output.with_file_name(name)
}

/// Columns and rows of the sheet with the shortest long side.
fn tiles([width, height, slices]: [usize; 3]) -> Result<[usize; 2]> {
    let side = |columns: usize| (columns * width).max(slices.div_ceil(columns) * height);
    let best = (1..=slices).min_by_key(|&columns| side(columns)).unwrap_or(1);
    if side(best) <= LARGEST_SIDE {
        return Ok([best, slices.div_ceil(best)]);
    }
    Err(Error::usage(format!(
        "{slices} slices of {width} x {height} points do not fit on a sheet of {LARGEST_SIDE} pixels \
         a side: pass a lower --resolution or --supersample, or --crop"
    )))
}

/// Calls `put` with the sheet's pixel of each coloured point: pixel, density, linear colour.
fn for_each_pixel(
    volume: &SparseVolume,
    columns: usize,
    mut put: impl FnMut(usize, f32, [f32; 3]),
) {
    let [width, height, _] = volume.lattice.counts();
    for leaf in &volume.leaves {
        for point in points(&leaf.colored) {
            let inside = place_of(point);
            let [x, y, z]: [usize; 3] =
                std::array::from_fn(|axis| leaf.at[axis] as usize * 8 + inside[axis]);
            let row = z / columns * height + y;
            let pixel = row * columns * width + z % columns * width + x;
            put(pixel, leaf.density[point], leaf.color[point]);
        }
    }
}

fn png(volume: &SparseVolume, [columns, rows]: [usize; 2], step: f64) -> Result<Vec<u8>> {
    let [width, height, _] = volume.lattice.counts();
    let mut pixels = vec![0u8; 4 * columns * width * rows * height];
    let byte = |value: f64| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
    for_each_pixel(volume, columns, |pixel, density, color| {
        let opacity = -libm::expm1(-f64::from(density) * step);
        let [red, green, blue] = color.map(|light| byte(display(light.into())));
        pixels[4 * pixel..4 * pixel + 4].copy_from_slice(&[red, green, blue, byte(opacity)]);
    });
    picture::png(columns * width, rows * height, &pixels)
}

fn exr(volume: &SparseVolume, [columns, rows]: [usize; 2]) -> Result<Vec<u8>> {
    let [width, height, _] = volume.lattice.counts();
    let mut channels = [(); 4].map(|()| vec![0.0f32; columns * width * rows * height]);
    for_each_pixel(volume, columns, |pixel, density, color| {
        for (channel, value) in channels.iter_mut().zip(color.into_iter().chain([density])) {
            channel[pixel] = value;
        }
    });
    let names = ["R", "G", "B", "A"].map(str::to_owned);
    let channels = names.into_iter().zip(channels).collect();
    picture::exr(columns * width, rows * height, channels, Samples::Half)
}
