//! `inspect`.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use serde::Serialize;
use serde_json::Value;

use super::outcome::{Outcome, readable};
use crate::bake::{GroupReport, LevelReport, level_reports};
use crate::base::bytes::SourceFile;
use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::codec::container::{Container, is_container};
use crate::input;
use crate::input::checkpoint::{Inspection, SourceOptions};
use crate::model::baked::{Group, Metadata};
use crate::model::grid::Bounds;
use crate::output::gltf::asset::{Asset, Fields, is_asset};

/// Show the contents of a container, a glTF asset or a checkpoint, without decoding it
#[derive(Debug, Args)]
pub struct Arguments {
    /// A container, a glTF asset, or anything that can be baked
    file: PathBuf,
}

#[derive(Debug, Serialize)]
struct ContainerReport {
    version: [u16; 2],
    file_bytes: u64,
    dimensions: [usize; 3],
    bounds: Bounds,
    /// Fine to coarse.
    levels: Vec<LevelReport>,
    /// Layer widths.
    mlp: Option<Vec<usize>>,
    /// Levels that a file which was cut does not hold; 0 is the finest.
    levels_missing: Vec<usize>,
    chunks: Vec<ChunkReport>,
    metadata: Metadata,
    provenance: Option<Value>,
}

#[derive(Debug, Serialize)]
struct AssetReport {
    kind: &'static str,
    file_bytes: u64,
    fields: Vec<FieldReport>,
}

/// A radiance field of an asset.
#[derive(Debug, Serialize)]
struct FieldReport {
    field: usize,
    /// Nodes that show it.
    nodes: Vec<usize>,
    uri: Option<Value>,
    buffer_view: Option<Value>,
    sha256: Value,
    #[serde(flatten)]
    container: ContainerReport,
}

#[derive(Debug, Serialize)]
struct ChunkReport {
    kind: String,
    level: Option<u32>,
    offset: u64,
    bytes: u64,
    critical: bool,
}

/// Inspects a file.
pub fn run(arguments: &Arguments, limits: &Limits) -> Result<Outcome> {
    let path = &arguments.file;
    let file = Arc::new(SourceFile::open(path)?);
    if is_container(&file) {
        let prefix = Container::read_prefix(file, limits)?;
        let mut report = ContainerReport::of(prefix.container())?;
        report.levels_missing = prefix.missing().collect();
        return Outcome::new("inspect", &report, container_text(path, &report));
    }
    if is_asset(&file) {
        return asset(path, &Asset::open(file, limits)?);
    }
    let inspection = input::inspect(path, &SourceOptions::default(), limits)?;
    Outcome::new("inspect", &inspection, checkpoint_text(path, &inspection))
}

impl ContainerReport {
    fn of(container: &Container) -> Result<Self> {
        let metadata = container.metadata();
        let chunk = |entry: &crate::codec::container::layout::Entry| ChunkReport {
            kind: entry.kind.escape_ascii().to_string(),
            level: entry.level,
            offset: entry.offset,
            bytes: entry.length,
            critical: entry.is_critical(),
        };
        Ok(Self {
            version: container.header().version,
            file_bytes: container.header().file_length,
            dimensions: metadata.levels.first().map_or([0; 3], |level| level.dimensions),
            bounds: metadata.bounds,
            levels: level_reports(metadata, container.entries()),
            mlp: metadata.view.as_ref().map(|view| view.widths.clone()),
            levels_missing: Vec::new(),
            chunks: container.entries().iter().map(chunk).collect(),
            metadata: metadata.clone(),
            provenance: container.provenance()?,
        })
    }
}

fn asset(path: &Path, asset: &Asset) -> Result<Outcome> {
    let root = asset.document()?.members()?;
    let fields = Fields::read(asset, &root)?;
    let mut report = AssetReport {
        kind: if asset.chunks().is_some() { "glb" } else { "gltf" },
        file_bytes: asset.file().length(),
        fields: Vec::new(),
    };
    for (field, object) in fields.objects.iter().enumerate() {
        let properties = object.members()?;
        let own =
            |name: &str| properties.get(name).map(|value| value.parse::<Value>("JSON")).transpose();
        let users = fields.users.iter().filter(|user| user.field == field);
        report.fields.push(FieldReport {
            field,
            nodes: users.map(|user| user.node).collect(),
            uri: own("uri")?,
            buffer_view: own("bufferView")?,
            sha256: own("sha256")?.unwrap_or_default(),
            container: ContainerReport::of(&asset.open_field(field)?)?,
        });
    }
    let (kind, bytes, count) = (report.kind, readable(report.file_bytes), report.fields.len());
    let mut text = format!("{}: {kind}, {bytes}, radiance fields: {count}\n", path.display());
    for field in &report.fields {
        let name = format!("field {} on nodes {:?}", field.field, field.nodes);
        text += &container_text(Path::new(&name), &field.container);
    }
    Outcome::new("inspect", &report, text)
}

fn container_text(path: &Path, report: &ContainerReport) -> String {
    let mut text = String::new();
    let [major, minor] = report.version;
    let [min, max] = [report.bounds.min, report.bounds.max];
    writeln!(
        text,
        "{}: container {major}.{minor}, {}",
        path.display(),
        readable(report.file_bytes)
    )
    .ok();
    writeln!(text, "  box {min:?} to {max:?}, levels by {}", report.metadata.filter).ok();
    match &report.mlp {
        Some(widths) => writeln!(text, "  view network {widths:?}").ok(),
        None => writeln!(text, "  no view network").ok(),
    };
    text + &levels_text(&report.levels)
}

/// A table of levels.
pub(super) fn levels_text(levels: &[LevelReport]) -> String {
    let mut text = String::from("  level   dimensions      blocks stored      bytes     prefix");
    for group in Group::ALL {
        write!(text, "   {:14}", group.name()).ok();
    }
    text = text.trim_end().to_owned() + "\n";
    for level in levels {
        let [x, y, z] = level.dimensions;
        let share = 100.0 * level.blocks_stored as f64 / level.blocks_total.max(1) as f64;
        let mut row = format!(
            "  {:5}   {:14} {:>9} {:>5.1} % {:>10} {:>10}",
            level.level,
            format!("{x} x {y} x {z}"),
            level.blocks_stored,
            share,
            readable(level.stored_bytes),
            level.prefix_bytes.map_or_else(|| "-".to_owned(), readable),
        );
        for group in Group::ALL {
            let stored = level.groups.iter().find(|stored| stored.group == group.name());
            write!(row, "   {:14}", stored.map_or_else(|| "-".to_owned(), depth)).ok();
        }
        text += row.trim_end();
        text.push('\n');
    }
    text
}

/// A group's bits and proved error, as three digits that are none too few.
fn depth(stored: &GroupReport) -> String {
    let (Some(bits), Some(error)) = (&stored.bits, stored.max_error.map(f64::from)) else {
        return "-".to_owned();
    };
    if error == 0.0 {
        return format!("{bits} exact");
    }
    let mut shown = format!("{error:.2e}");
    if shown.parse().is_ok_and(|shown: f64| shown < error) {
        let unit = 10f64.powi(error.log10().floor() as i32 - 2);
        shown = format!("{:.2e}", error + 0.5 * unit);
    }
    let unit = if bits.starts_with('f') { "" } else { " bit" };
    format!("{bits}{unit} {shown}")
}

fn checkpoint_text(path: &Path, inspection: &Inspection) -> String {
    let mut text = String::new();
    let (kind, bytes) = (inspection.kind.name(), readable(inspection.file_bytes));
    writeln!(text, "{}: {kind}, {bytes}", path.display()).ok();
    let [model, optimizer, other] =
        [inspection.model_bytes, inspection.optimizer_bytes, inspection.other_bytes].map(readable);
    writeln!(text, "  model {model}, optimizer {optimizer} (never read), other {other}").ok();
    if let Some(model) = &inspection.model {
        let [x, y, z] = model.dimensions;
        writeln!(
            text,
            "  {}: {x} x {y} x {z} nodes, {} colour channels",
            model.family.name(),
            model.channels
        )
        .ok();
    }
    if let Some(problem) = &inspection.problem {
        writeln!(text, "  cannot be baked: {problem}").ok();
    }
    for assumption in &inspection.assumptions {
        writeln!(text, "  assumes {}", assumption.message).ok();
    }
    for listed in &inspection.values {
        let value = listed.value.as_ref().map(Value::to_string).unwrap_or_default();
        let shape = listed.shape.as_ref().map(|shape| format!("{shape:?}")).unwrap_or_default();
        let dtype = listed.dtype.unwrap_or(listed.kind);
        writeln!(text, "  {:44} {dtype} {shape} {value}", listed.key).ok();
    }
    text
}
