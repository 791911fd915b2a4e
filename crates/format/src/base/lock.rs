//! Locks, and the rule that no parallel loop runs under one.
//!
//! A thread that waits for its loop runs parts of other loops meanwhile. If one of these needs a
//! lock that the thread holds, the thread deadlocks. So parallel work runs only before a lock is
//! taken or after it is released. Debug builds, and thus the tests, check this: each thread counts
//! its locks, and the loops of [`crate::base::parallel`] refuse to start under one.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, MutexGuard, PoisonError};

#[cfg(debug_assertions)]
thread_local! {
    /// Locks that this thread holds.
    static HELD: std::cell::Cell<usize> = const { std::cell::Cell::new(0) };
}

/// A guard that holds a value's lock until dropped.
#[derive(Debug)]
pub struct Locked<'a, T>(MutexGuard<'a, T>);

/// Waits for a lock. A panic elsewhere does not poison it.
pub fn lock<T>(mutex: &Mutex<T>) -> Locked<'_, T> {
    let guard = mutex.lock().unwrap_or_else(PoisonError::into_inner);
    #[cfg(debug_assertions)]
    HELD.set(HELD.get() + 1);
    Locked(guard)
}

/// Panics in debug builds if this thread holds a lock.
pub(super) fn assert_none_held() {
    #[cfg(debug_assertions)]
    assert_eq!(HELD.get(), 0, "a parallel loop under a lock");
}

impl<T> Deref for Locked<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0
    }
}

impl<T> DerefMut for Locked<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.0
    }
}

#[cfg(debug_assertions)]
impl<T> Drop for Locked<'_, T> {
    fn drop(&mut self) {
        HELD.set(HELD.get() - 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::parallel;

    #[test]
    fn loops_run_after_locks_are_given_back() {
        let mutex = Mutex::new(1);
        drop(lock(&mutex));
        assert_eq!(parallel::map(2, Ok).expect("no error"), [0, 1]);
    }

    #[test]
    #[cfg(debug_assertions)]
    #[should_panic(expected = "a parallel loop under a lock")]
    fn no_loop_begins_under_a_lock() {
        let mutex = Mutex::new(1);
        let _held = lock(&mutex);
        parallel::map(2, Ok).ok();
    }
}
