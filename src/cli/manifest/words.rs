//! A scene as words of the command line.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::arguments::ExplicitOptions;
use super::line::SceneLine;
use super::options::{OF_ALL, OptionKind};

/// Makes command lines of scenes.
#[derive(Debug, Clone, Copy)]
pub struct Words<'a> {
    /// The command line's options for all scenes.
    pub given: &'a ExplicitOptions,
    /// All options of `bake`.
    pub known: &'a [OptionKind],
    /// The base folder of outputs in lines.
    pub outputs: &'a Path,
}

impl Words<'_> {
    /// The command line for a scene: its own options, and the common options that it does not
    /// override.
    pub fn of(&self, line: &SceneLine) -> Vec<OsString> {
        let mut words: Vec<OsString> = vec!["mipvog-bake".into(), "bake".into()];
        for option in self.known.iter().filter(|option| !OF_ALL.contains(&option.name.as_str())) {
            let name = &option.name;
            if let Some(value) = own_value(line, option) {
                match value {
                    Value::Null | Value::Bool(false) => {}
                    Value::Bool(true) => words.push(format!("--{name}").into()),
                    Value::Array(values) if option.again => {
                        let own = values.iter().map(|one| format!("--{name}={}", text(one)).into());
                        words.extend(own);
                    }
                    Value::Array(values) => {
                        let values: Vec<String> = values.iter().map(text).collect();
                        words.push(format!("--{name}={}", values.join(",")).into());
                    }
                    value if option.is_output => {
                        let path = self.outputs.join(text(value));
                        words.extend([format!("--{name}").into(), path.into()]);
                    }
                    value => words.push(format!("--{name}={}", text(value)).into()),
                }
            } else if let Some(values) = self.given_values(name) {
                if !option.takes_value {
                    words.push(format!("--{name}").into());
                    continue;
                }
                for value in values {
                    words.extend([format!("--{name}").into(), value.clone()]);
                }
            }
        }
        let output = self.outputs.join(&line.output);
        words.extend(["--output".into(), output.into(), "--".into(), (&line.input).into()]);
        words
    }

    /// The output files of a scene, from its line or from the command line.
    pub fn written(&self, line: &SceneLine) -> Vec<Written> {
        let own = |option: &str, path: &str| Written {
            option: option.to_owned(),
            path: path.into(),
            is_own: true,
        };
        let mut written = vec![own("output", &line.output)];
        let outputs = self.known.iter().filter(|option| option.is_output);
        for option in outputs.filter(|option| !OF_ALL.contains(&option.name.as_str())) {
            match own_value(line, option) {
                Some(Value::Null | Value::Bool(_)) => {}
                Some(value) => written.push(own(&option.name, &text(value))),
                None => {
                    let given = self.given_values(&option.name).into_iter().flatten();
                    written.extend(given.map(|path| Written {
                        option: option.name.clone(),
                        path: path.into(),
                        is_own: false,
                    }));
                }
            }
        }
        written
    }

    fn given_values(&self, name: &str) -> Option<&[OsString]> {
        self.given.0.iter().find(|(own, _)| own == name).map(|(_, values)| &**values)
    }
}

/// A file that a scene writes.
#[derive(Debug)]
pub struct Written {
    /// The option that names it.
    pub option: String,
    /// The given path.
    pub path: PathBuf,
    /// True if the line names it, not the command line.
    pub is_own: bool,
}

fn own_value<'l>(line: &'l SceneLine, option: &OptionKind) -> Option<&'l Value> {
    line.options.iter().find(|(own, _)| option.is_named(own)).map(|(_, value)| value)
}

fn text(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}
