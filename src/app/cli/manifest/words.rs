//! A scene as words of the command line.

use std::ffi::OsString;
use std::path::Path;

use serde_json::Value;

use super::arguments::Given;
use super::line::SceneLine;
use super::options::{OF_ALL, OptionKind};

/// The command line that bakes a scene to `output`: its own options, and of those that `given` has
/// for all scenes the others.
pub fn words(
    line: &SceneLine,
    output: &Path,
    given: &Given,
    known: &[OptionKind],
) -> Vec<OsString> {
    let mut words: Vec<OsString> = vec!["mipvog-bake".into(), "bake".into()];
    for option in known.iter().filter(|option| !OF_ALL.contains(&option.name.as_str())) {
        let name = &option.name;
        if let Some((_, value)) = line.options.iter().find(|(own, _)| option.is_named(own)) {
            match value {
                Value::Null | Value::Bool(false) => {}
                Value::Bool(true) => words.push(format!("--{name}").into()),
                Value::Array(values) if option.again => {
                    words.extend(values.iter().map(|one| format!("--{name}={}", text(one)).into()));
                }
                Value::Array(values) => {
                    let values: Vec<String> = values.iter().map(text).collect();
                    words.push(format!("--{name}={}", values.join(",")).into());
                }
                value => words.push(format!("--{name}={}", text(value)).into()),
            }
        } else if let Some((_, values)) = given.0.iter().find(|(own, _)| own == name) {
            if !option.takes_value {
                words.push(format!("--{name}").into());
                continue;
            }
            for value in values {
                words.extend([format!("--{name}").into(), value.clone()]);
            }
        }
    }
    words.extend(["--output".into(), output.into(), "--".into(), (&line.input).into()]);
    words
}

fn text(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}
