//! Options of `bake` for the stored values.

use clap::{Args, ValueEnum};

use super::values::parse_bytes;
use crate::bake::{BakeOptions, Filter, LevelRule, MaxErrors, Quality};
use crate::codec::quantize::Bits;
use crate::model::field::Nonfinite;

/// The stored values and their precision.
#[derive(Debug, Args)]
#[command(next_help_heading = "Size and error")]
pub struct StoredArguments {
    /// Filter for coarser levels [default: rate-tent]
    #[arg(long, value_name = "NAME", help_heading = "Levels")]
    pub filter: Option<Filter>,
    /// Maximum number of levels [default: down to 4 nodes along the longest axis]
    #[arg(long, value_name = "N", help_heading = "Levels")]
    pub levels: Option<usize>,
    /// Bits per stored value: 4 to 16, f16 or f32 [default: 8]
    #[arg(long, value_name = "BITS")]
    pub bits: Option<Bits>,
    /// Instead of --bits: the largest error of decoded colour (0 to 1) and of opacity over one
    /// interval, 1e-6 to 0.25; each group of each level gets the fewest bits that satisfy it. Or
    /// three bounds with colons: opacity, diffuse colour and features
    #[arg(long, value_name = "ERROR", conflicts_with = "bits")]
    pub max_error: Option<MaxErrors>,
    /// Instead of --bits or --max-error: the quality of pictures, 1 to 100; 75 equals --preset web;
    /// every 25 less doubles the errors. With --cameras or --turntable, also sets --min-weight,
    /// --coarseness and --fill-error
    #[arg(long, value_name = "QUALITY", conflicts_with_all = ["bits", "max_error"])]
    pub quality: Option<Quality>,
    /// Instead of --bits or --max-error: the best quality that fits into this size, such as 3MB or
    /// 500KiB; if even the largest error does not fit, finest levels are dropped
    #[arg(long, value_name = "BYTES", value_parser = parse_bytes,
          conflicts_with_all = ["bits", "max_error", "quality", "dry_run"])]
    pub max_bytes: Option<u64>,
    /// Drop blocks whose opacity over one step of the level never exceeds this [default: 0.001]
    #[arg(long, value_name = "OPACITY")]
    pub alpha_threshold: Option<f32>,
    /// Nodes along a block's edge [default: 8]
    #[arg(long, value_name = "NODES")]
    pub block_size: Option<usize>,
    /// Compression level of zstd, 1 to 22 [default: 1]
    #[arg(long, value_name = "LEVEL")]
    pub zstd_level: Option<i32>,
    /// Rule that picks the level of a sample: a published rule instead of the filter's [default:
    /// the filter's]
    #[arg(long, value_name = "RULE", help_heading = "Levels")]
    pub lod_rule: Option<LevelRule>,
    /// Factor on the slope of the level rule [default: 1]
    #[arg(long, value_name = "FACTOR", help_heading = "Levels")]
    pub lod_scale: Option<f32>,
    /// Drop nodes whose weight is below this in every pixel of --cameras, above 0 to 1; other
    /// viewpoints may miss parts [default: keep all]
    #[arg(long, value_name = "WEIGHT")]
    pub min_weight: Option<f32>,
    /// Allow larger colour errors where cameras see less: N quantization steps at a node of average
    /// importance, 0 to 64 [default: 0]
    #[arg(long, value_name = "CODES")]
    pub coarseness: Option<f32>,
    /// Let blocks inherit their colours from the next coarser level if no retained node changes by
    /// more than this, above 0 to 1; with --min-weight or --coarseness, by more where --cameras see
    /// less [default: store all]
    #[arg(long, value_name = "ERROR")]
    pub fill_error: Option<f32>,
    /// Memory limit, such as 500MB or 2GiB; a small bound is slower, the output is the same
    /// [default: unlimited]
    #[arg(long, value_name = "BYTES", value_parser = parse_bytes)]
    pub memory: Option<u64>,
    /// What to do with values that are not finite
    #[arg(long, value_enum, default_value_t = NonfiniteChoice::Refuse)]
    nonfinite: NonfiniteChoice,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum NonfiniteChoice {
    /// Refuse the input, and report their count and the location of the first
    Refuse,
    /// Treat their nodes as empty, with a warning
    Empty,
}

impl StoredArguments {
    /// True if values that are not finite become empty.
    pub fn replaces_nonfinite(&self) -> bool {
        self.nonfinite == NonfiniteChoice::Empty
    }

    /// Explicit options override the preset's, and what a quality stands for where the field is
    /// `seen` from cameras or not.
    pub fn apply(&self, options: &mut BakeOptions, seen: bool) {
        if let Some(quality) = self.quality {
            quality.apply(options, seen);
        }
        if let Some(filter) = self.filter {
            options.filter = filter.into();
        }
        options.levels = self.levels.or(options.levels);
        if let Some(bits) = self.bits {
            (options.bits, options.max_error) = (bits, None);
        }
        options.max_error = self.max_error.or(options.max_error);
        if self.bits.is_some() || self.max_error.is_some() {
            // An error that is asked for holds at every node.
            options.nearby_coarseness = 0.0;
        }
        options.max_bytes = self.max_bytes;
        options.alpha_threshold = self.alpha_threshold.unwrap_or(options.alpha_threshold);
        options.block_size = self.block_size.unwrap_or(options.block_size);
        options.zstd_level = self.zstd_level.unwrap_or(options.zstd_level);
        options.lod_rule = self.lod_rule.or(options.lod_rule);
        options.lod_scale = self.lod_scale.unwrap_or(options.lod_scale);
        options.min_weight = self.min_weight.or(options.min_weight);
        options.fill_error = self.fill_error.or(options.fill_error);
        options.coarseness = self.coarseness.unwrap_or(options.coarseness);
        options.memory = self.memory;
        options.nonfinite = match self.nonfinite {
            NonfiniteChoice::Refuse => Nonfinite::Refuse,
            NonfiniteChoice::Empty => Nonfinite::Empty,
        };
    }
}
