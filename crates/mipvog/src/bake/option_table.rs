//! The options of a bake that can be given as text, one declaration each.
//!
//! Each row defines the argument of `bake` with its help, the list of values for `sweep`, the row
//! of the book's tables, and what a rebaked container keeps. Ranges are [`BakeOptions::check`]'s.

use std::str::FromStr;

use super::{BakeOptions, LevelRule, Quality};
use crate::base::text::parse_bytes;
use crate::levels::Filter;
use crate::model::field::Nonfinite;
use crate::quantize::Bits;

/// A value's name, and its help.
pub type Choice = (&'static str, String);

/// An option of a bake as text.
#[derive(Debug)]
pub struct BakeOption {
    /// Its name on the command line.
    pub key: &'static str,
    /// The name of its value.
    pub value_name: &'static str,
    /// The heading that it stands under.
    pub heading: &'static str,
    /// The help, with the default.
    pub help: &'static str,
    /// Other arguments that exclude it.
    pub conflicts: &'static [&'static str],
    /// All of its values, if they can be listed.
    pub choices: Option<fn() -> Vec<Choice>>,
    /// Takes over a value. The flag says whether cameras see the field.
    pub set: fn(&mut BakeOptions, &str, bool) -> Result<(), String>,
    /// Name and help of a list of values for sweeps. In such a list, 0 stands for no value if that
    /// is the default.
    pub list: Option<(&'static str, &'static str)>,
}

const LEVELS: &str = "Levels";
const SIZE: &str = "Size and error";

const NONE: BakeOption = BakeOption {
    key: "",
    value_name: "",
    heading: SIZE,
    help: "",
    conflicts: &[],
    choices: None,
    set: |_, _, _| Ok(()),
    list: None,
};

/// Every option, in the order of the help. A sweep varies the first ones slowest.
pub const BAKE_OPTIONS: [BakeOption; 16] = [
    BakeOption {
        key: "filter",
        value_name: "NAME",
        heading: LEVELS,
        help: "Filter that makes coarser levels [default: rate-tent]",
        choices: Some(|| {
            let choice = |filter: Filter| (filter.label(), filter.purpose().to_owned());
            Filter::all().into_iter().map(choice).collect()
        }),
        set: |options, text, _| parsed::<Filter>(text).map(|filter| options.filter = filter.into()),
        list: Some(("NAME,...", "Filters to try, as `bake --filter`")),
        ..NONE
    },
    BakeOption {
        key: "bits",
        value_name: "BITS",
        help: "Bits per stored value: 4 to 16, f16 or f32 [default: 8]",
        choices: Some(|| Bits::NAMES.map(|name| (name, String::new())).to_vec()),
        set: |options, text, _| {
            (options.bits, options.max_error) = (parsed(text)?, None);
            options.nearby_coarseness = 0.0;
            Ok(())
        },
        list: Some(("BITS,...", "Bits to try: 4 to 16, f16 or f32")),
        ..NONE
    },
    BakeOption {
        key: "max-error",
        value_name: "ERROR",
        help: "Largest error of colour (0 to 1) and of opacity over one interval, 1e-6 to 0.25; \
               every level gets the fewest bits that satisfy it. Three bounds with colons are for \
               opacity, diffuse colour and features. Replaces --bits",
        conflicts: &["bits"],
        set: |options, text, _| {
            options.max_error = Some(parsed(text)?);
            // A requested error holds at every node.
            options.nearby_coarseness = 0.0;
            Ok(())
        },
        list: Some(("ERROR,...", "Errors to try in addition to the bits, as `bake --max-error`")),
        ..NONE
    },
    BakeOption {
        key: "quality",
        value_name: "QUALITY",
        help: "Quality of pictures, 1 to 100; 75 equals --preset web, and every 25 less doubles \
               the errors. Replaces --bits and --max-error. With --cameras or --turntable, also sets \
               --min-weight, --coarseness and --fill-error",
        conflicts: &["bits", "max-error"],
        set: |options, text, seen| {
            parsed::<Quality>(text).map(|quality| quality.apply(options, seen))
        },
        ..NONE
    },
    BakeOption {
        key: "max-bytes",
        value_name: "BYTES",
        help: "Largest size of the container, such as 3MB or 500KiB; the best quality that fits is \
               chosen, and the finest levels are dropped if nothing fits. Replaces --bits, \
               --max-error and --quality",
        conflicts: &["bits", "max-error", "quality", "dry_run"],
        set: |options, text, _| parse_bytes(text).map(|bytes| options.max_bytes = Some(bytes)),
        ..NONE
    },
    BakeOption {
        key: "alpha-threshold",
        value_name: "OPACITY",
        help: "Drop blocks whose opacity over one step of the level never exceeds this, 0 to 1 \
               [default: 0.001]",
        set: |options, text, _| parsed(text).map(|value| options.alpha_threshold = value),
        list: Some(("OPACITY,...", "Opacity thresholds to try, as `bake --alpha-threshold`")),
        ..NONE
    },
    BakeOption {
        key: "levels",
        value_name: "N",
        heading: LEVELS,
        help: "Maximum number of levels [default: down to 4 voxels along the longest axis]",
        set: |options, text, _| parsed(text).map(|value| options.levels = Some(value)),
        list: Some(("N,...", "Numbers of levels to try")),
        ..NONE
    },
    BakeOption {
        key: "block-size",
        value_name: "VOXELS",
        help: "Voxels along a block's edge, 1 to 64 [default: 8]",
        set: |options, text, _| parsed(text).map(|value| options.block_size = value),
        list: Some(("VOXELS,...", "Block sizes to try: voxels along an edge")),
        ..NONE
    },
    BakeOption {
        key: "zstd-level",
        value_name: "LEVEL",
        help: "Compression level of zstd, 1 to 22 [default: 1]",
        set: |options, text, _| parsed(text).map(|value| options.zstd_level = value),
        list: Some(("LEVEL,...", "Compression levels of zstd to try, 1 to 22")),
        ..NONE
    },
    BakeOption {
        key: "lod-rule",
        value_name: "RULE",
        heading: LEVELS,
        help: "Published rule that picks the level of a sample [default: the filter's own]",
        choices: Some(|| {
            let choice = |rule: LevelRule| (rule.name(), rule.purpose());
            LevelRule::ALL.into_iter().map(choice).collect()
        }),
        set: |options, text, _| parsed(text).map(|rule| options.lod_rule = Some(rule)),
        ..NONE
    },
    BakeOption {
        key: "lod-scale",
        value_name: "FACTOR",
        heading: LEVELS,
        help: "Factor on the slope of the level rule [default: 1]",
        set: |options, text, _| parsed(text).map(|value| options.lod_scale = value),
        ..NONE
    },
    BakeOption {
        key: "min-weight",
        value_name: "WEIGHT",
        help: "Drop voxels that add less than this to every pixel of --cameras, above 0 to 1; \
               other viewpoints may miss parts [default: keep all]",
        set: |options, text, _| parsed(text).map(|value| options.min_weight = Some(value)),
        list: Some(("WEIGHT,...", "Minimum weights to try, as `bake --min-weight`; 0 keeps all")),
        ..NONE
    },
    BakeOption {
        key: "coarseness",
        value_name: "CODES",
        help: "How far colours may drift where cameras see little, in quantization steps at a voxel \
               of average visibility, 0 to 64 [default: 0]",
        set: |options, text, _| parsed(text).map(|value| options.coarseness = value),
        list: Some(("CODES,...", "Values of coarseness to try, as `bake --coarseness`")),
        ..NONE
    },
    BakeOption {
        key: "fill-error",
        value_name: "ERROR",
        help: "Leave out a block's colours where the next coarser level reproduces them to within \
               this error, above 0 to 1; with --min-weight or --coarseness, less exactly where \
               --cameras see little [default: store all]",
        set: |options, text, _| parsed(text).map(|value| options.fill_error = Some(value)),
        list: Some((
            "ERROR,...",
            "Errors of left-out colours to try, as `bake --fill-error`; 0 stores all",
        )),
        ..NONE
    },
    BakeOption {
        key: "memory",
        value_name: "BYTES",
        help: "Memory limit, such as 500MB or 2GiB; a low limit is slower and gives the same output \
               [default: unlimited]",
        set: |options, text, _| parse_bytes(text).map(|bytes| options.memory = Some(bytes)),
        ..NONE
    },
    BakeOption {
        key: "nonfinite",
        value_name: "NONFINITE",
        help: "What to do with values that are not finite [default: refuse]",
        choices: Some(|| {
            let refuse = "Refuse the input, and report their count and the location of the first";
            let empty = "Treat their nodes as empty, with a warning";
            vec![("refuse", refuse.to_owned()), ("empty", empty.to_owned())]
        }),
        set: |options, text, _| {
            options.nonfinite = match text {
                "empty" => Nonfinite::Empty,
                _ => Nonfinite::Refuse,
            };
            Ok(())
        },
        ..NONE
    },
];

impl BakeOption {
    /// The option of a name.
    pub fn find(key: &str) -> Option<&'static Self> {
        BAKE_OPTIONS.iter().find(|option| option.key == key)
    }

    /// Options with one value of a list; 0 gives the default if that is no value.
    ///
    /// # Errors
    /// Text that is not a value of the option.
    pub fn set_of_list(&self, options: &mut BakeOptions, text: &str) -> Result<(), String> {
        let none_is_default = matches!(self.key, "min-weight" | "fill-error");
        let is_zero = text.parse::<f32>().is_ok_and(|value| value == 0.0);
        if none_is_default && is_zero { Ok(()) } else { (self.set)(options, text, false) }
    }
}

fn parsed<T: FromStr<Err: ToString>>(text: &str) -> Result<T, String> {
    text.parse().map_err(|error: T::Err| error.to_string())
}

impl PartialEq for BakeOption {
    fn eq(&self, other: &Self) -> bool {
        self.key == other.key
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_in_the_help_are_those_of_the_code() {
        for option in &BAKE_OPTIONS {
            let Some((_, rest)) = option.help.split_once("[default: ") else { continue };
            let stated = rest.trim_end_matches(']');
            let mut options = BakeOptions::default();
            // A default that does not parse as a value stands for none.
            if (option.set)(&mut options, stated, false).is_ok() {
                options.nearby_coarseness = BakeOptions::default().nearby_coarseness;
                assert_eq!(options, BakeOptions::default(), "{}", option.key);
            }
        }
    }

    #[test]
    fn every_choice_is_a_value() {
        for option in &BAKE_OPTIONS {
            for (name, _) in option.choices.map_or(Vec::new(), |choices| choices()) {
                let mut options = BakeOptions::default();
                assert_eq!((option.set)(&mut options, name, false), Ok(()), "{name}");
            }
        }
    }
}
