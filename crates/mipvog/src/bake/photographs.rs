//! Photographs that replace pictures of level 0 in a fit.

use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::base::bytes::{SourceFile, sha256};
use crate::base::error::Result;
use crate::model::camera::Camera;
use crate::view::compare::photograph_file;

/// A folder of photographs, one for each camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Photographs {
    /// The folder. Files are named as the camera file names its frames.
    pub folder: PathBuf,
    /// The SHA-256 of the files' SHA-256, in the cameras' order.
    pub sha256: [u8; 32],
}

impl Photographs {
    /// The `cameras`' photographs in `folder`.
    ///
    /// # Errors
    /// A photograph that is missing or cannot be read.
    pub fn of(folder: &Path, cameras: &[Camera]) -> Result<Self> {
        let mut sum = Sha256::new();
        for camera in cameras {
            sum.update(sha256(&SourceFile::open(&photograph_file(folder, camera)?)?)?);
        }
        Ok(Self { folder: folder.to_owned(), sha256: sum.finalize().into() })
    }
}
