//! `inspect`.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::slice;
use std::sync::Arc;

use clap::Args;
use serde::Serialize;
use serde_json::Value;

use super::common::Common;
use super::container_report::{ContainerReport, container_text};
use super::field::wrong_kind;
use super::files::for_each_file;
use super::folders::input_path;
use super::inputs::refuse_inputs;
use super::layout::{Table, columns, folded};
use super::outcome::{Outcome, assumed, counted, readable};
use super::output::create;
use super::shell;
use super::stdin;
use crate::base::bytes::{ByteSink, SourceFile};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::container::{Container, is_container};
use mipvog_inputs::{Family, Inspection, SceneContent, SceneSettings, SourceOptions};
use mipvog_outputs::gltf::asset::{Asset, Fields, is_asset};

/// Show what files contain, without decoding them
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mipvog-bake inspect scene.mipvog
  mipvog-bake inspect fine_last.tar --format json
  mipvog-bake inspect *.mipvog")]
pub struct Arguments {
    /// Containers, glTF assets, or anything that can be baked; - means standard input
    #[arg(required = true, value_name = "FILE", value_parser = input_path())]
    files: Vec<PathBuf>,
    /// Extract the container's thumbnail to this PNG
    #[arg(long, value_name = "OUT.png")]
    thumbnail: Option<PathBuf>,
    /// Overwrite the thumbnail's file if it exists
    #[arg(long, requires = "thumbnail")]
    force: bool,
}

/// The report of a glTF asset.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct AssetReport {
    /// `glb` or `gltf`.
    kind: &'static str,
    /// Size of the asset's file in bytes.
    file_bytes: u64,
    /// Radiance fields of the asset.
    fields: Vec<FieldReport>,
}

/// A radiance field of a glTF asset.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
struct FieldReport {
    /// Index of the field in the asset, from 0.
    field: usize,
    /// Indices of the glTF nodes that show the field.
    nodes: Vec<usize>,
    /// URI of the container, if the asset links to it.
    uri: Option<Value>,
    /// Index of the buffer view with the container, if embedded.
    buffer_view: Option<Value>,
    /// SHA-256 of the container in hexadecimal, as the asset states it.
    sha256: Value,
    #[serde(flatten)]
    container: ContainerReport,
}

/// Inspects the files. The report of several files also lists those that failed.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    let (limits, verbose) = (common.limits(), common.verbose);
    if let Some(output) = &arguments.thumbnail {
        write_thumbnail(&arguments.files, output, arguments.force, &limits)?;
    }
    for_each_file("inspect", &arguments.files, |path| inspect(path, verbose, &limits))
}

/// Writes the thumbnail of a container.
fn write_thumbnail(files: &[PathBuf], output: &Path, force: bool, limits: &Limits) -> Result<()> {
    let [input] = files else {
        return Err(Error::usage("--thumbnail takes the picture of one file: name one"));
    };
    refuse_inputs([output], slice::from_ref(input))?;
    if output.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("png")) {
        let message = format!("--thumbnail {}: a thumbnail is a PNG", output.display());
        let named = output.with_extension("png");
        return Err(Error::usage(message).advise(format!("--thumbnail {}", named.display())));
    }
    let file = Arc::new(SourceFile::open(&stdin::resolve(input)?)?);
    if !is_container(&file) {
        return Err(wrong_kind(input, "a .mipvog container, to take its thumbnail"));
    }
    let prefix = Container::read_prefix(file, limits)?;
    let png = prefix.container().thumbnail()?.ok_or_else(|| {
        let advice = "put one in: transcode --thumbnail 256";
        let (found, expected) = ("no thumbnail", "chunk thmb");
        Error::malformed(Place::File, found, expected).in_file(input).advise(advice)
    })?;
    let mut output = create(output, force)?;
    output.append(&png)?;
    output.finish()
}

fn inspect(shown: &Path, verbose: bool, limits: &Limits) -> Result<Outcome> {
    let path = &stdin::resolve(shown)?;
    let file = Arc::new(SourceFile::open(path)?);
    if is_container(&file) {
        let prefix = Container::read_prefix(file, limits)?;
        let mut report = ContainerReport::of(prefix.container())?;
        report.levels_missing = prefix.missing().collect();
        return Outcome::new("inspect", &report, container_text(shown, &report, verbose));
    }
    if is_asset(&file) {
        return asset(shown, &Asset::open(file, limits)?, verbose);
    }
    // What a file beside the checkpoint states need not be assumed.
    let mut options = SourceOptions::default();
    let beside = SceneSettings::beside(path, limits)?;
    let stated = beside.map(|beside| (beside.complete(&mut options).join(", "), beside.path));
    let inspection = mipvog_inputs::inspect(path, &options, limits)?;
    let mut text = checkpoint_text(shown, &inspection, verbose);
    if let Some((names, path)) = stated.filter(|(names, _)| !names.is_empty()) {
        let name = path.file_name().unwrap_or_default().display();
        text += &(folded(&format!("  {name} has {names}"), columns(), 4) + "\n");
    }
    Outcome::new("inspect", &inspection, text)
}

fn asset(path: &Path, asset: &Asset, verbose: bool) -> Result<Outcome> {
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
        text += &container_text(Path::new(&name), &field.container, verbose);
    }
    Outcome::new("inspect", &report, text)
}

fn checkpoint_text(path: &Path, inspection: &Inspection, verbose: bool) -> String {
    let mut text = String::new();
    let (kind, bytes) = (inspection.kind.name(), readable(inspection.file_bytes));
    writeln!(text, "{}: {kind}, {bytes}", path.display()).ok();
    let bytes = [inspection.model_bytes, inspection.optimizer_bytes, inspection.other_bytes];
    if bytes.iter().any(|bytes| *bytes > 0) {
        let total: u64 = bytes.iter().sum();
        let [model, optimizer, other] = bytes.map(readable);
        // Entries of an archive are often compressed.
        let inflated = if total > inspection.file_bytes { "uncompressed: " } else { "" };
        let rest = format!("optimizer {optimizer} (never read), other {other}");
        writeln!(text, "  {inflated}scene {model}, {rest}").ok();
    }
    if let Some(model) = &inspection.model {
        write!(text, "  {}", model.name()).ok();
        if let Some(scene) = &inspection.scene {
            let ([x, y, z], channels) = (scene.dimensions, scene.channels);
            write!(text, ": {x} x {y} x {z} voxels, {channels} colour channels").ok();
        }
        text.push('\n');
    }
    if let Some(problem) = &inspection.problem {
        writeln!(text, "  cannot be baked: {problem}").ok();
    }
    if inspection.scene.is_none() && inspection.problem.is_none() {
        let output = path.with_extension("mipvog");
        let words = ["bake".as_ref(), path.as_os_str(), "-o".as_ref(), output.as_os_str()];
        writeln!(text, "  an unpacked container; to pack it: {}", shell::command(words)).ok();
    }
    for assumption in &inspection.assumptions {
        let line = format!("  note: {}", assumed(&assumption.message));
        text += &(folded(&line, columns(), 4) + "\n");
    }
    let is_unbounded = |scene: &SceneContent| scene.march.near == 0.0 && scene.march.far.is_none();
    if matches!(inspection.model, Some(Family::MipVog | Family::Dvgo))
        && inspection.scene.as_ref().is_some_and(is_unbounded)
    {
        let line = "  note: near and far are not stored: rays are not bounded, unless --near and \
                    --far say so; likewise --background, which is white";
        text += &(folded(line, columns(), 4) + "\n");
    }
    if !verbose {
        let count = counted(inspection.values.len(), "entry").replace("entrys", "entries");
        writeln!(text, "  {count}: -v lists them").ok();
        return text;
    }
    let mut table = Table::new(["key", "type", "shape", "value"], 4);
    // Keys and values share the width of a narrow terminal.
    let keys = inspection.values.iter().map(|listed| listed.key.chars().count());
    let room = columns().saturating_sub(keys.max().unwrap_or(0) + 10).clamp(8, 48);
    for listed in &inspection.values {
        table.add([
            listed.key.clone(),
            listed.dtype.unwrap_or(listed.kind).to_owned(),
            listed.shape.as_ref().map(|shape| format!("{shape:?}")).unwrap_or_default(),
            listed.value.as_ref().map(|value| shortened(value, room)).unwrap_or_default(),
        ]);
    }
    text + &table.text(columns())
}

/// A value cut to this many characters, with dots if it is longer.
fn shortened(value: &Value, characters: usize) -> String {
    let text = value.to_string();
    match text.char_indices().nth(characters) {
        Some((end, _)) => format!("{} ...", &text[..end]),
        None => text,
    }
}
