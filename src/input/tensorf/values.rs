//! Density and colours at nodes, plane by plane.

use std::sync::{Arc, Mutex};

use super::factors::Between;
use super::keys::Arrays;
use super::model::{Scratch, Tensorf};
use super::shading::STORED_FUNCTIONS;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::input::network::{NodeFeatures, PlaneCache, lock, visit};
use crate::model::field::NodeValues;
use crate::model::grid::Nodes;
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};

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
        let Nodes([_, _, nz]) = self.nodes();
        visit(self.nodes(), region, |[y, z]| {
            if let Some(out) = out.get_mut(y * nz + z) {
                *out = model.raw_density(&[x, y, z].map(Between::on), &mut scratch) as f32;
            }
        });
        Ok(0)
    }
}

/// The inputs of the network.
#[derive(Debug)]
pub(super) struct Features(pub(super) Arc<LazyModel>);

impl NodeFeatures for Features {
    fn nodes(&self) -> Nodes {
        self.0.nodes()
    }

    fn memory_bytes(&self) -> u64 {
        // Those of density stand for the factors.
        0
    }

    fn digest(&self, _: &mut dyn FnMut(&[u8])) -> Result<()> {
        // The digest of an archive has the checksums of all values.
        Ok(())
    }

    fn visit(
        &self,
        x: usize,
        region: &[u64],
        see: &mut dyn FnMut([usize; 2], &[f64]),
    ) -> Result<()> {
        let model = self.0.get()?;
        let mut scratch = Scratch::default();
        visit(self.nodes(), region, |[y, z]| {
            let at = [x, y, z].map(Between::on);
            see([y, z], &model.features(&at, &mut scratch));
        });
        Ok(())
    }
}

/// The colours of a field that are stored.
#[derive(Debug)]
pub(super) struct ColorValues {
    model: Arc<LazyModel>,
    /// Harmonics of the field; without them colours are plain.
    harmonics: Option<Harmonics>,
    /// Colours that do not depend on the view, of a model that has others.
    plain: bool,
    planes: PlaneCache,
}

impl ColorValues {
    /// Colours with harmonics of these rules, reduced to band 0 as plain colours on request;
    /// without rules those of the model itself.
    pub(super) fn new(model: &Arc<LazyModel>, harmonics: Option<Harmonics>, plain: bool) -> Self {
        Self { model: Arc::clone(model), harmonics, plain, planes: PlaneCache::default() }
    }

    /// All channels of a node.
    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn node(&self, model: &Tensorf, at: &[Between; 3], scratch: &mut Scratch) -> Vec<f32> {
        let features = model.features(at, scratch);
        let Some(rules) = self.harmonics else {
            return features.into_iter().map(|value| value as f32).collect();
        };
        // Stored colour by colour.
        let of_function =
            |function: usize| features.iter().skip(function).step_by(STORED_FUNCTIONS).take(3);
        let functions = (0..rules.functions()).flat_map(of_function);
        let coefficients: Vec<f32> = functions.map(|value| *value as f32).collect();
        match (self.plain, coefficients.as_slice()) {
            (true, &[red, green, blue, ..]) => {
                let band_0 = Harmonics { degree: 0, ..rules };
                band_0.color(&[BAND_0; FUNCTIONS], &[red, green, blue]).to_vec()
            }
            _ => coefficients,
        }
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
        PlaneCache::bytes(self.nodes(), self.channels())
    }

    fn digest(&self, _: &mut dyn FnMut(&[u8])) -> Result<()> {
        // The digest of an archive has the checksums of all values.
        Ok(())
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let (plane, channels) = (out.len(), self.channels());
        let Nodes([_, _, nz]) = self.nodes();
        self.planes.read(self.nodes(), x, [channel, channels], region, out, |region, values| {
            let model = self.model.get()?;
            let mut scratch = Scratch::default();
            visit(self.nodes(), region, |[y, z]| {
                let out = values.iter_mut().skip(y * nz + z).step_by(plane);
                let found = self.node(&model, &[x, y, z].map(Between::on), &mut scratch);
                out.zip(found).for_each(|(out, value)| *out = value);
            });
            Ok(())
        })?;
        Ok(0)
    }
}
