//! Density and colours at nodes, plane by plane.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::factors::Between;
use super::fit::Fit;
use super::keys::Arrays;
use super::model::{Scratch, Tensorf};
use super::shading::{STORED_FUNCTIONS, Shading};
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::model::field::NodeValues;
use crate::model::grid::{Nodes, row};
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};

/// Planes of colours that are kept, for their other channels.
const KEPT_PLANES: usize = 4;

/// A model that is loaded when the first node is asked for.
#[derive(Debug)]
pub(super) struct LazyModel {
    arrays: Arrays,
    limits: Limits,
    loaded: Mutex<Option<Arc<Tensorf>>>,
}

impl LazyModel {
    pub(super) fn new(arrays: Arrays, limits: &Limits) -> Self {
        Self { arrays, limits: limits.clone(), loaded: Mutex::new(None) }
    }

    fn get(&self) -> Result<Arc<Tensorf>> {
        let mut loaded = lock(&self.loaded);
        if let Some(model) = &*loaded {
            return Ok(Arc::clone(model));
        }
        let model = Arc::new(Tensorf::load(&self.arrays, &mut Budget::new(&self.limits))?);
        *loaded = Some(Arc::clone(&model));
        Ok(model)
    }

    /// Bytes of its factors; they are kept once, and once more while they are read.
    fn bytes(&self) -> u64 {
        let parts = self.arrays.density.iter().chain(&self.arrays.color).flatten();
        2 * parts.map(|part| part.tensor.bytes()).sum::<u64>()
    }

    fn nodes(&self) -> Nodes {
        self.arrays.settings.nodes
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Visits the nodes of a plane that belong to a region.
fn visit(nodes: Nodes, x: usize, region: &[u64], mut visit: impl FnMut(usize, &[Between; 3])) {
    let Nodes([_, _, nz]) = nodes;
    for (y, bits) in region.chunks_exact(row::words(nodes)).enumerate() {
        for (start, end) in row::runs(bits) {
            for z in start..end.min(nz) {
                visit(y * nz + z, &[Between::on(x), Between::on(y), Between::on(z)]);
            }
        }
    }
}

/// Density before its activation.
#[derive(Debug)]
pub(super) struct DensityValues(pub(super) Arc<LazyModel>);

impl NodeValues for DensityValues {
    fn nodes(&self) -> Nodes {
        self.0.nodes()
    }

    fn channels(&self) -> usize {
        1
    }

    fn memory_bytes(&self) -> u64 {
        self.0.bytes()
    }

    fn digest(&self, _: &mut dyn FnMut(&[u8])) -> Result<()> {
        // The digest of an archive has the checksums of all values.
        Ok(())
    }

    #[expect(clippy::cast_possible_truncation, reason = "densities are float32")]
    fn read(&self, _: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let model = self.0.get()?;
        let mut scratch = Scratch::default();
        visit(self.nodes(), x, region, |node, at| {
            if let Some(out) = out.get_mut(node) {
                *out = model.raw_density(at, &mut scratch) as f32;
            }
        });
        Ok(0)
    }
}

/// The colours of a field.
#[derive(Debug)]
pub(super) struct ColorValues {
    model: Arc<LazyModel>,
    /// Harmonics of the field; without them colours are plain.
    harmonics: Option<Harmonics>,
    /// Colours that do not depend on the view, of a model that has others.
    plain: bool,
    fit: Fit,
    kept: Mutex<Vec<Arc<Slot>>>,
}

/// A plane of colours.
#[derive(Debug)]
struct Slot {
    x: usize,
    filled: Mutex<Option<Filled>>,
}

#[derive(Debug)]
struct Filled {
    region: Vec<u64>,
    /// Channel by channel.
    values: Vec<f32>,
}

impl ColorValues {
    /// Colours with harmonics of these rules, reduced to band 0 as plain colours on request;
    /// without rules those of the model itself.
    pub(super) fn new(model: &Arc<LazyModel>, harmonics: Option<Harmonics>, plain: bool) -> Self {
        let fit = Fit::new(harmonics.map_or(1, |rules| rules.functions()));
        let kept = Mutex::new(Vec::new());
        Self { model: Arc::clone(model), harmonics, plain, fit, kept }
    }

    /// All channels of a node.
    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn node(&self, model: &Tensorf, at: &[Between; 3], scratch: &mut Scratch) -> Vec<f32> {
        let features = model.features(at, scratch);
        let Some(rules) = self.harmonics else {
            return features.into_iter().map(|value| value as f32).collect();
        };
        let coefficients: Vec<f32> = match &model.shading {
            // Stored colour by colour.
            Shading::Rgb | Shading::Harmonics => {
                let of_function = |function: usize| {
                    features.iter().skip(function).step_by(STORED_FUNCTIONS).take(3)
                };
                let functions = (0..rules.functions()).flat_map(of_function);
                functions.map(|value| *value as f32).collect()
            }
            shading @ Shading::Network(_) => {
                let mut place = [0.0; 3];
                for ((place, at), count) in place.iter_mut().zip(at).zip(self.nodes().0) {
                    *place = 2.0 * at.node() as f64 / (count - 1) as f64 - 1.0;
                }
                let offset = f64::from(rules.offset);
                let colors = self.fit.directions.iter().map(|&direction| {
                    shading.color(&features, place, direction).map(|value| value - offset)
                });
                let coefficients = self.fit.coefficients(colors);
                coefficients.into_iter().map(|value| value as f32).collect()
            }
        };
        match (self.plain, coefficients.as_slice()) {
            (true, &[red, green, blue, ..]) => {
                let band_0 = Harmonics { degree: 0, ..rules };
                band_0.color(&[BAND_0; FUNCTIONS], &[red, green, blue]).to_vec()
            }
            _ => coefficients,
        }
    }

    /// The plane's place among those that are kept.
    fn slot(&self, x: usize) -> Arc<Slot> {
        let mut kept = lock(&self.kept);
        if let Some(slot) = kept.iter().find(|slot| slot.x == x) {
            return Arc::clone(slot);
        }
        if kept.len() == KEPT_PLANES {
            kept.remove(0);
        }
        let slot = Arc::new(Slot { x, filled: Mutex::new(None) });
        kept.push(Arc::clone(&slot));
        slot
    }
}

impl NodeValues for ColorValues {
    fn nodes(&self) -> Nodes {
        self.model.nodes()
    }

    fn channels(&self) -> usize {
        match self.harmonics {
            Some(rules) if !self.plain => 3 * rules.functions(),
            _ => 3,
        }
    }

    fn memory_bytes(&self) -> u64 {
        let Nodes([_, ny, nz]) = self.nodes();
        (4 * KEPT_PLANES * self.channels() * ny * nz) as u64
    }

    fn digest(&self, _: &mut dyn FnMut(&[u8])) -> Result<()> {
        // The digest of an archive has the checksums of all values.
        Ok(())
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let slot = self.slot(x);
        let mut filled = lock(&slot.filled);
        let covers = |filled: &Filled| {
            filled.region.iter().zip(region).all(|(has, asked)| asked & !has == 0)
        };
        let plane = out.len();
        if !filled.as_ref().is_some_and(covers) {
            let model = self.model.get()?;
            let mut values = vec![0.0; plane * self.channels()];
            let mut scratch = Scratch::default();
            visit(self.nodes(), x, region, |node, at| {
                let channels = values.iter_mut().skip(node).step_by(plane);
                let found = self.node(&model, at, &mut scratch);
                channels.zip(found).for_each(|(out, value)| *out = value);
            });
            *filled = Some(Filled { region: region.to_vec(), values });
        }
        let values = filled.as_ref().map_or(&[][..], |filled| &filled.values);
        let values = values.get(channel * plane..).unwrap_or_default();
        out.iter_mut().zip(values).for_each(|(out, value)| *out = *value);
        Ok(0)
    }
}
