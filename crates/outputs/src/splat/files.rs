//! Kinds of splat files, by the output's name.

use std::path::Path;

use serde_json::{Value, json};

use super::project::{GaussianSplat, Rules};
use super::{gltf, ply, spz};
use crate::base::bytes::ByteSink as _;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{LimitName, Limits};
use crate::export_files::{ExportFiles, WrittenFiles};
use crate::gltf::asset::{Asset, Piece, uri, write_glb};

/// A kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// That of the training code of 3D Gaussian Splatting.
    Ply,
    /// Niantic's compressed splats.
    Spz,
    /// glTF in one file.
    Glb,
    /// glTF with its arrays in a file beside it.
    Gltf,
}

/// The provenance in a file.
#[derive(Debug)]
pub struct Origin<'a> {
    /// Name of the source, without folders.
    pub name: &'a str,
    /// Its SHA-256, in hexadecimal digits.
    pub sha256: &'a str,
}

impl FileKind {
    const ALL: [Self; 4] = [Self::Ply, Self::Spz, Self::Glb, Self::Gltf];

    /// The kind for an output's name.
    ///
    /// # Errors
    /// `Usage` for other names.
    pub fn of(output: &Path) -> Result<Self> {
        let own = output.extension().and_then(|extension| extension.to_str());
        let found = Self::ALL.into_iter().find(|kind| own == Some(kind.extension()));
        found.ok_or_else(|| {
            let output = output.display();
            let message = "the name of a file of splats must end in .ply, .spz, .glb or .gltf";
            Error::usage(format!("-o {output}: {message}"))
        })
    }

    /// The extension of this kind.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Spz => "spz",
            Self::Glb => "glb",
            Self::Gltf => "gltf",
        }
    }

    /// The format's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ply => "3D Gaussian Splatting PLY",
            Self::Spz => "SPZ 3",
            Self::Glb | Self::Gltf => gltf::EXTENSION,
        }
    }

    /// The rendering rules of its programs.
    pub fn rules(self) -> Rules {
        match self {
            Self::Ply | Self::Spz => Rules::TRAINING,
            Self::Glb | Self::Gltf => Rules::GLTF,
        }
    }

    /// Writes splats in training axes. `bits` are those after the point of positions in `.spz`.
    ///
    /// # Errors
    /// Errors of writing.
    pub fn write(
        self,
        splats: &[GaussianSplat],
        bits: i32,
        origin: &Origin,
        files: &mut ExportFiles,
    ) -> Result<()> {
        let path = files.output().to_owned();
        let document = || {
            let extras = json!({ "source": origin.name, "sha256": origin.sha256 });
            gltf::document(splats, &extras)
        };
        match self {
            Self::Ply => {
                let comment = format!(
                    "mipvog-bake {} of {} sha256 {}",
                    env!("CARGO_PKG_VERSION"),
                    origin.name.replace(['\n', '\r'], " "),
                    origin.sha256
                );
                files.add(path, &ply::bytes(splats, &comment))
            }
            Self::Spz => files.add(path, &spz::bytes(splats, bits)),
            Self::Glb => {
                let (document, bytes) = document();
                let bin = [Piece::Bytes(bytes)];
                write_glb(&document.to_string(), &bin, None, files.create(path)?)
            }
            Self::Gltf => {
                let (mut document, bytes) = document();
                let beside = path.with_extension("bin");
                document["buffers"][0]["uri"] = uri::relative(&path, &beside)?.into();
                files.create(path)?.append(document.to_string().as_bytes())?;
                files.add(beside, &bytes)
            }
        }
    }

    /// Reads written splats back, into training axes.
    ///
    /// # Errors
    /// `Malformed` for bytes that [`Self::write`] does not write, and more memory than the limits
    /// allow.
    pub fn read(self, files: &WrittenFiles, limits: &Limits) -> Result<Vec<GaussianSplat>> {
        let file = files.with_extension(self.extension())?;
        let what = (LimitName::Memory, "bytes of splats");
        match self {
            Self::Ply => ply::read(&file, limits),
            Self::Spz => spz::read(&file, limits),
            Self::Glb => {
                let asset = Asset::open(file.clone(), limits)?;
                let document: Value = serde_json::from_str(asset.text()).map_err(|_| not_json())?;
                let bin = asset.chunks().and_then(|chunks| chunks.bin.clone()).unwrap_or(0..0);
                let length = bin.end - bin.start;
                gltf::read(&document, &file.read_bounded(bin.start, length, what, limits.memory)?)
            }
            Self::Gltf => {
                let text = file.read_bounded(0, file.length(), what, limits.memory)?;
                let document: Value = serde_json::from_slice(&text).map_err(|_| not_json())?;
                let beside = files.with_extension("bin")?;
                let bytes = beside.read_bounded(0, beside.length(), what, limits.memory)?;
                gltf::read(&document, &bytes)
            }
        }
    }
}

fn not_json() -> Error {
    Error::malformed(Place::File, "no JSON", "the document of an asset")
}
