//! A trained model whose file is understood.

use std::path::PathBuf;
use std::sync::Arc;

use crate::base::bytes::SourceFile;
use crate::model::field::RadianceField;
use crate::model::trained_model::LoadModel;
use crate::tensor::FileKind;

/// A trained model that can be baked.
#[derive(Debug, Clone)]
pub struct Source {
    /// The trained scene; its grids are still in the file.
    pub field: RadianceField,
    /// The model with its own program's rules, if they differ from the field's. It renders pictures
    /// of the unbaked input.
    pub model: Option<Arc<dyn LoadModel>>,
    /// The program family that wrote it.
    pub family: Family,
    /// Format of the file.
    pub kind: FileKind,
    /// True if the digest holds checksums of all values.
    pub has_checksums: bool,
    /// True for an unbounded scene; the user decides how much of it is kept.
    pub is_unbounded: bool,
    /// Input units per scene unit, unless the user sets another value.
    pub scene_scale: f32,
    /// Assumed values of missing settings, to be shown to the user.
    pub assumptions: Vec<Assumption>,
    /// Names of the settings of [`SourceOptions`](super::SourceOptions) that the file records.
    pub recorded: Vec<&'static str>,
    /// SHA-256 that stands for its content; see
    /// [`crate::tensor::TensorFile::digest`].
    pub digest: [u8; 32],
    /// The open file.
    pub file: Arc<SourceFile>,
    /// Other files that were used: the coarse checkpoint, the network's.
    pub side_files: Vec<SideFile>,
}

/// Another file that a scene was read from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SideFile {
    /// `coarse`, `mlp` or `args`.
    pub role: &'static str,
    /// Its path.
    pub path: PathBuf,
    /// SHA-256 that stands for its content.
    pub digest: [u8; 32],
}

/// The program or model family that a checkpoint comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// Mip-VoG's research code.
    MipVog,
    /// DirectVoxGO, with names of either generation.
    Dvgo,
    /// Plenoxels (svox2).
    Plenoxels,
    /// PlenOctrees (svox, volrend).
    #[serde(rename = "plenoctree")]
    PlenOctree,
    /// Sampled arrays of density and colour, from any program.
    Sampled,
    /// TensoRF, vector-matrix or CP.
    Tensorf,
    /// SNeRG's folders of assets.
    Snerg,
    /// MERF's folders of assets: the core of the scene only.
    Merf,
    /// Instant-NGP's snapshots.
    InstantNgp,
    /// torch-ngp.
    TorchNgp,
    /// SVRaster, and programs with the same file format.
    #[serde(rename = "svraster")]
    SvRaster,
    /// nerfstudio's nerfacto.
    Nerfacto,
    /// Volumes in OpenVDB files.
    Vdb,
}

impl Source {
    /// The name of the file that states what is `recorded`: one beside the input, or the input,
    /// as `checkpoint`.
    pub fn recorded_in(&self) -> String {
        let beside = match self.family {
            Family::Plenoxels | Family::SvRaster => self.side_files.first(),
            _ => None,
        };
        let name = beside.and_then(|file| file.path.file_name());
        name.map_or_else(|| "checkpoint".to_owned(), |name| name.to_string_lossy().into_owned())
    }

    /// Bytes of the files that hold the scene: the input, and the pictures of a folder.
    pub fn content_bytes(&self) -> u64 {
        let is_folder = matches!(self.family, Family::Snerg | Family::Merf);
        let pictures = self.side_files.iter().filter(|_| is_folder);
        let length = |file: &SideFile| std::fs::metadata(&file.path).map_or(0, |data| data.len());
        self.file.length() + pictures.map(length).sum::<u64>()
    }

    /// True if the field is made of samples of a model without values at the nodes of a grid.
    pub fn is_resampled(&self) -> bool {
        self.is_unbounded
            || matches!(self.family, Family::PlenOctree | Family::SvRaster)
            || self.family.is_sampled()
    }
}

impl Family {
    /// True for models without a grid of values: nodes are placed as the user says.
    pub const fn is_sampled(self) -> bool {
        matches!(self, Self::InstantNgp | Self::TorchNgp | Self::Nerfacto)
    }

    /// Its common name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::MipVog => "Mip-VoG",
            Self::Dvgo => "DirectVoxGO",
            Self::Plenoxels => "Plenoxels",
            Self::PlenOctree => "PlenOctree",
            Self::Sampled => "sampled",
            Self::Tensorf => "TensoRF",
            Self::Snerg => "SNeRG",
            Self::Merf => "MERF",
            Self::InstantNgp => "Instant-NGP",
            Self::TorchNgp => "torch-ngp",
            Self::SvRaster => "SVRaster",
            Self::Nerfacto => "nerfacto",
            Self::Vdb => "OpenVDB",
        }
    }
}

/// An assumed value for a setting that the input lacks.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct Assumption {
    /// Name of the missing setting.
    pub key: &'static str,
    /// Assumed value.
    pub value: String,
    /// Warning: the missing setting, the assumed value, and the option that sets it.
    pub message: String,
}
