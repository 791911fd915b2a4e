//! `bake --dry-run`: its forecast, and that nothing is written.

use crate::common;
use std::path::Path;
use std::process::{Command, Output};

use crate::common::{assert_schema, fixture, folder};
use serde_json::Value;

fn bake(here: &Path, options: &[&str]) -> Output {
    let scene = fixture("trained/lego64/fine_last.tar");
    let mut command = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"));
    command.current_dir(here).arg("bake").arg(scene);
    command.args(["--stepsize", "0.5", "-o", "out.mipvog", "--format", "json"]).args(options);
    command.output().expect("starts")
}

fn report(here: &Path, options: &[&str]) -> Value {
    let output = bake(here, options);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report = serde_json::from_slice(&output.stdout).expect("a report");
    assert_schema("bake", &report);
    report
}

#[test]
fn bytes_are_forecast_and_nothing_is_written() {
    let presets = ["web", "archive", "faithful"].map(|preset| vec!["--preset", preset]);
    for options in presets.into_iter().chain([vec![], vec!["--block-size", "4"]]) {
        let options = &options[..];
        let folder = folder();
        let here = folder.path();
        let forecast = report(here, &[options, &["--dry-run"]].concat());
        assert_eq!(std::fs::read_dir(here).expect("a folder").count(), 0);
        assert_eq!(forecast["dry_run"], true);
        let baked = report(here, options);
        assert!(baked.get("dry_run").is_none());
        let bytes = |report: &Value| report["output_bytes"].as_f64().expect("bytes");
        let ratio = bytes(&forecast) / bytes(&baked);
        // A small scene is encoded whole; only the words of its provenance are others.
        assert!((0.999..1.001).contains(&ratio), "{options:?}: {ratio}");
        for (forecast, baked) in levels(&forecast).iter().zip(levels(&baked)) {
            assert_eq!(forecast["groups"], baked["groups"]);
        }
        assert_eq!(forecast["pruned"], baked["pruned"]);
        assert!(forecast["seconds"].as_f64().expect("seconds") > 0.0);
    }
}

#[test]
fn an_existing_output_stays_and_is_no_obstacle() {
    let folder = folder();
    let path = folder.path().join("out.mipvog");
    std::fs::write(&path, "theirs").expect("writable");
    report(folder.path(), &["--dry-run"]);
    assert_eq!(std::fs::read(&path).expect("readable"), b"theirs");
}

#[test]
fn a_fit_is_forecast_by_its_steps() {
    let folder = folder();
    let fit = ["--filter", "fit", "--fit-steps", "7", "--block-size", "4"];
    let forecast = report(folder.path(), &[&fit[..], &["--dry-run"]].concat());
    assert!(forecast["seconds"].is_null() && forecast["peak_memory_bytes"].is_null());
    assert!(forecast["least_memory_bytes"].is_null(), "a fit takes no bound");
    assert_eq!(forecast["fit_steps"], 7, "each moves all levels");
    let usual = report(folder.path(), &["--block-size", "4", "--dry-run"]);
    assert_eq!(forecast["pruned"], usual["pruned"]);
    assert!(usual["seconds"].as_f64() > Some(0.0) && usual.get("fit_steps").is_none());
    let ratio = forecast["output_bytes"].as_f64().expect("bytes")
        / usual["output_bytes"].as_f64().expect("bytes");
    assert!((0.9..1.1).contains(&ratio), "{ratio}");
}

/// The report of a sweep, or of its forecast.
fn sweep(here: &Path, options: &[&str]) -> Value {
    let scene = fixture("trained/lego64/fine_last.tar");
    let mut command = common::program();
    command.current_dir(here).arg("sweep").arg(scene).args(["--stepsize", "0.5", "-o", "out"]);
    command.args(["--turntable", "1", "--size", "8", "--scales", "1", "--repeat", "2"]);
    let output = command.args(["--block-size", "4", "--format", "json"]).args(options).output();
    let output = output.expect("starts");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{message}");
    serde_json::from_slice(&output.stdout).expect("a report")
}

#[test]
fn a_sweep_is_forecast_setting_by_setting() {
    let folder = folder();
    let here = folder.path();
    let forecast = sweep(here, &["--bits", "6,8", "--dry-run"]);
    assert_schema("sweep-forecast", &forecast);
    assert_eq!(std::fs::read_dir(here).expect("a folder").count(), 0);
    let swept = sweep(here, &["--bits", "6"]);
    let bytes = |report: &Value, i: usize| report["settings"][i]["output_bytes"].as_f64();
    let ratio = bytes(&forecast, 0).expect("bytes") / bytes(&swept, 0).expect("bytes");
    assert!((0.85..1.15).contains(&ratio), "{ratio}");
    let seconds = |i: usize| forecast["settings"][i]["seconds"].as_f64().expect("seconds");
    let total = forecast["seconds"].as_f64().expect("seconds");
    assert!((total / (2.0 * (seconds(0) + seconds(1))) - 1.0).abs() < 1e-6);
    let sum = bytes(&forecast, 0).zip(bytes(&forecast, 1)).map(|(a, b)| a + b);
    assert_eq!(forecast["output_bytes"].as_f64(), sum);
    // A result that is there is told, and costs nothing more.
    let again = sweep(here, &["--bits", "6", "--dry-run"]);
    assert_eq!((&again["settings"][0]["resumed"], &again["seconds"]), (&true.into(), &0.0.into()));
    assert_eq!(bytes(&again, 0), bytes(&swept, 0));
    // The end of a fit is not known.
    let fit = sweep(here, &["--bits", "6,7", "--filter", "rate-tent,fit", "--dry-run"]);
    assert!(fit["seconds"].is_null() && fit["settings"][3]["seconds"].is_null());
}

fn levels(report: &Value) -> &[Value] {
    report["levels"].as_array().expect("levels")
}

#[test]
fn unknown_numbers_are_null() {
    let folder = folder();
    let forecast = report(folder.path(), &["--dry-run"]);
    assert!(levels(&forecast).iter().all(|level| level["prefix_bytes"].is_null()));
    let mut text = common::program();
    text.args(["bake", "--dry-run", "--stepsize", "0.5", "--max-error", "0.02", "-o", "x"]);
    let output = text.arg(fixture("trained/lego64/fine_last.tar")).output().expect("starts");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains("smallest --memory") && text.contains("   -"), "{text}");
    let refused = bake(folder.path(), &["--dry-run", "--max-bytes", "1MB"]);
    assert_eq!(refused.status.code(), Some(2));
}
