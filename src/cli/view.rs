//! `view`.

use std::net::{IpAddr, Ipv4Addr};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use serde::Serialize;

use super::common::{Common, Format};
use super::field::warn_of_missing;
use super::interrupt;
use super::outcome::{Outcome, print, say, warn, write_stdout};
use super::stdin::{self, named};
use crate::base::bytes::SourceFile;
use crate::base::error::{ErrorKind, Result};
use crate::base::limits::Limits;
use crate::container::Container;
use crate::serve::{Kind, Server, Site};
use mipvog_outputs::gltf::asset::{Asset, Fields};
use mipvog_outputs::gltf::attach::companions;

/// Show a container or an asset in the browser
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  mipvog-bake view scene.mipvog
  mipvog-bake view scene.glb --port 8080 --no-open
  mipvog-bake view scene.mipvog --host 0.0.0.0

Ctrl-C ends it.")]
pub struct Arguments {
    /// A container, or a binary glTF asset with one; - means standard input
    file: PathBuf,
    /// Port to listen on, 0 for any free one
    #[arg(long, value_name = "PORT", default_value_t = 0)]
    port: u16,
    /// Address to listen on. With 0.0.0.0 (all addresses of this machine), everyone on the network
    /// can read the file
    #[arg(long, value_name = "ADDRESS", default_value_t = Ipv4Addr::LOCALHOST.into())]
    host: IpAddr,
    /// Do not open the browser
    #[arg(long)]
    no_open: bool,
}

/// The report of `view`.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct ServedReport {
    /// Path of the served file.
    input: String,
    /// Kind of the served file.
    kind: Kind,
    /// Size of the served file in bytes.
    input_bytes: u64,
    /// Address of the page.
    url: String,
    /// Port that the server listens on, 1 to 65535.
    port: u16,
}

/// Prints the address, opens it in the browser and serves until the program ends.
pub fn run(arguments: &Arguments, common: &Common) -> Result<()> {
    let path = stdin::resolve(&arguments.file)?;
    let file = SourceFile::open(&path)?;
    let input_bytes = file.length();
    let site = Site::new(file)?;
    let kind = site.kind();
    let server = Server::bind(arguments.host, arguments.port, site)?;
    let url = server.url();
    let report = ServedReport {
        input: arguments.file.to_string_lossy().into_owned(),
        kind,
        input_bytes,
        url: url.clone(),
        port: server.address().port(),
    };
    match kind {
        Kind::Asset => {
            warn_of_companions(&arguments.file, common);
            warn_of_no_field(&arguments.file, &common.limits(), common);
        }
        Kind::Container => warn_of_levels(&path, common),
    }
    if !arguments.host.is_loopback() {
        let message = "anybody who reaches this machine can read the file, without a password and \
                       without encryption";
        warn(message, common);
    }
    // Printed before serving, which never ends. The address is the purpose of the verb, so --quiet
    // keeps it.
    let outcome = Outcome::new("view", &report, format!("{url}\n"))?.with_warnings(common);
    match common.format {
        Format::Text => write_stdout(outcome.text.as_bytes())?,
        _ => print(&outcome, common, false)?,
    }
    if !arguments.no_open && open::that_detached(&url).is_err() {
        warn(&format!("no browser was found: open {url} yourself"), common);
    }
    if !common.quiet {
        say("serving until Ctrl-C");
    }
    interrupt::serve();
    server.run();
    Ok(())
}

/// Warns of an asset without a field. The viewer reports other faults of an asset.
fn warn_of_no_field(file: &Path, limits: &Limits, common: &Common) {
    let count = SourceFile::open(file).and_then(|file| {
        let asset = Asset::open(Arc::new(file), limits)?;
        let root = asset.document()?.members()?;
        Ok(Fields::read(&asset, &root)?.objects.len())
    });
    if matches!(count, Ok(0)) {
        warn(&format!("{} has no radiance field, only triangles", file.display()), common);
    }
}

/// Warns of the missing levels of a truncated container. The viewer reports other faults.
fn warn_of_levels(path: &Path, common: &Common) {
    let file = SourceFile::open(path).map(Arc::new);
    match file.and_then(|file| Container::read_prefix(file, &common.limits())) {
        Ok(prefix) => warn_of_missing(&prefix, common),
        Err(error) if matches!(error.kind(), ErrorKind::Truncated { .. }) => {
            warn(&named(&format!("the file ends within a level: {error}")), common);
        }
        Err(_) => {}
    }
}

/// Warns of files that the asset refers to and that are not served. The viewer reports faults of
/// the asset.
fn warn_of_companions(file: &Path, common: &Common) {
    let asset = SourceFile::open(file).map(Arc::new);
    let asset = asset.and_then(|file| Asset::open(file, &common.limits()));
    let names = asset.and_then(|asset| companions(&asset)).unwrap_or_default();
    if !names.is_empty() {
        let (file, names) = (file.display(), names.join(", "));
        warn(&format!("{file} needs other files, which are not served: {names}"), common);
    }
}
