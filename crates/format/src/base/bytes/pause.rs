//! Named points in the life of an output, where tests pause the program and kill it. Release builds
//! have none.

/// Pauses if `MIPVOG_PAUSE_AT` names this point and the number of times it was passed, such as
/// `appended 3`. Announces it on stderr, and continues at a byte or the end of stdin.
#[cfg(debug_assertions)]
pub(super) fn at(point: &str) {
    use std::io::Read;
    use std::sync::OnceLock;
    use std::sync::atomic::{AtomicUsize, Ordering};

    static WANTED: OnceLock<String> = OnceLock::new();
    static PASSED: AtomicUsize = AtomicUsize::new(0);
    let wanted = WANTED.get_or_init(|| std::env::var("MIPVOG_PAUSE_AT").unwrap_or_default());
    let Some((name, times)) = wanted.split_once(' ') else { return };
    if name == point && (PASSED.fetch_add(1, Ordering::Relaxed) + 1).to_string() == times {
        eprintln!("paused at {wanted}");
        std::io::stdin().read_exact(&mut [0]).ok();
    }
}

/// Nothing.
#[cfg(not(debug_assertions))]
#[inline(always)]
pub(super) fn at(_: &str) {}
