//! Writing a folder.

use std::path::Path;

use serde_json::{Map, json};

use super::grid::VoxelGrid;
use super::layout::Layout;
use super::parameters::{runs, text};
use super::read_back::read_back;
use super::slices::Slices;
use super::texels::Texels;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::export_files::{ExportFiles, WrittenFiles};
use crate::format::{ExportFormat, ExportOptions, ExportSource, Exported, Shown};
use crate::model::view_dependence::ViewDependence;
use crate::model::view_mlp::ViewMlp;
use crate::picture;
use crate::view::render::{Directions, Renderer};
use mipvog_inputs::snerg::layout::{EMPTY, INDICES, PARAMETERS};

/// Voxels for the finest spacing of nodes.
const FACTOR: usize = 2;
/// The largest number of voxels for the finest spacing of nodes.
const MOST_FACTOR: usize = 16;
/// Voxels along the edge of a block. With aprons, blocks are 16 texels: a multiple of the cubes
/// that the viewer skips, of which Mip-VoG's coarsest pictures still have two.
const BLOCK: usize = 14;
/// Maximum voxels along an axis: 255 blocks.
const MOST_VOXELS: usize = 255 * BLOCK;
/// Directions of a mean colour.
const DIRECTIONS: usize = 96;
/// Number of slices from which on names of coarser pictures would collide with finer ones.
const MOST_MIP_SLICES: usize = 100;

/// A folder of pictures for SNeRG's viewer.
#[derive(Debug)]
pub struct Snerg;

impl ExportFormat for Snerg {
    fn name(&self) -> &'static str {
        "snerg"
    }

    fn options(&self) -> &'static [&'static str] {
        &["supersample", "resolution", "crop", "mips"]
    }

    fn check(&self, source: &ExportSource, options: &ExportOptions, _: &Path) -> Result<()> {
        let grid = grid(source, options)?;
        // Possibly non-empty blocks: at least those that will be stored.
        let texels =
            Texels { field: &source.field, level: options.level, grid: &grid, directions: None };
        let [x, y, z] = grid.blocks();
        let mut blocks = 0;
        for number in 0..x * y * z {
            let block = block_at(grid.blocks(), number);
            blocks += usize::from(!texels.field.is_empty(grid.corners(block), options.level));
        }
        let layout = Layout::new(&grid, blocks, options.mips)?;
        let [width, height, depth] = layout.texels().map(|side| side as u64);
        if options.mips && depth as usize / 4 >= MOST_MIP_SLICES {
            let found = format!("{} slices", depth / 4);
            let expected = format!("fewer than {MOST_MIP_SLICES}, for the names of coarser ones");
            return Err(Error::invalid_option("mips", found, expected));
        }
        // A layer of both kinds, with its coarser layers and their pictures.
        let layer = width * height * layout.edge as u64 * 8;
        let bytes = 3 * layer + (x * y * z) as u64;
        limits::check(
            LimitName::Memory,
            "bytes of a layer of the atlas",
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
        let grid = grid(source, options)?;
        let network = network_of(&source.field).filter(|network| runs(network));
        let directions = network.is_none().then(|| Directions::spread(&source.field, DIRECTIONS));
        let (field, level) = (&source.field, options.level);
        let texels = Texels { field, level, grid: &grid, directions: directions.as_ref() };
        let [x, y, z] = grid.blocks();
        let total = x * y * z;
        progress.begin(Step::Prune, total as u64);
        let kept = parallel::map(total, |number| {
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            progress.advance(Step::Prune, 1);
            Ok(texels.keeps(block_at([x, y, z], number)))
        })?;
        let kept: Vec<usize> = (0..total).filter(|&number| kept[number]).collect();
        let layout = Layout::new(&grid, kept.len(), options.mips)?;
        let folder = files.output().to_owned();
        files.add(folder.join(PARAMETERS), text(&grid, &layout, network).as_bytes())?;
        files.add(folder.join(INDICES), &indices([x, y, z], &kept, &layout)?)?;
        let mut slices = Slices::new(layout, network.is_some(), options.mips);
        let [_, _, layers] = layout.blocks;
        progress.begin(Step::Write, layers as u64);
        for layer in 0..layers {
            let numbers = kept.chunks(layout.layer()).nth(layer).unwrap_or_default();
            let blocks = parallel::map(numbers.len(), |i| match progress.cancelled() {
                true => Err(Error::cancelled()),
                false => Ok(texels.of(block_at([x, y, z], numbers[i]))),
            })?;
            slices.push(&blocks, &folder, files)?;
            progress.advance(Step::Write, 1);
        }
        let mut details = Map::new();
        details.insert("voxels".to_owned(), json!(grid.counts));
        details.insert("voxel_size".to_owned(), json!(grid.voxel));
        details.insert("blocks".to_owned(), json!(kept.len()));
        details.insert("atlas".to_owned(), json!(layout.texels()));
        details.insert("url".to_owned(), json!(address(source, &folder)));
        Ok(Exported { lost: lost(source, options, network.is_some()), details })
    }

    fn read_back(
        &self,
        source: &ExportSource,
        files: &WrittenFiles,
        limits: &Limits,
    ) -> Result<Box<dyn Shown>> {
        Ok(Box::new(read_back(source.field.view(), files, limits)?))
    }
}

fn network_of(field: &Renderer) -> Option<&ViewMlp> {
    field.view().view_dependence.as_ref().and_then(ViewDependence::network)
}

/// The voxels for the options.
fn grid(source: &ExportSource, options: &ExportOptions) -> Result<VoxelGrid> {
    let view = source.field.view();
    let spacing = view.nodes.spacing(&view.bounds);
    let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
    let part = options.crop.as_ref().and(view.march.sampled.as_ref()).unwrap_or(&view.bounds);
    let longest = part.extent().into_iter().fold(0.0, f64::max);
    let factor = options.supersample.unwrap_or(FACTOR);
    let expected = format!("1 to {MOST_FACTOR}");
    Error::require_option((1..=MOST_FACTOR).contains(&factor), "supersample", factor, &expected)?;
    let cells = options.resolution.unwrap_or((longest / finest).ceil() as usize * factor);
    let expected = format!("1 to {MOST_VOXELS}: an axis has at most 255 blocks");
    Error::require_option((1..=MOST_VOXELS).contains(&cells), "resolution", cells, &expected)?;
    Ok(VoxelGrid::new(&view.bounds, part, cells, BLOCK))
}

/// The place of a block in a grid of blocks, z fastest.
fn block_at([_, y, z]: [usize; 3], number: usize) -> [usize; 3] {
    [number / z / y, number / z % y, number % z]
}

/// The picture of places: rows are z, then y.
fn indices([x, y, z]: [usize; 3], kept: &[usize], layout: &Layout) -> Result<Vec<u8>> {
    let mut pixels = vec![EMPTY; 3 * x * y * z];
    for (number, &block) in kept.iter().enumerate() {
        let [i, j, k] = block_at([x, y, z], block);
        let at = 3 * ((k * y + j) * x + i);
        let place = layout.place(number).map(|place| place as u8);
        pixels[at..at + 3].copy_from_slice(&place);
    }
    picture::png(x, z * y, &pixels)
}

/// The part of an address that opens the folder in the viewer. The angle is that of most training
/// pictures.
fn address(source: &ExportSource, folder: &Path) -> String {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    let near = source.field.view().march.near.max(0.33);
    format!("index.html?dir={name}&s=800,800&vfovy=39&near={near}")
}

/// Content that a folder cannot represent.
fn lost(source: &ExportSource, options: &ExportOptions, has_network: bool) -> Vec<String> {
    let field = &source.field;
    let mut lost = vec!["precision: colours, features and opacity have 8 bits".to_owned()];
    if !has_network && (field.view().view_dependence.is_some() || field.is_model()) {
        lost.push("view-dependent colour: colours are means over directions".to_owned());
    }
    if has_network {
        lost.push("colours of silhouettes: the background is added before the network".to_owned());
    }
    if field.view().background != [1.0; 3] {
        lost.push("background: the viewer's is white".to_owned());
    }
    if field.levels() > 1 && !options.mips {
        lost.push("other levels".to_owned());
    }
    if !field.is_model() {
        lost.push("sharpness: surfaces are softer".to_owned());
    }
    lost
}
