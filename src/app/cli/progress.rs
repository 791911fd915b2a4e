//! Progress bars on stderr.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::common::{Common, When};
use super::interrupt::Interrupts;
use super::outcome::say;
use crate::base::progress::{Progress, Step};

/// Draws one bar, for the current step.
pub struct Bar {
    bar: ProgressBar,
    step: Mutex<Option<Step>>,
    /// True if the current step is a fit: an interrupt then asks for the result so far.
    is_fit: AtomicBool,
    interrupts: Interrupts,
    /// True if bars are wanted, but there is no terminal to draw on: each step prints a line.
    lines: bool,
}

impl Bar {
    /// A bar that is drawn where the user wants one. From now on signals end the work that asks it.
    pub fn new(common: &Common) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let wanted = match common.progress {
            When::Always => true,
            When::Auto => terminal && !common.quiet,
            When::Never => false,
        };
        let target =
            if wanted { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(None, target);
        if let Ok(style) = ProgressStyle::with_template("{msg:12} {wide_bar} {percent:>3}% {eta}") {
            bar.set_style(style);
        }
        Self {
            bar,
            step: Mutex::new(None),
            is_fit: AtomicBool::new(false),
            interrupts: Interrupts::watch(),
            lines: wanted && !terminal,
        }
    }
}

impl Progress for Bar {
    fn begin(&self, step: Step, total: u64) {
        *self.step.lock().unwrap_or_else(PoisonError::into_inner) = Some(step);
        self.is_fit.store(step == Step::Fit, Ordering::Relaxed);
        if self.lines {
            say(step.name());
        }
        self.bar.reset();
        self.bar.set_length(total);
        self.bar.set_message(step.name());
    }

    fn advance(&self, step: Step, by: u64) {
        if *self.step.lock().unwrap_or_else(PoisonError::into_inner) == Some(step) {
            self.bar.inc(by);
        }
    }

    fn quality(&self, step: Step, psnr: f64) {
        self.bar.set_message(format!("{} {psnr:.2} dB", step.name()));
    }

    fn enough(&self) -> bool {
        self.interrupts.wants_result()
    }

    fn cancelled(&self) -> bool {
        match self.is_fit.load(Ordering::Relaxed) {
            true => self.interrupts.is_terminated(),
            false => self.interrupts.wants_end(),
        }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
