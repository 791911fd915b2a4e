//! `render` as users see it: cameras that are made, and outputs of every kind.

use std::path::{Path, PathBuf};
use std::process::Output;

use crate::common::{assert_schema, fixture, folder, program};
use mipvog::picture::{Rgba, read};
use serde_json::Value;

fn run(here: &Path, arguments: &[&str]) -> Output {
    let field = fixture("baked/tiny.rate.mipvog");
    let mut command = program();
    command.current_dir(here).arg("render").arg(field).args(arguments).output().expect("starts")
}

fn report(here: &Path, arguments: &[&str]) -> Value {
    let output = run(here, &[arguments, &["--format", "json"]].concat());
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {message}");
    let report = serde_json::from_slice(&output.stdout).expect("a report");
    assert_schema("render", &report);
    report
}

/// Runs the program, which must succeed.
fn done(here: &Path, arguments: &[&str]) {
    let output = program().current_dir(here).args(arguments).output().expect("starts");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

fn refused(here: &Path, arguments: &[&str], says: &str) {
    let before = names(here);
    let output = run(here, arguments);
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert!(message.contains(says), "{arguments:?}: no {says:?} in {message}");
    assert_eq!(names(here), before, "{arguments:?}");
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten();
    let mut names: Vec<String> =
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn picture(path: PathBuf) -> Rgba {
    read(&path, 1 << 24).expect("a picture")
}

#[test]
fn a_scene_without_cameras_fills_its_picture() {
    let folder = folder();
    let here = folder.path();
    let lego = fixture("trained/lego64/fine_last.tar").display().to_string();
    // The bounds of the scene's own cameras would cut the picture.
    let bounds = ["--stepsize", "0.5", "--near", "5", "--far", "6"];
    done(here, &[&["bake", &lego, "-o", "a.mipvog"], &bounds[..]].concat());
    for (size, file) in [("160x90", "wide.png"), ("90x160", "new/folder/high.png")] {
        done(here, &["render", "a.mipvog", "--alpha", "--size", size, "-o", file]);
        let picture = picture(here.join(file));
        let shown = |axis: usize| -> (usize, usize) {
            let pixels = picture.bytes.as_chunks::<4>().0.iter().enumerate();
            let shown = pixels.filter(|(_, pixel)| pixel[3] > 128);
            let places = shown.map(|(i, _)| [i % picture.width, i / picture.width][axis]);
            (places.clone().min().expect("something"), places.max().expect("something"))
        };
        let sides = [picture.width, picture.height];
        let shares = [0, 1].map(|axis| {
            let (low, high) = shown(axis);
            // Nothing is cut off, and the scene is in the middle.
            assert!(low > 0 && high + 1 < sides[axis], "{file}: {low} to {high}");
            let middle = (low + high) as f64 / 2.0 / sides[axis] as f64;
            assert!((0.45..0.55).contains(&middle), "{file}: {middle}");
            (high - low) as f64 / sides[axis] as f64
        });
        assert!(shares[0].max(shares[1]) > 0.85, "{file}: {shares:?}");
    }
}

#[test]
fn alpha_leaves_the_background_out_and_nothing_else() {
    let folder = folder();
    let here = folder.path();
    // Without the network, which adds light where nothing is.
    let lego = fixture("trained/lego64/fine_last.tar").display().to_string();
    let view = ["render", &lego, "--mlp", "none", "--stepsize", "0.5", "--turntable", "1"];
    let view = [&view[..], &["--size", "60", "--background", "0.2,0.5,0.9"]].concat();
    done(here, &[&view[..], &["-o", "over.png"]].concat());
    done(here, &[&view[..], &["-o", "alone.png", "--alpha"]].concat());
    let (over, alone) = (picture(here.join("over.png")), picture(here.join("alone.png")));
    let background = [0.2, 0.5, 0.9].map(|value| 255.0 * value);
    let (mut clear, mut half, mut full) = (0, 0, 0);
    let pairs = over.bytes.as_chunks::<4>().0.iter().zip(alone.bytes.as_chunks::<4>().0);
    for (over, alone) in pairs {
        let alpha = f64::from(alone[3]) / 255.0;
        for channel in 0..3 {
            let again = f64::from(alone[channel]) * alpha + background[channel] * (1.0 - alpha);
            // Both sides and alpha are rounded to 8 bits.
            assert!((again - f64::from(over[channel])).abs() < 2.0, "{over:?} {alone:?}");
        }
        match alone[3] {
            0 => clear += 1,
            255 => full += 1,
            _ => half += 1,
        }
    }
    assert!(clear > 100 && half > 50 && full > 0, "{clear} {half} {full}");
    refused(here, &["--alpha", "-o", "x.exr"], "an EXR has alpha anyway");
}

#[test]
fn films_hold_the_frames_that_a_folder_would() {
    let folder = folder();
    let here = folder.path();
    let view = ["--turntable", "3", "--size", "24x17", "--start", "-30"];
    report(here, &[&view[..], &["-o", "pictures"]].concat());
    let alpha = [&view[..], &["--alpha"]].concat();
    report(here, &[&alpha[..], &["-o", "alpha/"]].concat());
    let film = report(here, &[&alpha[..], &["-o", "spin.webp", "--fps", "10"]].concat());
    assert_eq!(film["frames"].as_array().map(Vec::len), Some(3));
    assert_eq!(film["frames"][2]["files"], serde_json::json!(["spin.webp"]));
    let bytes = std::fs::read(here.join("spin.webp")).expect("written");
    assert_eq!(film["output_bytes"], bytes.len());
    let webp = image_webp::WebPDecoder::new(std::io::Cursor::new(&bytes));
    let mut webp = webp.expect("a WebP");
    assert!(webp.is_animated() && webp.has_alpha());
    assert_eq!((webp.num_frames(), webp.dimensions()), (3, (24, 17)));
    assert_eq!(webp.loop_count(), image_webp::LoopCount::Forever);
    for i in 0..3 {
        let mut frame = vec![0; 24 * 17 * 4];
        assert_eq!(webp.read_frame(&mut frame).expect("a frame"), 100);
        let want = picture(here.join(format!("alpha/turn_00{i}.s1.png")));
        assert_eq!(frame, want.bytes, "frame {i}");
    }
    report(here, &[&view[..], &["-o", "spin.gif"]].concat());
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let bytes = std::fs::read(here.join("spin.gif")).expect("written");
    let mut gif = options.read_info(&bytes[..]).expect("a GIF");
    assert_eq!(gif.repeat(), gif::Repeat::Infinite);
    let mut frames = 0;
    while let Some(frame) = gif.read_next_frame().expect("a frame") {
        assert_eq!((frame.width, frame.height, frame.delay), (24, 17, 4));
        let want = picture(here.join(format!("pictures/turn_00{frames}.s1.png")));
        let errors = frame.buffer.iter().zip(&want.bytes).map(|(a, b)| a.abs_diff(*b));
        // 256 colours of at most 408 pixels: few of them are off by much.
        let mean = errors.map(u64::from).sum::<u64>() as f64 / want.bytes.len() as f64;
        assert!(mean < 4.0, "{mean}");
        frames += 1;
    }
    assert_eq!(frames, 3);
    // A film that is there is not replaced unasked.
    let again = run(here, &[&view[..], &["-o", "spin.gif"]].concat());
    assert!(!again.status.success());
    assert!(String::from_utf8_lossy(&again.stderr).contains("--force"));
    report(here, &[&alpha[..], &["-o", "spin.gif", "--force"]].concat());
    assert_ne!(std::fs::read(here.join("spin.gif")).expect("written"), bytes);
}

#[test]
fn the_name_of_the_output_decides_and_impossible_ones_are_refused() {
    let folder = folder();
    let here = folder.path();
    for bad in ["out.avi", "out.jpg", "out.txt", "out.mipvog"] {
        refused(here, &["-o", bad], ".gif, .webp, .mp4, .webm, .mov");
    }
    refused(here, &["-o", "-"], "standard output");
    refused(here, &["-o", "x.png", "--turntable", "3"], "3 pictures do not go into one");
    refused(here, &["-o", "x.png", "--scales", "1,2"], "2 pictures do not go into one");
    refused(here, &["-o", "x.gif", "--scales", "1,2"], "a film has one scale");
    refused(here, &["-o", "x.png", "--sheet"], "need a folder");
    refused(here, &["-o", "x.gif", "--exr"], "need a folder");
    refused(here, &["-o", "x", "--fps", "3"], "--fps belongs to films");
    refused(here, &["-o", "x.gif", "--fps", "60"], "at most 50");
    refused(here, &["-o", "x.gif", "--fps", "0"], "--fps");
    refused(here, &["-o", "x.mp4", "--alpha"], "a video has none");
    refused(here, &["-o", "x.webp", "--size", "20000x2"], "at most 16384 pixels");
    refused(here, &["-o", "x", "--size", "99999x99999"], "1 to 32768");
    refused(here, &["-o", "x", "--size", "4by4"], "WxH");
    let cameras = fixture("trained/lego64/transforms_test.json").display().to_string();
    let from = ["-o", "x", "--cameras", &cameras];
    refused(here, &[&from[..], &["--frames", "nope"]].concat(), "r_0, r_10, r_20, r_30, r_40, ...");
    refused(here, &[&from[..], &["--frames", "10"]].concat(), "index from 0 to 9");
    refused(here, &[&from[..], &["--frames", "0,r_0"]].concat(), "two of the frames");
    refused(here, &[&from[..], &["--radius", "2"]].concat(), "--radius");
    refused(here, &[&from[..], &["--spiral", "2"]].concat(), "--spiral");
    refused(here, &["-o", "x", "--path", "4"], "--cameras");
    refused(here, &["-o", "x", "--start", "4"], "--turntable");
    let around = ["-o", "x", "--turntable", "2"];
    for (option, value) in [
        ("--elevation", "90"),
        ("--elevation", "-90"),
        ("--elevation", "nan"),
        ("--radius", "0"),
        ("--radius", "inf"),
        ("--fov", "0"),
        ("--fov", "175"),
        ("--start", "nan"),
    ] {
        refused(here, &[&around[..], &[option, value]].concat(), option);
    }
    // Levels that the field has are told.
    let says = "auto, off, or a level from 0 to 3 that the field has";
    refused(here, &["-o", "x", "--level-of-detail", "9"], says);
    refused(here, &["-o", "x", "--level-of-detail", "4"], says);
    report(here, &["-o", "x", "--level-of-detail", "3", "--size", "8"]);
    // More than memory has room for.
    let huge = run(here, &["-o", "y", "--size", "32768"]);
    assert_eq!(huge.status.code(), Some(6), "{}", String::from_utf8_lossy(&huge.stderr));
    // A folder that is there is one, whatever its name.
    std::fs::create_dir(here.join("v1.png")).expect("writable");
    report(here, &["-o", "v1.png", "--size", "8"]);
    assert_eq!(names(&here.join("v1.png")), ["view.s1.png"]);
    assert_eq!(names(here), ["v1.png", "x"]);
}

#[test]
fn cameras_go_around_and_through_as_asked() {
    let folder = folder();
    let here = folder.path();
    let frames = |arguments: &[&str]| -> Vec<String> {
        let report = report(here, &[arguments, &["--size", "12", "--force"]].concat());
        let frames = report["frames"].as_array().expect("frames");
        frames.iter().map(|frame| frame["frame"].as_str().expect("a name").to_owned()).collect()
    };
    let bytes = |path: &str| std::fs::read(here.join(path)).expect("written");
    assert_eq!(frames(&["--spiral", "4", "-o", "s"])[3], "spiral_003");
    // Half a turn on, the first camera stands where the second one stood.
    frames(&["--turntable", "2", "-o", "a"]);
    frames(&["--turntable", "2", "-o", "b", "--start", "180"]);
    assert_eq!(bytes("a/turn_001.s1.png"), bytes("b/turn_000.s1.png"));
    frames(&["--turntable", "1", "-o", "c", "--elevation", "30"]);
    assert_eq!(bytes("a/turn_000.s1.png"), bytes("c/turn_000.s1.png"));
    for other in [["--elevation", "-10"], ["--radius", "2"], ["--fov", "60"], ["--start", "5"]] {
        frames(&[&["--turntable", "1", "-o", "d"], &other[..]].concat());
        assert_ne!(bytes("a/turn_000.s1.png"), bytes("d/turn_000.s1.png"), "{other:?}");
    }
    // A path begins and ends at the cameras that it leads through, and is the same every time.
    let cameras = fixture("trained/lego64/transforms_test.json").display().to_string();
    let through = ["--cameras", &cameras, "--frames", "0,3,5"];
    frames(&[&through[..], &["-o", "own"]].concat());
    let path = frames(&[&through[..], &["--path", "5", "-o", "path"]].concat());
    assert_eq!(path, ["path_000", "path_001", "path_002", "path_003", "path_004"]);
    let first = bytes("path/path_001.s1.png");
    frames(&[&through[..], &["--path", "5", "-o", "path"]].concat());
    assert_eq!(bytes("path/path_001.s1.png"), first);
    let close = |a: &str, b: &str| {
        let (a, b) = (picture(here.join(a)), picture(here.join(b)));
        a.bytes.iter().zip(&b.bytes).all(|(a, b)| a.abs_diff(*b) <= 1)
    };
    assert!(close("path/path_000.s1.png", "own/r_0.s1.png"));
    assert!(close("path/path_004.s1.png", "own/r_50.s1.png"));
}

#[cfg(unix)]
mod video {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    /// A folder with a program of the name ffmpeg.
    fn stand_in(here: &Path, script: &str) -> PathBuf {
        let folder = here.join("bin");
        std::fs::create_dir_all(&folder).expect("writable");
        let path = folder.join("ffmpeg");
        std::fs::write(&path, format!("#!/bin/sh\n{script}\n")).expect("writable");
        let mode = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(&path, mode).expect("own");
        folder
    }

    fn film(here: &Path, path: &str) -> Output {
        let field = fixture("baked/tiny.rate.mipvog");
        let mut command = program();
        command.current_dir(here).env("PATH", path).arg("render").arg(field);
        command.args(["--turntable", "3", "--size", "8x6", "--fps", "12", "-o", "spin.mp4"]);
        command.output().expect("starts")
    }

    fn message(output: &Output) -> String {
        String::from_utf8_lossy(&output.stderr).into_owned()
    }

    #[test]
    fn frames_go_to_ffmpeg_where_it_is() {
        let folder = folder();
        let here = folder.path();
        let missing = film(here, "/nowhere");
        assert_eq!(missing.status.code(), Some(2));
        assert!(message(&missing).contains("install"), "{}", message(&missing));
        assert!(names(here).is_empty());

        // It keeps its arguments, and writes what it gets into the last of them.
        let script = r#"echo "$@" > arguments; for last; do :; done; cat > "${last#file:}""#;
        let path = format!("{}:/usr/bin:/bin", stand_in(here, script).display());
        let written = film(here, &path);
        assert!(written.status.success(), "{}", message(&written));
        let frames = std::fs::read(here.join("spin.mp4")).expect("written");
        let mut want = Vec::new();
        report(here, &["--turntable", "3", "--size", "8x6", "-o", "pictures"]);
        for i in 0..3 {
            let picture = picture(here.join(format!("pictures/turn_00{i}.s1.png")));
            want.extend(picture.bytes.as_chunks::<4>().0.iter().flat_map(|p| [p[0], p[1], p[2]]));
        }
        assert_eq!(frames, want);
        let arguments = std::fs::read_to_string(here.join("arguments")).expect("kept");
        for part in ["-video_size 8x6", "-framerate 12", "-pixel_format rgb24", "-f mp4"] {
            assert!(arguments.contains(part), "no {part} in {arguments}");
        }

        std::fs::remove_file(here.join("spin.mp4")).expect("own");
        stand_in(here, "echo no such codec >&2; exit 1");
        let failed = film(here, &path);
        assert_eq!(failed.status.code(), Some(5));
        assert!(message(&failed).contains("no such codec"), "{}", message(&failed));
        assert!(!here.join("spin.mp4").exists());
        assert!(names(here).iter().all(|name| !name.ends_with(".partial")));
    }
}
