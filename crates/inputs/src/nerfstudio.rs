//! The folder of a nerfstudio run: `config.yml`, which is read as text, and checkpoints in
//! `nerfstudio_models`, which lack some of the settings.

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use sha2::{Digest, Sha256};

use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::plain_yaml::Plain;
use crate::source::{Assumption, SideFile};

/// The file of settings.
const NAME: &str = "config.yml";
/// The folder of checkpoints.
const CHECKPOINTS: &str = "nerfstudio_models";
/// The key above the model's settings.
const MODEL: &str = "pipeline.model.";

/// The checkpoint of the last step in the folder of a run; none for other folders. For a run
/// without checkpoints, a path that does not exist, for the error message.
pub fn newest_checkpoint(run: &Path) -> Option<PathBuf> {
    let folder = run.join(CHECKPOINTS);
    if !run.join(NAME).is_file() || !folder.is_dir() {
        return None;
    }
    let step = |path: &PathBuf| -> Option<u64> {
        let name = path.file_name()?.to_str()?;
        name.strip_prefix("step-")?.strip_suffix(".ckpt")?.parse().ok()
    };
    let entries = std::fs::read_dir(&folder).ok()?.flatten();
    let checkpoints =
        entries.map(|entry| entry.path()).filter_map(|path| Some((step(&path)?, path)));
    let newest = checkpoints.max().map(|(_, path)| path);
    Some(newest.unwrap_or_else(|| folder.join("step-*.ckpt")))
}

/// The file above the folder of a checkpoint, or beside it.
fn path_of(checkpoint: &Path) -> Option<PathBuf> {
    let folder = checkpoint.parent()?;
    let run = match (folder.file_name(), folder.parent()) {
        (Some(_), Some(run)) => run.to_owned(),
        _ => folder.join(".."),
    };
    [run.join(NAME), folder.join(NAME)].into_iter().find(|path| path.is_file())
}

/// Reads the settings of a model from the text.
#[derive(Debug, Default)]
pub(crate) struct RunSettings {
    plain: Plain,
    file: Option<SideFile>,
    /// Settings that were not found, with their assumed values.
    assumed: Vec<String>,
}

impl RunSettings {
    /// Reads the file of a checkpoint's run; without one, all settings are missing.
    pub(crate) fn of(checkpoint: &Path, limits: &Limits) -> Result<Self> {
        let Some(path) = path_of(checkpoint) else { return Ok(Self::default()) };
        let file = SourceFile::open(&path)?;
        let bytes = file.read(0, file.length(), limits.header_bytes)?;
        let digest = Sha256::digest(&bytes).into();
        Ok(Self {
            plain: Plain::read(&String::from_utf8_lossy(&bytes)),
            file: Some(SideFile { role: "config", path, digest }),
            assumed: Vec::new(),
        })
    }

    /// Settings from the text of a file.
    #[cfg(test)]
    pub(crate) fn of_text(text: &str) -> Self {
        let file = SideFile { role: "config", path: PathBuf::from(NAME), digest: [0; 32] };
        Self { plain: Plain::read(text), file: Some(file), assumed: Vec::new() }
    }

    /// True if there is a file.
    pub(crate) fn is_there(&self) -> bool {
        self.file.is_some()
    }

    /// Names the file in an error about its content.
    pub(crate) fn blame(&self, error: Error) -> Error {
        match &self.file {
            Some(file) => error.in_file(&file.path),
            None => error,
        }
    }

    /// The file, and the warning about what it lacks.
    pub(crate) fn told(self) -> (Option<SideFile>, Option<Assumption>) {
        let (value, is_there) = (self.assumed.join(", "), self.is_there());
        let assumption = (!self.assumed.is_empty()).then(|| Assumption {
            key: NAME,
            message: match is_there {
                true => {
                    format!("{NAME} lacks some settings of the training: assuming {value}")
                }
                false => format!(
                    "there is no {NAME} two folders above the checkpoint, where nerfstudio keeps the \
                     training's settings: assuming its defaults, {value}; put it there, or pass the \
                     folder of the run"
                ),
            },
            value,
        });
        (self.file, assumption)
    }

    /// Refuses methods with their own rendering rules; the name of the model's class ends with
    /// `class`.
    pub(crate) fn refuse_others(&self, class: &str, method: &str) -> Result<()> {
        let target = self.plain.text(&format!("{MODEL}_target")).unwrap_or_default();
        let found = target.split_whitespace().next().unwrap_or_default();
        let found = found.rsplit(['.', ':']).next().unwrap_or_default();
        if found.is_empty() || found.ends_with(class) {
            return Ok(());
        }
        let name = self.plain.value("method_name").unwrap_or("unnamed");
        let found = format!("the method {name} (class {found})");
        let error = Error::unsupported(Place::Key("method_name".to_owned()), found, method);
        Err(error.advise(
            "bake the run by nerfstudio's own code, with the Python module: python -m \
             mipvog_bake.nerfstudio RUN/config.yml -o scene.mipvog",
        ))
    }

    /// A setting of the model, or its assumed value.
    pub(crate) fn get<T: FromStr + Display>(
        &mut self,
        key: &str,
        default: T,
        expected: &str,
    ) -> Result<T> {
        let found = self.optional(key, expected)?;
        Ok(found.unwrap_or_else(|| {
            self.assumed.push(format!("{key} {default}"));
            default
        }))
    }

    /// A setting of the model that may be missing.
    pub(crate) fn optional<T: FromStr>(&self, key: &str, expected: &str) -> Result<Option<T>> {
        let path = format!("{MODEL}{key}");
        let Some(text) = self.plain.value(&path) else { return Ok(None) };
        let refuse = || Error::malformed(Place::Key(path.clone()), text, expected);
        text.parse().map(Some).map_err(|_| refuse())
    }

    /// A number of the model that has to be within a range.
    pub(crate) fn number(&mut self, key: &str, default: f64, most: f64) -> Result<f64> {
        let expected = format!("a number above 0, up to {most}");
        let found: f64 = self.get(key, default, &expected)?;
        if found > 0.0 && found <= most {
            return Ok(found);
        }
        Err(Error::malformed(place(key), found.to_string(), expected))
    }

    /// A whole number of the model from 1 on.
    pub(crate) fn count(&mut self, key: &str, default: usize, most: usize) -> Result<usize> {
        let expected = format!("1 to {most}");
        let found: usize = self.get(key, default, &expected)?;
        if (1..=most).contains(&found) {
            return Ok(found);
        }
        Err(Error::malformed(place(key), found.to_string(), expected))
    }
}

/// The path of a setting of the model.
pub(crate) fn place(key: &str) -> Place {
    Place::Key(format!("{MODEL}{key}"))
}
