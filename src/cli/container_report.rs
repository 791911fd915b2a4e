//! The report of a container, as JSON and as text.

use std::fmt::Write;
use std::path::Path;

use serde::Serialize;
use serde_json::Value;

use super::layout::{Table, columns, folded};
use super::outcome::readable;
use crate::bake::{GroupReport, LevelReport, level_reports, shell_reports};
use crate::base::error::Result;
use crate::container::Container;
use crate::model::baked::{Group, LevelOfDetail, Metadata, ViewMetadata};
use crate::model::grid::Bounds;

/// The contents of a container.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct ContainerReport {
    /// Major and minor version of the format.
    pub(super) version: [u16; 2],
    /// Size of the complete container in bytes.
    pub(super) file_bytes: u64,
    /// Nodes of level 0 along x, y and z.
    pub(super) dimensions: [usize; 3],
    /// Outermost box, in world units.
    pub(super) bounds: Bounds,
    /// Levels, fine to coarse.
    pub(super) levels: Vec<LevelReport>,
    /// Shells of levels from 1 on, around the next smaller box; empty without nested boxes.
    pub(super) shells: Vec<LevelReport>,
    /// Layer widths of the view network, from input to output; null without one.
    pub(super) mlp: Option<Vec<usize>>,
    /// Levels missing from a truncated file; 0 is the finest.
    pub(super) levels_missing: Vec<usize>,
    /// Chunks, in the order of the file.
    pub(super) chunks: Vec<ChunkReport>,
    /// Metadata of the container.
    pub(super) metadata: Metadata,
    /// Provenance of the container, if stored.
    pub(super) provenance: Option<Value>,
}

/// A chunk of a container.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct ChunkReport {
    /// Type of the chunk: four ASCII letters.
    kind: String,
    /// Level that the chunk belongs to, 0 being the finest; null if it belongs to none.
    level: Option<u32>,
    /// Offset of the first byte in the container.
    offset: u64,
    /// Length in bytes, without padding.
    bytes: u64,
    /// True if a reader must understand the chunk.
    critical: bool,
}

impl ContainerReport {
    pub(super) fn of(container: &Container) -> Result<Self> {
        let metadata = container.metadata();
        let network = metadata.view.as_ref().and_then(ViewMetadata::network);
        let chunk = |entry: &crate::container::layout::Entry| ChunkReport {
            kind: entry.kind.escape_ascii().to_string(),
            level: entry.level,
            offset: entry.offset,
            bytes: entry.length,
            critical: entry.is_critical(),
        };
        let provenance = container.provenance()?;
        let options = provenance.as_ref().map_or(&Value::Null, |of| &of["options"]);
        Ok(Self {
            version: container.header().version,
            file_bytes: container.header().file_length,
            dimensions: metadata.levels.first().map_or([0; 3], |level| level.dimensions),
            bounds: metadata.outer_bounds(),
            levels: level_reports(metadata, container.entries(), options),
            shells: shell_reports(metadata, container.entries(), options),
            mlp: network.map(|network| network.widths.clone()),
            levels_missing: Vec::new(),
            chunks: container.entries().iter().map(chunk).collect(),
            metadata: metadata.clone(),
            provenance,
        })
    }
}

/// A container's origin, the settings of its pictures, and its levels.
pub(super) fn container_text(path: &Path, report: &ContainerReport, verbose: bool) -> String {
    let mut text = String::new();
    let [major, minor] = report.version;
    let metadata = &report.metadata;
    let bytes = readable(report.file_bytes);
    writeln!(text, "{}: container {major}.{minor}, {bytes}", path.display()).ok();
    if let Some(origin) = report.provenance.as_ref().and_then(origin_text) {
        text += &(folded(&format!("  {origin}"), columns(), 4) + "\n");
    }
    let [min, max] = [report.bounds.min, report.bounds.max];
    let line = format!("  box {min:.4?} to {max:.4?}, filter {}", metadata.filter);
    text += &(folded(&line, columns(), 4) + "\n");
    let march = &metadata.march;
    let far = march.far.map_or_else(|| "unlimited".to_owned(), |far| far.to_string());
    let line = format!(
        "  step length {} voxels of {:.4}, near {}, far {far}, background {}",
        march.stepsize,
        march.voxel_size,
        march.near,
        color_text(metadata.background)
    );
    text += &(folded(&line, columns(), 4) + "\n");
    let network = report.mlp.as_ref();
    let harmonics = metadata.view.as_ref().and_then(ViewMetadata::harmonics);
    let view = match (network, harmonics) {
        (Some(widths), _) if verbose => format!("view-dependent colour: a network, {widths:?}"),
        (Some(_), _) => "view-dependent colour: a network".to_owned(),
        (None, Some(harmonics)) => {
            format!("view-dependent colour: harmonics of degree {}", harmonics.degree)
        }
        (None, None) => "view-dependent colour: none".to_owned(),
    };
    writeln!(text, "  {view}").ok();
    if verbose {
        text += &rule_text(&metadata.level_of_detail);
    }
    if !report.levels_missing.is_empty() {
        let missing = &report.levels_missing;
        writeln!(text, "  the file ends early: levels {missing:?} are missing").ok();
    }
    text += &levels_text(&report.levels, &report.shells, verbose);
    if verbose {
        text += &legend(!report.shells.is_empty());
    }
    text
}

/// The rule that picks the level of a sample.
fn rule_text(rule: &LevelOfDetail) -> String {
    let mut line =
        format!("  level of a sample: {} log2(footprint in voxels) {:+}", rule.factor, rule.bias);
    for [start, change] in rule.bends.as_slice() {
        write!(line, ", from {start} on {change:+} steeper").ok();
    }
    if let Some(bound) = rule.bound {
        write!(line, ", at most {bound}").ok();
    }
    folded(&line, columns(), 4) + "\n"
}

/// A colour as its option takes it.
pub(super) fn color_text([red, green, blue]: [f32; 3]) -> String {
    match red == green && green == blue {
        true => red.to_string(),
        false => format!("{red},{green},{blue}"),
    }
}

/// Explanation of the columns of [`levels_text`].
const LEGEND: [&str; 3] = [
    "prefix: bytes from the start of the file that draw this level and all coarser ones",
    "density, diffuse, ...: bits per value, and the largest error of opacity over one step or of \
     colour (0 to 1)",
    "out: what a level shows around the next smaller box",
];

/// The legend of a table of levels.
pub(super) fn legend(has_shells: bool) -> String {
    let lines = LEGEND.iter().take(if has_shells { 3 } else { 2 });
    lines.map(|line| folded(&format!("  {line}"), columns(), 4) + "\n").collect()
}

/// The tool, the input and the filter that made a container.
fn origin_text(provenance: &Value) -> Option<String> {
    let text = |pointer: &str| provenance.pointer(pointer).and_then(Value::as_str);
    let (tool, version) = (text("/tool")?, text("/version")?);
    let mut origin = format!("made by {tool} {version}");
    if let Some(kind) = text("/input/kind") {
        let article = if kind.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" };
        write!(origin, " from {article} {kind}").ok();
    }
    if let Some(digest) = text("/input/sha256") {
        write!(origin, ", fingerprint {}", digest.get(..16).unwrap_or(digest)).ok();
    }
    Some(origin)
}

/// A table of levels and shells. With `errors`, each group of any level has a column.
pub(super) fn levels_text(levels: &[LevelReport], shells: &[LevelReport], errors: bool) -> String {
    let rows = levels.iter().map(|level| (format!("{}", level.level), level));
    let shells = shells.iter().map(|shell| (format!("out {}", shell.level), shell));
    let rows: Vec<(String, &LevelReport)> = rows.chain(shells).collect();
    let stored = |group: &Group| {
        let mut all = rows.iter().flat_map(|(_, level)| &level.groups);
        all.any(|stored| stored.group == group.name())
    };
    let groups = Group::ALL.into_iter().filter(|group| errors && stored(group));
    let groups: Vec<Group> = groups.collect();
    let heads = ["level", "voxels", "blocks stored", "bytes", "prefix"].map(str::to_owned);
    let mut table = Table::new(heads.into_iter().chain(groups.iter().map(|g| g.name().into())), 2);
    for (name, level) in &rows {
        let [x, y, z] = level.dimensions;
        let share = 100.0 * level.blocks_stored as f64 / level.blocks_total.max(1) as f64;
        let cells = [
            name.clone(),
            format!("{x} x {y} x {z}"),
            format!("{} {share:>5.1} %", level.blocks_stored),
            readable(level.stored_bytes),
            level.prefix_bytes.map_or_else(|| "-".to_owned(), readable),
        ];
        let depths = groups.iter().map(|group| {
            let stored = level.groups.iter().find(|stored| stored.group == group.name());
            stored.map_or_else(|| "-".to_owned(), depth)
        });
        table.add(cells.into_iter().chain(depths));
    }
    let mut text = table.text(columns());
    if !errors {
        return text;
    }
    if rows.iter().flat_map(|(_, level)| &level.groups).any(|group| group.moved_error.is_some()) {
        let line = "  errors are of what can be seen; colours inside matter may differ by more";
        text += &(folded(line, columns(), 4) + "\n");
    }
    text
}

/// A group's bits and proved error, rounded up to three digits.
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
