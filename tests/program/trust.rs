//! No verb loses an input, blames a healthy file, or hides the reason of its exit code.

use crate::common;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use crate::common::{assert_schema, fixture, folder, program};
use serde_json::{Value, json};

fn run(folder: &Path, arguments: &[&str]) -> Output {
    program().current_dir(folder).args(arguments).output().expect("starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs the program, which must end with this code and say each of these things on stderr.
fn says(folder: &Path, arguments: &[&str], code: i32, parts: &[&str]) {
    let output = run(folder, arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
    for part in parts {
        assert!(message.contains(part), "{arguments:?}: no {part:?} in {message}");
    }
}

fn done(folder: &Path, arguments: &[&str]) -> Output {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    output
}

/// A folder with a trained scene, its container, unpacked file and assets.
fn scene() -> tempfile::TempDir {
    let folder = folder();
    let here = folder.path();
    std::fs::copy(fixture("trained/tiny/fine_last.tar"), here.join("fine_last.tar")).expect("copy");
    let bake = ["bake", "fine_last.tar", "--stepsize", "0.5", "-o", "a.mipvog", "--gltf", "a.glb"];
    done(here, &bake);
    done(here, &["unpack", "a.mipvog", "-o", "a.safetensors"]);
    done(here, &["detach", "a.glb", "-o", "mesh.glb"]);
    folder
}

#[test]
fn no_output_replaces_an_input_under_any_name() {
    let folder = scene();
    let here = folder.path();
    let inputs = ["fine_last.tar", "a.mipvog", "a.safetensors", "a.glb", "mesh.glb"];
    let before = inputs.map(|name| std::fs::read(here.join(name)).expect("a file"));
    for name in inputs {
        #[cfg(unix)]
        std::os::unix::fs::symlink(name, here.join(format!("soft-{name}"))).expect("linked");
        std::fs::hard_link(here.join(name), here.join(format!("hard-{name}"))).expect("linked");
    }
    for force in [None, Some("--force")] {
        let refused = |arguments: &[&str]| {
            let arguments: Vec<&str> = arguments.iter().copied().chain(force).collect();
            says(here, &arguments, 7, &["is also an input", "another name"]);
        };
        let soft = cfg!(unix).then_some("soft-");
        for prefix in ["", "./", "hard-", "../HERE/"].into_iter().chain(soft) {
            let own = here.file_name().expect("a name").to_string_lossy();
            let prefix = prefix.replace("HERE", &own);
            let output = |name: &str| format!("{prefix}{name}");
            refused(&["bake", "a.mipvog", "-o", &output("a.mipvog")]);
            refused(&["transcode", "a.mipvog", "-o", &output("a.mipvog"), "--bits", "6"]);
            refused(&["attach", "mesh.glb", "a.mipvog", "-o", &output("mesh.glb")]);
            refused(&["detach", "a.glb", "-o", &output("a.glb")]);
        }
        refused(&["bake", "fine_last.tar", "-o", "b.mipvog", "--gltf", "a.glb", "--mlp", "a.glb"]);
        refused(&["bake", "fine_last.tar", "-o", "b.mipvog", "--depfile", "fine_last.tar"]);
    }
    // A name of another kind is refused before.
    says(here, &["bake", "fine_last.tar", "-o", "fine_last.tar", "--force"], 2, &[".tar"]);
    let same = ["bake", "fine_last.tar", "-o", "b.mipvog", "--depfile", "./b.mipvog"];
    says(here, &same, 2, &["two outputs"]);
    for (name, before) in inputs.iter().zip(before) {
        assert_eq!(std::fs::read(here.join(name)).expect("kept"), before, "{name}");
    }
}

#[test]
fn healthy_files_of_another_kind_are_not_called_damaged() {
    let folder = scene();
    let here = folder.path();
    std::fs::write(here.join("notes.txt"), "just some text").expect("written");
    // Their signatures have much in common with a container's.
    std::fs::write(here.join("p.png"), b"\x89PNG\r\n\x1a\n and more").expect("written");
    std::fs::write(here.join("p.h5"), b"\x89HDF\r\n\x1a\n and more").expect("written");
    let findings = run(here, &["validate", "p.png"]);
    assert!(text(&findings.stdout).contains("found a PNG picture"), "{}", text(&findings.stdout));
    for (arguments, parts) in [
        (&["view", "fine_last.tar"][..], &["trained scene", "mipvog-bake bake fine_last.tar"][..]),
        (&["view", "a.safetensors"], &["a .safetensors file", "bake"]),
        (&["unpack", "fine_last.tar", "-o", "x.safetensors"], &["zip", "bake it first"]),
        (&["attach", "mesh.glb", "fine_last.tar", "-o", "x.glb"], &["zip", "bake it first"]),
        (&["attach", "a.mipvog", "a.mipvog", "-o", "x.glb"], &["a .mipvog container"]),
        (&["bake", "notes.txt", "-o", "x.mipvog"], &["a text file"]),
        (&["unpack", "notes.txt", "-o", "x.safetensors"], &["a text file"]),
        (&["unpack", "p.png", "-o", "x.safetensors"], &["a PNG picture"]),
        (&["render", "p.h5", "-o", "x.png"], &["an HDF5 file"]),
        (&["view", "p.png"], &["a PNG picture"]),
        (&["inspect", "p.png"], &["a PNG picture"]),
    ] {
        let output = run(here, arguments);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{arguments:?}: {message}");
        for part in parts {
            assert!(message.contains(part), "{arguments:?}: no {part:?} in {message}");
        }
        assert!(!message.contains("damaged"), "{arguments:?}: {message}");
    }
}

#[test]
fn a_choice_of_a_field_needs_an_asset() {
    let folder = scene();
    let here = folder.path();
    let lines: [&[&str]; 7] = [
        &["bake", "fine_last.tar", "-o", "x.mipvog"],
        &["bake", "a.mipvog", "-o", "x.mipvog"],
        &["transcode", "a.mipvog", "-o", "x.mipvog"],
        &["unpack", "a.safetensors", "-o", "x.npz"],
        &["render", "a.mipvog", "-o", "x.png", "--size", "8"],
        &["probe", "a.mipvog", "--rays", "rays.npz", "-o", "x.safetensors"],
        &["compare", "fine_last.tar", "a.mipvog", "--turntable", "1", "--size", "8"],
    ];
    for line in lines {
        let chosen: Vec<&str> = line.iter().copied().chain(["--field", "0"]).collect();
        says(here, &chosen, 2, &["--field 0", "glTF asset"]);
    }
    let missing = ["bake", "nothing", "-o", "x.mipvog", "--field", "0"];
    says(here, &missing, 5, &["nothing"]);
    done(here, &["unpack", "a.glb", "-o", "x.npz", "--field", "0"]);
    let measured = ["compare", "a.glb", "a.mipvog", "--turntable", "1", "--size", "8"];
    done(here, &[&measured[..], &["--scales", "1", "--field", "0"]].concat());
}

#[test]
fn an_existing_output_has_its_own_exit_code() {
    let folder = scene();
    let here = folder.path();
    let exists = &["exists already", "--force"][..];
    says(here, &["bake", "fine_last.tar", "-o", "a.mipvog"], 7, exists);
    says(here, &["unpack", "a.mipvog", "-o", "a.safetensors"], 7, exists);
    says(here, &["detach", "a.glb", "-o", "mesh.glb"], 7, exists);
    // Damaged inputs and missing ones keep theirs.
    says(here, &["bake", "gone.tar", "-o", "x.mipvog"], 5, &["gone.tar", "check the path"]);
}

#[test]
fn folders_are_made_and_stay_only_with_an_output() {
    let folder = scene();
    let here = folder.path();
    done(here, &["unpack", "a.mipvog", "-o", "new/deep/b.safetensors"]);
    assert!(here.join("new/deep/b.safetensors").is_file());
    says(here, &["bake", "a.glb", "-o", "other/deep/x.mipvog", "--bits", "3"], 2, &[]);
    says(here, &["bake", "gone.tar", "-o", "other/deep/x.mipvog"], 5, &[]);
    assert!(!here.join("other").exists());
}

#[test]
fn the_name_of_an_unpacked_file_says_its_kind() {
    let folder = scene();
    let here = folder.path();
    for name in ["slices", "x.bin", "x.mipvog"] {
        says(here, &["unpack", "a.mipvog", "-o", name], 2, &[name, ".safetensors", "slash"]);
        assert!(!here.join(name).exists());
    }
}

#[test]
fn unpacked_archives_hold_what_unpacked_tensors_do() {
    let folder = scene();
    let here = folder.path();
    done(here, &["unpack", "a.mipvog", "-o", "a.npz"]);
    let python = "
import numpy as np, json, struct
archive = np.load('a.npz')
data = open('a.safetensors', 'rb').read()
count = struct.unpack('<Q', data[:8])[0]
header = json.loads(data[8:8 + count])
texts = header.pop('__metadata__')
types = {'F32': '<f4', 'F64': '<f8', 'U8': '|u1'}
names = set(header) | {'__metadata__.' + name for name in texts}
assert names == set(archive.files), names ^ set(archive.files)
for name, entry in header.items():
    start, end = entry['data_offsets']
    want = np.frombuffer(data[8 + count + start:8 + count + end], types[entry['dtype']])
    found = archive[name]
    assert list(found.shape) == entry['shape'] and found.dtype == want.dtype, name
    assert np.array_equal(found.ravel(), want), name
for name, text in texts.items():
    assert str(archive['__metadata__.' + name]) == text, name
";
    if let Some(mut numpy) = common::others::python() {
        let output = numpy.current_dir(here).args(["-c", python]).output().expect("starts");
        assert!(output.status.success(), "{}", text(&output.stderr));
    }
    // Either bakes to the same atlases.
    done(here, &["bake", "a.npz", "-o", "n.mipvog"]);
    done(here, &["validate", "n.mipvog", "a.npz"]);
    let chunks = |name: &str| {
        let report = done(here, &["inspect", name, "--format", "json"]);
        let report: Value = serde_json::from_slice(&report.stdout).expect("JSON");
        (report["levels"].clone(), report["metadata"].clone())
    };
    assert_eq!(chunks("n.mipvog"), chunks("a.mipvog"));
}

#[test]
fn standard_streams_are_files_too() {
    let folder = scene();
    let here = folder.path();
    let pipe = |arguments: &[&str], input: &str| -> Output {
        let input = std::fs::File::open(here.join(input)).expect("a file");
        // A pipe, which cannot be read by position.
        let mut feeder = Command::new("cat");
        let mut feeder = feeder.stdin(input).stdout(Stdio::piped()).spawn().expect("cat");
        let mut program = program();
        program.current_dir(here).args(arguments).stdin(feeder.stdout.take().expect("a pipe"));
        let output = program.output().expect("starts");
        feeder.wait().expect("ends");
        output
    };
    let baked = pipe(&["bake", "-", "--stepsize", "0.5", "-o", "-"], "fine_last.tar");
    assert!(baked.status.success(), "{}", text(&baked.stderr));
    std::fs::write(here.join("piped.mipvog"), &baked.stdout).expect("written");
    // The coarse checkpoint is looked for beside the input: neither has one here.
    assert_eq!(baked.stdout, std::fs::read(here.join("a.mipvog")).expect("a file"));
    // The report moves to stderr.
    assert!(text(&baked.stderr).contains("smaller than the input"), "{}", text(&baked.stderr));
    let unpacked = pipe(&["unpack", "-", "-o", "-", "-q"], "a.mipvog");
    assert_eq!(unpacked.stdout, std::fs::read(here.join("a.safetensors")).expect("a file"));
    let inspected = pipe(&["inspect", "-"], "a.mipvog");
    assert!(text(&inspected.stdout).starts_with("-: container"), "{}", text(&inspected.stdout));
    let validated = pipe(&["validate", "-"], "a.mipvog");
    assert_eq!(validated.status.code(), Some(0));
    // A reader that has read enough is no error.
    let closed = "\"$0\" unpack a.mipvog -o - | head -c 10 > /dev/null; test ${PIPESTATUS[0]} = 0";
    let mut shell = Command::new("bash");
    shell.current_dir(here).args(["-c", closed, env!("CARGO_BIN_EXE_mipvog-bake")]);
    assert!(shell.status().expect("bash").success());
    for arguments in [
        &["bake", "fine_last.tar", "-o", "x.mipvog", "--depfile", "-"][..],
        &["attach", "mesh.glb", "a.mipvog", "-o", "-"],
        &["detach", "a.glb", "-o", "-"],
        &["render", "a.mipvog", "-o", "-", "--turntable", "1"],
        &["compare", "a.mipvog", "a.mipvog", "-o", "-", "--turntable", "1"],
        &["sweep", "fine_last.tar", "-o", "-", "--turntable", "1"],
    ] {
        says(here, arguments, 2, &["-"]);
    }
    assert!(!here.join("-").exists());
}

#[test]
fn quiet_keeps_the_reason_of_a_failure() {
    let folder = scene();
    let here = folder.path();
    let gate = [
        "bake",
        "fine_last.tar",
        "-o",
        "g.mipvog",
        "--stepsize",
        "0.5",
        "--bits",
        "4",
        "--turntable",
        "1",
        "--size",
        "16x16",
        "--require-psnr",
        "90",
        "-q",
    ];
    let output = run(here, &gate);
    assert_eq!(output.status.code(), Some(1));
    assert!(output.stdout.is_empty(), "{}", text(&output.stdout));
    let message = text(&output.stderr);
    assert!(message.contains("g.mipvog: not written:"), "{message}");
    assert!(message.contains("90 dB required"), "{message}");
    let bytes = std::fs::read(here.join("a.mipvog")).expect("a file");
    std::fs::write(here.join("cut.mipvog"), &bytes[..bytes.len() - 9]).expect("written");
    says(here, &["validate", "cut.mipvog", "-q"], 1, &["cut.mipvog: not valid", "error"]);
}

#[test]
fn colors_follow_the_environment() {
    let colored = |arguments: &[&str], variables: &[(&str, &str)]| {
        let output = program()
            .args(arguments)
            .env_remove("NO_COLOR")
            .env_remove("CLICOLOR_FORCE")
            .envs(variables.iter().copied())
            .output()
            .expect("starts");
        text(&output.stderr).contains('\u{1b}')
    };
    let missing = ["inspect", "missing.mipvog"];
    assert!(!colored(&missing, &[]));
    assert!(colored(&missing, &[("CLICOLOR_FORCE", "1")]));
    assert!(!colored(&missing, &[("CLICOLOR_FORCE", "1"), ("NO_COLOR", "1")]));
    assert!(colored(&[&missing[..], &["--color", "always"]].concat(), &[("NO_COLOR", "1")]));
    assert!(!colored(&[&missing[..], &["--color=never"]].concat(), &[("CLICOLOR_FORCE", "1")]));
    // Errors of parsing follow the same rules.
    assert!(colored(&["inspekt", "--color=always"], &[]));
    assert!(!colored(&["inspekt"], &[("CLICOLOR_FORCE", "1"), ("NO_COLOR", "1")]));
}

#[test]
fn several_files_share_a_report_and_an_exit_code() {
    let folder = scene();
    let here = folder.path();
    let bytes = std::fs::read(here.join("a.mipvog")).expect("a file");
    std::fs::write(here.join("cut.mipvog"), &bytes[..bytes.len() - 9]).expect("written");
    for verb in ["validate", "inspect"] {
        let files = ["a.mipvog", "a.glb", "gone.mipvog", "fine_last.tar"];
        let output = run(here, &[&[verb], &files[..], &["--format", "json"]].concat());
        assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
        let report: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        assert_schema(verb, &report);
        let listed = report["files"].as_array().expect("a list");
        assert_eq!(listed.len(), files.len());
        for (report, name) in listed.iter().zip(files) {
            assert_eq!(report["file"], name);
            assert_eq!(report.get("error").is_some(), name == "gone.mipvog", "{report}");
        }
        assert_eq!(report["failed"], 1);
        assert!(text(&output.stderr).contains("1 of 4 files"), "{}", text(&output.stderr));
    }
    done(here, &["validate", "a.mipvog", "a.glb", "mesh.glb"]);
    says(here, &["check", "a.mipvog", "cut.mipvog"], 1, &["1 of 2 files", "cut.mipvog"]);
    let sarif = run(here, &["validate", "a.mipvog", "cut.mipvog", "--format", "sarif"]);
    let log: Value = serde_json::from_slice(&sarif.stdout).expect("JSON");
    assert_eq!(log["runs"].as_array().map(Vec::len), Some(1));
    assert_eq!(log["runs"][0]["artifacts"].as_array().map(Vec::len), Some(2));
}

#[test]
fn verbs_have_the_names_that_people_try() {
    let folder = scene();
    let here = folder.path();
    done(here, &["info", "a.mipvog"]);
    done(here, &["check", "a.mipvog"]);
    done(here, &["version"]);
    says(here, &["diff", "a.mipvog"], 2, &["<FIELD>"]);
    let completions = text(&done(here, &["completions", "bash"]).stdout);
    for value in ["rate-tent", "gauss5", "f16", "mipmap", "faithful", "sarif"] {
        assert!(completions.contains(value), "{value} is not completed");
    }
    let manual = text(&done(here, &["man"]).stdout);
    assert!(manual.contains("Print the manual page"));
    let help = text(&done(here, &["--help"]).stdout);
    let general = help.find("General:").expect("a group");
    for option in ["--threads", "--quiet", "--color", "--progress", "--limit", "--verbose"] {
        assert!(help.find(&format!("{option} ")).or(help.find(option)) > Some(general), "{option}");
    }
}

#[test]
fn settings_come_from_the_nearest_place() {
    let folder = scene();
    let here = folder.path();
    let march = |arguments: &[&str]| {
        let output = [&["bake", "fine_last.tar", "-o", "s.mipvog", "--force"], arguments].concat();
        done(here, &output);
        let report = done(here, &["inspect", "s.mipvog", "--format", "json"]);
        let report: Value = serde_json::from_slice(&report.stdout).expect("JSON");
        let march = &report["metadata"]["march"];
        json!([march["stepsize"], march["near"], march["far"]])
    };
    assert_eq!(march(&[]), json!([0.5, 0.0, null]));
    // Flags, not the library's options.
    for verb in [&["inspect", "fine_last.tar"][..], &["bake", "fine_last.tar", "-o", "w.mipvog"]] {
        let said = run(here, verb);
        let said = text(&said.stdout) + &text(&said.stderr);
        assert!(said.contains("; --stepsize sets the trained one"), "{said}");
    }
    std::fs::write(here.join("scene.json"), r#"{"stepsize": 0.25, "near": 1, "far": 5}"#)
        .expect("written");
    assert_eq!(march(&[]), json!([0.25, 1.0, 5.0]));
    assert_eq!(march(&["--near", "2"]), json!([0.25, 2.0, 5.0]));
    let near_beyond = ["bake", "fine_last.tar", "-o", "t.mipvog", "--near", "9"];
    let places = ["near 9 (command line)", "far 5 (scene.json)"];
    says(here, &near_beyond, 2, &places);
    std::fs::write(here.join("scene.toml"), "far = 7\n").expect("written");
    assert_eq!(march(&[]), json!([0.5, 0.0, 7.0]));
    std::fs::write(here.join("scene.toml"), "far = 'seven'\n").expect("written");
    says(here, &["bake", "fine_last.tar", "-o", "t.mipvog"], 3, &["scene.toml", "far", "number"]);
    // A container states its own.
    let inspected = text(&done(here, &["inspect", "s.mipvog"]).stdout);
    assert!(inspected.contains("step length 0.5 voxels") && inspected.contains("far 7"));
    assert!(inspected.contains("made by mipvog-bake"), "{inspected}");
}
