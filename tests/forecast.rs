//! `bake --dry-run`: its forecast, and that nothing is written.

#![cfg(feature = "cli")]

mod common;

use std::path::Path;
use std::process::{Command, Output};

use common::{assert_schema, fixture, folder};
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
    // Small blocks, so that the box is long enough for windows.
    for options in [&["--block-size", "4"][..], &["--block-size", "4", "--max-error", "0.02"]] {
        let folder = folder();
        let here = folder.path();
        let forecast = report(here, &[options, &["--dry-run"]].concat());
        assert_eq!(std::fs::read_dir(here).expect("a folder").count(), 0);
        assert_eq!(forecast["dry_run"], true);
        let baked = report(here, options);
        assert!(baked.get("dry_run").is_none());
        let bytes = |report: &Value| report["output_bytes"].as_f64().expect("bytes");
        let ratio = bytes(&forecast) / bytes(&baked);
        assert!((0.85..1.15).contains(&ratio), "{ratio}");
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
fn fits_are_not_forecast() {
    let folder = folder();
    let output = bake(folder.path(), &["--dry-run", "--filter", "fit"]);
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        message.contains("--filter: found fit, whose end is not known beforehand"),
        "{message}"
    );
}
