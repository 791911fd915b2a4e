//! The results as one page: tables, plots and pictures in a single file that needs no other, no
//! network and no scripts.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::escape::escaped;
use super::plot::{PlotPoint, STYLES, mark, plot};
use super::report::{Fronts, SettingReport, SweepReport};
use super::thumbnail::Thumbnail;

const STYLE: &str = include_str!("page.css");

/// The page.
pub fn page(report: &SweepReport) -> String {
    let title = escaped(&format!("Sweep of {}", report.input));
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <meta name=\"color-scheme\" content=\"light dark\"/>\n\
         <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n"
    );
    html += &introduction(report);
    html += &legend(report);
    html += &plots(report);
    html += &table(report);
    html += &pictures(report);
    html + "</body>\n</html>\n"
}

fn introduction(report: &SweepReport) -> String {
    let failed = report.settings.iter().filter(|setting| setting.failure.is_some()).count();
    let [width, height] = report.size;
    let plural =
        |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
    let mut text = format!(
        "<p>{}, compared with the unbaked scene from {} at {width} x {height} pixels. Times are the \
         median of {} with {}.",
        plural(report.settings.len(), "setting"),
        plural(report.frames.len(), "camera"),
        plural(report.repeat, "bake"),
        plural(report.threads, "thread"),
    );
    if failed > 0 {
        write!(text, " <strong>{} failed.</strong>", plural(failed, "setting")).ok();
    }
    text + "</p>\n<p>Lines go through the Pareto fronts: no other setting is at most as large (or as \
            slow), at least as close, and better in one of the two. Numbers are those of the table; \
            point at a mark for its name and figures.</p>\n"
}

/// Each filter's mark, in the order in which filters come.
fn styles(report: &SweepReport) -> Vec<&str> {
    let mut filters: Vec<&str> = Vec::new();
    for setting in &report.settings {
        let filter = setting.options["filter"].as_str().unwrap_or_default();
        if !filters.contains(&filter) {
            filters.push(filter);
        }
    }
    filters
}

fn legend(report: &SweepReport) -> String {
    let mut html = String::from("<ul class=\"legend\">\n");
    for (number, filter) in styles(report).iter().enumerate() {
        let (style, path) = (number % STYLES, mark(number, [6.0, 6.0]));
        writeln!(
            html,
            "<li><svg viewBox=\"0 0 12 12\" class=\"key\" aria-hidden=\"true\"><g class=\"point \
             s{style} front\"><path d=\"{path}\"/></g></svg> {}</li>",
            escaped(filter)
        )
        .ok();
    }
    html + "</ul>\n"
}

/// What a setting costs, in the unit that suits the largest.
struct Cost {
    name: &'static str,
    unit: &'static str,
    /// One of the unit.
    one: f64,
    decimals: usize,
    value: fn(&SettingReport) -> Option<f64>,
    on_front: fn(&Fronts) -> bool,
}

impl Cost {
    fn text(&self, setting: &SettingReport) -> String {
        let (unit, decimals) = (self.unit, self.decimals);
        let value = (self.value)(setting).unwrap_or_default() / self.one;
        format!("{value:.decimals$} {unit}")
    }
}

fn costs(report: &SweepReport) -> [Cost; 2] {
    let bytes = |setting: &SettingReport| setting.output_bytes.map(|bytes| bytes as f64);
    let seconds = |setting: &SettingReport| setting.seconds;
    let most = |value: fn(&SettingReport) -> Option<f64>| {
        report.settings.iter().filter_map(value).fold(0.0, f64::max)
    };
    let (one, unit) = match most(bytes) {
        ..1e6 => (1e3, "kB"),
        1e6..1e9 => (1e6, "MB"),
        _ => (1e9, "GB"),
    };
    let size = Cost { name: "size", unit, one, decimals: 2, value: bytes, on_front: |f| f.bytes };
    let (one, unit, decimals) = if most(seconds) < 1.0 { (1e-3, "ms", 1) } else { (1.0, "s", 2) };
    let on_front = |fronts: &Fronts| fronts.seconds;
    [size, Cost { name: "time", unit, one, decimals, value: seconds, on_front }]
}

fn plots(report: &SweepReport) -> String {
    let costs = costs(report);
    let mut html = String::new();
    for (number, scale) in report.scales.iter().enumerate() {
        writeln!(html, "<h2>Scale 1/{scale}</h2>\n<div class=\"plots\">").ok();
        for cost in &costs {
            let about = format!("PSNR in dB at scale 1/{scale} against {}", cost.name);
            let points = points(report, number, cost);
            html += &plot([&format!("{}, {}", cost.name, cost.unit), "PSNR, dB"], &about, &points);
        }
        html += "</div>\n";
    }
    html
}

fn points(report: &SweepReport, number: usize, cost: &Cost) -> Vec<PlotPoint> {
    let styles: BTreeMap<&str, usize> =
        styles(report).into_iter().enumerate().map(|(style, filter)| (filter, style)).collect();
    let mut points = Vec::new();
    for (index, setting) in report.settings.iter().enumerate() {
        let figures = setting.errors.get(number).zip(setting.fronts.get(number));
        let (Some((errors, fronts)), Some(value)) = (figures, (cost.value)(setting)) else {
            continue;
        };
        let filter = setting.options["filter"].as_str().unwrap_or_default();
        points.push(PlotPoint {
            at: [value / cost.one, errors.psnr],
            on_front: (cost.on_front)(fronts),
            style: styles.get(filter).copied().unwrap_or(0),
            label: (index + 1).to_string(),
            title: format!("{}: {}, {:.2} dB", setting.name, cost.text(setting), errors.psnr),
        });
    }
    points
}

fn table(report: &SweepReport) -> String {
    let costs = costs(report);
    let mut html = String::from(
        "<h2>All settings</h2>\n<p>PSNR in dB at each scale; * is on the front of size, + on that of \
         time.</p>\n<div class=\"wide\"><table>\n<thead><tr><th>#</th><th>setting</th><th>size</th>\
         <th>time</th><th>levels</th>",
    );
    for scale in &report.scales {
        write!(html, "<th>1/{scale}</th>").ok();
    }
    html += "</tr></thead>\n<tbody>\n";
    for (index, setting) in report.settings.iter().enumerate() {
        let name = escaped(&setting.name);
        let preset = setting.preset.map_or_else(String::new, |preset| format!(" ({preset})"));
        write!(html, "<tr><td>{}</td><th scope=\"row\">{name}{preset}</th>", index + 1).ok();
        if let Some(failure) = &setting.failure {
            let columns = report.scales.len() + 3;
            let failure = escaped(failure);
            writeln!(
                html,
                "<td class=\"failed\" colspan=\"{columns}\">failed: {failure}</td></tr>"
            )
            .ok();
            continue;
        }
        let [size, time] = costs.each_ref().map(|cost| cost.text(setting));
        let levels = setting.levels.unwrap_or_default();
        write!(html, "<td>{size}</td><td>{time}</td><td>{levels}</td>").ok();
        for (errors, fronts) in setting.errors.iter().zip(&setting.fronts) {
            let class = if fronts.bytes || fronts.seconds { " class=\"front\"" } else { "" };
            let marks = fronts.marks();
            write!(html, "<td{class}>{:.2}<span class=\"marks\">{marks}</span></td>", errors.psnr)
                .ok();
        }
        html += "</tr>\n";
    }
    html + "</tbody></table></div>\n"
}

fn pictures(report: &SweepReport) -> String {
    let shown = report.settings.iter().find(|setting| !setting.thumbnails.is_empty());
    let Some(first) = shown else { return String::new() };
    let frame = first.thumbnails.first().map_or("", |thumbnail| thumbnail.frame.as_str());
    let scales: Vec<String> =
        first.thumbnails.iter().map(|thumbnail| format!("1/{}", thumbnail.scale)).collect();
    let mut html = format!(
        "<h2>Pictures</h2>\n<p>Frame {} at scale {}, reduced to fit.</p>\n<div class=\"pictures\">\n",
        escaped(frame),
        scales.join(" and ")
    );
    html += &figure("unbaked", first.thumbnails.iter().map(|t| (t, t.want.as_str())));
    for (index, setting) in report.settings.iter().enumerate() {
        if !setting.thumbnails.is_empty() {
            let caption = format!("{}: {}", index + 1, setting.name);
            html += &figure(&caption, setting.thumbnails.iter().map(|t| (t, t.got.as_str())));
        }
    }
    html + "</div>\n"
}

/// Pictures of several scales, all as wide as the first.
fn figure<'a>(caption: &str, pictures: impl Iterator<Item = (&'a Thumbnail, &'a str)>) -> String {
    let caption = escaped(caption);
    let mut html = String::from("<figure>");
    let mut width = None;
    for (thumbnail, png) in pictures {
        let (width, scale) = (*width.get_or_insert(thumbnail.width), thumbnail.scale);
        let height = thumbnail.height * width / thumbnail.width.max(1);
        write!(
            html,
            "<img src=\"data:image/png;base64,{}\" width=\"{width}\" height=\"{height}\" \
             alt=\"{caption} at scale 1/{scale}\"/>",
            escaped(png)
        )
        .ok();
    }
    html + &format!("<figcaption>{caption}</figcaption></figure>\n")
}
