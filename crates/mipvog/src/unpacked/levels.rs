//! A container's levels as dense arrays, independent of their storage.

use std::sync::Arc;

use serde_json::Value as Json;

use super::planes::{Slice, fill_plane, fill_slice};
use super::rotation::Rotation;
use super::tensors::digest_of_tensors;
use crate::base::bytes::Storage;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::parallel;
use crate::container::{Container, OtherChunk};
use crate::model::baked::{
    BakedLevel, ColorLayout, DensityDomain, GROUPS, Group, LevelMetadata, Metadata, Table,
};
use crate::model::field::{FreeSpace, Grid, Lattice, RadianceField, Scene, Shell, Volume};
use crate::model::grid::{Element, NodeMask, row};
use crate::model::view_dependence::ViewDependence;
use crate::model::view_mlp::ViewMlp;

/// An unpacked container: a file of dense arrays, or the container itself. Both give the same
/// values.
#[derive(Debug, Clone)]
pub struct Unpacked {
    /// The container's metadata.
    pub metadata: Metadata,
    /// The container's provenance; null where it has none.
    pub provenance: Json,
    /// The [`content_checksum`](crate::container::content_checksum) of the container, as stated in
    /// a file of dense arrays, whose values may have been edited since.
    pub content: Option<u32>,
    /// Levels, finest first, then shells: the parts of the metadata.
    pub levels: Vec<UnpackedLevel>,
    /// View-dependent colour, if any.
    pub view_mlp: Option<ViewMlp>,
    /// The free-space mask, if there is one.
    pub free_space: Option<FreeSpace>,
    /// Ancillary chunks unknown to this version; a file of dense arrays has none.
    pub others: Vec<OtherChunk>,
    /// SHA-256 of the header of the file of dense arrays. It identifies the content, except its
    /// values.
    pub digest: [u8; 32],
}

/// One level of dense arrays.
#[derive(Debug, Clone)]
pub struct UnpackedLevel {
    /// The blocks that count.
    pub table: Table,
    /// The values, before `density_scale` and `emptied`.
    pub values: LevelValues,
    /// Densities and their anisotropy are multiplied by this.
    pub density_scale: f32,
    /// Nodes whose density and anisotropy read as the level's empty values.
    pub emptied: Option<NodeMask>,
}

/// A level's values by [`Group`].
#[derive(Debug, Clone)]
pub enum LevelValues {
    /// Dense arrays.
    Volumes(Box<[Option<Volume>; GROUPS]>),
    /// A container's codes and their encodings.
    Codes(Arc<(BakedLevel, LevelMetadata)>),
    /// The values of a level before this rotation.
    Rotated(Box<(UnpackedLevel, Rotation)>),
}

impl Unpacked {
    /// A container's levels, decoded to codes.
    ///
    /// # Errors
    ///
    /// Damage, and more memory than the container's limits allow.
    pub fn of_container(container: &Container) -> Result<Self> {
        let provenance = container.provenance()?.unwrap_or(Json::Null);
        let digest = digest_of_tensors(container)?;
        let field = container.read()?;
        let levels = field.levels.into_iter().zip(field.metadata.parts());
        let levels = levels.map(|(level, metadata)| {
            let table = level.table.clone();
            UnpackedLevel::new(table, LevelValues::Codes(Arc::new((level, metadata.clone()))))
        });
        Ok(Self {
            levels: levels.collect(),
            metadata: field.metadata,
            provenance,
            content: None,
            view_mlp: field.view_mlp,
            free_space: field.free_space,
            others: container.other_chunks()?,
            digest,
        })
    }

    /// Level 0 as a trained field, for a new bake; none without densities. From a container's
    /// codes, the field holds its values in memory.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Unsupported`](crate::base::error::ErrorKind::Unsupported) where level 0 was a
    /// coarser one, whose densities are no logits; `OverLimit` if dense values take more memory
    /// than `limits` allow.
    pub fn field(&self, limits: &Limits) -> Result<Option<RadianceField>> {
        let metadata = &self.metadata;
        let (Some(finest), Some(stated)) = (self.levels.first(), metadata.levels.first()) else {
            return Ok(None);
        };
        if stated.density_domain() != DensityDomain::Raw {
            let found = "a container whose trained level 0 was dropped";
            let expected = "one with it, or the checkpoint, to bake anew";
            return Err(Error::unsupported(Place::File, found, expected));
        }
        let mut budget = Budget::new(limits);
        let Some((density, color)) = self.grids(finest, stated, &mut budget)? else {
            return Ok(None);
        };
        let mut shells = Vec::new();
        for (own, stated) in self.levels.iter().skip(metadata.levels.len()).zip(&metadata.shells) {
            let Some((density, color)) = self.grids(own, stated, &mut budget)? else {
                return Ok(None);
            };
            let bounds = stated.bounds.unwrap_or(metadata.bounds);
            let lattice = Lattice::new(bounds, own.table.grid().nodes);
            shells.push(Shell { lattice, density, color });
        }
        let scene = Scene {
            bounds: metadata.bounds,
            nodes: finest.table.grid().nodes,
            activation: metadata.activation,
            march: metadata.march,
            background: metadata.background,
        };
        Ok(Some(RadianceField {
            scene,
            density,
            color,
            color_domain: metadata.color_domain(),
            view: self.view_dependence(),
            free_space: self.free_space.clone(),
            shells,
        }))
    }

    /// A part's density and colours, in memory or in place; none without densities.
    fn grids(
        &self,
        level: &UnpackedLevel,
        stated: &LevelMetadata,
        budget: &mut Budget,
    ) -> Result<Option<(Grid, Vec<Grid>)>> {
        let layout = self.metadata.layout();
        let mut volume = |group| level.volume(group, stated, layout, budget);
        let Some(density) = volume(Group::Density)? else { return Ok(None) };
        let color: Result<Vec<Option<Volume>>> = Group::COLORS.into_iter().map(volume).collect();
        Ok(Some((density.into(), color?.into_iter().flatten().map(Grid::from).collect())))
    }
}

impl Unpacked {
    fn view_dependence(&self) -> Option<ViewDependence> {
        self.metadata.view_dependence(self.view_mlp.as_ref())
    }
}

impl UnpackedLevel {
    /// A level with values as stored.
    pub fn new(table: Table, values: LevelValues) -> Self {
        Self { table, values, density_scale: 1.0, emptied: None }
    }

    /// Bytes of its values as stored.
    pub fn bytes(&self) -> u64 {
        match &self.values {
            LevelValues::Volumes(volumes) => volumes.iter().flatten().map(Volume::bytes).sum(),
            LevelValues::Codes(codes) => {
                let atlases = codes.0.atlases.iter().flatten();
                atlases.map(|codes| (codes.len() * codes.number_bytes()) as u64).sum()
            }
            LevelValues::Rotated(rotated) => rotated.0.bytes(),
        }
    }

    /// Reads one x plane, `ny * nz` values, of one channel of a group that the level has. `empty`
    /// is the value of emptied nodes.
    ///
    /// # Errors
    ///
    /// Errors of reading.
    pub fn read_plane(
        &self,
        (group, channel): (Group, usize),
        x: usize,
        empty: f32,
        out: &mut [f32],
    ) -> Result<()> {
        match &self.values {
            LevelValues::Volumes(volumes) => {
                let Some(volume) = &volumes[group.index()] else { return Ok(()) };
                let mut scratch = Vec::new();
                for (y, row) in out.chunks_exact_mut(volume.nodes.0[2]).enumerate() {
                    volume.read_run(channel, [x, y, 0], row, &mut scratch, |_| {})?;
                }
            }
            LevelValues::Codes(codes) => {
                fill_plane(&codes.0, &codes.1, group, channel, x, out);
            }
            LevelValues::Rotated(_) => {
                self.fill_slice((group, channel), Slice { axis: 0, index: x }, empty, out)?;
            }
        }
        if group.is_color() {
            return Ok(());
        }
        if self.density_scale != 1.0 {
            out.iter_mut().for_each(|value| *value *= self.density_scale);
        }
        if let Some(emptied) = &self.emptied {
            for (y, values) in out.chunks_exact_mut(emptied.nodes().0[2]).enumerate() {
                for (start, end) in row::runs(emptied.row(x, y)) {
                    values[start..end].fill(empty);
                }
            }
        }
        Ok(())
    }

    /// As [`Self::read_plane`], of a slice along any axis.
    fn read_slice(
        &self,
        (group, channel): (Group, usize),
        slice: Slice,
        empty: f32,
        out: &mut [f32],
    ) -> Result<()> {
        if slice.axis == 0 {
            return self.read_plane((group, channel), slice.index, empty, out);
        }
        self.fill_slice((group, channel), slice, empty, out)?;
        if group.is_color() {
            return Ok(());
        }
        let length = self.table.grid().nodes.0[slice.spans()[1]];
        for (at, value) in out.iter_mut().enumerate() {
            *value *= self.density_scale;
            let node = slice.node(at / length, at % length);
            if self.emptied.as_ref().is_some_and(|emptied| emptied.contains(node)) {
                *value = empty;
            }
        }
        Ok(())
    }

    /// Reads the values of a slice, before `density_scale` and `emptied`.
    fn fill_slice(
        &self,
        (group, channel): (Group, usize),
        slice: Slice,
        empty: f32,
        out: &mut [f32],
    ) -> Result<()> {
        let length = self.table.grid().nodes.0[slice.spans()[1]];
        match &self.values {
            LevelValues::Volumes(volumes) => {
                let Some(volume) = &volumes[group.index()] else { return Ok(()) };
                let mut scratch = Vec::new();
                for (at, value) in out.chunks_exact_mut(1).enumerate() {
                    let node = slice.node(at / length, at % length);
                    volume.read_run(channel, node, value, &mut scratch, |_| {})?;
                }
            }
            LevelValues::Codes(codes) => {
                fill_slice(&codes.0, &codes.1, (group, channel), slice, out);
            }
            LevelValues::Rotated(rotated) => {
                let (level, rotation) = &**rotated;
                let sizes = self.table.grid().nodes.0;
                // Before the rotation, the nodes of the slice also share their index along one
                // axis.
                let axis = rotation.axes[slice.axis];
                let index = rotation.source(sizes, slice.node(0, 0))[axis];
                let before = Slice { axis, index };
                let [major, minor] = before.spans();
                let before_length = level.table.grid().nodes.0[minor];
                let mut values = vec![0.0; out.len()];
                let mut sums = vec![0.0; out.len()];
                for (channel, factor) in rotation.channel(group, channel) {
                    level.read_slice((group, channel), before, empty, &mut values)?;
                    for (at, sum) in sums.iter_mut().enumerate() {
                        let node = slice.node(at / length, at % length);
                        let node = rotation.source(sizes, node);
                        let value = values[node[major] * before_length + node[minor]];
                        *sum += factor * f64::from(value);
                    }
                }
                out.iter_mut().zip(sums).for_each(|(out, sum)| *out = sum as f32);
            }
        }
        Ok(())
    }

    /// All values of a group in one array.
    fn volume(
        &self,
        group: Group,
        stated: &LevelMetadata,
        layout: ColorLayout,
        budget: &mut Budget,
    ) -> Result<Option<Volume>> {
        if let LevelValues::Volumes(volumes) = &self.values {
            return Ok(volumes[group.index()].clone());
        }
        let Some(encoding) = stated.encoding(group) else { return Ok(None) };
        let nodes = self.table.grid().nodes;
        let [nx, ny, nz] = nodes.0;
        let channels = group.channels(layout);
        let number = size_of::<f32>();
        let (count, place) = (channels * nodes.count(), Place::Key(group.name().to_owned()));
        let mut bytes = budget.zeroed::<u8>(count * number, "bytes of dense values", &place)?;
        let mut planes: Vec<&mut [u8]> = bytes.chunks_exact_mut(ny * nz * number).collect();
        parallel::map_mut(&mut planes, |plane, out| {
            let mut values = vec![0.0; ny * nz];
            self.read_plane((group, plane / nx), plane % nx, encoding.empty, &mut values)?;
            let bytes = out.chunks_exact_mut(number).zip(values);
            bytes.for_each(|(bytes, value)| bytes.copy_from_slice(&value.to_le_bytes()));
            Ok(())
        })?;
        Ok(Some(Volume {
            nodes,
            channels,
            element: Element::F32,
            storage: Storage::Memory(bytes.into()),
            first: 0,
            strides: [nx * ny * nz, ny * nz, nz].map(|stride| stride as u64),
        }))
    }
}
