//! A trained field in memory.

use std::sync::Mutex;

use super::{
    Cell, CellPlace, OccupiedMacroCells, SampleLevels, SkipGrid, Values, interpolated_density,
    split,
};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::lock::lock;
use crate::base::progress::{Silent, Step};
use crate::levels::pyramid::SLAB;
use crate::levels::sizes::level_sizes;
use crate::levels::{
    Content, Direction, FieldPass, LevelFilter, Plane, PlaneSink, Pyramid, RequiredNodes, Verify,
    visible,
};
use crate::model::anisotropy::ANISOTROPY;
use crate::model::baked::DensityDomain;
use crate::model::directional::DIRECTIONAL;
use crate::model::field::{Nonfinite, RadianceField};
use crate::model::grid::{BoxFrame, NodeMask, Nodes};

/// The dense levels of a field.
#[derive(Debug)]
pub struct Dense<const C: usize> {
    nodes: Vec<Nodes>,
    /// Values of the levels, then of the shells.
    values: Vec<Values<C>>,
    /// Nodes and boxes of the shells.
    shells: Vec<(Nodes, BoxFrame)>,
    /// The box of level 0, if there are shells.
    first: Option<BoxFrame>,
    /// Skip grids, one per nested box.
    skip: Vec<SkipGrid>,
    /// Raw density of empty space.
    empty_raw: f32,
}

/// Values of a level's nodes, z fastest. Densities and anisotropy are empty if the level has
/// none.
#[derive(Debug)]
pub struct NodesMut<'a, const C: usize> {
    pub density: &'a mut [f32],
    pub anisotropy: &'a mut [[f32; ANISOTROPY]],
    pub color: &'a mut [[f32; C]],
}

impl<const C: usize> Dense<C> {
    /// Reads all of `field` and makes the levels of `filter`, up to the given number. Without a
    /// filter, there is only level 0.
    ///
    /// # Errors
    ///
    /// Errors of reading, values that are not finite, memory beyond `limits`, and `Usage` for
    /// coarser levels of a field with shells.
    pub fn new(
        field: &RadianceField,
        filter: Option<(&dyn LevelFilter, usize)>,
        limits: &Limits,
    ) -> Result<Self> {
        let place = Place::File;
        if filter.is_some() && !field.shells.is_empty() {
            let message = "a field of nested boxes has no filtered levels before it is baked";
            return Err(Error::usage(message));
        }
        let nodes = level_sizes(field.scene.nodes, filter.map_or(1, |(_, count)| count));
        let filter = filter.map(|(filter, _)| filter);
        let direction = filter.and_then(|filter| Direction::of(filter, field));
        let mut budget = Budget::new(limits);
        let mut values = Vec::new();
        for (level, size) in nodes.iter().enumerate() {
            let count = size.count();
            let has_density = level == 0 || filter.is_some_and(|filter| filter.has_density());
            let density = match has_density {
                true => Some(budget.zeroed(count, "bytes of density", &place)?),
                false => None,
            };
            budget.spend((count * C * 4) as u64, "bytes of colour", &place)?;
            let strides = [size.0[1] * size.0[2], size.0[2]];
            let domain = filter.map_or(DensityDomain::Raw, |filter| filter.density_domain(level));
            let color = vec![[0.0; C]; count];
            let anisotropy = match direction.filter(|_| level > 0) {
                Some(_) => {
                    let bytes = (count * ANISOTROPY * 4) as u64;
                    budget.spend(bytes, "bytes of anisotropy", &place)?;
                    vec![[0.0; ANISOTROPY]; count]
                }
                None => Vec::new(),
            };
            values.push(Values { density, domain, anisotropy, color, strides });
        }
        fill(field, filter, direction, &nodes, &mut values)?;
        let activation = &field.scene.activation;
        let mut visible: Vec<Vec<bool>> = Vec::new();
        for (&level_nodes, values) in nodes.iter().zip(&mut values) {
            let Some(density) = &mut values.density else {
                // Colour alone: level 0's cells.
                visible.push(visible[0].clone());
                continue;
            };
            let domain = values.domain;
            let place = CellPlace::same_box(level_nodes, nodes[0]);
            let mut cells =
                OccupiedMacroCells::new(level_nodes, nodes[0], place, domain, activation);
            let [nx, ny, nz] = level_nodes.0;
            let whole = [[0; 3], [nx - 1, ny - 1, nz - 1]];
            for (i, value) in density.iter_mut().enumerate() {
                *value = interpolated_density(activation, domain, *value);
                cells.mark([i / nz / ny, i / nz % ny, i % nz], *value, whole);
            }
            visible.push(cells.finish(nodes[0]));
        }
        let free_space = field.free_space.as_ref();
        let mut skip = vec![SkipGrid::new(nodes[0], &field.scene.bounds, free_space, &visible)?];
        let (frames, mut shells) = (field.frames(), Vec::new());
        for (number, frame) in frames.iter().enumerate().skip(1) {
            // Each is read as a field of one box.
            let Some(own) = field.of_shell(number) else { continue };
            let own = Self::new(&own, None, limits)?;
            shells.extend(own.nodes.iter().map(|&nodes| (nodes, *frame)));
            values.extend(own.values);
            skip.extend(own.skip);
        }
        let (first, empty_raw) = (frames.first().copied(), activation.empty_raw());
        Ok(Self { nodes, values, shells, first, skip, empty_raw })
    }
}

impl<const C: usize> Dense<C> {
    /// Densities and colours of a level's nodes, z fastest; no densities if the level has none.
    pub fn values(&self, level: usize) -> (&[f32], &[[f32; C]]) {
        let Values { density, color, .. } = &self.values[level];
        (density.as_deref().unwrap_or_default(), color)
    }

    /// Mutable densities, anisotropy and colours of a level's nodes. The skip grid does not follow
    /// changes.
    pub fn values_mut(&mut self, level: usize) -> NodesMut<'_, C> {
        let Values { density, anisotropy, color, .. } = &mut self.values[level];
        let density = density.as_deref_mut().unwrap_or_default();
        NodesMut { density, anisotropy, color }
    }

    /// Anisotropy of a level's nodes; empty if it has none.
    pub fn anisotropy(&self, level: usize) -> &[[f32; ANISOTROPY]] {
        &self.values[level].anisotropy
    }

    /// Moves a level's colours out.
    pub fn take_colors(&mut self, level: usize) -> Vec<[f32; C]> {
        std::mem::take(&mut self.values[level].color)
    }

    /// Distances of a level's neighbours along x and y, in nodes.
    pub fn strides(&self, level: usize) -> [usize; 2] {
        self.values[level].strides
    }

    /// The nodes at a cell's corners, and their interpolation weights.
    pub fn corners(&self, level: usize, cell: &Cell) -> [(usize, f32); 8] {
        let [x, y] = self.values[level].strides;
        let weight = |up: usize, fraction: f32| if up == 1 { fraction } else { 1.0 - fraction };
        std::array::from_fn(|corner| {
            let up = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let [fx, fy, fz] = cell.fraction;
            let weight = weight(up[0], fx) * weight(up[1], fy) * weight(up[2], fz);
            (cell.node + up[0] * x + up[1] * y + up[2], weight)
        })
    }
}

impl<const C: usize> SampleLevels<C> for Dense<C> {
    fn levels(&self) -> usize {
        self.nodes.len()
    }

    #[inline(always)]
    fn locate(&self, level: usize, position: [f64; 3]) -> Option<Cell> {
        let shell = level.checked_sub(self.nodes.len());
        let (Nodes([sx, sy, sz]), [px, py, pz]) = match shell.and_then(|at| self.shells.get(at)) {
            Some((nodes, frame)) => (*nodes, frame.place_within(position)),
            None => match &self.first {
                Some(frame) => (self.nodes[level], frame.place_within(position)),
                None => (self.nodes[level], position),
            },
        };
        let [(x, fx), (y, fy), (z, fz)] = [split(px, sx), split(py, sy), split(pz, sz)];
        Some(Cell { node: (x * sy + y) * sz + z, fraction: [fx, fy, fz] })
    }

    #[inline(always)]
    fn density(&self, level: usize, cell: &Cell, along: &[f32; ANISOTROPY]) -> f32 {
        self.values[level].density(cell, along)
    }

    #[inline(always)]
    fn color(&self, level: usize, cell: &Cell) -> [f32; C] {
        self.values[level].color(cell)
    }

    fn density_level(&self, level: usize) -> bool {
        self.values.get(level).is_some_and(|values| values.density.is_some())
    }

    fn density_domain(&self, level: usize) -> DensityDomain {
        self.values[level].domain
    }

    fn empty_density(&self, level: usize) -> f32 {
        if self.values[level].domain == DensityDomain::Raw { self.empty_raw } else { 0.0 }
    }

    fn empty_color(&self, _level: usize) -> [f32; C] {
        [0.0; C]
    }

    fn skip(&self, number: usize) -> &SkipGrid {
        &self.skip[number]
    }
}

/// Streams the field through its levels into the arrays.
fn fill<const C: usize>(
    field: &RadianceField,
    filter: Option<&dyn LevelFilter>,
    direction: Option<Direction>,
    nodes: &[Nodes],
    values: &mut [Values<C>],
) -> Result<()> {
    let planes = visible::masked_planes(field, Nonfinite::Refuse, &Silent)?;
    let channels = planes.channels();
    if channels - 1 > C {
        let found = format!("{} colour channels", channels - 1);
        return Err(Error::unsupported(Place::File, found, format!("at most {C}")));
    }
    let whole: Vec<NodeMask> = nodes.iter().map(|&nodes| NodeMask::full(nodes)).collect();
    let weights = filter.map_or_else(|| vec![1.0], |filter| filter.weights());
    let required = RequiredNodes::new(whole.clone(), None, &weights)?;
    let visibility = match filter {
        Some(filter) => visible::visibility(&planes, nodes, filter)?,
        None => None,
    };
    let content = match filter {
        Some(filter) => {
            let whole = whole.iter().collect();
            Content::of_levels(filter, visibility.as_ref(), field, whole, direction)
        }
        None => Content::Logits(0..channels),
    };
    let pass = FieldPass::new(&planes, Verify::Nothing);
    let levels = values.iter_mut().map(array_planes).collect();
    let pyramid =
        Pyramid { source: &pass, required: &required, content, slab: SLAB, pipelined: true };
    let sink = DenseSink { levels, channels, direction };
    pyramid.run(&sink, Step::Encode, &Silent)?;
    drop(pyramid);
    planes.accepted(pass.finish()?.nonfinite()).map(|_| ())
}

/// Copies planes into arrays.
struct DenseSink<'a, const C: usize> {
    /// Planes, by level.
    levels: Vec<Vec<Mutex<ArrayPlane<'a, C>>>>,
    /// Channels of level 0. Those of directional brightness follow, then those of anisotropy.
    channels: usize,
    direction: Option<Direction>,
}

impl<const C: usize> PlaneSink for DenseSink<'_, C> {
    fn plane(&self, Plane { level, x, channel, values }: Plane) -> Result<()> {
        let mut plane = lock(&self.levels[level][x]);
        let ArrayPlane { density, color, anisotropy } = &mut *plane;
        let has_brightness = self.direction.is_some_and(|of| of.has_brightness(level));
        let brightness =
            self.channels..self.channels + if has_brightness { DIRECTIONAL } else { 0 };
        let lane = match density {
            Some(density) if channel == 0 => {
                density.copy_from_slice(values);
                return Ok(());
            }
            _ if channel >= brightness.end => {
                let number = channel - brightness.end;
                anisotropy.iter_mut().zip(values).for_each(|(node, value)| node[number] = *value);
                return Ok(());
            }
            // The last lanes.
            _ if channel >= brightness.start => C - (brightness.end - channel),
            Some(_) => channel - 1,
            None => channel,
        };
        color.iter_mut().zip(values).for_each(|(node, value)| node[lane] = *value);
        Ok(())
    }
}

/// A plane of a level's arrays.
struct ArrayPlane<'a, const C: usize> {
    density: Option<&'a mut [f32]>,
    color: &'a mut [[f32; C]],
    anisotropy: &'a mut [[f32; ANISOTROPY]],
}

fn array_planes<const C: usize>(values: &mut Values<C>) -> Vec<Mutex<ArrayPlane<'_, C>>> {
    let length = values.strides[0];
    let mut density = values.density.as_mut().map(|all| all.chunks_exact_mut(length));
    let mut anisotropy = values.anisotropy.chunks_exact_mut(length);
    let plane = |color| {
        let density = density.as_mut().and_then(Iterator::next);
        let anisotropy = anisotropy.next().unwrap_or_default();
        Mutex::new(ArrayPlane { density, color, anisotropy })
    };
    values.color.chunks_exact_mut(length).map(plane).collect()
}
