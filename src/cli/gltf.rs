//! The glTF asset that `bake` writes beside the container.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, value_parser};
use serde::Serialize;

use super::layout::grouped;
use super::output::{create as create_output, digest, refuse_stdout};
use crate::base::bytes::{ByteSink, Output, SourceFile};
use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::container::Container;
use mipvog_outputs::gltf::asset::{Asset, EXTENSION};
use mipvog_outputs::gltf::attach::write_fallback;
use mipvog_outputs::gltf::mesh::{FEWEST_TRIANGLES, meshes};

/// Kind of asset, and quality of the mesh for other viewers.
#[derive(Debug, Args)]
pub struct GltfArguments {
    /// Also write a glTF asset, .glb or .gltf; it has the field, and a mesh for other viewers
    #[arg(long, value_name = "OUT.glb|OUT.gltf")]
    gltf: Option<PathBuf>,
    /// Link a .glb to the container by URI instead of embedding it
    #[arg(long, requires = "gltf")]
    external: bool,
    /// Maximum number of triangles in the mesh
    #[arg(long, value_name = "N", default_value_t = 100_000, requires = "gltf")]
    fallback_triangles: usize,
    /// Number of coarser meshes, each with a quarter of the triangles, as levels of detail
    /// (MSFT_lod)
    #[arg(long, value_name = "N", default_value_t = 0, requires = "gltf",
        value_parser = value_parser!(u8).range(0..=8))]
    fallback_lods: u8,
}

/// The written glTF asset.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct GltfReport {
    /// Path of the asset.
    output: String,
    /// Size of the asset in bytes.
    output_bytes: u64,
    /// SHA-256 of the asset in hexadecimal.
    sha256: String,
    /// True if the container is embedded in the asset.
    embedded: bool,
    /// Number of triangles of the fallback mesh.
    triangles: usize,
    /// Number of vertices of the fallback mesh.
    vertices: usize,
    /// Numbers of triangles of the coarser fallback meshes, fine to coarse.
    coarser_triangles: Vec<usize>,
}

/// True if a new asset of this name is a GLB.
pub fn is_glb(path: &Path) -> Result<bool> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("glb") => Ok(true),
        Some("gltf") => Ok(false),
        _ => Err(Error::usage(format!("{} must end in .glb or .gltf", path.display()))),
    }
}

impl GltfArguments {
    /// The asset, if requested.
    pub fn path(&self) -> Option<&Path> {
        self.gltf.as_deref()
    }

    /// True if the existing asset has a field, so that an earlier run may have written it.
    pub fn is_own(&self) -> bool {
        let Some(path) = &self.gltf else { return false };
        let opened = SourceFile::open(path).map(Arc::new);
        let asset = opened.and_then(|file| Asset::open(file, &Limits::default()));
        asset.is_ok_and(|asset| asset.text().contains(EXTENSION))
    }

    /// Starts writing, if an asset is requested. This comes before the work, so that an existing
    /// file is an error immediately.
    pub fn create(&self, container: &Path, overwrite: bool) -> Result<Option<Output>> {
        let Some(path) = &self.gltf else { return Ok(None) };
        is_glb(path)?;
        refuse_stdout(container, "--gltf names the container's file")?;
        if path == container {
            return Err(Error::usage("--gltf and --output name the same file"));
        }
        if !(FEWEST_TRIANGLES..=10_000_000).contains(&self.fallback_triangles) {
            return Err(Error::usage("--fallback-triangles must be from 4 to 10000000"));
        }
        create_output(path, overwrite).map(Some)
    }

    /// Writes the asset of the container in the file `written`, whose name will be `path`.
    pub fn write(
        &self,
        written: &Path,
        path: &Path,
        limits: &Limits,
        output: &mut Output,
    ) -> Result<GltfReport> {
        let asset = self.gltf.as_deref().unwrap_or(Path::new(""));
        let file = Arc::new(SourceFile::open(written)?);
        let container = Container::open(file, limits)?;
        let coarser = usize::from(self.fallback_lods);
        let meshes = meshes(&container, self.fallback_triangles, coarser)?;
        let glb = is_glb(asset)?;
        let attached =
            write_fallback(&meshes, &container, path, asset, glb, self.external, output)?;
        Ok(GltfReport {
            output: asset.to_string_lossy().into_owned(),
            output_bytes: output.length(),
            sha256: digest(output.written())?,
            embedded: attached.embedded,
            triangles: meshes.first().map_or(0, |mesh| mesh.triangles.len()),
            vertices: meshes.first().map_or(0, |mesh| mesh.positions.len()),
            coarser_triangles: meshes.iter().skip(1).map(|mesh| mesh.triangles.len()).collect(),
        })
    }
}

impl GltfReport {
    /// Bytes of the asset.
    pub fn bytes(&self) -> u64 {
        self.output_bytes
    }

    /// For people.
    pub fn text(&self) -> String {
        let bytes = super::outcome::readable(self.output_bytes);
        let container = if self.embedded { "the container" } else { "a link to the container" };
        let triangles = grouped(self.triangles as u64);
        format!("  {}: {bytes}, {container} and {triangles} triangles\n", self.output)
    }
}
