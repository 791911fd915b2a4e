//! Changes to a container that is packed again.

use serde_json::{Value, json};

use super::edit::Placement;
use super::plan::activation_of;
use super::{LevelRule, MaxErrors, option_rules};
use crate::base::error::{Error, Result};
use crate::model::baked::{Encoding, Metadata};
use crate::model::field::{March, Scene};
use crate::model::grid::Bounds;
use crate::quantize::{Bits, planned_encoding};

/// Changes to a container.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Changes {
    /// Other bits, with ranges to match.
    pub bits: Option<Bits>,
    /// Use the fewest bits that keep this error of the container's values, 1e-6 to 0.25; overrides
    /// `bits`. Encodings with no more bits than that stay: they hold the values exactly.
    pub max_error: Option<MaxErrors>,
    /// Use the smallest errors that fit the new container into this many bytes; overrides `bits`
    /// and `max_error`. If no error is large enough, the finest levels are dropped.
    pub max_bytes: Option<u64>,
    /// Finest levels to drop.
    pub without_finest: usize,
    /// Outermost of nested boxes to drop, before anything else is changed.
    pub without_outermost: usize,
    /// Levels that stay, at most: the coarsest are dropped, after `without_finest`.
    pub levels: Option<usize>,
    /// The box outside which everything becomes empty, in world coordinates.
    pub crop: Option<Bounds>,
    /// Connected parts of level 0 with fewer visible nodes than this become empty.
    pub drop_islands: Option<u64>,
    /// The new placement of the container, applied after all edits: `crop` uses coordinates from
    /// before it.
    pub placement: Placement,
    /// Another compression level of zstd. Default: as the provenance says, else the bake's
    pub zstd_level: Option<i32>,
    /// Another rule of levels.
    pub lod_rule: Option<LevelRule>,
    /// Multiplies the rule's factor.
    pub lod_scale: Option<f32>,
    /// Start of rays.
    pub near: Option<f32>,
    /// Farthest entry of rays into the box.
    pub far: Option<f32>,
    /// Colour behind the field.
    pub background: Option<[f32; 3]>,
    /// Samples of at most this weight add no colour.
    pub color_threshold: Option<f32>,
}

impl Changes {
    /// Checks that every change is in its range, for a container whose rays have this `march`.
    ///
    /// # Errors
    ///
    /// [`crate::base::error::ErrorKind::InvalidOption`].
    pub fn check(&self, march: &March) -> Result<()> {
        self.placement.check()?;
        self.bits.map_or(Ok(()), option_rules::bits)?;
        self.levels.map_or(Ok(()), option_rules::levels)?;
        self.zstd_level.map_or(Ok(()), option_rules::zstd_level)?;
        self.lod_scale.map_or(Ok(()), option_rules::lod_scale)?;
        self.max_error.map_or(Ok(()), |max_error| max_error.check())?;
        self.near.map_or(Ok(()), option_rules::near)?;
        self.background.map_or(Ok(()), option_rules::background)?;
        self.color_threshold.map_or(Ok(()), option_rules::color_threshold)?;
        // One of the two may contradict the container's other one.
        let near = self.near.unwrap_or(march.near);
        let far = self.far.or(march.far).unwrap_or(f32::INFINITY);
        let (option, found, expected) = match self.far {
            Some(far) => ("far", far, format!("a distance beyond near, which is {near}")),
            None => ("near", near, format!("a distance below far, which is {far}")),
        };
        Error::require_option(far > near, option, found, &expected)
    }

    /// True if the changes alter pictures of the whole scene by more than quantization errors.
    pub(super) fn changes_the_scene(&self) -> bool {
        let cuts = self.crop.is_some() || self.drop_islands.is_some() || self.without_outermost > 0;
        cuts || !self.placement.is_identity() || self.background.is_some()
    }

    /// The requested bits; none if an error or a size was requested.
    pub(super) fn fixed_bits(&self) -> Option<Bits> {
        self.bits.filter(|_| self.max_error.is_none() && self.max_bytes.is_none())
    }

    /// Changes how rays are marched through a field.
    pub fn apply_to_scene(&self, scene: &mut Scene) {
        self.apply_to_march(&mut scene.march);
        scene.background = self.background.unwrap_or(scene.background);
    }

    fn apply_to_march(&self, march: &mut March) {
        march.near = self.near.unwrap_or(march.near);
        march.far = self.far.or(march.far);
        march.color_threshold = self.color_threshold.unwrap_or(march.color_threshold);
    }

    /// Changes everything that is stated in metadata alone: encodings by bits, the number of
    /// levels, rules.
    pub(super) fn apply(&self, metadata: &mut Metadata) {
        if let Some(bits) = self.fixed_bits() {
            let parts = metadata.parts().count();
            let own: Vec<_> = (0..parts).map(|part| activation_of(metadata, part)).collect();
            for (level, activation) in metadata.parts_mut().zip(own) {
                for (_, encoding) in level.encodings_mut() {
                    change(encoding, &planned_encoding(bits, encoding.decode, &activation));
                }
            }
        }
        metadata.levels.truncate(self.levels.unwrap_or(usize::MAX));
        if let Some(rule) = self.lod_rule {
            metadata.level_of_detail = rule.applied_to(metadata.level_of_detail);
        }
        let scale = self.lod_scale.unwrap_or(1.0);
        metadata.level_of_detail = metadata.level_of_detail.scaled(scale);
        self.apply_to_march(&mut metadata.march);
        metadata.background = self.background.unwrap_or(metadata.background);
    }

    /// As provenance and reports name them.
    pub fn to_json(&self) -> Value {
        let mut changes = json!({
            "bits": self.fixed_bits().map(|bits| bits.to_string()),
            "levels": self.levels,
            "zstd_level": self.zstd_level,
            "lod_scale": self.lod_scale,
            "near": self.near,
            "far": self.far,
            "background": self.background,
            "color_threshold": self.color_threshold,
        });
        if let Some(rule) = self.lod_rule {
            changes["lod_rule"] = rule.name().into();
        }
        if let Some(max_error) = self.max_error.filter(|_| self.max_bytes.is_none()) {
            changes["max_error"] = max_error.to_json();
        }
        if let Some(bytes) = self.max_bytes {
            changes["max_bytes"] = bytes.into();
        }
        if self.without_finest > 0 {
            changes["without_finest"] = self.without_finest.into();
        }
        if self.without_outermost > 0 {
            changes["without_outermost"] = self.without_outermost.into();
        }
        if let Some(crop) = &self.crop {
            changes["crop"] = json!(crop);
        }
        if let Some(nodes) = self.drop_islands {
            changes["drop_islands"] = nodes.into();
        }
        self.placement.add_to_json(&mut changes);
        changes
    }
}

/// Takes over another encoding. If the old one has as many bits, it stays, with its range.
fn change(encoding: &mut Encoding, to: &Encoding) {
    if (encoding.number, encoding.bits) != (to.number, to.bits) {
        *encoding = to.clone();
    }
}
