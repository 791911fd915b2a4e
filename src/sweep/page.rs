//! The results as one page: plots and a table in a single file that needs no other, no network and
//! no scripts.

use std::fmt::Write;

use super::escape::escaped;
use super::plot::{PlotPoint, plot};
use super::report::{Fronts, SettingReport, SweepReport};

const STYLE: &str = include_str!("page.css");

/// The page.
pub(super) fn page(report: &SweepReport) -> String {
    let title = escaped(&format!("Sweep of {}", report.input));
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <meta name=\"color-scheme\" content=\"light dark\"/>\n\
         <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n"
    );
    let [width, height] = report.size;
    writeln!(
        html,
        "<p>Settings: {}. Cameras: {}, of {width} x {height} pixels. Each setting is compared with \
         the unbaked scene. Times are the median of {} bakes, with {} threads.</p>\n\
         <p>Numbers at the points are those of the table. The lines are Pareto fronts: no other \
         setting is both smaller (or faster) and more accurate than one on the line. The best \
         trade-off is number {}: beyond it, more bytes gain less.</p>",
        report.settings.len(),
        report.frames.len(),
        report.repeat,
        report.threads,
        report.recommended_row().map_or_else(|| "-".to_owned(), |row| (row + 1).to_string()),
    )
    .ok();
    for (number, scale) in report.scales.iter().enumerate() {
        writeln!(html, "<h2>Scale 1/{scale}</h2>\n<div class=\"plots\">").ok();
        for cost in &COSTS {
            let about = format!("PSNR in dB at scale 1/{scale} against {}", cost.name);
            html += &plot([cost.name, "PSNR, dB"], &about, &points(report, number, cost));
        }
        html += "</div>\n";
    }
    html += &table(report);
    html + "</body>\n</html>\n"
}

/// One cost of a setting, in the unit of its name.
struct Cost {
    name: &'static str,
    value: fn(&SettingReport) -> Option<f64>,
    on_front: fn(&Fronts) -> bool,
}

const COSTS: [Cost; 2] = [
    Cost {
        name: "size, MB",
        value: |setting| setting.output_bytes.map(|bytes| bytes as f64 / 1e6),
        on_front: |fronts| fronts.bytes,
    },
    Cost { name: "time, s", value: |setting| setting.seconds, on_front: |fronts| fronts.seconds },
];

fn points(report: &SweepReport, scale: usize, cost: &Cost) -> Vec<PlotPoint> {
    let point = |(index, setting): (usize, &SettingReport)| {
        let (errors, fronts) = (setting.errors.get(scale)?, setting.fronts.get(scale)?);
        let value = (cost.value)(setting)?;
        let (name, psnr) = (&setting.name, errors.psnr);
        Some(PlotPoint {
            at: [value, psnr],
            on_front: (cost.on_front)(fronts),
            label: (index + 1).to_string(),
            title: format!("{name}: {} {value:.3}, {psnr:.2} dB", cost.name),
        })
    };
    report.settings.iter().enumerate().filter_map(point).collect()
}

fn table(report: &SweepReport) -> String {
    let mut html = String::from(
        "<h2>All settings</h2>\n<p>PSNR in dB at each scale; * no other setting is both smaller and \
         more accurate, + none is both faster and more accurate.</p>\n<table>\n<thead><tr><th>#</th><th>setting</th><th>size, MB</th>\
         <th>time, s</th><th>levels</th>",
    );
    for scale in &report.scales {
        write!(html, "<th>1/{scale}</th>").ok();
    }
    html += "</tr></thead>\n<tbody>\n";
    for (index, setting) in report.settings.iter().enumerate() {
        let preset = setting.preset.map_or_else(String::new, |preset| format!(" ({preset})"));
        // A container lies beside the page, unless its bake failed.
        let (name, file) = (escaped(&setting.name), escaped(&setting.file));
        let name = match &setting.failure {
            None => format!("<a href=\"{file}\">{name}</a>{preset}"),
            Some(_) => name + &preset,
        };
        write!(html, "<tr><td>{}</td><td>{name}</td>", index + 1).ok();
        if let Some(failure) = &setting.failure {
            let (columns, failure) = (report.scales.len() + 3, escaped(failure));
            write!(html, "<td class=\"failed\" colspan=\"{columns}\">failed: {failure}</td>").ok();
        }
        for value in COSTS.iter().filter_map(|cost| (cost.value)(setting)) {
            write!(html, "<td>{value:.3}</td>").ok();
        }
        if let Some(levels) = setting.levels {
            write!(html, "<td>{levels}</td>").ok();
        }
        for (errors, fronts) in setting.errors.iter().zip(&setting.fronts) {
            write!(html, "<td>{:.2}{}</td>", errors.psnr, fronts.marks()).ok();
        }
        html += "</tr>\n";
    }
    html + "</tbody></table>\n"
}
