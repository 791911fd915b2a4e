//! `detach`.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use serde::Serialize;

use super::attach::{check_kind, warn_of_companions};
use super::common::Common;
use super::outcome::{Outcome, counted, readable};
use super::output::{create as create_output, digest, refuse_stdout};
use super::stdin;
use crate::base::bytes::{ByteSink, SourceFile};
use crate::base::error::Result;
use mipvog_outputs::gltf::asset::Asset;
use mipvog_outputs::gltf::attach::detach;

/// Remove fields from a glTF asset
///
/// Everything else in the asset stays as it is.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  mipvog-bake detach scene.glb -o mesh.glb")]
pub struct Arguments {
    /// The asset, .glb or .gltf; - means standard input
    asset: PathBuf,
    /// The asset to write, of the same kind
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Number of the field to remove [default: all]
    #[arg(long, value_name = "I")]
    field: Option<usize>,
    /// Overwrite the output if it exists
    #[arg(long)]
    force: bool,
}

/// The report of `detach`.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct DetachReport {
    /// Path of the input asset.
    asset: String,
    /// Path of the written asset.
    output: String,
    /// Size of the written asset in bytes.
    output_bytes: u64,
    /// SHA-256 of the written asset in hexadecimal.
    sha256: String,
    /// Indices of the removed fields, from 0.
    fields: Vec<usize>,
    /// Number of fields that remain.
    left: usize,
}

/// Detaches.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    let file = Arc::new(SourceFile::open(&stdin::resolve(&arguments.asset)?)?);
    let asset = Asset::open(file, &common.limits())?;
    let path = &arguments.output;
    refuse_stdout(path, "the finished asset is read again")?;
    check_kind(&asset, path)?;
    let mut output = create_output(path, arguments.force)?;
    let detached = detach(&asset, arguments.field, &mut output)?;
    let (bytes, sha256) = (output.length(), digest(output.written())?);
    output.finish()?;
    let left = Asset::open(Arc::new(SourceFile::open(path)?), &common.limits())?;
    warn_of_companions(&left, &arguments.asset, path, common)?;
    let report = DetachReport {
        asset: arguments.asset.to_string_lossy().into_owned(),
        output: path.to_string_lossy().into_owned(),
        output_bytes: bytes,
        sha256,
        fields: detached.fields.clone(),
        left: detached.left,
    };
    let (taken, left) = (counted(detached.fields.len(), "field"), detached.left);
    let bytes = readable(bytes);
    let text = format!("{}: {taken} removed, {left} left, {bytes}\n", path.display());
    Outcome::new("detach", &report, text)
}
