//! `bake --memory`: the bound holds, as the operating system counts; the bytes do not depend on it.

use std::path::Path;
use std::process::{Command, Output};

use crate::common::checkpoint::Checkpoint;
use crate::common::{Random, fixture, folder};
use serde_json::Value;

fn bake(input: &Path, output: &Path, options: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mipvog-bake"));
    command.arg("bake").arg(input).arg("-o").arg(output);
    command.args(["--stepsize", "0.5", "--format", "json"]).args(options);
    command.output().expect("starts")
}

/// The least bound that would do, as the error says that one byte is refused with.
fn least(input: &Path, output: &Path, options: &[&str]) -> u64 {
    let refused = bake(input, output, &[&["--memory", "1"], options].concat());
    assert_eq!(refused.status.code(), Some(6));
    assert!(!output.exists());
    let text = String::from_utf8(refused.stderr).expect("text");
    assert!(text.contains(" MB of memory, the bound is 0.0 MB"), "{text}");
    let (_, after) = text.split_once("pass --memory ").expect("a remedy");
    let digits: String = after.chars().take_while(char::is_ascii_digit).collect();
    digits.parse().expect("a number")
}

/// Bakes within the least bound, and within ones between it and the memory of an unbounded bake.
fn holds(input: &Path, options: &[&str]) {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let free = bake(input, &path("free.mipvog"), options);
    assert!(free.status.success(), "{}", String::from_utf8_lossy(&free.stderr));
    let expected = std::fs::read(path("free.mipvog")).expect("a container");
    for threads in ["1", "2", "5", "16"] {
        let options = [options, &["--threads", threads, "--force"]].concat();
        let least = least(input, &path("none.mipvog"), &options);
        // No forecast tells the size that a search ends with.
        if !options.contains(&"--max-bytes") {
            let dry_run = [&["--dry-run"], &options[..]].concat();
            let forecast = bake(input, &path("none.mipvog"), &dry_run);
            let forecast: Value = serde_json::from_slice(&forecast.stdout).expect("a report");
            assert_eq!(forecast["least_memory_bytes"], least, "a forecast says the same");
        }
        let below = (least - 1).to_string();
        let refused =
            bake(input, &path("none.mipvog"), &[&["--memory", &below], &options[..]].concat());
        assert_eq!(refused.status.code(), Some(6));
        // Room for no run at all, and for a few.
        for bound in [least, least + expected.len() as u64 / 3] {
            let text = bound.to_string();
            let output =
                bake(input, &path("bound.mipvog"), &[&["--memory", &text], &options[..]].concat());
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            let report: Value = serde_json::from_slice(&output.stdout).expect("a report");
            let peak = report["peak_memory_bytes"].as_u64().expect("a number");
            assert!(peak <= bound, "{options:?}: {peak} of {bound}");
            // What is refused would not be kept by far. Of more threads than there are cores, some
            // never get any work, and never touch their memory: how many depends on the system.
            // Codes within an error are counted as two bytes, as how many bits they need is not
            // known beforehand. Those of this preset and of an error of 0.01 need one, and a run of
            // blocks of 16 nodes is then made in a quarter of the lanes that were counted, times the
            // threads.
            let slack = match threads {
                "16" if options.contains(&"0.01") => 6.0,
                "5" if options.contains(&"0.01") => 3.0,
                "16" => 3.0,
                // A search tries float32 too, and ends with fewer bits.
                _ if options.contains(&"--max-bytes") => 4.0,
                _ if options.contains(&"web") || options.contains(&"0.01") => 2.0,
                "5" => 1.6,
                _ => 1.35,
            };
            let refused = least as f64 / peak as f64;
            assert!(refused < slack, "{options:?}: {least} asked for, {peak} taken");
            let bytes = std::fs::read(path("bound.mipvog")).expect("a container");
            assert!(bytes == expected, "{options:?}, {bound}");
        }
        let names = std::fs::read_dir(folder.path()).expect("a folder").count();
        assert_eq!(names, 2, "nothing is left of what waited");
    }
}

#[test]
fn a_trained_scene_bakes_within_its_bound() {
    let scene = fixture("trained/lego64/fine_last.tar");
    let options: [&[&str]; 8] = [
        &["--block-size", "64"],
        &["--max-bytes", "300KB", "--levels", "3"],
        &["--max-error", "1e-6"],
        &[],
        &["--preset", "web"],
        &["--bits", "f32"],
        &["--max-error", "0.01", "--block-size", "16"],
        &["--filter", "paper"],
    ];
    for options in options {
        holds(&scene, options);
    }
}

#[test]
fn a_scene_whose_planes_outweigh_the_program_bakes_within_its_bound() {
    let folder = folder();
    let path = folder.path().join("large.safetensors");
    let (nodes, channels) = ([16, 200, 300], 9);
    let mut random = Random::new(3);
    let count: usize = nodes.iter().product();
    let mut checkpoint = Checkpoint::sound();
    for (name, shape, values) in &mut checkpoint.arrays {
        let channels = match *name {
            "density.grid" => 1,
            "k0.grid" => channels,
            _ => continue,
        };
        *shape = [&[1, channels], &nodes[..]].concat();
        *values = (0..channels * count).map(|_| random.between(-9.0, 9.0)).collect();
    }
    checkpoint.arrays.retain(|(name, ..)| !name.starts_with("rgbnet"));
    std::fs::write(&path, checkpoint.to_bytes()).expect("writable");
    holds(&path, &["--mlp", "none"]);
}

#[test]
fn a_small_scene_bakes_within_its_bound() {
    holds(&fixture("trained/tiny/fine_last.tar"), &[]);
}

#[test]
fn what_holds_a_whole_field_is_refused() {
    let scene = fixture("trained/lego64/fine_last.tar");
    let folder = folder();
    let output = folder.path().join("none.mipvog");
    for options in [&["--filter", "fit"][..], &["--turntable", "2", "--require-psnr", "30"]] {
        let refused = bake(&scene, &output, &[&["--memory", "8G"], options].concat());
        assert_eq!(refused.status.code(), Some(2), "{options:?}");
        assert!(String::from_utf8_lossy(&refused.stderr).contains("--memory"));
    }
    let wrong = bake(&scene, &output, &["--memory", "much"]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(!output.exists());
}
