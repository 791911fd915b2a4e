//! Output files of the program.

use std::path::Path;

use crate::base::bytes::{Output, remove_stale};
use crate::base::error::Result;

/// Starts writing `path`; an existing file there is refused unless `force`. Files that ended runs of
/// the program left in its folder are removed first.
pub fn create(path: &Path, force: bool) -> Result<Output> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    remove_stale(folder.unwrap_or(Path::new(".")));
    Output::create(path, force)
}
