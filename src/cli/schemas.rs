//! JSON schemas of reports, derived from the types of the reports.

use schemars::generate::{SchemaGenerator, SchemaSettings};
use schemars::{JsonSchema, Schema};
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::attach::AttachReport;
use super::bake::BakeJson;
use super::compare::CompareReport;
use super::container_report::ContainerReport;
use super::detach::DetachReport;
use super::error_report::ErrorReport;
use super::export_report::ExportReport;
use super::inspect::AssetReport;
use super::manifest::SceneResult;
use super::probe::ProbeReport;
use super::render::RenderReport;
use super::report::BatchReport;
use super::unpack::UnpackReport;
use super::view::ServedReport;
use crate::check::Report;
use crate::sweep::{SweepForecast, SweepReport};
use mipvog_inputs::Inspection;

/// The report of several files.
#[derive(JsonSchema, Serialize)]
struct Several<T> {
    /// Reports of the files, in the order of the arguments.
    files: Vec<OfFile<T>>,
    /// Number of files that are invalid or whose report is an error.
    failed: usize,
    /// `validate` only: true if all files are valid.
    #[serde(skip_serializing_if = "Option::is_none")]
    valid: Option<bool>,
}

/// The report or the error of one file.
#[derive(JsonSchema, Serialize)]
struct OfFile<T> {
    /// Path of the file.
    file: String,
    #[serde(flatten)]
    report: ReportOrError<T>,
}

#[derive(JsonSchema, Serialize)]
#[serde(untagged)]
#[expect(dead_code, reason = "only its schema counts")]
enum ReportOrError<T> {
    Report(T),
    Error(FileError),
}

/// The error of a file that has no report.
#[derive(JsonSchema, Serialize)]
struct FileError {
    /// Error message.
    error: String,
}

/// The report of `inspect` for one file.
#[derive(JsonSchema, Serialize)]
#[serde(untagged)]
#[expect(dead_code, clippy::large_enum_variant, reason = "only its schema counts")]
enum Inspected {
    Container(ContainerReport),
    Asset(AssetReport),
    Input(Inspection),
}

/// The report of one or several files.
#[derive(JsonSchema, Serialize)]
#[serde(untagged)]
#[expect(dead_code, reason = "only its schema counts")]
enum Files<T> {
    One(T),
    Several(Several<T>),
}

/// The schemas of all reports by verb, as stored in `formats/VERB.schema.json`.
pub fn schemas() -> Vec<(&'static str, Value)> {
    vec![
        ("attach", of_report::<AttachReport>("attach")),
        ("bake", of_report::<BakeJson>("bake")),
        ("compare", of_report::<CompareReport>("compare")),
        ("detach", of_report::<DetachReport>("detach")),
        ("error", of_error()),
        ("export", of_report::<ExportReport>("export")),
        ("inspect", of_files::<Inspected>("inspect")),
        ("probe", of_report::<ProbeReport>("probe")),
        ("render", of_report::<RenderReport>("render")),
        ("report", of_report::<BatchReport>("report")),
        ("scene-result", closed(titled(schema::<SceneResult>(), "scene-result"))),
        ("sweep", of_report::<SweepReport>("sweep")),
        ("sweep-forecast", of_report::<SweepForecast>("sweep-forecast")),
        ("transcode", of_report::<BakeJson>("transcode")),
        ("unpack", of_report::<UnpackReport>("unpack")),
        ("validate", of_files::<Report>("validate")),
        ("view", of_report::<ServedReport>("view")),
    ]
}

fn schema<T: JsonSchema>() -> Schema {
    let settings = SchemaSettings::draft2020_12().for_serialize();
    SchemaGenerator::new(settings).into_root_schema_for::<T>()
}

/// Adds the name of the verb to a schema.
fn titled(schema: Schema, verb: &str) -> Value {
    let mut value = schema.to_value();
    value["$id"] = format!("mipvog-{verb}/1").into();
    value["title"] = format!("What `{verb} --format json` prints").into();
    value
}

/// The schema of a report, which starts with its schema's name and ends with its warnings.
fn of_report<T: JsonSchema>(verb: &str) -> Value {
    let mut value = titled(schema::<T>(), verb);
    state(&mut value, verb);
    warn(&mut value);
    closed(value)
}

/// The schema of an error, which any verb can print instead of its report.
fn of_error() -> Value {
    let mut value = titled(schema::<ErrorReport>(), "error");
    value["title"] = "What a verb that failed prints with `--format json`".into();
    state(&mut value, "error");
    closed(value)
}

/// The schema of a verb that takes one or several files. For several, each report names its file.
fn of_files<T: JsonSchema>(verb: &str) -> Value {
    let mut value = titled(schema::<Files<T>>(), verb);
    value["type"] = "object".into();
    state(&mut value, verb);
    warn(&mut value);
    value["unevaluatedProperties"] = false.into();
    // Alternatives stand beside keys of the object that they are alternatives of.
    let mut open = Vec::new();
    alternatives(&value, &mut open);
    if let Some(Value::Object(definitions)) = value.get_mut("$defs") {
        for (name, definition) in definitions {
            match open.contains(name) {
                true => {
                    let parts = definition.as_object_mut().into_iter().flat_map(Map::values_mut);
                    parts.for_each(close);
                }
                false => close(definition),
            }
        }
    }
    value
}

/// Names of the definitions that are alternatives.
fn alternatives(value: &Value, names: &mut Vec<String>) {
    match value {
        Value::Object(object) => {
            for one in object.get("anyOf").and_then(Value::as_array).into_iter().flatten() {
                let name = one["$ref"].as_str().and_then(|name| name.strip_prefix("#/$defs/"));
                names.extend(name.map(str::to_owned));
            }
            object.values().for_each(|value| alternatives(value, names));
        }
        Value::Array(values) => values.iter().for_each(|value| alternatives(value, names)),
        _ => {}
    }
}

/// Adds the key for the schema's name to a report.
fn state(value: &mut Value, verb: &str) {
    if !value["properties"].is_object() {
        value["properties"] = json!({});
    }
    value["properties"]["schema"] = json!({ "const": format!("mipvog-{verb}/1") });
    match &mut value["required"] {
        // A report that is written as a file states it by itself.
        Value::Array(required) if required.contains(&"schema".into()) => {}
        Value::Array(required) => required.insert(0, "schema".into()),
        required => *required = json!(["schema"]),
    }
}

/// Adds the key for warnings to a report. Reports that are files have none.
fn warn(value: &mut Value) {
    let description = "The warnings of the run.";
    value["properties"]["warnings"] =
        json!({ "type": "array", "items": { "type": "string" }, "description": description });
}

/// Forbids keys that the schema does not name.
fn closed(mut value: Value) -> Value {
    close(&mut value);
    value
}

fn close(value: &mut Value) {
    match value {
        Value::Object(object) => {
            let is_open = object.contains_key("properties")
                && !object.contains_key("additionalProperties")
                && !object.contains_key("unevaluatedProperties");
            if is_open {
                // Keys of alternatives stand beside an object's own.
                let has_alternatives = object.contains_key("anyOf");
                let others =
                    if has_alternatives { "unevaluatedProperties" } else { "additionalProperties" };
                object.insert(others.to_owned(), false.into());
            }
            object.values_mut().for_each(close);
        }
        Value::Array(values) => values.iter_mut().for_each(close),
        _ => {}
    }
}

/// The text of a schema, with keys in the order of the types.
pub fn text(schema: &Value) -> String {
    let text = serde_json::to_string_pretty(schema).unwrap_or_default();
    text + "\n"
}
