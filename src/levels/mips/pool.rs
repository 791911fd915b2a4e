//! Planes to be used again: touching fresh memory costs more than filtering it.

use std::sync::{Mutex, PoisonError};

/// Planes that nobody holds.
#[derive(Debug, Default)]
pub struct Pool(Mutex<Vec<Vec<f32>>>);

impl Pool {
    /// A plane of so many numbers, whatever they are.
    pub fn take(&self, length: usize) -> Vec<f32> {
        let mut planes = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match planes.iter().rposition(|plane| plane.len() == length) {
            Some(i) => planes.swap_remove(i),
            None => {
                drop(planes);
                vec![0.0; length]
            }
        }
    }

    /// Gives planes back.
    pub fn give(&self, planes: impl IntoIterator<Item = Vec<f32>>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend(planes);
    }
}
