//! Density and harmonics at nodes, plane by plane.

use std::sync::Arc;

use super::evaluate::{Ngp, harmonics};
use super::file::NgpFile;
use super::frame::Frame;
use super::perceptron::{LANES, Lanes};
use crate::base::error::Result;
use crate::input::network::{Fit, PlaneCache, visit};
use crate::model::activate;
use crate::model::field::{EMPTY_LOGIT, NodeValues};
use crate::model::grid::Nodes;
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};

/// Optical depth of a voxel from which nothing is seen behind it.
const OPAQUE: f64 = 60.0;

/// Nodes at which a model is evaluated: `side` along each axis of its cube.
#[derive(Debug, Clone)]
pub(super) struct Samples {
    pub(super) file: Arc<NgpFile>,
    pub(super) side: usize,
}

impl Samples {
    /// Edges of the unit cube between two nodes.
    fn spacing(&self) -> f64 {
        1.0 / (self.side - 1) as f64
    }

    /// Calls `see` with up to [`LANES`] nodes of a region at a time, and what the density network
    /// makes of them. Nodes that touch no occupied cell are left out.
    fn for_each(
        &self,
        model: &Ngp,
        x: usize,
        region: &[u64],
        mut see: impl FnMut(&[[usize; 2]], &[Lanes]),
    ) {
        let (mut nodes, mut positions) = (Vec::new(), Vec::new());
        let spacing = self.spacing();
        let mut found = |nodes: &mut Vec<[usize; 2]>, positions: &mut Vec<[f64; 3]>| {
            see(nodes, &model.geometry(positions));
            nodes.clear();
            positions.clear();
        };
        visit(Nodes([self.side; 3]), region, |[y, z]| {
            let at = Frame::turned([x, y, z].map(|at| at as f64 * spacing));
            if !self.file.occupancy.touches(at, spacing) {
                return;
            }
            nodes.push([y, z]);
            positions.push(at);
            if nodes.len() == LANES {
                found(&mut nodes, &mut positions);
            }
        });
        if !nodes.is_empty() {
            found(&mut nodes, &mut positions);
        }
    }
}

/// Raw densities: logits of the optical depth of a voxel.
#[derive(Debug)]
pub(super) struct DensityValues(pub(super) Samples);

impl NodeValues for DensityValues {
    fn nodes(&self) -> Nodes {
        Nodes([self.0.side; 3])
    }

    fn channels(&self) -> usize {
        1
    }

    fn memory_bytes(&self) -> u64 {
        self.0.file.memory_bytes()
    }

    fn digest(&self, see: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.0.file.digest(see)
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn read(&self, _: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let model = self.0.file.load()?;
        out.fill(EMPTY_LOGIT);
        let spacing = self.0.spacing();
        self.0.for_each(&model, x, region, |nodes, geometry| {
            for (&[y, z], density) in nodes.iter().zip(model.densities(geometry)) {
                if let Some(out) = out.get_mut(y * self.0.side + z) {
                    let depth = (density * spacing).min(OPAQUE);
                    let raw = activate::inverse_softplus(depth);
                    *out = raw.max(EMPTY_LOGIT.into()) as f32;
                }
            }
        });
        Ok(0)
    }
}

/// Coefficients of harmonics, fitted to the colours.
#[derive(Debug)]
pub(super) struct ColorValues {
    samples: Samples,
    rules: Harmonics,
    /// True for the colours of band 0 alone.
    plain: bool,
    fit: Fit,
    directions: Vec<[Lanes; FUNCTIONS]>,
    planes: PlaneCache,
}

impl ColorValues {
    /// Of rules; `plain` for colours that do not depend on the view.
    pub(super) fn new(samples: Samples, rules: Harmonics, plain: bool) -> Self {
        let fit = Fit::new(rules.functions());
        let directions = harmonics(&fit.directions);
        Self { samples, rules, plain, fit, directions, planes: PlaneCache::default() }
    }
}

impl NodeValues for ColorValues {
    fn nodes(&self) -> Nodes {
        Nodes([self.samples.side; 3])
    }

    fn channels(&self) -> usize {
        if self.plain { 3 } else { 3 * self.rules.functions() }
    }

    fn memory_bytes(&self) -> u64 {
        PlaneCache::bytes(self.nodes(), self.channels())
    }

    fn digest(&self, see: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.samples.file.digest(see)
    }

    #[expect(clippy::cast_possible_truncation, reason = "coefficients are float32")]
    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let plane = out.len();
        let offset = f64::from(self.rules.offset);
        self.planes.read(x, [channel, self.channels()], region, out, |values| {
            let model = self.samples.file.load()?;
            self.samples.for_each(&model, x, region, |nodes, geometry| {
                for (lane, &[y, z]) in nodes.iter().enumerate() {
                    let colors = model.colors_along(geometry, lane, &self.directions);
                    let colors = colors.into_iter().take(self.fit.directions.len());
                    let off = colors.map(|color| color.map(|value| value - offset));
                    let mut found = self.fit.coefficients(off);
                    if self.plain {
                        let band_0 = f64::from(BAND_0);
                        found.iter_mut().for_each(|value| *value = *value * band_0 + offset);
                    }
                    let out = values.iter_mut().skip(y * self.samples.side + z).step_by(plane);
                    out.zip(found).for_each(|(out, value)| *out = value as f32);
                }
            });
            Ok(())
        })?;
        Ok(0)
    }
}
