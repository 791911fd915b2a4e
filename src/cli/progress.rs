//! Progress bars on stderr.

use std::io::IsTerminal;
use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::{Common, When};
use crate::progress::{Progress, Step};

/// Draws one bar, for the current step.
pub struct Bar {
    bar: ProgressBar,
    step: Mutex<Option<Step>>,
}

impl Bar {
    /// A bar that is drawn where the user wants one.
    pub fn new(common: &Common) -> Self {
        let wanted = match common.progress {
            When::Always => true,
            When::Auto => std::io::stderr().is_terminal() && !common.quiet,
            When::Never => false,
        };
        let target =
            if wanted { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(None, target);
        if let Ok(style) = ProgressStyle::with_template("{msg:8} {wide_bar} {percent:>3}% {eta}") {
            bar.set_style(style);
        }
        Self { bar, step: Mutex::new(None) }
    }
}

impl Progress for Bar {
    fn begin(&self, step: Step, total: u64) {
        *self.step.lock().unwrap_or_else(PoisonError::into_inner) = Some(step);
        self.bar.reset();
        self.bar.set_length(total);
        self.bar.set_message(step.name());
    }

    fn advance(&self, step: Step, by: u64) {
        if *self.step.lock().unwrap_or_else(PoisonError::into_inner) == Some(step) {
            self.bar.inc(by);
        }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
