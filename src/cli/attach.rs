//! `attach`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use serde::Serialize;

use super::common::Common;
use super::gltf;
use super::outcome::{Outcome, readable, warn};
use super::output::{create as create_output, digest, refuse_stdout};
use super::shell;
use crate::base::bytes::{ByteSink, SourceFile};
use crate::base::error::{Error, Result};
use crate::container::{Container, is_container};
use mipvog_outputs::gltf::asset::{Asset, is_asset};
use mipvog_outputs::gltf::attach::{AttachOptions, NodeChoice, attach, companions};

/// Add a container to a glTF asset
///
/// Everything else in the asset stays as it is.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  mipvog-bake attach scene.glb scene.mipvog --node statue -o both.glb")]
pub struct Arguments {
    /// The asset, .glb or .gltf
    asset: PathBuf,
    /// The container
    container: PathBuf,
    /// The asset to write, of the same kind
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Number or name of the node that shows the field; other viewers show its mesh [default: a new
    /// node in the default scene]
    #[arg(long, value_name = "INDEX|NAME", value_parser = parse_node)]
    node: Option<NodeChoice>,
    /// Link a .glb to the container by URI instead of embedding it
    #[arg(long)]
    external: bool,
    /// Overwrite the output if it exists
    #[arg(long)]
    force: bool,
}

/// The report of `attach`.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct AttachReport {
    /// Path of the input asset.
    asset: String,
    /// Path of the container.
    container: String,
    /// Path of the written asset.
    output: String,
    /// Size of the written asset in bytes.
    output_bytes: u64,
    /// Index of the new field in the asset, from 0.
    field: usize,
    /// Index of the glTF node that shows the field.
    node: usize,
    /// True if the container is embedded in the asset.
    embedded: bool,
    /// SHA-256 of the container in hexadecimal.
    sha256: String,
    /// SHA-256 of the written asset in hexadecimal.
    output_sha256: String,
}

/// Attaches.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    let limits = common.limits();
    let asset = Arc::new(SourceFile::open(&arguments.asset)?);
    let file = Arc::new(SourceFile::open(&arguments.container)?);
    if is_container(&asset) && is_asset(&file) {
        let words = [&arguments.container, &arguments.asset].map(|path| path.as_os_str());
        let output = ["-o".as_ref(), arguments.output.as_os_str()];
        let words = std::iter::once("attach".as_ref()).chain(words).chain(output);
        let error = Error::usage("the asset comes first, then the container");
        return Err(error.advise(shell::command(words)).in_file(&arguments.asset));
    }
    let asset = Asset::open(asset, &limits)?;
    let container = Container::open(file, &limits)?;
    let path = &arguments.output;
    refuse_stdout(path, "the names of other files depend on the asset's own")?;
    check_kind(&asset, path)?;
    let mut output = create_output(path, arguments.force)?;
    let options = AttachOptions { node: arguments.node.clone(), external: arguments.external };
    let attached = attach(&asset, &container, &arguments.container, path, &options, &mut output)?;
    let (bytes, output_sha256) = (output.length(), digest(output.written())?);
    output.finish()?;
    warn_of_companions(&asset, &arguments.asset, path, common)?;
    let report = AttachReport {
        asset: arguments.asset.to_string_lossy().into_owned(),
        container: arguments.container.to_string_lossy().into_owned(),
        output: path.to_string_lossy().into_owned(),
        output_bytes: bytes,
        field: attached.field,
        node: attached.node,
        embedded: attached.embedded,
        sha256: attached.sha256,
        output_sha256,
    };
    let (field, node) = (attached.field, attached.node);
    let text = format!("{}: field {field} on node {node}, {}\n", path.display(), readable(bytes));
    Outcome::new("attach", &report, text)
}

/// Refuses an output whose extension does not match the asset's kind.
pub fn check_kind(asset: &Asset, output: &Path) -> Result<()> {
    let is_glb = asset.chunks().is_some();
    match gltf::is_glb(output) {
        Ok(named_glb) if named_glb != is_glb => {
            let kind = if is_glb { "glb" } else { "gltf" };
            let (asset, output) = (asset.path().display(), output.with_extension(kind));
            let message = format!("{asset} is a .{kind}, so the output must be one, too");
            Err(Error::usage(message).advise(format!("-o {}", output.display())))
        }
        _ => Ok(()),
    }
}

/// Warns of files that `asset` refers to and that stay in the folder of `input` when the asset is
/// written to another folder.
pub fn warn_of_companions(
    asset: &Asset,
    input: &Path,
    output: &Path,
    common: &Common,
) -> Result<()> {
    let folder = |path: &Path| {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        folder.unwrap_or(Path::new(".")).canonicalize().ok()
    };
    if folder(input) == folder(output) {
        return Ok(());
    }
    let names = companions(asset)?;
    if !names.is_empty() {
        let names = names.join(", ");
        warn(&format!("{} needs files beside it too: {names}", output.display()), common);
    }
    Ok(())
}

fn parse_node(text: &str) -> std::result::Result<NodeChoice, String> {
    Ok(match text.parse() {
        Ok(index) => NodeChoice::Index(index),
        Err(_) => NodeChoice::Name(text.to_owned()),
    })
}
