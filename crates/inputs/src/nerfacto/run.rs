//! The folder of a training.

use std::path::{Path, PathBuf};

use super::settings::NAME;

/// Checkpoints stand in it.
const CHECKPOINTS: &str = "nerfstudio_models";

/// The checkpoint of the last step in the folder of a run; none for another folder. Of a run without
/// checkpoints a path that no file has, for the error to name.
pub fn newest_checkpoint(run: &Path) -> Option<PathBuf> {
    let folder = run.join(CHECKPOINTS);
    if !run.join(NAME).is_file() || !folder.is_dir() {
        return None;
    }
    let step = |path: &PathBuf| -> Option<u64> {
        let name = path.file_name()?.to_str()?;
        name.strip_prefix("step-")?.strip_suffix(".ckpt")?.parse().ok()
    };
    let entries = std::fs::read_dir(&folder).ok()?.filter_map(Result::ok);
    let checkpoints =
        entries.map(|entry| entry.path()).filter_map(|path| Some((step(&path)?, path)));
    let newest = checkpoints.max().map(|(_, path)| path);
    Some(newest.unwrap_or_else(|| folder.join("step-*.ckpt")))
}
