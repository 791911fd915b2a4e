//! Parallel loops whose results do not depend on the number of threads.
//!
//! The only user of rayon. The result of each call depends only on its index. Results come back in
//! index order, and of several errors the one with the lowest index is returned.

#[cfg(feature = "parallel")]
use std::path::Path;
use std::sync::{Mutex, PoisonError};

#[cfg(feature = "parallel")]
use crate::base::error::Error;
use crate::base::error::Result;
use crate::base::lock;

/// Calls `make(i)` for `i` in `0..count` and returns the results in order, or the error with the
/// lowest index.
pub fn map<T: Send>(
    count: usize,
    make: impl Fn(usize) -> Result<T> + Sync + Send,
) -> Result<Vec<T>> {
    map_mut(&mut vec![(); count], |i, ()| make(i))
}

/// Calls `change(i, item)` for every item and returns the results in order, or the error with the
/// lowest index.
pub fn map_mut<I: Send, T: Send>(
    items: &mut [I],
    change: impl Fn(usize, &mut I) -> Result<T> + Sync + Send,
) -> Result<Vec<T>> {
    lock::assert_none_held();
    // An uncontended lock per item, the cost of a type-erased loop. Work under it may be parallel
    // again, so it does not use `base::lock`.
    let places: Vec<_> = items.iter_mut().map(|item| Mutex::new((item, None))).collect();
    for_each(places.len(), &|i| {
        let mut place = places[i].lock().unwrap_or_else(PoisonError::into_inner);
        let (item, result) = &mut *place;
        *result = Some(change(i, item));
    });
    let results = places.into_iter().filter_map(|place| {
        let (_, result) = place.into_inner().unwrap_or_else(PoisonError::into_inner);
        result
    });
    results.collect()
}

/// Calls `work` for every index. Type-erased, so that rayon's part of a loop is compiled once, not
/// per loop, which was a fifth of all code.
fn for_each(count: usize, work: &(dyn Fn(usize) + Sync)) {
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::*;
        (0..count).into_par_iter().with_max_len(1).for_each(work);
    }
    #[cfg(not(feature = "parallel"))]
    (0..count).for_each(work);
}

/// Runs both, in parallel if there are threads.
pub fn join<A: Send, B: Send>(
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
) -> (A, B) {
    lock::assert_none_held();
    #[cfg(feature = "parallel")]
    return rayon::join(first, second);
    #[cfg(not(feature = "parallel"))]
    (first(), second())
}

/// Threads that loops called from here use.
pub fn threads() -> usize {
    #[cfg(feature = "parallel")]
    return rayon::current_num_threads();
    #[cfg(not(feature = "parallel"))]
    1
}

/// Runs `work` with this many threads; 0 means one for each processor.
///
/// # Errors
///
/// The system cannot create more threads.
pub fn with_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> Result<T> {
    lock::assert_none_held();
    #[cfg(feature = "parallel")]
    {
        let builder = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = builder.spawn_handler(spawn).build();
        let pool = pool.map_err(|error| {
            Error::io(std::io::Error::other(error.to_string()), Path::new("threads"))
        })?;
        Ok(pool.install(work))
    }
    #[cfg(not(feature = "parallel"))]
    {
        let _ = threads;
        Ok(work())
    }
}

/// Address space that must be free before a thread is created, because a thread without room for
/// its first allocations aborts the program. Larger than glibc's cache, so that the test reaches
/// the system.
#[cfg(feature = "parallel")]
const LEFT: usize = 40 << 20;

/// Starts a thread of a pool. Returns once it runs, so that the next one sees the remaining address
/// space.
#[cfg(feature = "parallel")]
fn spawn(thread: rayon::ThreadBuilder) -> std::io::Result<()> {
    let mut left = Vec::<u8>::new();
    left.try_reserve_exact(LEFT)?;
    drop(std::hint::black_box(left));
    let (runs, started) = std::sync::mpsc::sync_channel(1);
    std::thread::Builder::new().spawn(move || {
        keep_freed_memory();
        runs.send(()).ok();
        thread.run();
    })?;
    started.recv().map_err(std::io::Error::other)
}

/// Makes a thread keep the memory that it frees. By default, glibc's allocator returns memory and
/// fetches it again page by page, under a lock that all threads share: a fifth of a bake's time on
/// two threads. After a piece of 31 MiB (larger ones have no effect) was freed, it keeps 62 MiB,
/// and later grows in large steps. No page is touched, so no memory is used. Other allocators are
/// not affected.
#[cfg(feature = "parallel")]
fn keep_freed_memory() {
    for mebibytes in [&[31][..], &[28, 28]] {
        let pieces = mebibytes.iter().map(|mebibytes: &usize| {
            let mut piece = Vec::<u8>::new();
            // If address space is short, nothing changes.
            piece.try_reserve_exact(mebibytes << 20).map(|()| piece)
        });
        std::hint::black_box(pieces.collect::<Vec<_>>());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::error::Error;

    #[test]
    fn order_and_errors_do_not_depend_on_threads() {
        for threads in [1, 2, 5] {
            let done = with_threads(threads, || {
                let squares = map(100, |i| Ok(i * i)).expect("no error");
                assert!(squares.iter().enumerate().all(|(i, &s)| s == i * i));
                let failed =
                    map(100, |i| if i % 7 == 6 { Err(Error::usage(i.to_string())) } else { Ok(i) });
                assert_eq!(failed.expect_err("seven fail").to_string(), "6");
                let mut items = [1, 2, 3];
                let old = map_mut(&mut items, |i, item| Ok(std::mem::replace(item, i)));
                assert_eq!((old.expect("no error"), items), (vec![1, 2, 3], [0, 1, 2]));
            });
            done.expect("threads");
        }
    }
}
