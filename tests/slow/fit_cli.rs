//! `bake --filter fit` as users see it: budgets, cameras, signals.

use crate::common;
use std::path::Path;
use std::process::{Command, Output};

use crate::common::{assert_schema, fixture, folder, open_bytes};
use serde_json::Value;

/// A fit that would take minutes without a signal.
fn long_fit(here: &Path) -> Command {
    let scene = fixture("trained/lego64/fine_last.tar").display().to_string();
    let mut command = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"));
    command.current_dir(here).args(["bake", &scene, "--stepsize", "0.5", "-o", "fit.mipvog"]);
    command.args(["--filter", "fit", "--fit-steps", "100000", "--format", "json"]);
    command
}

fn report(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report = serde_json::from_slice(&output.stdout).expect("a report");
    assert_schema("bake", &report);
    report
}

/// That the fit was cut short and says so in its provenance.
fn assert_cut_short(here: &Path, report: &Value) {
    assert_eq!(report["fitted"]["cut_short"], true);
    let bytes = std::fs::read(here.join("fit.mipvog")).expect("a container");
    let provenance = open_bytes(&bytes).expect("valid").provenance().expect("readable");
    let taken = &provenance.expect("a provenance")["options"]["fit_steps_taken"];
    let levels = report["fitted"]["levels"].as_array().expect("levels");
    let steps: Vec<Value> = levels.iter().map(|level| level["steps"].clone()).collect();
    assert_eq!(taken, &Value::from(steps));
    for level in levels {
        let psnr = |key: &str| level[key].as_f64();
        assert!(psnr("psnr_after") >= psnr("psnr_before"), "{level}");
        // Where the pictures took all the time, nothing was measured.
        assert!(psnr("psnr_before").is_some() || level["steps"] == 0, "{level}");
    }
}

#[test]
fn seconds_end_a_fit_with_what_there_is() {
    let folder = folder();
    let here = folder.path();
    let output = long_fit(here).args(["--fit-seconds", "0.5"]).output().expect("starts");
    assert_cut_short(here, &report(&output));
}

#[test]
fn seconds_after_the_pictures_are_for_steps() {
    let folder = folder();
    let here = folder.path();
    // Small pictures take no time.
    let cameras = std::fs::read(fixture("trained/lego64/transforms_test.json")).expect("cameras");
    let mut cameras: Value = serde_json::from_slice(&cameras).expect("JSON");
    (cameras["w"], cameras["h"]) = (24.into(), 24.into());
    std::fs::write(here.join("small.json"), cameras.to_string()).expect("writable");
    let mut command = long_fit(here);
    command.args(["--fit-cameras", "small.json", "--fit-seconds", "30"]);
    let report = report(&command.output().expect("starts"));
    assert_cut_short(here, &report);
    for level in report["fitted"]["levels"].as_array().expect("levels") {
        assert!(level["steps"].as_u64() > Some(0), "{level}");
    }
}

#[test]
fn a_level_without_time_takes_no_step_and_is_named() {
    let folder = folder();
    let output = long_fit(folder.path()).args(["--fit-seconds", "1e-6"]).output().expect("starts");
    let report = report(&output);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    for level in report["fitted"]["levels"].as_array().expect("levels") {
        let idle = format!("level {} took no step before the fit ended", level["level"]);
        assert!(level["steps"] == 0 && message.contains(&idle), "{level}: {message}");
    }
}

#[test]
fn levels_are_not_judged_by_what_they_were_fitted_to() {
    let folder = folder();
    let cameras = fixture("trained/lego64/transforms_test.json").display().to_string();
    let mut command = long_fit(folder.path());
    command.args(["--fit-cameras", &cameras, "--cameras", &cameras, "--size", "40x40"]);
    let output = command.output().expect("starts");
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(message.contains("is among --fit-cameras"), "{message}");
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
}

#[test]
fn given_cameras_are_fitted_to() {
    let folder = folder();
    let here = folder.path();
    let cameras = fixture("trained/lego64/transforms_test.json").display().to_string();
    let mut command = long_fit(here);
    command.args(["--fit-cameras", &cameras, "--fit-seconds", "2"]);
    let report = report(&command.output().expect("starts"));
    assert!(report["options"]["fit_cameras"]["count"].as_u64() >= Some(1), "{report}");
    assert_cut_short(here, &report);
}

#[test]
fn photographs_are_fitted_to_and_one_in_eight_judges() {
    let folder = folder();
    let here = folder.path();
    let scene = fixture("trained/lego64/fine_last.tar").display().to_string();
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"));
        command.current_dir(here).args(arguments).output().expect("starts")
    };
    let cameras = std::fs::read(fixture("trained/lego64/transforms_test.json")).expect("cameras");
    let cameras: Value = serde_json::from_slice(&cameras).expect("JSON");
    let frames = cameras["frames"].as_array().expect("frames").len();
    assert!(frames >= 8, "one is held out");
    std::fs::write(here.join("cameras.json"), cameras.to_string()).expect("writable");
    let march = ["--stepsize", "0.5", "--cameras", "cameras.json", "--size", "160x160"];
    let mut render = vec!["render", &scene, "-o", "photographs"];
    render.extend(march);
    let output = run(&render);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // Pictures of `render` tell their scale; photographs have the frame's name alone.
    for entry in std::fs::read_dir(here.join("photographs")).expect("a folder") {
        let path = entry.expect("a picture").path();
        let name = path.display().to_string().replace(".s1.png", ".png");
        std::fs::rename(&path, name).expect("renamed");
    }
    let mut bake = vec!["bake", &scene, "-o", "fit.mipvog", "--filter", "fit"];
    bake.extend(["--photographs", "photographs", "--fit-steps", "30", "--format", "json"]);
    bake.extend(march);
    let report = report(&run(&bake));
    assert_eq!(
        report["quality"]["errors"][0]["frames"].as_u64(),
        Some(frames as u64 / 8),
        "{report}"
    );
    assert!(report["options"]["photographs"]["sha256"].is_string(), "{report}");
    for level in report["fitted"]["levels"].as_array().expect("levels").iter().take(3) {
        let psnr = |key: &str| level[key].as_f64().expect("a number");
        assert!(psnr("psnr_after") > psnr("psnr_before"), "{level}");
    }
    std::fs::remove_file(here.join("fit.mipvog")).expect("a container");
    std::fs::remove_dir_all(here.join("photographs")).expect("a folder");
    let output = run(&bake);
    assert_eq!(output.status.code(), Some(5), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(!here.join("fit.mipvog").exists());
}

#[cfg(unix)]
mod signals {
    use std::io::Read;
    use std::process::Stdio;

    use super::*;

    /// Starts a long fit, sends a signal once its steps run, and waits.
    fn signalled(here: &Path, signal: &str) -> Output {
        let mut command = long_fit(here);
        command.args(["--progress", "always"]).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("starts");
        let mut stderr = child.stderr.take().expect("a pipe");
        let (mut seen, mut buffer) = (Vec::new(), [0; 256]);
        while !String::from_utf8_lossy(&seen).contains("fit") {
            let count = stderr.read(&mut buffer).expect("readable");
            assert!(count > 0, "it ended: {}", String::from_utf8_lossy(&seen));
            seen.extend_from_slice(&buffer[..count]);
        }
        // Bars go on being drawn. They have no use, but the pipe must not fill up.
        let rest = std::thread::spawn(move || std::io::copy(&mut stderr, &mut std::io::sink()));
        common::send(signal, child.id());
        let output = child.wait_with_output().expect("ends");
        rest.join().expect("no panic").expect("readable");
        output
    }

    #[test]
    fn an_interrupt_ends_a_fit_with_what_there_is() {
        let folder = folder();
        let output = signalled(folder.path(), "-INT");
        assert_cut_short(folder.path(), &report(&output));
    }

    #[test]
    fn a_termination_leaves_nothing_behind() {
        let folder = folder();
        let output = signalled(folder.path(), "-TERM");
        assert_eq!(output.status.code(), Some(143));
        assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
    }
}
