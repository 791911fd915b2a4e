//! A model with background spheres at the nodes of nested boxes.
//!
//! **The own box.** Its nodes are the centres of cells, with the model's own values. Beyond the
//! unit sphere, in the corners, the background is added: densities add up, and coefficients are
//! means by density. The nodes behind the faces hold only the background.
//!
//! **Boxes around it** hold the background, and with another resolution the own box is sampled like
//! them: nodes are means over their cells ([`crate::nested`]).

use std::sync::Arc;

use super::arrays::Arrays;
use super::spheres::{SphereFile, SpherePoint, SphereSpace, Spheres, Viewers, dot};
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::lazy::Lazy;
use crate::model::harmonics::{BAND_0, Harmonics};
use crate::nested::World;
use crate::sparse::{ColoredRows, LoadedRows};

/// Red, green and blue.
const COLORS: usize = 3;

/// A model, for sampling by boxes.
#[derive(Debug)]
pub(super) struct WholeFile {
    pub(super) arrays: Arrays,
    pub(super) spheres: Arc<SphereFile>,
    pub(super) space: SphereSpace,
    /// The viewpoints for the spheres.
    pub(super) viewers: Viewers,
    /// The step of a ray, in cells.
    pub(super) step_size: f64,
    /// The rules of the harmonics that a field keeps.
    pub(super) harmonics: Harmonics,
    /// True for colours instead of coefficients.
    pub(super) plain: bool,
    /// True if the own box is sampled like the others.
    pub(super) resampled: bool,
    pub(super) limits: Limits,
    pub(super) loaded: Lazy<Whole>,
}

/// A model in memory.
#[derive(Debug)]
pub(super) struct Whole {
    spheres: Arc<Spheres>,
    /// Rows of the own box, if it is sampled.
    foreground: Option<ColoredRows>,
}

impl Arrays {
    /// All rows in memory.
    pub(super) fn load(&self, limits: &Limits) -> Result<LoadedRows> {
        let [density, color] = self.columns;
        let files = match Arc::ptr_eq(&self.density, &self.color) {
            true => vec![&*self.density],
            false => vec![&*self.density, &*self.color],
        };
        LoadedRows::load(&self.index, &files, density, color, &mut Budget::new(limits))
    }
}

impl WholeFile {
    /// Channels of colour.
    pub(super) fn channels(&self) -> usize {
        COLORS * if self.plain { 1 } else { self.harmonics.functions() }
    }

    /// Radius of a world position, in half edges, and the spheres' value there.
    pub(super) fn background(&self, spheres: &Spheres, position: [f64; 3]) -> (f64, SpherePoint) {
        spheres.seen_at(&self.space, position, &self.viewers, self.step_size)
    }

    /// Channels of colour at a position, and its optical depth per world unit.
    pub(super) fn shown(&self, whole: &Whole, position: [f64; 3], channels: &mut [f64]) -> f64 {
        let (_, behind) = self.background(&whole.spheres, position);
        self.put(behind.coefficients, channels);
        let Some(rows) = &whole.foreground else { return behind.density };
        let at = rows.lattice.to_nodes(position);
        if !rows.lattice.contains(at) {
            return behind.density;
        }
        let cell = rows.rows.cell(rows.rows.clamped(at));
        let density = rows.rows.density(&cell).max(0.0);
        let sum = density + behind.density;
        let share = if sum > 0.0 { density / sum } else { 0.0 };
        if share > 0.0 {
            let mut coefficients = vec![0.0; COLORS * self.arrays.functions];
            rows.rows.coefficients(&cell, &mut coefficients);
            let own = coefficients.chunks_exact(self.arrays.functions);
            for (color, own) in own.enumerate() {
                let channels = channels.iter_mut().skip(color).step_by(COLORS);
                for (channel, coefficient) in channels.zip(own) {
                    let own = if self.plain { self.color(*coefficient) } else { *coefficient };
                    *channel += share * (own - *channel);
                }
            }
        }
        sum
    }

    /// Writes coefficients of band 0 as channels of colour.
    pub(super) fn put(&self, coefficients: [f64; 3], channels: &mut [f64]) {
        channels.fill(0.0);
        for (channel, value) in channels.iter_mut().zip(coefficients) {
            *channel = if self.plain { self.color(value) } else { value };
        }
    }

    /// The colour of a coefficient of band 0.
    fn color(&self, coefficient: f64) -> f64 {
        (coefficient * f64::from(BAND_0) + f64::from(self.harmonics.offset)).max(0.0)
    }

    /// The spheres.
    pub(super) fn spheres<'a>(&self, whole: &'a Whole) -> &'a Spheres {
        &whole.spheres
    }
}

impl World for WholeFile {
    type Loaded = Whole;

    fn load(&self) -> Result<Arc<Whole>> {
        self.loaded.get(|| {
            let spheres = self.spheres.load()?;
            let foreground = match self.resampled {
                true => Some(ColoredRows {
                    rows: self.arrays.load(&self.limits)?,
                    lattice: self.arrays.cells.lattice(),
                    stored: self.arrays.functions,
                    harmonics: Some(self.harmonics),
                }),
                false => None,
            };
            Ok(Whole { spheres, foreground })
        })
    }

    fn memory_bytes(&self) -> u64 {
        let arrays = &self.arrays;
        let width = arrays.density.width() + arrays.color.width();
        let rows = match self.resampled {
            true => {
                4 * (arrays.index.nodes().count() as u64 + arrays.density.rows() * width as u64)
            }
            false => 0,
        };
        self.spheres.memory_bytes() + rows
    }

    fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.spheres.digest(hash)
    }

    fn detail(&self, position: [f64; 3]) -> f64 {
        let at = self.space.place(position);
        let radius = dot(at, at).sqrt();
        let [edge, unit] = [0, 1].map(|kind| {
            let axes = self.space.radius.into_iter().zip(self.arrays.cells.cells.0);
            let of_axis = axes.map(|(radius, count)| match kind {
                0 => 2.0 * radius / count as f64,
                _ => radius,
            });
            of_axis.fold(f64::INFINITY, f64::min)
        });
        if radius < 1.0 {
            return edge;
        }
        let around = radius * std::f64::consts::PI / self.spheres.along() as f64;
        unit * around.min(radius * radius / self.spheres.layers() as f64)
    }

    fn densities(&self, whole: &Whole, positions: &[[f64; 3]], _: bool, densities: &mut Vec<f64>) {
        densities.extend(positions.iter().map(|position| {
            let (_, behind) = self.background(&whole.spheres, *position);
            let own = whole.foreground.as_ref().map_or(0.0, |rows| rows.density(*position));
            own.max(0.0) + behind.density
        }));
    }
}
