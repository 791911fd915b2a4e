//! Persistent results.
//!
//! Each container has a record beside it: a digest of all inputs of its result, and the result. A
//! record without a result claims the names before other files are written, so that an interrupted
//! sweep recognizes its own files.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::options::SweepOptions;
use super::report::Measured;
use super::setting::Setting;
use super::thumbnail::Thumbnail;
use crate::base::bytes::hex;
use crate::base::bytes::{ByteSink, Output, SourceFile};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::Limits;
use crate::base::parallel;
use crate::model::camera::Camera;
use crate::model::field::Lookup;
use mipvog_inputs::Source;

/// Schema of a setting's record.
pub const RECORD_SCHEMA: &str = "mipvog-sweep-setting/1";
/// Bytes of an input that are read at once.
const CHUNK: u64 = 1 << 22;

/// A sweep's record of a setting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SettingRecord {
    schema: String,
    setting: String,
    digest: String,
    result: Option<Measured>,
    /// A small picture of it; none in records of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    thumbnail: Option<Thumbnail>,
}

/// The result of a setting, and a small picture of it.
pub type Kept = (Measured, Option<Thumbnail>);

/// Path of a setting's container.
pub fn container_path(folder: &Path, setting: &Setting) -> PathBuf {
    folder.join(format!("{}.mipvog", setting.name))
}

fn record_path(folder: &Path, setting: &Setting) -> PathBuf {
    folder.join(format!("{}.json", setting.name))
}

impl SettingRecord {
    /// A record of a result; without a result, the claim to its names.
    pub fn new(setting: &Setting, digest: &str, result: Option<Kept>) -> Self {
        let (schema, setting) = (RECORD_SCHEMA.to_owned(), setting.name.clone());
        let (result, thumbnail) = result.unzip();
        let thumbnail = thumbnail.flatten();
        Self { schema, setting, digest: digest.to_owned(), result, thumbnail }
    }

    /// Writes it beside the setting's container.
    pub fn write(&self, folder: &Path, setting: &Setting) -> Result<()> {
        let path = record_path(folder, setting);
        let text = serde_json::to_string_pretty(self)
            .map_err(|error| Error::malformed(Place::File, error.to_string(), "finite numbers"))?;
        write_file(&path, format!("{text}\n").as_bytes())
    }
}

/// Writes a file that the sweep may replace.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut output = Output::create(path, true)?;
    output.append(bytes)?;
    output.finish()
}

/// The result of a setting from an earlier sweep, if its inputs are the same and its container
/// still exists. An unreadable result is made again.
pub fn finished(folder: &Path, setting: &Setting, digest: &str, limits: &Limits) -> Option<Kept> {
    let record = read(&record_path(folder, setting), limits)?;
    let record: SettingRecord = serde_json::from_slice(&record).ok()?;
    if record.schema != RECORD_SCHEMA || record.digest != digest {
        return None;
    }
    let found = container_path(folder, setting).symlink_metadata().ok()?;
    let result = record.result?;
    let is_there = found.is_file() && found.len() == result.output_bytes;
    is_there.then_some((result, record.thumbnail))
}

/// Refuses to start if an output would replace a file that no sweep wrote.
pub fn refuse_foreign(folder: &Path, settings: &[&Setting], limits: &Limits) -> Result<()> {
    let setting_files = |&setting: &&Setting| {
        let record = record_path(folder, setting);
        (is_ours(&record, RECORD_SCHEMA, limits), vec![record, container_path(folder, setting)])
    };
    let page = folder.join("sweep.json");
    let beside = ["sweep.csv", "sweep.html"].map(|name| folder.join(name));
    let report = (is_ours(&page, super::SCHEMA, limits), [vec![page], beside.to_vec()].concat());
    let groups = settings.iter().map(setting_files).chain([report]);
    let foreign = groups.filter(|(ours, _)| !ours).flat_map(|(_, files)| files);
    let mut taken = foreign.filter(|file| file.symlink_metadata().is_ok());
    match taken.next() {
        None => Ok(()),
        Some(file) => Err(Error::new(ErrorKind::Exists, Place::File).in_file(&file)),
    }
}

fn is_ours(path: &Path, schema: &str, limits: &Limits) -> bool {
    let document = read(path, limits).and_then(|text| serde_json::from_slice(&text).ok());
    document.is_some_and(|document: serde_json::Value| document["schema"] == schema)
}

fn read(path: &Path, limits: &Limits) -> Option<Vec<u8>> {
    let file = SourceFile::open(path).ok()?;
    file.read(0, file.length(), limits.header_bytes).ok()
}

/// Digest of everything that all results of a sweep follow from, beside their own options: this
/// program, the input and the user's settings for it, the cameras, and the conditions of timings.
pub struct Basis(Sha256);

impl Basis {
    /// Reads the input's values only if no checksum represents them.
    pub fn new(source: &Source, cameras: &[Camera], options: &SweepOptions) -> Result<Self> {
        let mut basis = Self(Sha256::new());
        basis.add(env!("CARGO_PKG_VERSION").as_bytes());
        basis.add(&source.digest);
        if !source.field.density.has_checksum() {
            basis.add_file(&source.file)?;
        }
        for side_file in &source.side_files {
            basis.add(side_file.role.as_bytes());
            basis.add(&side_file.digest);
        }
        let field = &source.field;
        // Debug text has every value of these exactly, including future fields.
        basis.add(format!("{:?} {:?}", field.scene, field.view).as_bytes());
        if let Some(free_space) = &field.free_space {
            let (nodes, scale, shift) = (free_space.nodes, free_space.scale, free_space.shift);
            basis.add(format!("{nodes:?} {scale:?} {shift:?}").as_bytes());
            match &free_space.lookup {
                Lookup::Nearest(inside) => {
                    basis.add(&inside.iter().map(|&inside| u8::from(inside)).collect::<Vec<_>>());
                }
                Lookup::Trilinear { values, threshold } => {
                    let values = values.iter().chain([threshold]);
                    basis.add(&values.flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>());
                }
            }
        }
        for camera in cameras {
            let Camera { name, to_world, lens, .. } = camera;
            basis.add(format!("{name} {to_world:?} {lens:?}").as_bytes());
        }
        let conditions = (&options.scales, options.repeat, parallel::threads());
        basis.add(format!("{conditions:?}").as_bytes());
        Ok(basis)
    }

    /// The digest of one setting, as records hold it.
    pub fn digest(&self, setting: &Setting) -> String {
        let mut basis = Self(self.0.clone());
        basis.add(setting.options.to_json().to_string().as_bytes());
        hex(&basis.0.finalize().into())
    }

    /// Adds bytes, prefixed by their count, so that parts cannot be confused.
    fn add(&mut self, bytes: &[u8]) {
        self.0.update((bytes.len() as u64).to_le_bytes());
        self.0.update(bytes);
    }

    fn add_file(&mut self, file: &SourceFile) -> Result<()> {
        self.0.update(file.length().to_le_bytes());
        let mut at = 0;
        while at < file.length() {
            let count = CHUNK.min(file.length() - at);
            self.0.update(file.read(at, count, CHUNK)?);
            at += count;
        }
        Ok(())
    }
}
