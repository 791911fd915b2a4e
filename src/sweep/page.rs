//! The results as one page: plots and a table in a self-contained file without scripts.

use std::fmt::Write;

use super::plot::{PlotPoint, legend, plot};
use super::report::{Fronts, SettingReport, SweepReport};
use crate::report_page::{self, escaped};

/// The page.
pub(super) fn page(report: &SweepReport) -> String {
    let mut html = report_page::start(&format!("Sweep of {}", report.input));
    let [width, height] = report.size;
    writeln!(
        html,
        "<p>Settings: {}. Cameras: {}, of {width} x {height} pixels. Each setting is compared with \
         the unbaked scene. Bakes of a setting: {}, of which the median time is shown; threads: {}.</p>\n\
         <p>Numbers at the points are those of the table. The lines are Pareto fronts: no other \
         setting is both smaller (or faster) and more accurate than one on the line.</p>",
        report.settings.len(),
        report.frames.len(),
        report.repeat,
        report.threads,
    )
    .ok();
    html += &recommendation(report);
    let series = filters(report);
    html += &legend(&series);
    for (number, scale) in report.scales.iter().enumerate() {
        writeln!(html, "<h2>Scale 1/{scale}</h2>\n<div class=\"plots\">").ok();
        for cost in &COSTS {
            let about = format!("PSNR in dB at scale 1/{scale} against {}", cost.name);
            html += &plot([cost.name, "PSNR, dB"], &about, &points(report, &series, number, cost));
        }
        html += "</div>\n";
    }
    html += &table(report);
    html + report_page::END
}

/// The recommended setting, and the command that bakes it.
fn recommendation(report: &SweepReport) -> String {
    let row = report.recommended_row();
    let Some((row, setting)) = row.and_then(|row| Some((row, report.settings.get(row)?))) else {
        return String::new();
    };
    let mut html = format!(
        "<p>Recommended: <strong>{}</strong>, number {}, with a ring in the plots. It is the knee of \
         the front of size at full size: smaller settings lose more quality for each byte they \
         save, larger ones gain less for each byte they add.</p>\n",
        escaped(&setting.name),
        row + 1,
    );
    if let Some(command) = &setting.command {
        html += &report_page::command(command);
    }
    html
}

/// The name of a setting's filter.
fn filter(setting: &SettingReport) -> &str {
    setting.options["filter"].as_str().unwrap_or_default()
}

/// The filters, in the order of the table. Each is a series of the plots.
fn filters(report: &SweepReport) -> Vec<String> {
    let mut filters: Vec<String> = Vec::new();
    for setting in &report.settings {
        if !filters.iter().any(|name| name == filter(setting)) {
            filters.push(filter(setting).to_owned());
        }
    }
    filters
}

/// A cost of a setting, in the unit of its name.
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

fn points(report: &SweepReport, series: &[String], scale: usize, cost: &Cost) -> Vec<PlotPoint> {
    let chosen = report.recommended_row();
    let point = |(index, setting): (usize, &SettingReport)| {
        let (errors, fronts) = (setting.errors.get(scale)?, setting.fronts.get(scale)?);
        let value = (cost.value)(setting)?;
        let (name, psnr) = (&setting.name, errors.psnr);
        Some(PlotPoint {
            at: [value, psnr],
            on_front: (cost.on_front)(fronts),
            is_chosen: chosen == Some(index),
            series: series.iter().position(|name| name == filter(setting)).unwrap_or_default(),
            label: (index + 1).to_string(),
            title: format!("{name}: {} {value:.3}, {psnr:.2} dB", cost.name),
        })
    };
    report.settings.iter().enumerate().filter_map(point).collect()
}

fn table(report: &SweepReport) -> String {
    let mut html = String::from(
        "<h2>All settings</h2>\n<p>PSNR in dB at each scale; * no other setting is both smaller and \
         more accurate, + none is both faster and more accurate. The pictures are the first frame, \
         and its error: black for none, white for 0.25 or more.</p>\n",
    );
    let heads = ["#", "setting", "picture, error", "size, MB", "time, s", "levels"];
    let scales = report.scales.iter().map(|scale| format!("1/{scale}"));
    html += &report_page::table_start(heads.map(str::to_owned).into_iter().chain(scales));
    let chosen = report.recommended_row();
    for (index, setting) in report.settings.iter().enumerate() {
        let class = if chosen == Some(index) { " class=\"chosen\"" } else { "" };
        write!(html, "<tr{class}><td>{}</td><td class=\"name\">{}</td>", index + 1, name(setting))
            .ok();
        match &setting.failure {
            Some(failure) => {
                let (columns, failure) = (report.scales.len() + 4, escaped(failure));
                write!(html, "<td class=\"failed\" colspan=\"{columns}\">failed: {failure}</td>")
                    .ok();
            }
            None => html += &figures(setting),
        }
        html += "</tr>\n";
    }
    html + report_page::TABLE_END
}

/// A setting's name as a link to its container, with the command that bakes it.
fn name(setting: &SettingReport) -> String {
    let preset = setting.preset.map_or_else(String::new, |preset| format!(" ({preset})"));
    // A container lies beside the page, unless its bake failed.
    let (name, file) = (escaped(&setting.name), escaped(&setting.file));
    let mut html = match &setting.failure {
        None => format!("<a href=\"{file}\">{name}</a>{preset}"),
        Some(_) => name + &preset,
    };
    if let Some(command) = &setting.command {
        let command = report_page::command(command);
        write!(html, "<details><summary>command</summary>{command}</details>").ok();
    }
    html
}

/// The cells of a setting that was baked.
fn figures(setting: &SettingReport) -> String {
    let thumbnail = setting.thumbnail.as_ref().map_or_else(String::new, |thumbnail| {
        let about = format!("{} and its error", setting.name);
        report_page::picture(&thumbnail.png, thumbnail.size, &about)
    });
    let mut html = format!("<td>{thumbnail}</td>");
    for value in COSTS.iter().filter_map(|cost| (cost.value)(setting)) {
        write!(html, "<td>{value:.3}</td>").ok();
    }
    if let Some(levels) = setting.levels {
        write!(html, "<td>{levels}</td>").ok();
    }
    for (errors, fronts) in setting.errors.iter().zip(&setting.fronts) {
        write!(html, "<td>{:.2}{}</td>", errors.psnr, fronts.marks()).ok();
    }
    html
}
