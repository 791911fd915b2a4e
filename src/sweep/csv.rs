//! The results as a table for spreadsheets: one row per setting, as in RFC 4180 except for line
//! ends.

use std::fmt::Write;

use super::report::{SettingReport, SweepReport};

/// Columns of each scale.
const FIGURES: [&str; 8] = [
    "psnr",
    "ssim",
    "max_abs",
    "p99_abs",
    "psnr_diffuse",
    "psnr_opacity",
    "front_bytes",
    "front_seconds",
];

/// The table. Columns of scale `k` end in `_sk`; unknown values are empty.
pub fn csv(report: &SweepReport) -> String {
    let head = [
        "name",
        "preset",
        "filter",
        "bits",
        "max_error",
        "alpha_threshold",
        "block_size",
        "zstd_level",
        "most_levels",
        "output_bytes",
        "seconds",
        "levels",
    ];
    let mut columns: Vec<String> = head.map(str::to_owned).to_vec();
    for scale in &report.scales {
        columns.extend(FIGURES.map(|figure| format!("{figure}_s{scale}")));
    }
    columns.push("failure".to_owned());
    let mut text = columns.join(",") + "\n";
    for setting in &report.settings {
        writeln!(text, "{}", row(setting, report.scales.len()).join(",")).ok();
    }
    text
}

fn row(setting: &SettingReport, scales: usize) -> Vec<String> {
    fn shown<T: ToString>(value: Option<T>) -> String {
        value.map(|value| value.to_string()).unwrap_or_default()
    }
    let option = |name: &str| match &setting.options[name] {
        serde_json::Value::Null => String::new(),
        serde_json::Value::String(text) => quoted(text),
        // Options are f32, whose shortest text is the typed one.
        serde_json::Value::Number(number) if number.is_f64() => {
            shown(number.as_f64().map(|number| number as f32))
        }
        other => other.to_string(),
    };
    let options =
        ["filter", "bits", "max_error", "alpha_threshold", "block_size", "zstd_level", "levels"];
    let mut row = vec![quoted(&setting.name), shown(setting.preset)];
    row.extend(options.map(option));
    row.extend([shown(setting.output_bytes), shown(setting.seconds), shown(setting.levels)]);
    for scale in 0..scales {
        let (errors, fronts) = (setting.errors.get(scale), setting.fronts.get(scale));
        row.extend([
            shown(errors.map(|errors| errors.psnr)),
            shown(errors.and_then(|errors| errors.ssim)),
            shown(errors.map(|errors| errors.max_abs)),
            shown(errors.map(|errors| errors.p99_abs)),
            shown(errors.and_then(|errors| errors.psnr_diffuse)),
            shown(errors.and_then(|errors| errors.psnr_opacity)),
            shown(fronts.map(|fronts| fronts.bytes)),
            shown(fronts.map(|fronts| fronts.seconds)),
        ]);
    }
    row.push(quoted(setting.failure.as_deref().unwrap_or_default()));
    row
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::quoted;

    #[test]
    fn only_what_needs_quotes_has_them() {
        assert_eq!(quoted("plain text"), "plain text");
        assert_eq!(quoted("a,b"), "\"a,b\"");
        assert_eq!(quoted("say \"no\"\n"), "\"say \"\"no\"\"\n\"");
    }
}
