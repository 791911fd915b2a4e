//! Storage for compressed runs that wait for the coarsest level.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use crate::base::bytes::Spill;
use crate::base::error::Result;
use crate::base::lock::lock;
use crate::container::CompressedRun;

/// Memory for compressed runs, and a file for the rest.
#[derive(Debug)]
pub struct RunStore {
    /// The folder of the file.
    folder: PathBuf,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    bytes_left: u64,
    /// The file, once a run needs it.
    spill: Option<Arc<Spill>>,
}

impl RunStore {
    /// For this many bytes in memory; further runs go to an unnamed file on the disk of `folder`.
    pub fn new(bytes: u64, folder: &Path) -> Self {
        let state = State { bytes_left: bytes, spill: None };
        Self { folder: folder.to_owned(), state: Mutex::new(state) }
    }

    /// Keeps a run.
    ///
    /// # Errors
    ///
    /// The file cannot be made or written.
    pub fn keep(&self, run: &mut CompressedRun) -> Result<()> {
        match self.spill_for(run.length())? {
            Some(spill) => run.spill(&spill),
            None => Ok(()),
        }
    }

    /// Counts a run of this many bytes. Returns the file if it exceeds the memory.
    fn spill_for(&self, bytes: u64) -> Result<Option<Arc<Spill>>> {
        let mut state = lock(&self.state);
        if let Some(rest) = state.bytes_left.checked_sub(bytes) {
            state.bytes_left = rest;
            return Ok(None);
        }
        let spill = match state.spill.take() {
            Some(spill) => spill,
            None => Arc::new(Spill::new(&self.folder)?),
        };
        Ok(Some(Arc::clone(state.spill.insert(spill))))
    }
}
