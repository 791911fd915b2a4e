//! The options of a bake.

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::{MaxErrors, Photographs, option_rules};
use crate::base::bytes::hex;
use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::container::LARGEST_BLOCK;
use crate::levels::{Filter, LevelFilter, LevelRule, SharedFilter};
use crate::model::baked::{LevelOfDetail, Metadata};
use crate::model::camera::{Camera, digest};
use crate::model::field::Nonfinite;
use crate::quantize::Bits;

/// Default compression level of zstd: the highest level that is not a bottleneck.
pub(super) const DEFAULT_ZSTD_LEVEL: i32 = 1;

/// Maximum number of steps, far more than any fit needs.
const MAX_FIT_STEPS: usize = 100_000;

/// Options of a bake.
///
/// In serialized form, keys are the field names, and missing keys take their defaults. Cameras and
/// limits are not serialized.
///
/// ```
/// use mipvog::{BakeOptions, Filter};
///
/// let options: BakeOptions = serde_json::from_str(r#"{"filter": "paper", "bits": "12"}"#)?;
/// assert_eq!(options, BakeOptions::default().with_filter(Filter::Paper).with_bits("12".parse()?));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BakeOptions {
    /// Filter that makes the coarser levels. Default: [`Filter::RateTent`], made for distant views
    pub filter: SharedFilter,
    /// Maximum number of levels. Default: levels down to 4 nodes along the longest axis
    pub levels: Option<usize>,
    /// Bits per code. Default: 8
    pub bits: Bits,
    /// Largest allowed error of a decoded value at any retained node of any level: of opacity over
    /// one interval, and of colours and features from 0 to 1. The error ranges from 1e-6 to 0.25.
    /// Each group of each level gets the fewest sufficient bits, and `bits` is ignored. Default:
    /// none, `bits` is used
    pub max_error: Option<MaxErrors>,
    /// Maximum size of the container in bytes. A bake finds the smallest errors that fit. If none
    /// fits, the finest levels are dropped. `bits`, `max_error` and `nearby_coarseness` are
    /// ignored. Default: unlimited
    pub max_bytes: Option<u64>,
    /// Blocks are dropped if their opacity over one interval never exceeds this. Default: 1e-3
    pub alpha_threshold: f32,
    /// Nodes along each edge of a block. Default: 8
    pub block_size: usize,
    /// Compression level of zstd, 1 to 22. Default: 1
    pub zstd_level: i32,
    /// Rule that picks the level of a sample. Default: the filter's own; a fit finds its own
    pub lod_rule: Option<LevelRule>,
    /// Factor on the slope of the rule that picks levels. Default: 1
    pub lod_scale: f32,
    /// Maximum number of steps of [`Filter::Fit`]; each step changes all levels. Default: 130
    pub fit_steps: usize,
    /// Time limit of a fit in seconds. With a limit, the result depends on the machine. Default:
    /// unlimited
    pub fit_seconds: Option<f64>,
    /// Cameras of the pictures that a fit uses. Default: none, a fit places cameras on spheres
    /// around the box
    #[serde(skip)]
    pub fit_cameras: Vec<Camera>,
    /// Photographs from the [`fit_cameras`](Self::fit_cameras), the target of a fit. Default: none,
    /// the target is pictures of level 0
    #[serde(skip)]
    pub photographs: Option<Photographs>,
    /// Nodes are dropped if they add less than this to every pixel of
    /// [`seen_from`](Self::seen_from); above 0 to 1. Default: none, all visible nodes are kept
    pub min_weight: Option<f32>,
    /// How far colours may move, in codes, at nodes of average weight in the pictures of
    /// [`seen_from`](Self::seen_from). Nodes of less weight may move further. 0 to 64. Default: 0
    pub coarseness: f32,
    /// How far colours may move, in codes, at nodes of importance 1 to viewers in the empty space
    /// around them ([`crate::levels::importance`]). Less important nodes may move further. Takes
    /// effect only if `coarseness` is 0, `fill_error` is none and levels average alpha. 0 to 64.
    /// Default: 0
    pub nearby_coarseness: f32,
    /// A block inherits its colours from the next coarser level if that changes colours and
    /// features by at most this, 0 to 1, in addition to the error of codes. With
    /// [`seen_from`](Self::seen_from), the error applies at nodes of average importance and is
    /// larger at less important ones. Default: none, all colours are stored
    pub fill_error: Option<f32>,
    /// Cameras of `min_weight` and `coarseness`. Default: none
    #[serde(skip)]
    pub seen_from: Vec<Camera>,
    /// Memory limit in bytes. The result does not depend on it. Default: unlimited
    pub memory: Option<u64>,
    /// Treatment of values that are not finite. Default: refuse
    pub nonfinite: Nonfinite,
    /// Limits on sizes and memory. The result does not depend on them. Default: the limits for
    /// untrusted files
    #[serde(skip)]
    pub limits: Limits,
}

impl Default for BakeOptions {
    fn default() -> Self {
        Self {
            filter: Filter::RateTent.into(),
            levels: None,
            bits: Bits::Integer(8),
            max_error: None,
            max_bytes: None,
            alpha_threshold: 1e-3,
            block_size: 8,
            zstd_level: DEFAULT_ZSTD_LEVEL,
            lod_rule: None,
            lod_scale: 1.0,
            fit_steps: 130,
            fit_seconds: None,
            fit_cameras: Vec::new(),
            photographs: None,
            min_weight: None,
            coarseness: 0.0,
            nearby_coarseness: 0.0,
            fill_error: None,
            seen_from: Vec::new(),
            memory: None,
            nonfinite: Nonfinite::Refuse,
            limits: Limits::default(),
        }
    }
}

impl BakeOptions {
    /// Sets the filter: a built-in one, or any type that implements [`LevelFilter`].
    #[must_use]
    pub fn with_filter(mut self, filter: impl LevelFilter + 'static) -> Self {
        self.filter = filter.into();
        self
    }

    /// Sets the maximum number of levels.
    #[must_use]
    pub fn with_levels(mut self, levels: usize) -> Self {
        self.levels = Some(levels);
        self
    }

    /// Sets the bits per code.
    #[must_use]
    pub fn with_bits(mut self, bits: Bits) -> Self {
        self.bits = bits;
        self
    }

    /// Sets the largest allowed error: one number for all groups, or one per group.
    #[must_use]
    pub fn with_max_error(mut self, max_error: impl Into<MaxErrors>) -> Self {
        self.max_error = Some(max_error.into());
        self
    }

    /// The options that made a container, from its metadata and provenance.
    pub fn of_container(metadata: &Metadata, provenance: &serde_json::Value) -> Self {
        let mut options = Self::default();
        options.filter =
            metadata.filter.parse::<Filter>().map_or(options.filter, SharedFilter::from);
        options.levels = Some(metadata.levels.len());
        options.alpha_threshold = metadata.alpha_threshold;
        if let Some(finest) = metadata.levels.first() {
            options.block_size = finest.block_size;
            options.bits = finest.diffuse.as_ref().map_or(options.bits, Bits::of);
        }
        options.max_error = MaxErrors::from_json(&provenance["options"]["max_error"]);
        let zstd_level = provenance["options"]["zstd_level"].as_i64();
        let zstd_level = zstd_level.and_then(|level| i32::try_from(level).ok());
        options.zstd_level = zstd_level.unwrap_or(options.zstd_level);
        options
    }

    /// True if the result depends on the cameras of [`seen_from`](Self::seen_from).
    pub fn sees(&self) -> bool {
        self.min_weight.is_some() || self.coarseness > 0.0
    }

    /// True if the result depends on the importance of nodes to nearby viewers.
    pub(super) fn is_seen_nearby(&self) -> bool {
        let is_moved = match self.max_bytes {
            Some(_) => true,
            None => self.nearby_coarseness > 0.0,
        };
        // A requested error of inherited colours holds at every node.
        self.coarseness == 0.0 && self.fill_error.is_none() && is_moved
    }

    /// True if every value of a stored block is kept exactly, even at invisible nodes.
    pub(super) fn keeps_blocks(&self) -> bool {
        self.bits == Bits::F32 && self.max_error.is_none() && self.max_bytes.is_none()
    }

    /// True if a bake holds a whole level at once, so no memory bound applies.
    pub(super) fn holds_level(&self) -> bool {
        self.filter.is_fitted() || self.sees() || self.fill_error.is_some()
    }

    /// The rule that picks the level of a sample.
    pub(super) fn level_of_detail(&self) -> LevelOfDetail {
        let own = self.filter.rule();
        let rule = self.lod_rule.map_or(own, |rule| rule.applied_to(own));
        rule.scaled(self.lod_scale)
    }

    /// Checks that all options are in range and consistent.
    ///
    /// # Errors
    ///
    /// [`crate::base::error::ErrorKind::InvalidOption`].
    pub fn check(&self) -> Result<()> {
        option_rules::bits(self.bits)?;
        self.levels.map_or(Ok(()), option_rules::levels)?;
        let alpha = self.alpha_threshold;
        Error::require_option(
            (1e-9..1.0).contains(&alpha),
            "alpha_threshold",
            alpha,
            "1e-9 to below 1",
        )?;
        let block = self.block_size;
        Error::require_option(
            (1..=LARGEST_BLOCK).contains(&block),
            "block_size",
            block,
            "1 to 64",
        )?;
        option_rules::zstd_level(self.zstd_level)?;
        let steps = self.fit_steps;
        Error::require_option(steps <= MAX_FIT_STEPS, "fit_steps", steps, "at most 100000")?;
        let seconds = self.fit_seconds.unwrap_or(1.0);
        Error::require_option(seconds > 0.0, "fit_seconds", seconds, "a number above 0")?;
        let is_share = |value: f32| value > 0.0 && value <= 1.0;
        let weight = self.min_weight.unwrap_or(1.0);
        Error::require_option(is_share(weight), "min_weight", weight, "above 0 and at most 1")?;
        for (name, codes) in
            [("coarseness", self.coarseness), ("nearby_coarseness", self.nearby_coarseness)]
        {
            Error::require_option((0.0..=64.0).contains(&codes), name, codes, "0 to 64")?;
        }
        let fill = self.fill_error.unwrap_or(1.0);
        Error::require_option(is_share(fill), "fill_error", fill, "above 0 and at most 1")?;
        let has_floats = matches!(self.bits, Bits::F16 | Bits::F32)
            && self.max_error.is_none()
            && self.max_bytes.is_none();
        let moves =
            [("fill_error", self.fill_error.is_some()), ("coarseness", self.coarseness > 0.0)];
        for (name, is_asked) in moves {
            let found = format!("a number beside {} bits", self.bits);
            let expected = "none: only colours that are stored as integers move";
            Error::require_option(!(has_floats && is_asked), name, found, expected)?;
        }
        let fits_rule = self.lod_rule.is_some() && self.filter.is_fitted();
        Error::require_option(
            !fits_rule,
            "lod_rule",
            "a rule",
            "none, because the fit finds its own rule",
        )?;
        option_rules::lod_scale(self.lod_scale)?;
        Error::require_option(
            self.memory.is_none() || !self.holds_level(),
            "memory",
            "a bound beside the filter fit, min_weight, coarseness or fill_error",
            "no bound: they hold a whole level at once",
        )?;
        self.max_error.map_or(Ok(()), |max_error| max_error.check())
    }

    /// The options as JSON, with the keys of provenance and reports.
    pub fn to_json(&self) -> serde_json::Value {
        let mut options = json!({
            "filter": self.filter.name(),
            "levels": self.levels,
            "bits": self.max_error.is_none().then(|| self.bits.to_string()),
            "alpha_threshold": self.alpha_threshold,
            "block_size": self.block_size,
            "zstd_level": self.zstd_level,
            "lod_scale": self.lod_scale,
            "nonfinite": match self.nonfinite {
                Nonfinite::Refuse => "refuse",
                Nonfinite::Empty => "empty",
            },
        });
        if let Some(rule) = self.lod_rule {
            options["lod_rule"] = rule.name().into();
        }
        if let Some(max_error) = self.max_error.filter(|_| self.max_bytes.is_none()) {
            options["max_error"] = max_error.to_json();
        }
        if let Some(bytes) = self.max_bytes {
            options["bits"] = serde_json::Value::Null;
            options["max_bytes"] = bytes.into();
        }
        if self.filter.is_fitted() {
            options["fit_steps"] = self.fit_steps.into();
            options["fit_seconds"] = self.fit_seconds.into();
            options["fit_cameras"] = cameras_json(&self.fit_cameras);
            if let Some(Photographs { sha256, .. }) = &self.photographs {
                options["photographs"] = json!({ "sha256": hex(sha256) });
            }
        }
        if let Some(min_weight) = self.min_weight {
            options["min_weight"] = min_weight.into();
        }
        if self.coarseness > 0.0 {
            options["coarseness"] = self.coarseness.into();
        }
        if self.is_seen_nearby() && self.max_bytes.is_none() {
            options["nearby_coarseness"] = self.nearby_coarseness.into();
        }
        if let Some(fill_error) = self.fill_error {
            options["fill_error"] = fill_error.into();
        }
        if !self.seen_from.is_empty() {
            options["seen_from"] = cameras_json(&self.seen_from);
        }
        options
    }
}

/// The number of cameras and their digest.
fn cameras_json(cameras: &[Camera]) -> serde_json::Value {
    match cameras.len() {
        0 => serde_json::Value::Null,
        count => json!({ "count": count, "sha256": hex(&digest(cameras)) }),
    }
}
