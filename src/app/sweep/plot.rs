//! One plot as inline SVG: points, the front as a line, axes with ticks and units.

use std::fmt::Write;

use super::escape::escaped;

/// The picture's size in its own units. Small, so that text stays readable where the page is narrow.
const SIZE: [f64; 2] = [340.0, 270.0];
/// Room for tick labels and the axes' names: left, top, right, bottom.
const MARGINS: [f64; 4] = [56.0, 10.0, 14.0, 44.0];
/// An axis whose values span more than this factor is logarithmic.
const LINEAR_UP_TO: f64 = 6.0;
/// Half the side of a point's mark.
const MARK: f64 = 4.5;
/// Kinds of mark and colour; whatever goes beyond starts again.
pub const STYLES: usize = 8;

/// One result.
#[derive(Debug, Clone)]
pub struct PlotPoint {
    /// Along the axes.
    pub at: [f64; 2],
    /// Whether the front goes through it.
    pub on_front: bool,
    /// Kind of mark and colour.
    pub style: usize,
    /// Stands beside it.
    pub label: String,
    /// Shown on pointing at it.
    pub title: String,
}

/// Draws points over axes with these names. `about` says it in words.
pub fn plot(names: [&str; 2], about: &str, points: &[PlotPoint]) -> String {
    let [left, top, right, bottom] = MARGINS;
    let (x_end, y_end) = (SIZE[0] - right, SIZE[1] - bottom);
    let values = |axis: usize| points.iter().map(move |point| point.at[axis]);
    let x_axis = Axis::new(values(0), [left, x_end], true);
    let y_axis = Axis::new(values(1), [y_end, top], false);
    let mut svg = format!(
        "<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">\n",
        SIZE[0],
        SIZE[1],
        escaped(about)
    );
    for (x, label) in x_axis.ticks() {
        writeln!(svg, "<path class=\"grid\" d=\"M{x:.1} {top}V{y_end}\"/>").ok();
        let y = y_end + 15.0;
        writeln!(
            svg,
            "<text class=\"tick\" x=\"{x:.1}\" y=\"{y}\" text-anchor=\"middle\">{label}</text>"
        )
        .ok();
    }
    for (y, label) in y_axis.ticks() {
        writeln!(svg, "<path class=\"grid\" d=\"M{left} {y:.1}H{x_end}\"/>").ok();
        let (x, y) = (left - 5.0, y + 4.0);
        writeln!(
            svg,
            "<text class=\"tick\" x=\"{x}\" y=\"{y:.1}\" text-anchor=\"end\">{label}</text>"
        )
        .ok();
    }
    writeln!(svg, "<path class=\"axis\" d=\"M{left} {top}V{y_end}H{x_end}\"/>").ok();
    let (x, y) = (0.5 * (left + x_end), SIZE[1] - 8.0);
    let [x_name, y_name] = names.map(escaped);
    writeln!(
        svg,
        "<text class=\"name\" x=\"{x}\" y=\"{y}\" text-anchor=\"middle\">{x_name}</text>"
    )
    .ok();
    let y = 0.5 * (top + y_end);
    writeln!(
        svg,
        "<text class=\"name\" transform=\"translate(11 {y}) rotate(-90)\" text-anchor=\"middle\">{y_name}</text>"
    )
    .ok();
    let placed: Vec<[f64; 2]> =
        points.iter().map(|point| [x_axis.place(point.at[0]), y_axis.place(point.at[1])]).collect();
    svg += &front_line(points, &placed);
    let labels = label_places(points, &placed, [left, top, x_end, y_end]);
    // What is on the front is drawn last, over what is not.
    let mut drawn: Vec<_> = points.iter().zip(&placed).zip(labels).collect();
    drawn.sort_by_key(|((point, _), _)| point.on_front);
    for ((point, &at), label) in drawn {
        let (class, style) = (if point.on_front { " front" } else { "" }, point.style % STYLES);
        writeln!(
            svg,
            "<g class=\"point s{style}{class}\"><title>{}</title>",
            escaped(&point.title)
        )
        .ok();
        writeln!(svg, "<path d=\"{}\"/>", mark(style, at)).ok();
        let ([x, y], text) = (label, escaped(&point.label));
        writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">{text}</text></g>")
            .ok();
    }
    svg + "</svg>\n"
}

/// A mark's outline. Shapes differ too, for those who cannot tell the colours apart.
pub fn mark(style: usize, [x, y]: [f64; 2]) -> String {
    let r = MARK;
    match style % 4 {
        0 => format!(
            "M{:.1} {y:.1}a{r} {r} 0 1 0 {} 0a{r} {r} 0 1 0 -{} 0z",
            x - r,
            2.0 * r,
            2.0 * r
        ),
        1 => format!("M{:.1} {:.1}h{}v{}h-{}z", x - r, y - r, 2.0 * r, 2.0 * r, 2.0 * r),
        2 => format!("M{x:.1} {:.1}l{r} {}h-{}z", y - r, 2.0 * r, 2.0 * r),
        _ => format!("M{x:.1} {:.1}l{r} {r}l-{r} {r}l-{r} -{r}z", y - r),
    }
}

/// The line through the front, cheapest first.
fn front_line(points: &[PlotPoint], placed: &[[f64; 2]]) -> String {
    let on_front = points.iter().zip(placed).filter(|(point, _)| point.on_front);
    let mut line: Vec<[f64; 2]> = on_front.map(|(_, &at)| at).collect();
    line.sort_by(|a, b| a[0].total_cmp(&b[0]).then(b[1].total_cmp(&a[1])));
    if line.len() < 2 {
        return String::new();
    }
    let corners: Vec<String> = line.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
    format!("<polyline class=\"line\" points=\"{}\"/>\n", corners.join(" "))
}

/// Where each label goes: the first side of its mark at which it covers no mark and no label.
fn label_places(
    points: &[PlotPoint],
    marks: &[[f64; 2]],
    [left, top, right, bottom]: [f64; 4],
) -> Vec<[f64; 2]> {
    let mut taken: Vec<[f64; 4]> =
        marks.iter().map(|[x, y]| [x - MARK, y - MARK, x + MARK, y + MARK]).collect();
    let mut places = Vec::with_capacity(points.len());
    for (point, &[x, y]) in points.iter().zip(marks) {
        let half = 3.2 * point.label.chars().count() as f64;
        let (aside, up) = (MARK + half + 2.0, MARK + 6.0);
        let sides = [
            [x + aside, y],
            [x - aside, y],
            [x, y - up],
            [x, y + up],
            [x + aside, y - up],
            [x - aside, y - up],
            [x + aside, y + up],
            [x - aside, y + up],
            [x, y - 2.0 * up],
            [x, y + 2.0 * up],
        ];
        let bounds = |[x, y]: [f64; 2]| [x - half, y - 5.0, x + half, y + 5.0];
        let fits = |side: &[f64; 2]| {
            let own = bounds(*side);
            let inside =
                own[0] >= left && own[1] >= top - 4.0 && own[2] <= right + 12.0 && own[3] <= bottom;
            inside && taken.iter().all(|other| !overlap(own, *other))
        };
        let place = sides.iter().copied().find(fits).unwrap_or(sides[0]);
        taken.push(bounds(place));
        // Text stands on its base line.
        places.push([place[0], place[1] + 4.0]);
    }
    places
}

fn overlap(a: [f64; 4], b: [f64; 4]) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// Values to places along one axis.
struct Axis {
    low: f64,
    high: f64,
    /// Places of `low` and `high`.
    ends: [f64; 2],
    is_logarithmic: bool,
}

impl Axis {
    fn new(values: impl Iterator<Item = f64>, ends: [f64; 2], may_be_logarithmic: bool) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.filter(|value| value.is_finite()) {
            (low, high) = (low.min(value), high.max(value));
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        let is_logarithmic = may_be_logarithmic && low > 0.0 && high / low > LINEAR_UP_TO;
        if is_logarithmic {
            let room = (high / low).powf(0.06);
            return Self { low: low / room, high: high * room, ends, is_logarithmic };
        }
        let span = high - low;
        let room = if span > 0.0 { 0.08 * span } else { (0.05 * high.abs()).max(1e-3) };
        Self { low: low - room, high: high + room, ends, is_logarithmic }
    }

    fn place(&self, value: f64) -> f64 {
        let share = if self.is_logarithmic {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        self.ends[0] + share * (self.ends[1] - self.ends[0])
    }

    /// Places of ticks and what stands at them.
    fn ticks(&self) -> Vec<(f64, String)> {
        let values = if self.is_logarithmic { self.powers() } else { self.multiples() };
        values.into_iter().map(|(value, text)| (self.place(value), text)).collect()
    }

    /// 1, 2 and 5 times powers of ten; powers alone where that is too many.
    fn powers(&self) -> Vec<(f64, String)> {
        let exponents = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
        let few = self.high / self.low > 200.0;
        let digits: &[f64] = if few { &[1.0] } else { &[1.0, 2.0, 5.0] };
        let all = exponents.flat_map(|exponent| {
            digits.iter().map(move |digit| (digit * 10f64.powi(exponent), exponent))
        });
        let inside = all.filter(|(value, _)| (self.low..=self.high).contains(value));
        let decimals = |exponent: i32| usize::try_from(-exponent).unwrap_or(0);
        inside.map(|(value, exponent)| (value, format!("{value:.*}", decimals(exponent)))).collect()
    }

    /// Multiples of a round step, three to eight.
    fn multiples(&self) -> Vec<(f64, String)> {
        let rough = (self.high - self.low) / 8.0;
        let power = rough.log10().floor();
        let unit = 10f64.powf(power);
        let step = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * unit);
        let step = step.into_iter().find(|step| *step >= rough).unwrap_or(unit);
        let decimals = usize::try_from(-(step.log10() + 1e-9).floor() as i64).unwrap_or(0);
        let numbers = (self.low / step).ceil() as i64..=(self.high / step).floor() as i64;
        let values = numbers.map(|number| number as f64 * step);
        values.map(|value| (value, format!("{value:.decimals$}"))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(values: [f64; 2], may_be_logarithmic: bool) -> Vec<String> {
        let axis = Axis::new(values.into_iter(), [0.0, 100.0], may_be_logarithmic);
        axis.ticks().into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(
            labels([4.15, 4.45], true),
            ["4.15", "4.20", "4.25", "4.30", "4.35", "4.40", "4.45"]
        );
        assert_eq!(labels([0.2, 20.0], true), ["0.2", "0.5", "1", "2", "5", "10", "20"]);
        assert_eq!(labels([25.0, 60.0], false), ["30", "40", "50", "60"]);
        assert!(!labels([3.0, 3.0], true).is_empty());
        assert!(labels([1e-3, 1e9], true).len() <= 14);
        let axis = Axis::new([1.0, 2.0].into_iter(), [40.0, 240.0], true);
        assert!(axis.ticks().iter().all(|(at, _)| (40.0..=240.0).contains(at)));
    }
}
