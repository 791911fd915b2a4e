//! `bake --if-changed` and `--depfile`.

use std::path::Path;
use std::process::{Command, Output};

use crate::common::{assert_schema, fixture, folder};
use serde_json::Value;

fn bake(here: &Path, more: &[&str]) -> Output {
    let scene = fixture("trained/tiny/fine_last.tar").display().to_string();
    let mut command = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"));
    command.current_dir(here).args(["bake", &scene, "--stepsize", "0.5", "-o", "tiny.mipvog"]);
    command.args(["--if-changed", "--format", "json", "--quiet"]).args(more);
    command.output().expect("starts")
}

/// True if the bake found nothing to do.
fn unchanged(output: &Output) -> bool {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).expect("a report");
    assert_schema("bake", &report);
    report["unchanged"].as_bool().expect("a claim")
}

#[test]
fn only_what_changed_is_baked() {
    let folder = folder();
    let here = folder.path();
    let container = here.join("tiny.mipvog");
    assert!(!unchanged(&bake(here, &[])));
    let first = std::fs::read(&container).expect("a container");
    assert!(unchanged(&bake(here, &[])));
    assert!(unchanged(&bake(here, &["--bits", "8"])), "8 bits are the default");
    for more in [
        &["--bits", "7"][..],
        &["--near", "0.25"],
        &["--background", "0"],
        &["--mlp", "none"],
        &["--filter", "code"],
        &["--max-error", "0.05"],
    ] {
        assert!(!unchanged(&bake(here, more)), "{more:?}");
        assert!(unchanged(&bake(here, more)), "{more:?}");
    }
    assert!(!unchanged(&bake(here, &[])));
    assert!(std::fs::read(&container).expect("a container") == first);
}

#[test]
fn damage_is_a_change() {
    let folder = folder();
    let here = folder.path();
    let container = here.join("tiny.mipvog");
    assert!(!unchanged(&bake(here, &[])));
    let whole = std::fs::read(&container).expect("a container");
    for at in (0..whole.len()).step_by(whole.len() / 40) {
        let mut damaged = whole.clone();
        damaged[at] ^= 1;
        // A file that no longer looks like a container belongs to another program, and stays.
        std::fs::write(&container, damaged).expect("writable");
        if at < 8 {
            assert_eq!(bake(here, &[]).status.code(), Some(7), "{at}");
            continue;
        }
        assert!(!unchanged(&bake(here, &[])), "{at}");
        assert!(std::fs::read(&container).expect("a container") == whole, "{at}");
    }
    std::fs::write(&container, &whole[..whole.len() / 2]).expect("writable");
    assert!(!unchanged(&bake(here, &[])));
}

#[test]
fn the_gate_and_the_asset_do_not_need_a_new_bake() {
    let folder = folder();
    let here = folder.path();
    assert!(!unchanged(&bake(here, &[])));
    let gate = ["--turntable", "2", "--size", "24x24", "--require-psnr"];
    assert!(unchanged(&bake(here, &[&gate[..], &["20"]].concat())));
    let missed = bake(here, &[&gate[..], &["190"]].concat());
    assert_eq!(missed.status.code(), Some(1));
    assert!(here.join("tiny.mipvog").is_file());
    assert!(unchanged(&bake(here, &["--gltf", "tiny.glb"])));
    assert!(here.join("tiny.glb").is_file());
    // The asset of a former run is replaced, another one is not.
    assert!(unchanged(&bake(here, &["--gltf", "tiny.glb"])));
    let house = br#"{"asset": {"version": "2.0"}}"#;
    std::fs::write(here.join("house.gltf"), house).expect("writable");
    assert_eq!(bake(here, &["--gltf", "house.gltf"]).status.code(), Some(7));
    assert_eq!(std::fs::read(here.join("house.gltf")).expect("there"), house);
}

#[test]
fn dependency_files_name_what_was_read() {
    let folder = folder();
    let here = folder.path();
    let cameras = fixture("trained/lego64/transforms_test.json").display().to_string();
    let gate = ["--cameras", &cameras, "--size", "16x16", "--frames", "0"];
    for _ in 0..2 {
        let output = bake(here, &[&gate[..], &["--depfile", "tiny.d"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let rule = std::fs::read_to_string(here.join("tiny.d")).expect("a rule");
        let (target, inputs) = rule.trim_end().split_once(": ").expect("a rule");
        assert_eq!(target, "tiny.mipvog");
        let inputs: Vec<&str> = inputs.split(' ').collect();
        assert!(inputs[0].ends_with("fine_last.tar") && inputs.contains(&&*cameras), "{rule}");
    }
}

#[test]
fn a_container_packed_again_with_the_same_bytes_is_no_change() {
    let folder = folder();
    let here = folder.path();
    let baked = fixture("baked/tiny.rate.mipvog").display().to_string();
    let pack = |bits: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"));
        command.current_dir(here).args(["bake", &baked, "--bits", bits, "-o", "again.mipvog"]);
        command.args(["--if-changed", "--format", "json", "--quiet"]);
        unchanged(&command.output().expect("starts"))
    };
    let bytes = || std::fs::read(here.join("again.mipvog")).expect("a container");
    assert!(!pack("7"));
    let first = bytes();
    assert!(pack("7"));
    assert!(!pack("6"));
    assert!(bytes() != first);
    assert!(!pack("7"));
    assert!(bytes() == first);
}
