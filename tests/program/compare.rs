//! `compare`: what it measures, and what it warns about.

use std::path::Path;
use std::process::Output;

use serde_json::Value;

use crate::common::{assert_schema, fixture, folder, program};

fn run(here: &Path, arguments: &[&str]) -> Output {
    let view = ["--turntable", "2", "--size", "40", "--scales", "1,2,4"];
    let mut command = program();
    command.current_dir(here).arg("compare").args(arguments).args(view);
    command.output().expect("starts")
}

fn report(here: &Path, arguments: &[&str]) -> (Value, String) {
    let output = run(here, &[arguments, &["--format", "json"]].concat());
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments:?}: {message}");
    let report = serde_json::from_slice(&output.stdout).expect("a report");
    assert_schema("compare", &report);
    (report, message)
}

fn psnrs(report: &Value) -> Vec<f64> {
    let scales = report["scales"].as_array().expect("scales");
    scales.iter().map(|scale| scale["psnr"].as_f64().expect("a number")).collect()
}

#[test]
fn the_difference_of_a_file_from_itself_is_none_at_every_scale() {
    let folder = folder();
    let here = folder.path();
    let file = fixture("baked/tiny.rate.mipvog").display().to_string();
    let other = fixture("baked/tiny.12bit.mipvog").display().to_string();
    let (aliased, _) = report(here, &[&file, &file]);
    assert_eq!(aliased["measures"], "against_full_size");
    assert_eq!(psnrs(&aliased)[0], 200.0);
    assert!(psnrs(&aliased)[1] < 60.0, "{aliased}");
    for more in [&[][..], &["--supersample", "2"]] {
        let same = [&[&file[..], &file, "--difference"], more].concat();
        let (same, _) = report(here, &same);
        assert_eq!(same["measures"], "difference");
        assert_eq!(psnrs(&same), [200.0; 3]);
    }
    let maps = ["-o", "maps/of/heat"];
    let (differ, _) = report(here, &[&[&file[..], &other, "--difference"], &maps[..]].concat());
    assert!(psnrs(&differ).iter().all(|psnr| (20.0..150.0).contains(psnr)), "{differ}");
    assert_eq!(std::fs::read_dir(here.join("maps/of/heat")).expect("maps").count(), 6);
    // The text says so too.
    let text =
        |arguments: &[&str]| String::from_utf8_lossy(&run(here, arguments).stdout).into_owned();
    assert!(text(&[&file, &other]).contains("averaged down, so they include aliasing"));
    let difference = text(&[&file, &other, "--difference"]);
    assert!(difference.contains("rendered at the size of each scale"), "{difference}");
    // Pictures cannot be rendered at another scale.
    std::fs::create_dir(here.join("pictures")).expect("writable");
    let refused = run(here, &["pictures", &file, "--difference"]);
    assert_eq!(refused.status.code(), Some(2));
}

#[test]
fn settings_that_contradict_the_container_are_warned_about() {
    let folder = folder();
    let here = folder.path();
    let scene = fixture("trained/tiny/fine_last.tar").display().to_string();
    let bake = ["bake", &scene, "-o", "a.mipvog", "--stepsize", "0.5", "--near", "0.25"];
    assert!(program().current_dir(here).args(bake).output().expect("starts").status.success());
    let compare = |more: &[&str]| {
        let (_, message) = report(here, &[&[&scene[..], "a.mipvog"], more].concat());
        message
    };
    let agrees = compare(&["--stepsize", "0.5", "--near", "0.25"]);
    assert!(!agrees.contains("was baked with"), "{agrees}");
    let step = compare(&["--stepsize", "0.25", "--near", "0.25"]);
    assert!(step.contains("a.mipvog was baked with --stepsize 0.5"), "{step}");
    assert!(step.contains("the reference has 0.25: pass --stepsize 0.5"), "{step}");
    let left_out = compare(&["--stepsize", "0.5"]);
    assert!(left_out.contains("a.mipvog was baked with --near 0.25"), "{left_out}");
    let more = ["--stepsize", "0.5", "--near", "0.25"];
    for (option, value) in [("--far", "9"), ("--background", "0.5"), ("--color-threshold", "0.01")]
    {
        let warned = compare(&[&more[..], &[option, value]].concat());
        assert!(warned.contains(&format!("was baked with {option} ")), "{warned}");
        assert_eq!(warned.matches("was baked with").count(), 1, "{warned}");
    }
}

#[test]
fn a_page_shows_the_pictures_side_by_side() {
    let folder = folder();
    let here = folder.path();
    let file = fixture("baked/tiny.rate.mipvog").display().to_string();
    let other = fixture("baked/tiny.12bit.mipvog").display().to_string();
    let (found, _) = report(here, &[&file, &other, "-o", "pages/report.html"]);
    let page = std::fs::read_to_string(here.join("pages/report.html")).expect("a page");
    for outside in ["http", "<script", "<link", "@import", "url(", "src=\"/"] {
        assert!(!page.contains(outside), "{outside}");
    }
    // Two frames at three scales: reference, field and error.
    assert_eq!(page.matches("<figure>").count(), 18);
    assert_eq!(page.matches("data:image/png;base64,").count(), 18);
    assert!(page.contains("All frames are shown"));
    for scale in found["scales"].as_array().expect("scales") {
        let psnr = scale["psnr"].as_f64().expect("a number");
        assert!(page.contains(&format!("<td>{psnr:.2}</td>")), "{psnr}");
    }
    // The command that made it can be run again.
    assert!(page.contains(" compare ") && page.contains("-o pages/report.html"), "no command");
    // A page that is there stays, and nothing is left of one that cannot be made.
    let taken = run(here, &[&file, &other, "-o", "pages/report.html"]);
    assert_eq!(taken.status.code(), Some(7));
    let forced = run(here, &[&file, &other, "-o", "pages/report.html", "--force"]);
    assert!(forced.status.success());
    let missing = run(here, &["missing.mipvog", &other, "-o", "more/report.html"]);
    assert!(!missing.status.success() && !here.join("more").exists());
    // Names are text, not markup.
    std::fs::copy(&other, here.join("a<b>&.mipvog")).expect("copied");
    let named = run(here, &[&file, "a<b>&.mipvog", "-o", "named.html"]);
    assert!(named.status.success());
    let page = std::fs::read_to_string(here.join("named.html")).expect("a page");
    assert!(page.contains("a&lt;b&gt;&amp;.mipvog") && !page.contains("a<b>"));
}
