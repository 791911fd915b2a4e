//! Things that are loaded when they are first asked for.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::base::error::Result;

/// A thing that is loaded once, or once more where loading failed.
#[derive(Debug)]
pub struct Lazy<T> {
    loaded: Mutex<Option<Arc<T>>>,
}

impl<T> Default for Lazy<T> {
    fn default() -> Self {
        Self { loaded: Mutex::new(None) }
    }
}

impl<T> Lazy<T> {
    /// The thing. Others who ask while it is loaded wait for it.
    ///
    /// # Errors
    /// Those of loading.
    pub fn get(&self, load: impl FnOnce() -> Result<T>) -> Result<Arc<T>> {
        let mut loaded = lock(&self.loaded);
        if let Some(thing) = &*loaded {
            return Ok(Arc::clone(thing));
        }
        let thing = Arc::new(load()?);
        *loaded = Some(Arc::clone(&thing));
        Ok(thing)
    }
}

/// A lock that a panic elsewhere does not poison.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
