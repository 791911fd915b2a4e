//! Pictures of the x planes of a container's levels: y runs down, z to the right.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use crate::base::bytes::Provisional;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::lock::lock;
use crate::base::parallel;
use crate::container::Container;
use crate::model::baked::{BakedLevel, Group, LevelMetadata, Metadata};
use crate::picture::{self, Samples};
use mipvog::unpacked::{check_levels, fill_plane};

/// The content of a slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SliceFormat {
    /// Float32 EXR of the stored values: `density`, `R`, `G`, `B` and `feature0` and so on.
    Exr,
    /// 8-bit PNG, one of opacity and one of diffuse colour, both activated.
    Png,
}

/// Writes `level{k}.x{i}.exr`, or `level{k}.opacity.x{i}.png` and `level{k}.diffuse.x{i}.png`, into
/// `folder`. Empty `levels` means all; 0 is the finest.
///
/// # Errors
/// Missing levels; damaged containers; existing files, unless `overwrite`. After an error, new
/// files and folders are removed.
pub fn write_slices(
    container: &Container,
    levels: &[usize],
    format: SliceFormat,
    folder: &Path,
    overwrite: bool,
) -> Result<()> {
    check_levels(container, levels)?;
    let metadata = container.metadata();
    let wanted = |number: usize| levels.is_empty() || levels.contains(&number);
    // A damaged container is refused before the first file is written.
    container.read_head()?;
    container.for_each_part(|_, _| Ok(()))?;
    let path = |number: usize, name: &str| folder.join(format!("level{number}.{name}"));
    for (number, level) in metadata.levels.iter().enumerate().filter(|(n, _)| wanted(*n)) {
        for name in (0..level.dimensions[0]).flat_map(|x| names(level, format, x)) {
            let path = path(number, &name);
            if !overwrite && path.symlink_metadata().is_ok() {
                return Err(Error::new(ErrorKind::Exists, Place::File).in_file(&path));
            }
        }
    }
    let mut made = Provisional::default();
    made.create_folder(folder)?;
    let made = Mutex::new(made);
    container.for_each_part(|number, level| {
        let Some(level_metadata) = metadata.levels.get(number).filter(|_| wanted(number)) else {
            return Ok(());
        };
        parallel::map(level_metadata.dimensions[0], |x| {
            let files = slice(level, level_metadata, metadata, format, x)?;
            for (name, bytes) in names(level_metadata, format, x).iter().zip(files) {
                let mut made = lock(&made);
                made.write(&path(number, name), &bytes, overwrite)?;
            }
            Ok(())
        })
        .map(|_| ())
    })?;
    made.into_inner().unwrap_or_else(PoisonError::into_inner).keep();
    Ok(())
}

/// The names of a plane's files, after the level's number.
fn names(level: &LevelMetadata, format: SliceFormat, x: usize) -> Vec<String> {
    match format {
        SliceFormat::Exr => vec![format!("x{x:04}.exr")],
        SliceFormat::Png => {
            let opacity = level.density.as_ref().map(|_| format!("opacity.x{x:04}.png"));
            opacity.into_iter().chain([format!("diffuse.x{x:04}.png")]).collect()
        }
    }
}

/// The files of one plane, in the order of their [`names`].
fn slice(
    level: &BakedLevel,
    level_metadata: &LevelMetadata,
    metadata: &Metadata,
    format: SliceFormat,
    x: usize,
) -> Result<Vec<Vec<u8>>> {
    let [_, ny, nz] = level_metadata.dimensions;
    let plane = |group, channel| {
        let mut plane = vec![0.0; ny * nz];
        fill_plane(level, level_metadata, group, channel, x, &mut plane).then_some(plane)
    };
    if format == SliceFormat::Exr {
        let mut channels = Vec::new();
        channels.extend(plane(Group::Density, 0).map(|plane| ("density".to_owned(), plane)));
        for (channel, name) in ["R", "G", "B"].into_iter().enumerate() {
            channels.extend(plane(Group::Diffuse, channel).map(|plane| (name.to_owned(), plane)));
        }
        let layout = metadata.layout();
        let others = Group::ALL.into_iter();
        let others = others.filter(|&group| group != Group::Density && group != Group::Diffuse);
        let others =
            others.flat_map(|group| (0..group.channels(layout)).map(move |at| (group, at)));
        for (number, (group, channel)) in others.enumerate() {
            let name = match group {
                Group::Directional | Group::Anisotropy => format!("{}{channel}", group.name()),
                _ => format!("feature{number}"),
            };
            channels.extend(plane(group, channel).map(|plane| (name, plane)));
        }
        return Ok(vec![picture::exr(nz, ny, channels, Samples::Single)?]);
    }
    let mut files = Vec::new();
    let byte = |share: f64| (share * 255.0 + 0.5) as u8;
    if let (Some(encoding), Some(density)) = (&level_metadata.density, plane(Group::Density, 0)) {
        let opacity =
            |&stored: &f32| encoding.decode.activated(stored.into(), &metadata.activation);
        let grey: Vec<u8> = density.iter().map(|stored| byte(opacity(stored))).collect();
        files.push(picture::png(nz, ny, &grey)?);
    }
    let mut rgb = vec![0; 3 * ny * nz];
    for channel in 0..3 {
        let values = plane(Group::Diffuse, channel).unwrap_or_default();
        for (pixel, &raw) in rgb.chunks_exact_mut(3).zip(&values) {
            pixel[channel] = byte(metadata.mean_color(raw));
        }
    }
    files.push(picture::png(nz, ny, &rgb)?);
    Ok(files)
}
