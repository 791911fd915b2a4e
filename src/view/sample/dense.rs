//! A field as trained, in memory.

use std::sync::{Mutex, PoisonError};

use super::level::{Cell, Values, split};
use super::skip::{OccupiedMacroCells, SkipGrid};
use super::{Sample, interpolated_density};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::levels::mips::{
    Cascade, Kernel, Lift, Matter, Regions, SLAB, Settled, Settlers, level_sizes,
};
use crate::levels::prune;
use crate::model::baked::DensityDomain;
use crate::model::field::{EMPTY_DENSITY, Nonfinite, RadianceField};
use crate::model::grid::{NodeMask, Nodes};

/// Coarser levels to make of a trained field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Levels {
    /// Levels in all, at most.
    pub most: usize,
    /// The low-pass before each halving.
    pub kernel: Kernel,
    /// Whether coarser levels have density of their own.
    pub density: bool,
    /// What is averaged, where it is not raw values.
    pub matter: Option<Matter>,
}

impl Levels {
    /// What densities of a level mean.
    pub fn density_domain(&self, level: usize) -> DensityDomain {
        match self.matter.filter(|_| level > 0).map(|matter| matter.settled) {
            None => DensityDomain::Raw,
            Some(Settled::SqrtOpticalDepth) => DensityDomain::SqrtOpticalDepth,
            Some(Settled::Opacity) => DensityDomain::Opacity,
        }
    }

    /// Level 0 alone.
    pub const FINEST: Self = Self { most: 1, kernel: Kernel::None, density: true, matter: None };
}

/// Dense levels.
#[derive(Debug)]
pub struct Dense<const C: usize> {
    nodes: Vec<Nodes>,
    values: Vec<Values<C>>,
    skip: SkipGrid,
}

impl<const C: usize> Dense<C> {
    /// Reads all of `field` and makes its levels.
    pub fn new(field: &RadianceField, levels: Levels, limits: &Limits) -> Result<Self> {
        let place = Place::File;
        let nodes = level_sizes(field.scene.nodes, levels.most);
        let mut budget = Budget::new(limits);
        let mut values = Vec::new();
        for (level, size) in nodes.iter().enumerate() {
            let count = size.count();
            let has_density = level == 0 || levels.density;
            let density = match has_density {
                true => Some(budget.zeroed(count, "bytes of density", &place)?),
                false => None,
            };
            budget.spend((count * C * 4) as u64, "bytes of colour", &place)?;
            let strides = [size.0[1] * size.0[2], size.0[2]];
            let domain = levels.density_domain(level);
            values.push(Values { density, domain, color: vec![[0.0; C]; count], strides });
        }
        fill(field, levels, &nodes, &mut values)?;
        let activation = &field.scene.activation;
        let mut seen: Vec<Vec<bool>> = Vec::new();
        for (&nodes_of_level, values) in nodes.iter().zip(&mut values) {
            let Some(density) = &mut values.density else {
                // Colour alone: what level 0 shows.
                seen.push(seen[0].clone());
                continue;
            };
            let domain = values.domain;
            let mut cells = OccupiedMacroCells::new(nodes_of_level, nodes[0], domain, activation);
            let [nx, ny, nz] = nodes_of_level.0;
            let whole = [[0; 3], [nx - 1, ny - 1, nz - 1]];
            for (i, value) in density.iter_mut().enumerate() {
                *value = interpolated_density(activation, domain, *value);
                cells.mark([i / nz / ny, i / nz % ny, i % nz], *value, whole);
            }
            seen.push(cells.finish(nodes[0]));
        }
        let skip = SkipGrid::new(nodes[0], &field.scene.bounds, field.free_space.as_ref(), &seen)?;
        Ok(Self { nodes, values, skip })
    }
}

impl<const C: usize> Dense<C> {
    /// Densities and colours of a level's nodes, z fastest; no densities where the level has none.
    pub fn values(&self, level: usize) -> (&[f32], &[[f32; C]]) {
        let Values { density, color, .. } = &self.values[level];
        (density.as_deref().unwrap_or_default(), color)
    }

    /// The same, to be changed. What can be skipped stays.
    pub fn values_mut(&mut self, level: usize) -> (&mut [f32], &mut [[f32; C]]) {
        let Values { density, color, .. } = &mut self.values[level];
        (density.as_deref_mut().unwrap_or_default(), color)
    }

    /// The nodes that a cell's values come from, and their weights.
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

impl<const C: usize> Sample<C> for Dense<C> {
    fn levels(&self) -> usize {
        self.nodes.len()
    }

    #[inline(always)]
    fn locate(&self, level: usize, position: [f64; 3]) -> Option<Cell> {
        let Nodes(sizes) = self.nodes[level];
        let [(x, fx), (y, fy), (z, fz)] = [0, 1, 2].map(|a| split(position[a], sizes[a]));
        Some(Cell { node: (x * sizes[1] + y) * sizes[2] + z, fraction: [fx, fy, fz] })
    }

    #[inline(always)]
    fn density(&self, level: usize, cell: &Cell) -> f32 {
        self.values[level].density(cell)
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
        if self.values[level].domain == DensityDomain::Raw { EMPTY_DENSITY } else { 0.0 }
    }

    fn empty_color(&self, _level: usize) -> [f32; C] {
        [0.0; C]
    }

    fn skip(&self) -> &SkipGrid {
        &self.skip
    }
}

/// Streams the field through its levels into the arrays.
fn fill<const C: usize>(
    field: &RadianceField,
    levels: Levels,
    nodes: &[Nodes],
    values: &mut [Values<C>],
) -> Result<()> {
    let planes = prune::masked_planes(field, Nonfinite::Refuse)?;
    let channels = planes.channels();
    if channels - 1 > C {
        let found = format!("{} colour channels", channels - 1);
        return Err(Error::unsupported(Place::File, found, format!("at most {C}")));
    }
    let whole: Vec<NodeMask> = nodes.iter().map(|&nodes| NodeMask::full(nodes)).collect();
    let regions = Regions::new(whole.clone(), None, levels.kernel)?;
    let visibility = match levels.matter.filter(|_| nodes.len() > 1) {
        Some(matter) => Some(prune::visibility(&planes, nodes, levels.kernel, matter)?),
        None => None,
    };
    let lift = Lift::of_levels(levels.matter.zip(visibility.as_ref()), levels.density, channels);
    let settlers = Settlers::new(levels.matter, channels, &whole);
    let values: Vec<Vec<Mutex<PlaneOf<C>>>> = values.iter_mut().map(Values::planes).collect();
    let put = |level: usize, x: usize, channel, plane: &mut [f32]| {
        values[level][x].lock().unwrap_or_else(PoisonError::into_inner).put(channel, plane);
        Ok(())
    };
    Cascade::new(&regions, channels, lift, SLAB).run(
        |x, channel, region, plane| {
            planes.read(channel, x, region, plane)?;
            put(0, x, channel, plane)
        },
        |level, x, channel, plane| settlers.pass([level, x, channel], plane, put),
        |level, planes| settlers.settle(level, planes, put, |_| Ok(())),
    )?;
    planes.take_nonfinite().map(|_| ()).map_err(|error| match error.kind() {
        ErrorKind::NonFinite { .. } => error,
        _ => Error::malformed(Place::File, error.to_string(), "a readable field"),
    })
}

/// A plane of a level's arrays.
struct PlaneOf<'a, const C: usize> {
    density: Option<&'a mut [f32]>,
    color: &'a mut [[f32; C]],
}

impl<const C: usize> Values<C> {
    fn planes(&mut self) -> Vec<Mutex<PlaneOf<'_, C>>> {
        let length = self.strides[0];
        let mut density = self.density.as_mut().map(|all| all.chunks_exact_mut(length));
        let plane = |color| {
            let density = density.as_mut().and_then(Iterator::next);
            Mutex::new(PlaneOf { density, color })
        };
        self.color.chunks_exact_mut(length).map(plane).collect()
    }
}

impl<const C: usize> PlaneOf<'_, C> {
    /// Copies a channel, of which density is the first where the level has it.
    fn put(&mut self, channel: usize, values: &[f32]) {
        match (&mut self.density, channel) {
            (Some(density), 0) => density.copy_from_slice(values),
            (density, _) => {
                let lane = channel - usize::from(density.is_some());
                for (node, &value) in self.color.iter_mut().zip(values) {
                    node[lane] = value;
                }
            }
        }
    }
}
