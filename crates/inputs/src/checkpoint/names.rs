//! The layout of checkpoints: weights under `model_state_dict`, settings under `model_kwargs`.
//!
//! Flat files (.safetensors, .npz) have no dictionaries inside dictionaries. They use the same
//! names, with or without `model_state_dict.` and `model_kwargs.` before them; safetensors may
//! also hold settings as texts of its metadata.

use std::borrow::Cow;
use std::collections::BTreeMap;

use crate::base::error::Result;
use crate::tensor::{Tensor, TensorFile, Value};

/// The dictionary of weights.
pub const STATE: &str = "model_state_dict";
/// The dictionary of settings.
pub(super) const SETTINGS: &str = "model_kwargs";
/// The dictionary that describes a checkpoint's own density, for scenes that use it as a mask.
pub(super) const AS_MASK: &str = "MaskCache_kwargs";

/// Dictionaries in which some programs keep the configuration of training or rendering.
const CONFIGURATIONS: [&str; 4] = ["render_kwargs", "cfg", "config", "args"];

/// Weights and settings of a checkpoint by name.
pub struct NamedValues<'a> {
    root: &'a Value,
    state: BTreeMap<&'a str, &'a Value>,
    settings: BTreeMap<&'a str, Cow<'a, Value>>,
    as_mask: Option<&'a Value>,
}

impl<'a> NamedValues<'a> {
    /// Splits the contents of `file` into weights and settings.
    pub fn new(file: &'a TensorFile) -> Self {
        let mut names = Self {
            root: &file.root,
            state: BTreeMap::new(),
            settings: BTreeMap::new(),
            as_mask: file.root.get(AS_MASK),
        };
        // The least specific first, because later ones override them.
        for (key, value) in file.root.entries() {
            if matches!(value, Value::Dict(_)) {
                continue;
            }
            names.state.insert(key, value);
            names.settings.insert(key, Cow::Borrowed(value));
        }
        for (key, value) in file.root.get("__metadata__").map_or(&[][..], Value::entries) {
            let key =
                key.strip_prefix(SETTINGS).and_then(|rest| rest.strip_prefix('.')).unwrap_or(key);
            if let Value::Text(text) = value {
                names.settings.insert(key, Cow::Owned(setting(text)));
            }
        }
        for (key, value) in file.root.entries() {
            let within =
                |dict: &str| key.strip_prefix(dict).and_then(|rest| rest.strip_prefix('.'));
            if let Some(key) = within(STATE) {
                names.state.insert(key, value);
            } else if let Some(key) = within(SETTINGS) {
                names.settings.insert(key, Cow::Borrowed(value));
            }
        }
        for (key, value) in file.root.get(STATE).map_or(&[][..], Value::entries) {
            names.state.insert(key, value);
        }
        for (key, value) in file.root.get(SETTINGS).map_or(&[][..], Value::entries) {
            names.settings.insert(key, Cow::Borrowed(value));
        }
        names
    }

    /// A weight.
    pub fn weight(&self, name: &str) -> Option<&'a Value> {
        self.state.get(name).copied().filter(|value| !value.is_none())
    }

    /// A weight that is a tensor.
    pub fn tensor(&self, name: &str) -> Option<&'a Tensor> {
        self.weight(name).and_then(Value::tensor)
    }

    /// True if the name of any weight has this prefix.
    pub(super) fn has_prefix(&self, prefix: &str) -> bool {
        self.state.range(prefix..).next().is_some_and(|(name, _)| name.starts_with(prefix))
    }

    /// NamedValues of weights that start with `prefix`, without it.
    pub fn after(&self, prefix: &str) -> impl Iterator<Item = &'a str> {
        let names: Vec<&'a str> =
            self.state.keys().filter_map(|name| name.strip_prefix(prefix)).collect();
        names.into_iter()
    }

    /// A setting.
    pub fn setting(&self, name: &str) -> Option<&Value> {
        self.settings.get(name).map(AsRef::as_ref).filter(|value| !value.is_none())
    }

    /// A setting that is a number.
    pub(super) fn number(&self, name: &str) -> Result<Option<f64>> {
        self.setting(name).map(|value| value.number(&format!("{SETTINGS}.{name}"))).transpose()
    }

    /// A number of the configuration of training or rendering, from the settings or from a
    /// dictionary in the form of DirectVoxGO's configurations.
    pub(super) fn recorded(&self, name: &str) -> Result<Option<f64>> {
        self.recorded_value(name).map(|value| value.number(name)).transpose()
    }

    /// The recorded colour behind the field: a number, three, or true for white.
    pub(super) fn recorded_background(&self) -> Result<Option<[f64; 3]>> {
        for name in ["background", "bg", "white_bkgd"] {
            match self.recorded_value(name) {
                None => {}
                Some(&Value::Bool(is_white)) => {
                    return Ok(Some([f64::from(u8::from(is_white)); 3]));
                }
                Some(value) => {
                    let grey = value.number(name).map(|grey| [grey; 3]);
                    return grey.or_else(|_| value.vector3(name)).map(Some);
                }
            }
        }
        Ok(None)
    }

    fn recorded_value(&self, name: &str) -> Option<&Value> {
        let within = |path: &[&str]| self.root.at(path).filter(|value| !value.is_none());
        let configured = CONFIGURATIONS.iter().find_map(|dict| {
            within(&[dict, name])
                .or_else(|| within(&[dict, "fine_model_and_render", name]))
                .or_else(|| within(&[dict, "data", name]))
        });
        self.setting(name).or(configured)
    }

    /// A boolean setting; false if missing.
    pub fn flag(&self, name: &str) -> Result<bool> {
        self.setting(name).map_or(Ok(false), |value| value.boolean(&format!("{SETTINGS}.{name}")))
    }

    /// Three numbers, among the weights or else the settings.
    pub(super) fn vector3(&self, name: &str) -> Result<Option<[f64; 3]>> {
        self.weight(name)
            .or_else(|| self.setting(name))
            .map(|value| value.vector3(name))
            .transpose()
    }

    /// A setting of this model's own density.
    pub(super) fn own_mask_number(&self, name: &str) -> Result<Option<f64>> {
        let value = self.as_mask.and_then(|dict| dict.get(name)).filter(|value| !value.is_none());
        value.map(|value| value.number(&format!("{AS_MASK}.{name}"))).transpose()
    }
}

/// A setting from its text, in JSON or Python syntax.
fn setting(text: &str) -> Value {
    fn plain(json: serde_json::Value) -> Option<Value> {
        Some(match json {
            serde_json::Value::Null => Value::None,
            serde_json::Value::Bool(value) => Value::Bool(value),
            serde_json::Value::Number(number) => match number.as_i64() {
                Some(value) => Value::Int(value),
                None => Value::Float(number.as_f64()?),
            },
            serde_json::Value::String(text) => Value::Text(text),
            serde_json::Value::Array(items) => {
                Value::List(items.into_iter().map(plain).collect::<Option<_>>()?)
            }
            serde_json::Value::Object(_) => return None,
        })
    }
    match text.trim() {
        "True" => Value::Bool(true),
        "False" => Value::Bool(false),
        "None" => Value::None,
        trimmed => serde_json::from_str(trimmed)
            .ok()
            .and_then(plain)
            .unwrap_or_else(|| Value::Text(text.to_owned())),
    }
}
