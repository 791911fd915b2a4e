//! All levels as tensors: those of an unpacked container, a safetensors file or a NumPy archive.
//!
//! | tensor | shape | holds |
//! |---|---|---|
//! | `level{k}.density` | `[Nx,Ny,Nz]` f32 | stored density, node-centred, C order |
//! | `level{k}.diffuse`, `level{k}.features` | `[C,Nx,Ny,Nz]` f32 | stored colour |
//! | `level{k}.directional` | `[3,Nx,Ny,Nz]` f32 | stored directional brightness |
//! | `level{k}.anisotropy` | `[5,Nx,Ny,Nz]` f32 | stored anisotropy |
//! | `level{k}.occupied` | `[Bx,By,Bz]` u8 | 0 empty, 1 stored, 2 inherited |
//! | `mlp.{i}.weight`, `mlp.{i}.bias` | `[out,in]`, `[out]` f32 | the view network |
//! | `free_space.inside` or `free_space.values` | mask nodes, u8 or f32 | the free-space mask |
//! | `free_space.map` | `[3,3]` f64 | its scale, shift and (threshold, 0, 0) |
//!
//! `__metadata__.mipvog` is the container's metadata, `__metadata__.mipvog_provenance` its
//! provenance, and `__metadata__.mipvog_content`, the [`content_checksum`] in hexadecimal digits,
//! reveals edited values.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::{Row, check_levels, fill_plane, safetensors_digest, safetensors_header};
use crate::base::bytes::ByteSink;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Budget;
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::container::json::to_canonical;
use crate::container::{Container, content_checksum};
use crate::model::baked::{BakedLevel, ColorLayout, Group, LevelMetadata, Metadata};
use crate::model::field::{FreeSpace, Lookup};
use crate::model::view_mlp::ViewMlp;

/// The text of `__metadata__` that holds the checksum of the values.
pub const CONTENT: &str = "mipvog_content";

/// The levels in `levels` (all if empty) in memory: tensors, each with its bytes, little-endian.
///
/// # Errors
///
/// `InvalidOption` for levels that are not there; damage; more memory than the container's limits
/// allow.
pub fn read_tensors(
    container: &Container,
    levels: &[usize],
    progress: &dyn Progress,
) -> Result<Vec<(Row, Vec<u8>)>> {
    check_levels(container, levels)?;
    let head = container.read_head()?;
    let rows = rows(container.metadata(), levels, head.0.as_ref(), head.1.as_ref())?;
    let mut budget = Budget::new(container.limits());
    for row in &rows {
        budget.spend(row.bytes, "bytes of tensors", &Place::Tensor(row.name.clone()))?;
    }
    let tensors = rows.into_iter().map(|row| (row, Vec::new())).collect();
    let mut sink = TensorSink { tensors, current: 0, length: 0 };
    append_all(container, head, levels, &mut sink, progress)?;
    Ok(sink.tensors)
}

/// Appended bytes, tensor by tensor.
struct TensorSink {
    tensors: Vec<(Row, Vec<u8>)>,
    current: usize,
    length: u64,
}

impl ByteSink for TensorSink {
    fn append(&mut self, mut bytes: &[u8]) -> Result<()> {
        self.length += bytes.len() as u64;
        while let Some((row, own)) = self.tensors.get_mut(self.current) {
            own.reserve_exact(row.bytes as usize - own.len());
            let (here, rest) = bytes.split_at(bytes.len().min(row.bytes as usize - own.len()));
            own.extend_from_slice(here);
            bytes = rest;
            if bytes.is_empty() && own.len() < row.bytes as usize {
                break;
            }
            self.current += 1;
        }
        Ok(())
    }

    fn length(&self) -> u64 {
        self.length
    }

    fn folder(&self) -> PathBuf {
        std::env::temp_dir()
    }
}

/// Appends the bytes of all tensors, in the order of [`rows`].
pub fn append_all(
    container: &Container,
    (view_mlp, free_space): (Option<ViewMlp>, Option<FreeSpace>),
    levels: &[usize],
    output: &mut dyn ByteSink,
    progress: &dyn Progress,
) -> Result<()> {
    let metadata = container.metadata();
    let wanted = |part: usize| levels.is_empty() || levels.contains(&metadata.level_of_part(part));
    append_small(view_mlp.as_ref(), free_space.as_ref(), output)?;
    progress.begin(Step::Decode, metadata.parts().count() as u64);
    container.for_each_part(|part, level| {
        progress.advance(Step::Decode, 1);
        if progress.cancelled() {
            return Err(Error::cancelled());
        }
        match metadata.part(part).filter(|_| wanted(part)) {
            Some(level_metadata) => append_level(level, level_metadata, metadata.layout(), output),
            None => Ok(()),
        }
    })
}

/// The digest of the file that all levels of a container unpack to, as its reader states it.
pub fn digest_of_tensors(container: &Container) -> Result<[u8; 32]> {
    let metadata = container.metadata();
    let (view_mlp, free_space) = container.read_head()?;
    let rows = rows(metadata, &[], view_mlp.as_ref(), free_space.as_ref())?;
    Ok(safetensors_digest(header(container, metadata, &rows)?.as_bytes()))
}

/// The tensors of some levels and their shells (all if `levels` is empty), in file order: coarse to
/// fine, in the order of reading.
pub fn rows(
    metadata: &Metadata,
    levels: &[usize],
    view_mlp: Option<&ViewMlp>,
    free_space: Option<&FreeSpace>,
) -> Result<Vec<Row>> {
    let mut rows = small_rows(view_mlp, free_space)?;
    for part in metadata.parts_in_file() {
        if levels.is_empty() || levels.contains(&metadata.level_of_part(part)) {
            rows.extend(part_rows(part, metadata)?);
        }
    }
    Ok(rows)
}

/// The tensor that holds a group's values.
pub fn tensor_name(group: Group) -> &'static str {
    match group {
        Group::Band(_) => Group::Features.name(),
        group => group.name(),
    }
}

fn part_rows(part: usize, metadata: &Metadata) -> Result<Vec<Row>> {
    let Some(level) = metadata.part(part) else { return Ok(Vec::new()) };
    let own = metadata.part_name(part);
    let name = |of: &str| format!("{own}.{of}");
    let mut rows = vec![Row::new(name("occupied"), "U8", &level.grid().counts())?];
    let [nx, ny, nz] = level.dimensions;
    for group in Group::ALL.into_iter().filter(|&group| level.encoding(group).is_some()) {
        let shape = match group {
            Group::Density => vec![nx, ny, nz],
            Group::Diffuse | Group::Directional | Group::Anisotropy => {
                vec![group.channels(metadata.layout()), nx, ny, nz]
            }
            // All bands follow each other in one tensor.
            Group::Features | Group::Band(1) => vec![metadata.features, nx, ny, nz],
            Group::Band(_) => continue,
        };
        rows.push(Row::new(name(tensor_name(group)), "F32", &shape)?);
    }
    Ok(rows)
}

fn small_rows(view_mlp: Option<&ViewMlp>, free_space: Option<&FreeSpace>) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for (i, layer) in view_mlp.iter().flat_map(|network| &network.layers).enumerate() {
        rows.push(Row::new(format!("mlp.{i}.weight"), "F32", &[layer.outputs, layer.inputs])?);
        rows.push(Row::new(format!("mlp.{i}.bias"), "F32", &[layer.outputs])?);
    }
    if let Some(free_space) = free_space {
        rows.push(Row::new("free_space.map".to_owned(), "F64", &[3, 3])?);
        let (name, dtype) = match free_space.lookup {
            Lookup::Nearest(_) => ("free_space.inside", "U8"),
            Lookup::Trilinear { .. } => ("free_space.values", "F32"),
        };
        rows.push(Row::new(name.to_owned(), dtype, &free_space.nodes.0)?);
    }
    Ok(rows)
}

fn append_small(
    view_mlp: Option<&ViewMlp>,
    free_space: Option<&FreeSpace>,
    output: &mut dyn ByteSink,
) -> Result<()> {
    for layer in view_mlp.iter().flat_map(|network| &network.layers) {
        output.append(&float_bytes(&layer.weights))?;
        output.append(&float_bytes(&layer.bias))?;
    }
    let Some(free_space) = free_space else { return Ok(()) };
    let threshold = match &free_space.lookup {
        Lookup::Nearest(_) => 0.0,
        Lookup::Trilinear { threshold, .. } => f64::from(*threshold),
    };
    let map = [free_space.scale, free_space.shift, [threshold, 0.0, 0.0]];
    output.append(&map.as_flattened().iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<_>>())?;
    match &free_space.lookup {
        Lookup::Nearest(inside) => {
            output.append(&inside.iter().map(|&inside| u8::from(inside)).collect::<Vec<u8>>())
        }
        Lookup::Trilinear { values, .. } => output.append(&float_bytes(values)),
    }
}

fn append_level(
    level: &BakedLevel,
    metadata: &LevelMetadata,
    layout: ColorLayout,
    output: &mut dyn ByteSink,
) -> Result<()> {
    let occupied: Vec<u8> = level.table.occupancy().iter().map(|block| block.id()).collect();
    output.append(&occupied)?;
    let [nx, ny, nz] = metadata.dimensions;
    for group in Group::ALL.into_iter().filter(|&group| metadata.encoding(group).is_some()) {
        for channel in 0..group.channels(layout) {
            for start in (0..nx).step_by(metadata.block_size) {
                let count = metadata.block_size.min(nx - start);
                let planes = parallel::map(count, |i| {
                    let mut plane = vec![0.0; ny * nz];
                    fill_plane(level, metadata, group, channel, start + i, &mut plane);
                    Ok(float_bytes(&plane))
                })?;
                planes.iter().try_for_each(|plane| output.append(plane))?;
            }
        }
    }
    Ok(())
}

/// The header of a safetensors file of `rows` that is an unpacked container.
pub fn header(container: &Container, metadata: &Metadata, rows: &[Row]) -> Result<String> {
    Ok(safetensors_header(&texts(container, metadata)?, rows))
}

/// The metadata that makes a file of tensors an unpacked container.
pub fn texts(container: &Container, metadata: &Metadata) -> Result<BTreeMap<&'static str, String>> {
    let mut texts = BTreeMap::from([("mipvog", to_canonical(metadata)?)]);
    if let Some(provenance) = container.provenance()? {
        texts.insert("mipvog_provenance", to_canonical(&provenance)?);
        texts.insert(CONTENT, format!("{:08x}", content_checksum(container.entries())));
    }
    Ok(texts)
}

fn float_bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}
