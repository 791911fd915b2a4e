//! One plot as inline SVG: points, the front as a line, two linear axes.

use std::fmt::Write;

use crate::report_page::escaped;

/// The picture's size in its own units. Small, so that text stays readable on narrow pages.
const SIZE: [f64; 2] = [340.0, 270.0];
/// The corners that the axes span: left, top, right, bottom.
const FRAME: [f64; 4] = [56.0, 10.0, 326.0, 226.0];

/// One result.
#[derive(Debug, Clone)]
pub(super) struct PlotPoint {
    /// Along the axes.
    pub(super) at: [f64; 2],
    /// True if the front goes through it.
    pub(super) on_front: bool,
    /// True for the recommended point, which has a ring.
    pub(super) is_chosen: bool,
    /// The number of its series, which decides its mark and its colour.
    pub(super) series: usize,
    /// The text beside it, if it is on the front.
    pub(super) label: String,
    /// Shown on pointing at it.
    pub(super) title: String,
}

/// Draws points over axes with these names. `about` is the text alternative.
pub(super) fn plot(names: [&str; 2], about: &str, points: &[PlotPoint]) -> String {
    let [left, top, right, bottom] = FRAME;
    let [width, height] = SIZE;
    let about = escaped(about);
    let mut svg =
        format!("<svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{about}\">\n");
    let values = |axis: usize| points.iter().map(move |point| point.at[axis]);
    let (x_axis, y_axis) = (Axis::new(values(0), left, right), Axis::new(values(1), bottom, top));
    for (x, label) in x_axis.ticks() {
        writeln!(svg, "<path class=\"grid\" d=\"M{x:.1} {top}V{bottom}\"/>").ok();
        svg += &text([x, bottom + 15.0], "middle", &label);
    }
    for (y, label) in y_axis.ticks() {
        writeln!(svg, "<path class=\"grid\" d=\"M{left} {y:.1}H{right}\"/>").ok();
        svg += &text([left - 5.0, y + 4.0], "end", &label);
    }
    svg += &text([0.5 * (left + right), height - 8.0], "middle", names[0]);
    writeln!(svg, "<g transform=\"translate(11 {}) rotate(-90)\">", 0.5 * (top + bottom)).ok();
    svg += &text([0.0; 2], "middle", names[1]);
    svg += "</g>\n";
    let place = |point: &PlotPoint| [x_axis.place(point.at[0]), y_axis.place(point.at[1])];
    let mut front: Vec<[f64; 2]> = points.iter().filter(|p| p.on_front).map(place).collect();
    front.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let corners: Vec<String> = front.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
    writeln!(svg, "<polyline class=\"line\" points=\"{}\"/>", corners.join(" ")).ok();
    for point in points {
        let ([x, y], title) = (place(point), escaped(&point.title));
        let (class, front) = (class(point.series), if point.on_front { " front" } else { "" });
        writeln!(svg, "<g class=\"{class}{front}\"><title>{title}</title>").ok();
        if point.is_chosen {
            writeln!(svg, "<circle class=\"halo\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"8\"/>").ok();
        }
        svg += &mark(point.series, [x, y]);
        // Labels of all points would overlap.
        if point.on_front {
            svg += &text([x + 8.0, y + 4.0], "start", &point.label);
        }
        svg += "</g>\n";
    }
    svg + "</svg>\n"
}

/// A legend of series, by their numbers.
pub(super) fn legend(names: &[String]) -> String {
    let mut html = String::from("<ul class=\"legend\">\n");
    for (series, name) in names.iter().enumerate() {
        let (class, mark, name) = (class(series), mark(series, [8.0; 2]), escaped(name));
        writeln!(
            html,
            "<li><svg viewBox=\"0 0 16 16\" aria-hidden=\"true\"><g class=\"{class} front\">{mark}\
             </g></svg> {name}</li>"
        )
        .ok();
    }
    html + "</ul>\n"
}

/// Series differ in shape and in colour, which repeat for many series.
const SHAPES: [&str; 6] = [
    "M-4 0A4 4 0 1 0 4 0A4 4 0 1 0 -4 0Z",
    "M-3.6 -3.6H3.6V3.6H-3.6Z",
    "M0 -4.8L4.6 3.6H-4.6Z",
    "M0 -5L5 0L0 5L-5 0Z",
    "M0 4.8L4.6 -3.6H-4.6Z",
    "M-1.5 -4.5H1.5V-1.5H4.5V1.5H1.5V4.5H-1.5V1.5H-4.5V-1.5H-1.5Z",
];

fn mark(series: usize, [x, y]: [f64; 2]) -> String {
    let shape = SHAPES.iter().cycle().nth(series).copied().unwrap_or_default();
    format!("<path class=\"mark\" transform=\"translate({x:.1} {y:.1})\" d=\"{shape}\"/>\n")
}

fn class(series: usize) -> String {
    format!("series{}", series % SHAPES.len())
}

fn text([x, y]: [f64; 2], anchor: &str, text: &str) -> String {
    let text = escaped(text);
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>\n")
}

/// The mapping from values to places along an axis.
struct Axis {
    low: f64,
    high: f64,
    /// Places of `low` and `high`.
    ends: [f64; 2],
}

impl Axis {
    fn new(values: impl Iterator<Item = f64>, start: f64, end: f64) -> Self {
        let finite = values.filter(|value| value.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        });
        let (low, high) = if low > high { (0.0, 1.0) } else { (low, high) };
        let room = (0.08 * (high - low)).max(1e-3 * high.abs()).max(1e-6);
        Self { low: low - room, high: high + room, ends: [start, end] }
    }

    fn place(&self, value: f64) -> f64 {
        let share = (value - self.low) / (self.high - self.low);
        self.ends[0] + share * (self.ends[1] - self.ends[0])
    }

    /// Places and texts at multiples of a round step: two to eight.
    fn ticks(&self) -> Vec<(f64, String)> {
        let rough = (self.high - self.low) / 8.0;
        let unit = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0].map(|digit| digit * unit).into_iter().find(|s| *s >= rough);
        let step = step.unwrap_or(10.0 * unit);
        let decimals = usize::try_from(-(step.log10() + 1e-9).floor() as i64).unwrap_or(0);
        let numbers = (self.low / step).ceil() as i64..=(self.high / step).floor() as i64;
        let values = numbers.map(|number| number as f64 * step);
        values.map(|value| (self.place(value), format!("{value:.decimals$}"))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let labels = |values: [f64; 2]| -> Vec<String> {
            let axis = Axis::new(values.into_iter(), 40.0, 240.0);
            assert!(axis.ticks().iter().all(|(at, _)| (40.0..=240.0).contains(at)));
            axis.ticks().into_iter().map(|(_, label)| label).collect()
        };
        assert_eq!(labels([4.15, 4.45]), ["4.15", "4.20", "4.25", "4.30", "4.35", "4.40", "4.45"]);
        assert_eq!(labels([25.0, 60.0]), ["30", "40", "50", "60"]);
        assert!(!labels([3.0, 3.0]).is_empty());
    }
}
