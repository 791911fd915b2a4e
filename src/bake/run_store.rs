//! A place for compressed runs that wait until the coarsest level is there.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use crate::base::bytes::Spill;
use crate::base::error::Result;
use crate::codec::container::CompressedRun;

/// Memory for compressed runs, and a file for those that find no room in it.
#[derive(Debug)]
pub struct RunStore {
    bytes_left: Mutex<u64>,
    spill: Arc<Spill>,
}

impl RunStore {
    /// For this many bytes in memory; other runs go to a nameless file on the disk of `folder`.
    ///
    /// # Errors
    ///
    /// The file cannot be made.
    pub fn new(bytes: u64, folder: &Path) -> Result<Self> {
        Ok(Self { bytes_left: Mutex::new(bytes), spill: Arc::new(Spill::new(folder)?) })
    }

    /// Keeps a run.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn keep(&self, run: &mut CompressedRun) -> Result<()> {
        let mut bytes_left = self.bytes_left.lock().unwrap_or_else(PoisonError::into_inner);
        match bytes_left.checked_sub(run.length()) {
            Some(rest) => *bytes_left = rest,
            None => run.spill(&self.spill)?,
        }
        Ok(())
    }
}
