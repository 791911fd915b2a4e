//! Colours at nodes, plane by plane.

use std::sync::Arc;

use super::keys::Arrays;
use super::shading::STORED_FUNCTIONS;
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::base::progress::Progress;
use crate::factors::{Mixed, Scratch, Tap};
use crate::lazy::Lazy;
use crate::model::field::NodeValues;
use crate::model::grid::Nodes;
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};
use crate::network::{PlaneCache, visit};

/// The colours of a field whose model stores them.
#[derive(Debug)]
pub(super) struct ColorValues {
    arrays: Arrays,
    limits: Limits,
    features: Lazy<Mixed>,
    /// Harmonics of the field; without them colours are plain.
    harmonics: Option<Harmonics>,
    /// View-independent colours of a model with view-dependent ones.
    plain: bool,
    planes: PlaneCache,
}

impl ColorValues {
    /// Colours with harmonics of these rules, reduced to band 0 as plain colours on request;
    /// without rules, the model's own.
    pub(super) fn new(
        arrays: &Arrays,
        harmonics: Option<Harmonics>,
        plain: bool,
        limits: &Limits,
    ) -> Self {
        let (arrays, limits) = (arrays.clone(), limits.clone());
        let (features, planes) = (Lazy::default(), PlaneCache::with_archive());
        Self { arrays, limits, features, harmonics, plain, planes }
    }

    fn features(&self) -> Result<Arc<Mixed>> {
        self.features.get(|| self.arrays.features.load(&mut Budget::new(&self.limits)))
    }

    /// All channels of a node.
    #[expect(clippy::cast_possible_truncation, reason = "colours are float32")]
    fn node(&self, features: &Mixed, at: &[Tap; 3], scratch: &mut Scratch) -> Vec<f32> {
        let features = features.values(at, scratch);
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
        self.arrays.settings.nodes
    }

    fn channels(&self) -> usize {
        match self.harmonics {
            Some(rules) if !self.plain => 3 * rules.functions(),
            _ => 3,
        }
    }

    fn memory_bytes(&self) -> u64 {
        // Factors are held twice while they are read.
        2 * self.arrays.features.bytes() + self.planes.bytes(self.nodes(), self.channels())
    }

    fn digest(&self, _: &mut dyn FnMut(&[u8])) -> Result<()> {
        // The digest of an archive includes the checksums of all values.
        Ok(())
    }

    fn prepare(&self, _: &dyn Progress) -> Result<()> {
        self.features().map(drop)
    }

    fn read(&self, channel: usize, x: usize, region: &[u64], out: &mut [f32]) -> Result<u64> {
        let (plane, channels) = (out.len(), self.channels());
        let Nodes([_, _, nz]) = self.nodes();
        let features = self.features()?;
        self.planes.read(self.nodes(), x, [channel, channels], region, out, |region, values| {
            let mut scratch = Scratch::default();
            visit(self.nodes(), region, |[y, z]| {
                let out = values.iter_mut().skip(y * nz + z).step_by(plane);
                let found = self.node(&features, &[x, y, z].map(Tap::on), &mut scratch);
                out.zip(found).for_each(|(out, value)| *out = value);
            });
            Ok(())
        })?;
        Ok(0)
    }
}
