//! A comparison as one page: its figures, and pictures side by side.

use std::fmt::Write;

use super::layout::Table;
use super::shell;
use crate::base::error::Result;
use crate::model::camera::Camera;
use crate::picture::png;
use crate::report_page::{self, FULL_HEAT, bytes_of, escaped};
use crate::view::compare::FrameErrors;
use crate::view::compare::metrics::psnr;

/// Maximum pixels of all pictures of a page, so that pages stay small enough for browsers and mail.
const MOST_PIXELS: usize = 32 << 20;

/// A page under construction, frame by frame.
pub struct ComparePage {
    /// The frames that it shows, in order.
    shown: Vec<bool>,
    /// The number of frames so far, and the name of the last one.
    frames: usize,
    last: Option<String>,
    html: String,
}

impl ComparePage {
    /// A page with the frames of `cameras` at `scales`, or evenly spaced ones if there are too
    /// many.
    pub fn new(cameras: &[Camera], scales: &[usize]) -> Self {
        let pixels = |camera: &Camera| -> usize {
            let of = |&scale: &usize| camera.lens.width / scale * (camera.lens.height / scale);
            3 * scales.iter().map(of).sum::<usize>()
        };
        let largest = cameras.iter().map(pixels).max().unwrap_or(1).max(1);
        let count = cameras.len();
        let most = (MOST_PIXELS / largest).clamp(1, count.max(1));
        // The first of each of `most` runs of frames.
        let is_first =
            |frame: usize| frame == 0 || frame * most / count != (frame - 1) * most / count;
        let shown = (0..count).map(is_first).collect();
        Self { shown, frames: 0, last: None, html: String::new() }
    }

    /// Adds a frame's pictures at one scale.
    ///
    /// # Errors
    ///
    /// Errors of writing a PNG.
    pub fn add(&mut self, errors: &FrameErrors) -> Result<()> {
        if self.last.as_deref() != Some(errors.frame) {
            self.frames += 1;
            self.last = Some(errors.frame.to_owned());
            if self.is_shown() {
                writeln!(self.html, "<h2>{}</h2>", escaped(errors.frame)).ok();
            }
        }
        if !self.is_shown() {
            return Ok(());
        }
        let (want, got, scale) = (errors.want, errors.got, errors.scale);
        let size = [want.width, want.height];
        let heat = want.heat_map(got, FULL_HEAT);
        let of = format!("{} at 1/{scale}", errors.frame);
        let figure = |name: &str, pixels: &[u8]| -> Result<String> {
            let png = png(size[0], size[1], pixels)?;
            let picture = report_page::picture(&png, size, &format!("{name}: {of}"));
            Ok(format!("<figure>{picture}<figcaption>{name}</figcaption></figure>\n"))
        };
        let decibels = psnr(want.color.as_flattened(), got.color.as_flattened());
        let [width, height] = size;
        writeln!(self.html, "<h3>1/{scale}: {decibels:.2} dB, {width} x {height}</h3>").ok();
        self.html += "<div class=\"frames\">\n";
        self.html += &figure("reference", &bytes_of(&want.color))?;
        self.html += &figure("field", &bytes_of(&got.color))?;
        self.html += &figure("error", &heat)?;
        self.html += "</div>\n";
        Ok(())
    }

    fn is_shown(&self) -> bool {
        let last = self.frames.checked_sub(1);
        last.and_then(|frame| self.shown.get(frame)).is_some_and(|&shown| shown)
    }

    /// The page, with the figures of all frames and notes about them.
    pub fn finish(self, title: &str, table: &Table, notes: &[String]) -> String {
        let mut html = report_page::start(title);
        if let Some(typed) = shell::typed() {
            html += &report_page::command(&shell::command(typed));
        }
        html += &report_page::table_start(table.heads());
        for row in table.rows() {
            let cells = row.iter().map(|cell| format!("<td>{}</td>", escaped(cell)));
            writeln!(html, "<tr>{}</tr>", cells.collect::<String>()).ok();
        }
        html += report_page::TABLE_END;
        let (shown, all) = (self.shown.iter().filter(|&&shown| shown).count(), self.shown.len());
        let frames = match shown == all {
            true => "All frames are shown".to_owned(),
            false => format!("{shown} of {all} frames are shown, evenly spaced"),
        };
        let errors = format!("{frames}. Errors are black for none, white for {FULL_HEAT} or more.");
        for note in notes.iter().chain([&errors]) {
            writeln!(html, "<p>{}</p>", escaped(&sentence(note))).ok();
        }
        html + &self.html + report_page::END
    }
}

/// A note with a capital letter and a full stop.
fn sentence(note: &str) -> String {
    let mut letters = note.chars();
    let first = letters.next().into_iter().flat_map(char::to_uppercase);
    let end = if note.ends_with('.') { "" } else { "." };
    first.chain(letters).collect::<String>() + end
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::camera::turntable;
    use crate::model::grid::Bounds;

    fn shown(frames: usize, size: usize, scales: &[usize]) -> usize {
        let bounds = Bounds { min: [-1.0; 3], max: [1.0; 3] };
        let page = ComparePage::new(&turntable(&bounds, frames, [size; 2]), scales);
        assert_eq!(page.shown.len(), frames);
        assert!(page.shown[0]);
        page.shown.iter().filter(|&&shown| shown).count()
    }

    #[test]
    fn a_page_shows_as_many_frames_as_it_can_hold() {
        assert_eq!(shown(1, 8, &[1]), 1);
        assert_eq!(shown(8, 400, &[1, 2, 4, 8]), 8);
        assert_eq!(shown(200, 800, &[1]), 17);
        assert_eq!(shown(5, 8000, &[1]), 1);
    }
}
