//! Progress on stderr: one bar per verb that only grows, or plain lines without a terminal.

use std::fmt::Write;
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use super::common::{Common, When};
use super::interrupt::Work;
use super::outcome::{drawn, say};
use super::plan::Plan;
use super::watcher::SharedWatcher;
use crate::base::error::{Error, Result};
use crate::base::lock::{Locked, lock};
use crate::base::progress::{Progress, Step};

/// Parts of the bar: finer than any terminal shows.
const LENGTH: u64 = 10_000;
/// Minimum time between two lines of a step.
const BETWEEN_LINES: Duration = Duration::from_secs(1);

/// The progress of a verb.
pub struct Bar {
    bar: ProgressBar,
    current: Mutex<Current>,
    work: Work,
    /// True if progress is wanted, but there is no terminal to draw on.
    lines: bool,
    quiet: bool,
    watcher: Option<SharedWatcher>,
}

/// The current step.
struct Current {
    step: Option<Step>,
    done: u64,
    total: u64,
    part: String,
    plan: Plan,
    /// Start of the bar.
    start: Instant,
    last_line: Option<Instant>,
    /// True after the note about interrupts was shown.
    told: bool,
}

impl Bar {
    /// A bar, if requested, for a verb that first opens its inputs. Until it is dropped, signals
    /// request a stop instead of ending the work.
    pub fn new(common: &Common) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let wanted = match common.progress {
            When::Always => true,
            When::Auto => terminal && !common.quiet,
            When::Never => false,
        };
        let target = match wanted && terminal {
            true => ProgressDrawTarget::stderr(),
            false => ProgressDrawTarget::hidden(),
        };
        let bar = ProgressBar::with_draw_target(Some(LENGTH), target);
        let template = "{percent:>3}% {bar:16} {left:12} {wide_msg}";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.with_key("left", |state: &ProgressState, text: &mut dyn Write| {
                text.write_str(&left(state.elapsed(), state.fraction().into())).ok();
            }));
        }
        bar.set_message("open");
        bar.tick();
        *drawn() = Some(bar.clone());
        let lines = wanted && !terminal;
        if lines {
            say("open");
        }
        let current = Current {
            step: None,
            done: 0,
            total: 0,
            part: String::new(),
            plan: Plan::default(),
            start: Instant::now(),
            last_line: None,
            told: false,
        };
        let (current, work) = (Mutex::new(current), Work::begin());
        let watcher = common.watcher.clone();
        Self { bar, current, work, lines, quiet: common.quiet, watcher }
    }

    /// Sets the planned steps, with their costs in any unit. Without a plan, each step takes half
    /// of the rest of the bar.
    pub fn plan(&self, stages: Vec<(Step, f64)>) {
        self.current().plan = Plan::new(stages);
    }

    /// The last check before outputs get their names.
    ///
    /// # Errors
    /// `Cancelled` if the work should end.
    pub fn check(&self) -> Result<()> {
        if self.cancelled() { Err(Error::cancelled()) } else { Ok(()) }
    }

    fn current(&self) -> Locked<'_, Current> {
        lock(&self.current)
    }

    /// Shows the current state; `new` if a step has just begun.
    fn show(&self, current: &mut Current, new: bool) {
        let share = current.plan.share(current.done, current.total);
        self.bar.set_position((share * LENGTH as f64) as u64);
        if let Some(SharedWatcher(watcher)) = &self.watcher {
            watcher.shows(&current.label(), share);
        }
        let due = current.last_line.is_none_or(|last| last.elapsed() >= BETWEEN_LINES);
        if self.lines && (new || due) {
            let left = left(current.start.elapsed(), share);
            let percent = (100.0 * share) as u32;
            say(format!("{}, {percent} % {left}", current.label()).trim_end());
            current.last_line = Some(Instant::now());
        }
    }

    /// Explains once what an interrupt of a fit does.
    fn tell(&self, sentence: &str) {
        let told = std::mem::replace(&mut self.current().told, true);
        if !self.quiet && !told {
            say(sentence);
        }
    }
}

impl Current {
    fn label(&self) -> String {
        let step = self.step.map_or("open", Step::name);
        if self.part.is_empty() { step.to_owned() } else { format!("{step}: {}", self.part) }
    }
}

/// The estimated remaining time, from `elapsed` for a share of the work; none before it is known.
fn left(elapsed: Duration, share: f64) -> String {
    if share <= 0.005 || elapsed < Duration::from_millis(300) {
        return String::new();
    }
    let seconds = (elapsed.as_secs_f64() * (1.0 - share) / share).ceil() as u64;
    match seconds {
        0..100 => format!("{seconds} s left"),
        100..6000 => format!("{} min left", seconds.div_ceil(60)),
        _ => format!("{} h left", seconds.div_ceil(3600)),
    }
}

impl Progress for Bar {
    fn begin(&self, step: Step, total: u64) {
        self.work.takes_result(step == Step::Fit);
        let mut current = self.current();
        current.plan.begin(step);
        (current.step, current.done, current.total) = (Some(step), 0, total);
        current.part.clear();
        self.bar.set_message(current.label());
        self.show(&mut current, true);
    }

    fn advance(&self, step: Step, by: u64) {
        let mut current = self.current();
        if current.step == Some(step) {
            current.done += by;
            self.show(&mut current, false);
        }
    }

    fn part(&self, step: Step, name: &str) {
        let mut current = self.current();
        if current.step == Some(step) {
            name.clone_into(&mut current.part);
            self.bar.set_message(current.label());
            self.show(&mut current, false);
        }
    }

    fn enough(&self) -> bool {
        let enough = self.work.wants_result();
        if enough {
            self.tell("interrupted: the container takes what is fitted so far");
        }
        enough
    }

    fn cancelled(&self) -> bool {
        let unwanted = self.watcher.as_ref().is_some_and(|SharedWatcher(watcher)| watcher.ends());
        let cancelled = unwanted || self.work.is_cancelled();
        if cancelled && self.current().step == Some(Step::Targets) {
            self.tell(
                "interrupted before the fit's first step: nothing is fitted, nothing written",
            );
        }
        cancelled
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        *drawn() = None;
        self.bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_left_have_units_people_read() {
        let after = |seconds, share| left(Duration::from_secs(seconds), share);
        assert_eq!(after(0, 0.5), "");
        assert_eq!(after(10, 0.0), "");
        assert_eq!(after(10, 0.5), "10 s left");
        assert_eq!(after(100, 0.1), "15 min left");
        assert_eq!(after(3600, 0.1), "9 h left");
        assert_eq!(after(60, 1.0), "0 s left");
    }
}
