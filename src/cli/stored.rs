//! Options of `bake` for the stored values, as [`BAKE_OPTIONS`] declares them.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};

use crate::bake::{BAKE_OPTIONS, BakeOption, BakeOptions};
use crate::base::error::{Error, Result};

/// The options that are given, with their texts.
#[derive(Debug, Default)]
pub struct StoredArguments {
    given: Vec<(&'static BakeOption, String)>,
}

impl StoredArguments {
    /// True if an option is given.
    pub fn has(&self, key: &str) -> bool {
        self.given.iter().any(|(option, _)| option.key == key)
    }

    /// Explicit options override those of the preset and of the quality, which depend on whether
    /// the field is `seen` from cameras.
    ///
    /// # Errors
    /// `Usage` for invalid values.
    pub fn apply(&self, options: &mut BakeOptions, seen: bool) -> Result<()> {
        // The options of a quality come first.
        let (qualities, others): (Vec<_>, Vec<_>) =
            self.given.iter().partition(|(option, _)| option.key == "quality");
        for (option, text) in qualities.into_iter().chain(others) {
            (option.set)(options, text, seen)
                .map_err(|reason| Error::usage(format!("--{}: {reason}", option.key)))?;
        }
        Ok(())
    }
}

/// The argument of an option: a value, or a list for sweeps.
pub fn argument(option: &'static BakeOption, value_name: &'static str, help: &'static str) -> Arg {
    let set = option.set;
    let is_value =
        move |text: &str| set(&mut BakeOptions::default(), text, false).map(|()| text.to_owned());
    let argument = Arg::new(option.key)
        .long(option.key)
        .value_name(value_name)
        .help_heading(option.heading)
        .help(help);
    match option.choices {
        None => argument.value_parser(is_value),
        Some(choices) => {
            let value = |(name, help): (&'static str, String)| {
                let value = PossibleValue::new(name);
                if help.is_empty() { value } else { value.help(help) }
            };
            let values: Vec<_> = choices().into_iter().map(value).collect();
            argument.value_parser(PossibleValuesParser::new(values).map(|name| name))
        }
    }
}

impl Args for StoredArguments {
    fn augment_args(command: Command) -> Command {
        let arguments = BAKE_OPTIONS.iter().map(|option| {
            let argument = argument(option, option.value_name, option.help);
            argument.conflicts_with_all(option.conflicts)
        });
        command.args(arguments)
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for StoredArguments {
    fn from_arg_matches(matches: &ArgMatches) -> std::result::Result<Self, clap::Error> {
        let given = BAKE_OPTIONS.iter().filter_map(|option| {
            matches.get_one::<String>(option.key).map(|text| (option, text.clone()))
        });
        Ok(Self { given: given.collect() })
    }

    fn update_from_arg_matches(
        &mut self,
        matches: &ArgMatches,
    ) -> std::result::Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}
