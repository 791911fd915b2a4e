//! Mistakes on the command line, and what is told of them: the remedy is what to type.

use std::path::Path;
use std::process::Output;

use crate::common::{fixture, folder, program};

fn run(here: &Path, line: &[&str]) -> Output {
    program().current_dir(here).args(line).output().expect("starts")
}

fn words(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a line that must end with this code, and say each of these on standard error.
fn ends(here: &Path, line: &[&str], code: i32, says: &[&str]) -> Output {
    let output = run(here, line);
    let message = words(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{line:?}: {message}");
    for part in says {
        assert!(message.contains(part), "{line:?}: no {part:?} in {message}");
    }
    output
}

/// A container, `a.mipvog`, and its checkpoint, `in.tar`.
fn workplace() -> tempfile::TempDir {
    let folder = folder();
    let here = folder.path();
    std::fs::copy(fixture("baked/tiny.rate.mipvog"), here.join("a.mipvog")).expect("copied");
    std::fs::copy(fixture("trained/tiny/fine_last.tar"), here.join("in.tar")).expect("copied");
    folder
}

#[test]
fn values_out_of_range_name_their_range_and_nothing_else() {
    let folder = workplace();
    let here = folder.path();
    let bake = ["bake", "in.tar", "-o", "x.mipvog"];
    for (option, value, says) in [
        ("--stepsize", "-1", "--stepsize: found -1"),
        ("--far", "abc", "expected a number"),
        ("--levels", "-3", "expected a whole number"),
        ("--zstd-level", "x", "expected a whole number"),
    ] {
        let output = ends(here, &[&bake[..], &[option, value]].concat(), 2, &[says]);
        let message = words(&output.stderr);
        assert!(
            !message.contains("For more information") && !message.contains("-- -"),
            "{message}"
        );
    }
    let output = ends(here, &["bake", "in.tar", "-o", "x.mipvog", "--log"], 2, &["--log"]);
    assert!(!words(&output.stderr).contains("as a value"));
}

#[test]
fn the_remedy_of_a_path_in_the_wrong_place_can_be_typed() {
    let folder = workplace();
    let here = folder.path();
    std::fs::create_dir(here.join("empty")).expect("made");
    std::fs::write(here.join("scenes.jsonl"), "{\"input\": \"a\", \"output\": \"b\"}\n").expect("");
    std::fs::copy(here.join("in.tar"), here.join("two.tar")).expect("copied");
    std::fs::write(here.join("notes.txt"), "nothing to bake\n").expect("written");
    let cases: [(&[&str], i32, &[&str]); 13] = [
        (&["bake", "in.tar", "two.tar"], 2, &["several inputs go into a folder: -o baked/"]),
        (&["render", "a.mipvog", "b.mipvog", "-o", "p/"], 2, &["render takes one input"]),
        (&["compare", "in.tar", "a.mipvog", "b.mipvog"], 2, &["'b.mipvog' is a third path"]),
        (&["compare", "in.tar", "a.mipvog", "-o", "x.png"], 2, &["name a folder", "page.html"]),
        (&["export", "a.mipvog", "-o", "a.obj"], 2, &["write a mesh as .glb"]),
        (&["export", "a.mipvog", "--to", "obj", "-o", "a.obj"], 2, &["write a mesh as .glb"]),
        (&["report", "r.jsonl", "--to", "junit"], 2, &["--junit FILE.xml"]),
        (&["report", "r.jsonl", "-o", "out.xml"], 2, &["--junit FILE.xml"]),
        (&["report", "a.mipvog"], 3, &["found a .mipvog container", "lines of JSON"]),
        (&["bake", "scenes.jsonl", "-o", "x.mipvog"], 3, &["bake --manifest"]),
        (&["bake", "in.tar", "-o", "x.mipvog", "--cameras", "empty"], 5, &["transforms.json"]),
        (&["inspect", "notes.txt"], 3, &["expected a .mipvog container, a glTF asset with one, "]),
        (&["inspect", "a.mipvog", "--thumbnail", "t.jpg"], 2, &["a thumbnail is a PNG", "t.png"]),
    ];
    for (line, code, says) in cases {
        ends(here, line, code, says);
    }
    let left = std::fs::read_dir(here).expect("a folder").count();
    assert_eq!(left, 6, "nothing is written");
}

#[test]
fn a_forecast_needs_no_output() {
    let folder = workplace();
    let here = folder.path();
    let output = ends(here, &["bake", "in.tar", "--dry-run"], 0, &[]);
    assert!(words(&output.stdout).starts_with("in.mipvog: about "), "{}", words(&output.stdout));
    ends(here, &["bake", "in.tar"], 2, &["there is no output"]);
}

#[test]
fn the_options_of_a_preset_bake_the_same_when_they_are_typed() {
    let folder = workplace();
    let here = folder.path();
    for preset in ["faithful", "web", "archive"] {
        let bake = ["bake", "in.tar", "--force", "-o"];
        let output =
            ends(here, &[&bake[..], &["p.mipvog", "--preset", preset]].concat(), 0, &["preset "]);
        let message = words(&output.stderr).replace("\n   ", "");
        let start = format!("preset {preset}: ");
        let told = message.lines().find_map(|line| line.strip_prefix(&start));
        let options: Vec<&str> = told.expect("its options").split(' ').collect();
        ends(here, &[&bake[..], &["t.mipvog"], &options].concat(), 0, &[]);
        let [stands_for, typed] =
            ["p.mipvog", "t.mipvog"].map(|name| std::fs::read(here.join(name)).expect("baked"));
        assert!(stands_for == typed, "{preset}: {told:?}");
    }
}

#[test]
fn files_beside_a_checkpoint_count_for_inspect_and_validate() {
    let folder = workplace();
    let here = folder.path();
    let noted = ends(here, &["inspect", "in.tar"], 0, &[]);
    assert!(words(&noted.stdout).contains("step length"));
    assert!(words(&noted.stdout).contains("near and far are not stored"));
    ends(here, &["validate", "in.tar", "--deny-warnings"], 1, &["warning", "--deny-warnings"]);
    std::fs::write(here.join("scene.toml"), "stepsize = 0.25\n").expect("written");
    let noted = words(&ends(here, &["inspect", "in.tar"], 0, &[]).stdout);
    assert!(!noted.contains("step length") && noted.contains("scene.toml has stepsize"), "{noted}");
}

#[test]
fn hints_of_names_and_values_lead_on() {
    let folder = workplace();
    let here = folder.path();
    std::fs::create_dir_all(here.join("scenes/one")).expect("made");
    std::fs::copy(here.join("in.tar"), here.join("scenes/one/fine_last.tar")).expect("copied");
    std::fs::create_dir(here.join("photos")).expect("made");
    std::fs::write(here.join("photos/a.png"), "").expect("written");
    std::fs::create_dir(here.join("packed")).expect("made");
    std::fs::write(here.join("packed/fine_last.tar.zst"), "").expect("written");
    std::fs::write(here.join("packed/truth.npz"), "").expect("written");
    std::fs::write(here.join("page.html"), "<!doctype html><p>A page.").expect("written");
    std::fs::write(here.join("cameras.json"), "{\"frames\": []}").expect("written");
    std::fs::write(here.join("cut.npz"), b"PK\x03\x04cut short").expect("written");
    let sweep = ["sweep", "in.tar", "-o", "s"];
    let cases: [(&[&str], i32, &[&str]); 20] = [
        (&["compare", "in.tar", "a.mipvog", "--scale", "1,2"], 2, &["--scales may be meant"]),
        (&["transcode", "a.mipvog", "-o", "b.mipvog", "--stepsize", "1"], 2, &["option of bake"]),
        (
            &["transcode", "a.mipvog", "-o", "b.mipvog", "--near", "1"],
            2,
            &["bake takes containers too: ", "mipvog-bake bake a.mipvog -o b.mipvog --near 1"],
        ),
        (&[&sweep[..], &["--filter", "rate-tent", "code"]].concat(), 2, &["with commas"]),
        (&["sweep", "a.mipvog", "-o", "s"], 3, &["a baked field", "pass its checkpoint"]),
        (&["sweep", "in.tar", "-o", "s.csv"], 2, &["name a folder, such as -o sweep/"]),
        (&["compare", "in.tar", "a.mipvog", "-o", "e.csv"], 2, &["for heat maps, or a page.html"]),
        (
            &["probe", "a.mipvog", "--rays", "cameras.json", "-o", "v.safetensors"],
            3,
            &["origins and"],
        ),
        (&["view", "a.mipvog", "--host", "localhost"], 2, &["an IP address such as 127.0.0.1"]),
        (&["bake", "in.tar", "-o", "b.mipvog", "--thumbnail", "2000"], 2, &["expected 16 to 1024"]),
        (&["bake", "scenes", "-o", "b.mipvog"], 5, &["pass the scenes in it: scenes/*/fine_last"]),
        (&["bake", "packed", "-o", "b.mipvog"], 5, &["truth.npz; or unpack packed/fine_last.tar"]),
        (&["unpack", "packed", "-o", "b.npz"], 5, &["unpack the file in it"]),
        (&["compare", "a.mipvog", "photos"], 5, &["pictures are a reference, which comes before"]),
        (
            &["bake", "page.html", "-o", "b.mipvog"],
            4,
            &["found a web page", "open it in a browser"],
        ),
        (&["inspect", "cut.npz"], 3, &["without a directory at its end", "copy it again"]),
        (&["export", "a.mipvog", "--to", "html", "-o", "p.vdb"], 2, &["leave out --to"]),
        (&["render", "a.mipvog", "--frames", "0-3", "-o", "p/"], 2, &["several with commas"]),
        (&["render", "a.mipvog"], 2, &["mipvog-bake render a.mipvog -o pictures/"]),
        (&["unpack", "a.mipvog", "-o", "x.npz", "--slices", "png"], 2, &["needs a folder"]),
    ];
    for (line, code, says) in cases {
        ends(here, line, code, says);
    }
    let output = ends(here, &[], 2, &["Usage: mipvog-bake"]);
    assert!(!words(&output.stderr).contains("error:"));
    ends(
        here,
        &["transcode", "a.mipvog", "-o", "none.mipvog", "--drop-islands", "100000000"],
        0,
        &["nothing is left of the scene"],
    );
}

#[test]
fn reports_count_what_they_name() {
    let folder = workplace();
    let here = folder.path();
    let json = |line: &[&str]| -> serde_json::Value {
        let output = ends(here, &[line, &["--format", "json"]].concat(), 0, &[]);
        serde_json::from_slice(&output.stdout).expect("JSON")
    };
    // A thumbnail lies before the levels, and is part of what is read before them.
    let baked = json(&["bake", "in.tar", "-o", "t.mipvog", "--thumbnail", "256"]);
    let inspected = json(&["inspect", "t.mipvog"]);
    let prefixes = |report: &serde_json::Value| -> Vec<u64> {
        let levels = report["levels"].as_array().expect("levels");
        levels.iter().map(|level| level["prefix_bytes"].as_u64().expect("bytes")).collect()
    };
    assert_eq!(prefixes(&baked), prefixes(&inspected));
    assert_eq!(prefixes(&baked)[0], baked["output_bytes"].as_u64().expect("bytes"));
    // A folder's pictures are the scene.
    let model = fixture("worlds/merf_whole");
    let bytes: u64 = std::fs::read_dir(&model)
        .expect("a folder")
        .map(|entry| entry.expect("a file").metadata().expect("bytes").len())
        .sum();
    let model = model.to_string_lossy();
    let line = ["bake", &*model, "-o", "m.mipvog", "--drop-background"];
    assert_eq!(json(&line)["input_bytes"], bytes);
    assert_eq!(json(&["inspect", &*model])["file_bytes"], bytes);
    // Diffuse colour is told apart where a network adds to it, and nowhere else.
    let compare = |reference: &str, field: &str| {
        json(&["compare", reference, field, "--turntable", "2", "--size", "16x16"])["scales"][0]
            ["psnr_diffuse"]
            .clone()
    };
    assert!(compare("in.tar", "a.mipvog").is_number());
    let harmonics = fixture("baked/harmonics.mipvog");
    let harmonics = harmonics.to_string_lossy();
    assert!(compare(&harmonics, &harmonics).is_null());
    assert!(compare(&model, "m.mipvog").is_null());
    // Of a world, the voxels of the innermost box are counted.
    let world = fixture("worlds/dvgo_unbounded.tar");
    let world = world.to_string_lossy();
    let line = ["bake", &*world, "-o", "w.mipvog", "--resolution", "9", "--extent", "4"];
    let told = words(&ends(here, &line, 0, &[]).stdout);
    assert!(told.contains(" voxels of the innermost box kept"), "{told}");
}
