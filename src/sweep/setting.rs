//! The settings of a sweep.

use crate::bake::{BakeOption, BakeOptions, Preset};
use crate::base::bytes::hex;
use crate::base::error::{Error, Result};
use crate::model::camera;
use crate::model::field::Nonfinite;
use crate::quantize::Bits;

/// One way to bake.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// The name of its files. The same options have the same name in every sweep.
    pub name: String,
    /// Options of the bake.
    pub options: BakeOptions,
    /// The preset that says the same, if the sweep was asked for one.
    pub preset: Option<Preset>,
    /// The corresponding options of `bake` as text; none if the options were made otherwise.
    pub words: Option<Vec<String>>,
    /// The command that bakes it, if known.
    pub command: Option<String>,
}

/// Values of an option to try.
#[derive(Debug, Clone, PartialEq)]
pub struct List {
    /// The option, which must support lists in sweeps.
    pub option: &'static BakeOption,
    /// Its values, as texts.
    pub values: Vec<String>,
}

/// Options to combine: every value of each list with every value of the others. An option without a
/// list has the value of [`BakeOptions::default`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Grid {
    /// Lists in the order of [`crate::bake::BAKE_OPTIONS`].
    pub lists: Vec<List>,
    /// Additional settings beside the combinations.
    pub presets: Vec<Preset>,
}

/// Options and texts of one value of an axis.
type Axis<'a> = Vec<(&'static BakeOption, &'a str)>;

impl Grid {
    /// Four bit depths with each of the common filters.
    pub fn usual() -> Self {
        Self::default()
            .with("filter", &["rate-tent", "code", "paper"])
            .with("bits", &["6", "8", "10", "12"])
    }

    /// Adds a list of values of an option; no effect for options without lists.
    #[must_use]
    pub fn with(mut self, key: &str, values: &[&str]) -> Self {
        let option = BakeOption::find(key).filter(|option| option.list.is_some());
        let values = values.iter().map(|&value| value.to_owned()).collect();
        self.lists.extend(option.map(|option| List { option, values }));
        self
    }

    /// The axes to combine. Values of mutually exclusive options share an axis.
    fn axes(&self) -> Vec<Axis<'_>> {
        let mut axes: Vec<Axis> = Vec::new();
        for list in &self.lists {
            let values = list.values.iter().map(|value| (list.option, value.as_str()));
            let excluded = |axis: &&mut Axis| {
                axis.iter().any(|(other, _)| list.option.conflicts.contains(&other.key))
            };
            match axes.iter_mut().find(excluded) {
                Some(axis) => axis.extend(values),
                None => axes.push(values.collect()),
            }
        }
        axes
    }

    /// Its settings without duplicates: filters vary slowest, presets come last. Without any list
    /// and any preset these are [`Self::usual`]'s.
    ///
    /// # Errors
    /// `Usage` for an invalid value of an option.
    pub fn settings(&self) -> Result<Vec<Setting>> {
        if *self == Self::default() {
            return Self::usual().settings();
        }
        let mut combined = vec![(BakeOptions::default(), Vec::new())];
        if self.lists.is_empty() {
            combined.clear();
        }
        for axis in self.axes() {
            let mut varied = Vec::new();
            for (options, words) in &combined {
                for (option, text) in &axis {
                    let (mut options, mut words) = (options.clone(), words.clone());
                    let key = format!("--{}", option.key);
                    option
                        .set_of_list(&mut options, text)
                        .map_err(|reason| Error::usage(format!("{key}: {reason}")))?;
                    words.extend([key, (*text).to_owned()]);
                    varied.push((options, words));
                }
            }
            combined = varied;
        }
        let mut settings: Vec<Setting> = Vec::new();
        for (options, words) in combined {
            if settings.iter().all(|setting| setting.options != options) {
                settings.push(Setting { words: Some(words), ..Setting::new(options) });
            }
        }
        for &preset in &self.presets {
            let options = preset.options();
            match settings.iter_mut().find(|setting| setting.options == options) {
                Some(setting) => setting.preset = Some(preset),
                None => settings.push(Setting {
                    preset: Some(preset),
                    words: Some(vec!["--preset".to_owned(), preset.name().to_owned()]),
                    ..Setting::new(options)
                }),
            }
        }
        Ok(settings)
    }
}

impl Setting {
    /// A setting, named after its options.
    pub fn new(options: BakeOptions) -> Self {
        Self { name: name(&options), options, preset: None, words: None, command: None }
    }
}

/// A name such as `code-8bit-t1e-3-b8-z1`. Rarely changed options appear only if they differ from
/// the default.
fn name(options: &BakeOptions) -> String {
    if *options == Preset::Web.options() {
        // No list can say the same, and all of its numbers would be a long name.
        return Preset::Web.name().to_owned();
    }
    // Destructured, so that new options cannot be forgotten: two settings must not share a file.
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
    use crate::bake::Filter;

    fn names(grid: &Grid) -> Vec<String> {
        let settings = grid.settings().expect("values");
        settings.into_iter().map(|setting| setting.name).collect()
    }

    #[test]
    fn lists_are_combined_in_order_and_each_setting_comes_once() {
        let grid = Grid::default()
            .with("filter", &["code", "paper", "code"])
            .with("bits", &["8", "f16"])
            .with("levels", &["3"]);
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
        let errors = |grid: Grid| grid.with("max-error", &["0.01", "2e-4"]).with("levels", &["2"]);
        let expected = ["rate-tent-e1e-2-t1e-3-b8-z1-l2", "rate-tent-e2e-4-t1e-3-b8-z1-l2"];
        assert_eq!(names(&errors(Grid::default())), expected);
        let both = errors(Grid::default().with("bits", &["8"]));
        assert_eq!(names(&both), [&["rate-tent-8bit-t1e-3-b8-z1-l2"], &expected[..]].concat());
    }

    #[test]
    fn presets_are_settings_of_their_own() {
        let alone = Grid { presets: vec![Preset::Web, Preset::Web], ..Grid::default() };
        assert_eq!(names(&alone), [Setting::new(Preset::Web.options()).name]);
        let beside = Grid { presets: Preset::ALL.to_vec(), ..Grid::default() };
        let settings = beside.with("bits", &["f32"]).settings().expect("values");
        let presets: Vec<_> = settings.iter().map(|setting| setting.preset).collect();
        assert!(presets.iter().all(Option::is_some), "{presets:?}");
        assert_eq!(settings.len(), 3);
    }

    #[test]
    fn names_are_unique_and_fit_any_file_system() {
        let filters = Filter::all().into_iter().map(Filter::label).collect::<Vec<_>>();
        let grid = Grid::default()
            .with("filter", &filters)
            .with("bits", &["4", "16", "f16", "f32"])
            .with("max-error", &["1e-6", "0.0015", "0.25", "0.0015:0.25:0.0015"])
            .with("alpha-threshold", &["1e-9", "1.5e-3", "0.01", "0.1"])
            .with("levels", &["1", "2"])
            .with("block-size", &["4", "8"])
            .with("zstd-level", &["1", "12"])
            .with("min-weight", &["0", "1e-3"])
            .with("coarseness", &["0", "2.5"])
            .with("fill-error", &["0", "0.05"]);
        let all = names(&grid);
        assert_eq!(all.len(), filters.len() * 8 * 4 * 2 * 2 * 2 * 2 * 2 * 2);
        let allowed = |c: char| c.is_ascii_alphanumeric() || "-.".contains(c);
        assert!(all.iter().all(|name| name.chars().all(allowed)));
        let unique: std::collections::BTreeSet<String> =
            all.iter().map(|name| name.to_lowercase()).collect();
        assert_eq!(unique.len(), all.len());
        assert!(!names(&Grid::default()).is_empty());
    }

    #[test]
    fn what_is_no_value_is_refused() {
        assert!(Grid::default().with("bits", &["3"]).settings().is_err());
    }
}
