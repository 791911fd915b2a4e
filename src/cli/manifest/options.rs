//! The options of `bake`, and those that a scene may have.

use clap::{Arg, ArgAction};
use serde_json::Value;

use super::super::output::OUTPUTS;

/// Options that select scenes, and cannot be set per scene.
pub const OF_ALL: [&str; 6] = ["output", "manifest", "index", "index-from-env", "shard", "results"];
/// An option for all scenes at once, which a line cannot set.
const FORECAST: &str = "dry-run";

/// An option of `bake`.
#[derive(Debug)]
pub struct OptionKind {
    /// Its long name.
    pub name: String,
    /// True if a value follows it.
    pub takes_value: bool,
    /// True if it is given again for each value of a list; else commas are between them.
    pub again: bool,
    /// True if it names a file to write.
    pub is_output: bool,
}

impl OptionKind {
    /// Of an argument that has a long name.
    pub fn of(argument: &Arg) -> Option<Self> {
        let again = matches!(argument.get_action(), ArgAction::Append);
        Some(Self {
            name: argument.get_long()?.to_owned(),
            takes_value: argument.get_action().takes_values(),
            again: again && argument.get_value_delimiter().is_none(),
            is_output: OUTPUTS.contains(&argument.get_id().as_str()),
        })
    }

    /// True if a manifest's name matches it.
    pub fn is_named(&self, name: &str) -> bool {
        self.name == name.replace('_', "-")
    }
}

/// The options that a line may have.
pub fn of_scenes(known: &[OptionKind]) -> impl Iterator<Item = &OptionKind> {
    let others = [&OF_ALL[..], &[FORECAST]].concat();
    known.iter().filter(move |option| !others.contains(&option.name.as_str()))
}

/// True if an option's value can be converted to words.
pub fn is_value(value: &Value) -> bool {
    match value {
        Value::Array(values) => {
            values.iter().all(|value| matches!(value, Value::String(_) | Value::Number(_)))
        }
        other => !other.is_object(),
    }
}
