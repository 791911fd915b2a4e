//! The contents of an input, without reading its grids.

use std::path::Path;

use serde::Serialize;

use super::checkpoint::STATE;
use super::families;
use super::open::file_of;
use super::options::SourceOptions;
use super::source::{Assumption, Family};
use super::tensor::{self, FileKind, TensorFile, Value};
use crate::base::error::Result;
use crate::base::limits::{Budget, Limits};
use crate::model::field::{Activation, March};
use crate::model::grid::Bounds;
use crate::model::harmonics::Harmonics;
use crate::model::view_mlp::ViewMlp;

/// Tensors of up to this many elements are listed with their values.
const SHOWN: u64 = 16;
/// The most bytes that are read to show values of one tensor.
const SHOWN_BYTES: u64 = 4 << 20;

/// The contents of an input and their meaning.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct Inspection {
    /// Format of the file.
    pub kind: FileKind,
    /// Size of the file in bytes.
    pub file_bytes: u64,
    /// Fingerprint of the content, a SHA-256 in hexadecimal.
    pub digest: String,
    /// Bytes of the model's tensors.
    pub model_bytes: u64,
    /// Bytes of the optimizer's tensors, which a bake never reads.
    pub optimizer_bytes: u64,
    /// Bytes of all other tensors.
    pub other_bytes: u64,
    /// Model family; null if unknown.
    pub model: Option<Family>,
    /// Scene, as a bake without options reads it; null if it cannot be baked.
    pub scene: Option<SceneContent>,
    /// Reason that the input cannot be baked; null if it can.
    pub problem: Option<String>,
    /// Settings that a bake would assume.
    pub assumptions: Vec<Assumption>,
    /// All values, by key.
    pub values: Vec<ListedValue>,
}

/// A scene, as a bake reads it.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct SceneContent {
    /// Nodes along x, y and z.
    pub dimensions: [usize; 3],
    /// Box of the grid, in world units.
    pub bounds: Bounds,
    /// Number of colour channels in use.
    pub channels: usize,
    /// Rule from raw density to opacity.
    pub activation: Activation,
    /// Rule for the steps along a ray.
    pub march: March,
    /// Layer widths of the view network, from input to output; null without one.
    pub mlp: Option<Vec<usize>>,
    /// Rules of the spherical harmonics; null without harmonics.
    pub harmonics: Option<Harmonics>,
    /// Nodes of the free-space mask along x, y and z; null without one.
    pub free_space: Option<[usize; 3]>,
}

/// A value of a checkpoint.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct ListedValue {
    /// Path of keys to the value, joined by dots.
    pub key: String,
    /// `none`, `bool`, `int`, `float`, `text` or `tensor`; `list` or `dict` if empty.
    pub kind: &'static str,
    /// The value, if small. Numbers that JSON cannot represent are strings.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<serde_json::Value>,
    /// Element type of a tensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dtype: Option<&'static str>,
    /// Shape of a tensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<Vec<u64>>,
    /// Size of a tensor in bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// Byte offset of a tensor in the file; absent for tensors that are compressed or in the
    /// pickle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset: Option<u64>,
}

/// Lists an input of any kind.
///
/// # Errors
/// As [`tensor::open`]. A file that can be read but not baked is not an error; the result says why.
pub fn inspect(path: &Path, options: &SourceOptions, limits: &Limits) -> Result<Inspection> {
    inspect_tensors(&tensor::open(&file_of(path), limits)?, options, limits)
}

/// The same for a file that is open already.
pub fn inspect_tensors(
    file: &TensorFile,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<Inspection> {
    let mut list = List { values: Vec::new(), key: String::new(), bytes: [0; 3] };
    list.add(&file.root);
    let [model_bytes, optimizer_bytes, other_bytes] = list.bytes;
    let mut inspection = Inspection {
        kind: file.kind,
        file_bytes: file.file.length(),
        digest: file.digest.iter().map(|byte| format!("{byte:02x}")).collect(),
        model_bytes,
        optimizer_bytes,
        other_bytes,
        model: families::family(file),
        scene: None,
        problem: None,
        assumptions: Vec::new(),
        values: list.values,
    };
    // It is not a model, but can be baked.
    if file.unpacked_metadata().is_some() {
        return Ok(inspection);
    }
    match families::describe(file, options, limits) {
        Ok((source, free_space)) => {
            inspection.file_bytes = source.content_bytes();
            let field = source.field;
            inspection.model = Some(source.family);
            inspection.scene = Some(SceneContent {
                dimensions: field.scene.nodes.0,
                bounds: field.scene.bounds,
                channels: field.color_channels(),
                activation: field.scene.activation,
                march: field.scene.march,
                mlp: field.network().map(ViewMlp::widths),
                harmonics: field.harmonics().copied(),
                free_space,
            });
            inspection.assumptions = source.assumptions;
        }
        Err(error) => inspection.problem = Some(format!("{error}; {}", error.remedy())),
    }
    Ok(inspection)
}

/// The list while it grows.
struct List {
    values: Vec<ListedValue>,
    key: String,
    /// Of the model, the optimizer, and the rest.
    bytes: [u64; 3],
}

impl List {
    fn add(&mut self, value: &Value) {
        let (kind, shown) = match value {
            Value::Dict(entries) if !entries.is_empty() => {
                for (key, value) in entries {
                    self.under(key, value);
                }
                return;
            }
            Value::List(items) if items.iter().any(|item| plain(item).is_none()) => {
                for (number, item) in items.iter().enumerate() {
                    self.under(&number.to_string(), item);
                }
                return;
            }
            Value::Dict(_) => ("dict", Some(serde_json::Value::Object(serde_json::Map::new()))),
            Value::List(items) => ("list", Some(items.iter().filter_map(plain).collect())),
            Value::None => ("none", Some(serde_json::Value::Null)),
            Value::Bool(_) => ("bool", plain(value)),
            Value::Int(_) => ("int", plain(value)),
            Value::Float(_) => ("float", plain(value)),
            Value::Text(_) => ("text", plain(value)),
            Value::Opaque(kind) => ("opaque", Some(kind.as_str().into())),
            Value::Tensor(tensor) => ("tensor", tensor.unread_kind().map(Into::into)),
        };
        let is_optimizer = self.key.starts_with("optimizer");
        let mut listed = ListedValue {
            key: self.key.clone(),
            kind,
            value: shown,
            dtype: None,
            shape: None,
            bytes: None,
            offset: None,
        };
        if let Value::Tensor(tensor) = value
            && tensor.unread_kind().is_none()
        {
            let within =
                |dict: &str| self.key.strip_prefix(dict).is_some_and(|rest| rest.starts_with('.'));
            let part = match is_optimizer {
                true => 1,
                false if within(STATE) || !self.key.contains("kwargs.") => 0,
                false => 2,
            };
            self.bytes[part] += tensor.bytes();
            listed.dtype = Some(tensor.element().name());
            listed.shape = Some(tensor.shape().to_vec());
            listed.bytes = Some(tensor.bytes());
            listed.offset = tensor.offset();
            if tensor.count() <= SHOWN && !is_optimizer && !tensor.is_compressed() {
                let limits = Limits::default().with_memory(SHOWN_BYTES);
                let values = tensor.read_f64(&mut Budget::new(&limits)).ok();
                let values = values.unwrap_or_default();
                let shown = values.into_iter().filter_map(|value| plain(&Value::Float(value)));
                listed.value = Some(shown.collect());
            }
        }
        self.values.push(listed);
    }

    fn under(&mut self, key: &str, value: &Value) {
        let length = self.key.len();
        if length > 0 {
            self.key.push('.');
        }
        self.key.push_str(key);
        self.add(value);
        self.key.truncate(length);
    }
}

/// A value that fits on a line.
fn plain(value: &Value) -> Option<serde_json::Value> {
    Some(match value {
        Value::None => serde_json::Value::Null,
        Value::Bool(value) => (*value).into(),
        Value::Int(value) => (*value).into(),
        Value::Float(value) => match serde_json::Number::from_f64(*value) {
            Some(number) => number.into(),
            None => value.to_string().into(),
        },
        Value::Text(text) => text.as_str().into(),
        _ => return None,
    })
}
