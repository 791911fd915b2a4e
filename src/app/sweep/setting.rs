//! The settings of a sweep.

use crate::bake::{BakeOptions, Filter, MaxErrors, Preset};
use crate::base::bytes::hex;
use crate::codec::quantize::Bits;
use crate::model::camera;
use crate::model::field::Nonfinite;

/// One way to bake.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// Names its files. The same options have the same name in every sweep.
    pub name: String,
    /// Options of the bake.
    pub options: BakeOptions,
    /// The preset that says the same, if the sweep was asked for one.
    pub preset: Option<Preset>,
}

/// Options to combine: every value of each list with every value of the others. An empty list is
/// [`BakeOptions::default`]'s value alone.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Grid {
    /// Filters of coarser levels.
    pub filters: Vec<Filter>,
    /// Bits of a code.
    pub bits: Vec<Bits>,
    /// Largest errors instead of bits; combined with the others as if they were more `bits`.
    pub max_errors: Vec<MaxErrors>,
    /// Opacity up to which blocks are dropped.
    pub alpha_thresholds: Vec<f32>,
    /// Levels in all, at most.
    pub levels: Vec<usize>,
    /// Nodes along a block's edge.
    pub block_sizes: Vec<usize>,
    /// Compression levels of zstd.
    pub zstd_levels: Vec<i32>,
    /// Least weights in a pixel of the sweep's cameras; 0 keeps all.
    pub min_weights: Vec<f32>,
    /// Coarseness of colours by the same cameras.
    pub coarsenesses: Vec<f32>,
    /// Errors within which blocks inherit their colours; 0 stores all.
    pub fill_errors: Vec<f32>,
    /// Settings of their own beside the combinations.
    pub presets: Vec<Preset>,
}

impl Grid {
    /// Four depths with each of the filters that people choose between.
    pub fn usual() -> Self {
        Self {
            filters: vec![Filter::RateTent, Filter::Code, Filter::Paper],
            bits: [6, 8, 10, 12].map(Bits::Integer).to_vec(),
            ..Self::default()
        }
    }

    /// True if there is nothing but presets.
    fn has_no_lists(&self) -> bool {
        let without = Self { presets: Vec::new(), ..self.clone() };
        without == Self::default()
    }

    /// Its settings, each once: filters vary slowest, compression levels fastest, presets come
    /// last. Without any list and any preset these are [`Self::usual`]'s.
    pub fn settings(&self) -> Vec<Setting> {
        if *self == Self::default() {
            return Self::usual().settings();
        }
        let mut combined = vec![BakeOptions::default()];
        if self.has_no_lists() {
            combined.clear();
        }
        vary(&mut combined, &self.filters, |options, &filter| options.filter = filter.into());
        let bits = self.bits.iter().map(|&bits| (bits, None));
        let default = BakeOptions::default().bits;
        let errors = self.max_errors.iter().map(|&error| (default, Some(error)));
        let depths: Vec<(Bits, Option<MaxErrors>)> = bits.chain(errors).collect();
        vary(&mut combined, &depths, |options, &depth| (options.bits, options.max_error) = depth);
        vary(&mut combined, &self.alpha_thresholds, |options, &threshold| {
            options.alpha_threshold = threshold;
        });
        vary(&mut combined, &self.levels, |options, &levels| options.levels = Some(levels));
        vary(&mut combined, &self.block_sizes, |options, &size| options.block_size = size);
        vary(&mut combined, &self.zstd_levels, |options, &level| options.zstd_level = level);
        vary(&mut combined, &self.min_weights, |options, &weight| {
            options.min_weight = Some(weight).filter(|&weight| weight != 0.0);
        });
        vary(&mut combined, &self.coarsenesses, |options, &coarseness| {
            options.coarseness = coarseness;
        });
        vary(&mut combined, &self.fill_errors, |options, &error| {
            options.fill_error = Some(error).filter(|&error| error != 0.0);
        });
        let mut settings: Vec<Setting> = Vec::new();
        for options in combined {
            if settings.iter().all(|setting| setting.options != options) {
                settings.push(Setting::new(options));
            }
        }
        for &preset in &self.presets {
            let options = preset.options();
            match settings.iter_mut().find(|setting| setting.options == options) {
                Some(setting) => setting.preset = Some(preset),
                None => settings.push(Setting { preset: Some(preset), ..Setting::new(options) }),
            }
        }
        settings
    }
}

/// Each of the options with each of the values, or unchanged if there are none.
fn vary<T>(all: &mut Vec<BakeOptions>, values: &[T], set: impl Fn(&mut BakeOptions, &T)) {
    if values.is_empty() {
        return;
    }
    let with = |options: &BakeOptions, value: &T| {
        let mut options = options.clone();
        set(&mut options, value);
        options
    };
    *all = all.iter().flat_map(|options| values.iter().map(|v| with(options, v))).collect();
}

impl Setting {
    /// A setting, named after its options.
    pub fn new(options: BakeOptions) -> Self {
        Self { name: name(&options), options, preset: None }
    }
}

/// A name such as `code-8bit-t1e-3-b8-z1`. Options that seldom change show only if they differ from
/// the default.
fn name(options: &BakeOptions) -> String {
    // Taken apart, so that a new option cannot be forgotten: two settings must not share a file.
    let BakeOptions {
        filter,
        levels,
        bits,
        max_error,
        max_bytes,
        alpha_threshold,
        block_size,
        zstd_level,
        lod_rule,
        lod_scale,
        fit_steps,
        fit_seconds,
        fit_cameras,
        photographs,
        min_weight,
        coarseness,
        nearby_coarseness,
        fill_error,
        // A sweep's own cameras.
        seen_from: _,
        // The output does not depend on these.
        memory: _,
        limits: _,
        nonfinite,
    } = options;
    let depth = match (max_bytes, max_error, bits) {
        (Some(max_bytes), ..) => format!("{max_bytes}bytes"),
        (None, Some(max_error), _) => format!("e{max_error:e}").replace(':', "-"),
        (None, None, Bits::Integer(bits)) => format!("{bits}bit"),
        (None, None, Bits::F16 | Bits::F32) => bits.to_string(),
    };
    let mut name =
        format!("{}-{depth}-t{alpha_threshold:e}-b{block_size}-z{zstd_level}", filter.name());
    if let Some(levels) = levels {
        name += &format!("-l{levels}");
    }
    if let Some(rule) = lod_rule {
        name += &format!("-{}", rule.name());
    }
    if *lod_scale != 1.0 {
        name += &format!("-lod{lod_scale}");
    }
    if filter.is_fitted() {
        name += &format!("-s{fit_steps}");
        if let Some(seconds) = fit_seconds {
            name += &format!("-within{seconds}");
        }
        if !fit_cameras.is_empty() {
            name += &format!("-c{}", &hex(&camera::digest(fit_cameras))[..8]);
        }
        if let Some(photographs) = photographs {
            name += &format!("-p{}", &hex(&photographs.sha256)[..8]);
        }
    }
    if let Some(weight) = min_weight {
        name += &format!("-w{weight:e}");
    }
    if *coarseness > 0.0 {
        name += &format!("-i{coarseness:e}");
    }
    if *nearby_coarseness > 0.0 {
        name += &format!("-n{nearby_coarseness:e}");
    }
    if let Some(error) = fill_error {
        name += &format!("-f{error:e}");
    }
    if *nonfinite == Nonfinite::Empty {
        name += "-empty";
    }
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(grid: &Grid) -> Vec<String> {
        grid.settings().into_iter().map(|setting| setting.name).collect()
    }

    #[test]
    fn lists_are_combined_in_order_and_each_setting_comes_once() {
        let grid = Grid {
            filters: vec![Filter::Code, Filter::Paper, Filter::Code],
            bits: vec![Bits::Integer(8), Bits::F16],
            levels: vec![3],
            ..Grid::default()
        };
        let expected = [
            "code-8bit-t1e-3-b8-z1-l3",
            "code-f16-t1e-3-b8-z1-l3",
            "paper-8bit-t1e-3-b8-z1-l3",
            "paper-f16-t1e-3-b8-z1-l3",
        ];
        assert_eq!(names(&grid), expected);
    }

    #[test]
    fn errors_stand_beside_bits() {
        let errors = Grid {
            max_errors: [0.01, 2e-4].map(MaxErrors::from).to_vec(),
            levels: vec![2],
            ..Grid::default()
        };
        let expected = ["rate-tent-e1e-2-t1e-3-b8-z1-l2", "rate-tent-e2e-4-t1e-3-b8-z1-l2"];
        assert_eq!(names(&errors), expected);
        let both = Grid { bits: vec![Bits::Integer(8)], ..errors };
        assert_eq!(names(&both), [&["rate-tent-8bit-t1e-3-b8-z1-l2"], &expected[..]].concat());
    }

    #[test]
    fn presets_are_settings_of_their_own() {
        let alone = Grid { presets: vec![Preset::Web, Preset::Web], ..Grid::default() };
        assert_eq!(names(&alone), [Setting::new(Preset::Web.options()).name]);
        let beside = Grid { bits: vec![Bits::F32], presets: Preset::ALL.to_vec(), ..alone };
        let settings = beside.settings();
        let presets: Vec<_> = settings.iter().map(|setting| setting.preset).collect();
        assert!(presets.iter().all(Option::is_some), "{presets:?}");
        assert_eq!(settings.len(), 3);
    }

    #[test]
    fn names_are_unique_and_fit_any_file_system() {
        let grid = Grid {
            filters: Filter::all(),
            bits: vec![Bits::Integer(4), Bits::Integer(16), Bits::F16, Bits::F32],
            max_errors: [1e-6, 0.0015, 0.25]
                .map(MaxErrors::from)
                .into_iter()
                .chain([MaxErrors::new(0.0015, 0.25, 0.0015)])
                .collect(),
            alpha_thresholds: vec![1e-9, 1.5e-3, 0.01, 0.1],
            levels: vec![1, 2],
            block_sizes: vec![4, 8],
            zstd_levels: vec![1, 12],
            min_weights: vec![0.0, 1e-3],
            coarsenesses: vec![0.0, 2.5],
            fill_errors: vec![0.0, 0.05],
            presets: Vec::new(),
        };
        let all = names(&grid);
        let allowed = |c: char| c.is_ascii_alphanumeric() || "-.".contains(c);
        assert!(all.iter().all(|name| name.chars().all(allowed)));
        let unique: std::collections::BTreeSet<String> =
            all.iter().map(|name| name.to_lowercase()).collect();
        assert_eq!(unique.len(), all.len());
        assert!(!names(&Grid::default()).is_empty());
    }
}
