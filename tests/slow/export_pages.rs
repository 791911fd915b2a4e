//! `export --to snerg` and `--to html`: folders and pages of a web server.

use std::path::Path;

use crate::common::{assert_schema, fixture, folder, program};
use mipvog::Container;
use mipvog::base::limits::Limits;
use mipvog::picture;
use serde_json::Value;

/// The code of a run of the program, its report, its errors.
fn run(here: &Path, arguments: &[&str]) -> (Option<i32>, Value, String) {
    let mut command = program();
    let output = command.current_dir(here).args(arguments).output().expect("starts");
    let report = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output.status.code(), report, String::from_utf8_lossy(&output.stderr).into_owned())
}

fn done(here: &Path, arguments: &[&str]) -> Value {
    let (code, report, errors) = run(here, &[arguments, &["--format", "json"]].concat());
    assert_eq!(code, Some(0), "{arguments:?}: {errors}");
    report
}

fn exported(here: &Path, arguments: &[&str]) -> Value {
    let report = done(here, &[&["export"], arguments].concat());
    assert_schema("export", &report);
    report
}

fn psnr(report: &Value) -> f64 {
    report["psnr"].as_f64().expect("a number")
}

fn baked(name: &str) -> String {
    fixture("baked").join(name).display().to_string()
}

fn lego(here: &Path) -> String {
    let path = here.join("lego64.mipvog").display().to_string();
    let input = fixture("trained/lego64/fine_last.tar").display().to_string();
    done(here, &["bake", &input, "--stepsize", "0.5", "-o", &path]);
    path
}

#[test]
fn a_folder_is_read_back_and_opens_as_any_other() {
    let folder = folder();
    let here = folder.path();
    let lego = lego(here);
    let snerg = |cells: &str, to: &str| {
        exported(here, &[&lego, "--to", "snerg", "-o", to, "--resolution", cells])
    };
    let (coarse, fine) = (snerg("64", "coarse"), snerg("160", "fine"));
    assert!(psnr(&fine) > psnr(&coarse) + 4.0 && psnr(&fine) > 27.0, "{fine}");
    // The report's figure is the distance that `compare` finds.
    let found = done(here, &["inspect", "fine/scene_params.json"]);
    assert_eq!(found["model"], "snerg");
    assert_eq!(fine["details"]["voxels"].as_array().expect("sizes").len(), 3);
    assert!(fine["details"]["url"].as_str().expect("an address").contains("dir=fine"));
    // The same bytes for any number of threads.
    let line = [&lego, "--to", "snerg", "-o", "coarse", "--resolution", "64", "--force"];
    let again = exported(here, &[&line[..], &["--threads", "1"]].concat());
    assert_eq!(coarse["files"], again["files"]);
}

#[test]
fn coarser_pictures_are_halves_and_names_are_those_of_mip_vog() {
    let folder = folder();
    let here = folder.path();
    let tiny = baked("tiny.rate.f16.mipvog");
    let line = [&tiny, "--to", "snerg", "-o", "mips", "--resolution", "40", "--mips"];
    let report = exported(here, &line);
    let atlas = report["details"]["atlas"].as_array().expect("sizes");
    let [width, height, depth] = [0, 1, 2].map(|axis| atlas[axis].as_u64().expect("a size"));
    assert_eq!(depth % 32, 0);
    for level in 0..4u64 {
        let slices = (depth / 4) >> level;
        for slice in 0..slices {
            let path = here.join("mips").join(format!("rgba_{level}{slice:02}.png"));
            let size = [width >> level, 4 * (height >> level)].map(|side| side as usize);
            assert_eq!(picture::size(&path).expect("a picture"), size, "{path:?}");
        }
        let next = here.join("mips").join(format!("rgba_{level}{slices:02}.png"));
        assert!(!next.exists(), "{next:?}");
    }
}

#[test]
fn colours_without_a_network_are_means_over_directions() {
    let folder = folder();
    let here = folder.path();
    let report = exported(here, &[&baked("harmonics.mipvog"), "--to", "snerg", "-o", "sh"]);
    let lost = report["lost"].to_string();
    assert!(lost.contains("view-dependent colour"), "{lost}");
    assert!(here.join("sh/rgba_000.png").exists() && !here.join("sh/feature_000.png").exists());
    // An export of an unbaked model takes its values where it has them.
    let model = fixture("grids/plenoxels_cubic.npz").display().to_string();
    let report = exported(here, &[&model, "--to", "snerg", "-o", "model", "--supersample", "3"]);
    assert!(psnr(&report) > 20.0, "{report}");
}

#[test]
fn a_page_holds_the_container_and_a_folder_lies_beside_it() {
    let folder = folder();
    let here = folder.path();
    let container = baked("tiny.rate.f16.mipvog");
    let bytes = std::fs::read(&container).expect("a fixture");
    let page = exported(here, &[&container, "--to", "html", "-o", "page.html"]);
    assert_eq!((psnr(&page), &page["lost"]), (200.0, &Value::Array(Vec::new())));
    let text = std::fs::read_to_string(here.join("page.html")).expect("a page");
    let outside = ["src=\"viewer.js\"", "href=\"style.css\""];
    assert!(outside.into_iter().all(|link| !text.contains(link)), "all is within");
    let site = exported(here, &[&container, "--to", "html", "-o", "site"]);
    assert_eq!(site["files"].as_array().expect("files").len(), 7);
    let beside = std::fs::read(here.join("site/tiny.rate.f16.mipvog")).expect("the container");
    assert!(beside == bytes, "the container as it is");
    assert_eq!(picture::size(&here.join("site/poster.png")).expect("a picture"), [600, 315]);
    let index = std::fs::read_to_string(here.join("site/index.html")).expect("a page");
    assert!(index.contains("data-file=\"tiny.rate.f16.mipvog\"") && index.contains("og:image"));
    // Of a trained input, the container is what a bake with default options makes.
    let model = fixture("grids/plenoxels_cubic.npz").display().to_string();
    exported(here, &[&model, "--to", "html", "-o", "model"]);
    let made = here.join("model/plenoxels_cubic.mipvog");
    let made = Container::open_path(&made, &Limits::default()).expect("a container");
    assert!(made.metadata().levels.len() > 1);
}

#[test]
fn what_cannot_be_is_refused_before_any_work() {
    let folder = folder();
    let here = folder.path();
    let tiny = baked("tiny.rate.f16.mipvog");
    for (arguments, code, says) in [
        (&["--to", "snerg", "-o", "a", "--resolution", "3571"][..], 2, "255 blocks"),
        (&["--to", "snerg", "-o", "a", "--resolution", "3000"], 2, "texels"),
        (&["--to", "snerg", "-o", "a", "--resolution", "900", "--mips"], 2, "slices"),
        (&["--to", "snerg", "-o", "a", "--supersample", "17"], 2, "1 to 16"),
        (&["--to", "snerg", "-o", "a", "--memory", "1kB"], 6, "bytes"),
        (&["--to", "html", "-o", "a.html", "--level", "1"], 2, "level"),
        (&["--to", "html", "-o", "a.html", "--mips"], 2, "snerg"),
        (&["--to", "html", "-o", "a.html", "--memory", "1kB"], 6, "bytes"),
    ] {
        let (found, _, errors) = run(here, &[&["export", &tiny], arguments].concat());
        assert_eq!(found, Some(code), "{arguments:?}: {errors}");
        assert!(errors.contains(says), "{arguments:?}: {errors}");
    }
    assert_eq!(std::fs::read_dir(here).expect("a folder").count(), 0);
}
