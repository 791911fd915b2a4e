//! Signals at any moment: a verb ends within a second, leaves nothing half or in the way, and the
//! same command runs again.

use crate::common;
use std::path::Path;
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::asset::glb;
use crate::common::{Random, fixture, folder, program};

/// A run has this much time to end after a signal: the second that is promised, of which the
/// program takes 0.65 at most, and half of one more for a machine whose processors are all taken by
/// other tests: there threads, the shell that sends the signal, and the test itself wait for their turn.
const END: Duration = Duration::from_millis(1500);

fn start(here: &Path, line: &str) -> Child {
    let words = line.split(' ').map(|word| match word {
        "SCENE" => fixture("trained/lego64/fine_last.tar").display().to_string(),
        "TINY" => fixture("trained/tiny/fine_last.tar").display().to_string(),
        "BAKED" => fixture("baked/tiny.rate.mipvog").display().to_string(),
        word => word.to_owned(),
    });
    let mut command = program();
    command.current_dir(here).args(words).stdin(Stdio::null()).stdout(Stdio::null());
    command.stderr(Stdio::piped()).spawn().expect("starts")
}

/// Sends a signal and waits; the time until the end is asserted.
fn signalled(child: Child, signal: &str) -> Output {
    let clock = Instant::now();
    common::send(signal, child.id());
    let output = child.wait_with_output().expect("ends");
    let took = clock.elapsed();
    assert!(took < END, "{took:?}: {}", message(&output));
    output
}

fn message(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> =
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn wait_for(holds: impl Fn() -> bool) {
    let clock = Instant::now();
    while !holds() {
        assert!(clock.elapsed() < Duration::from_secs(60), "it never comes");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// The first time that a folder of this name has so many files.
fn wait_for_files(folder: &Path, count: usize) {
    wait_for(|| names(folder).iter().filter(|name| name.ends_with(".png")).count() >= count);
}

#[test]
fn pictures_of_an_interrupted_run_go_and_it_runs_again() {
    let folder = folder();
    let here = folder.path();
    let render = "render BAKED --turntable 300 --size 60 -o new/pictures";
    let compare = "compare BAKED BAKED --turntable 300 --size 60 --scales 1 -o new/pictures";
    for (line, signal, code) in
        [(render, "-INT", 130), (compare, "-TERM", 143), (render, "-TERM", 143)]
    {
        let child = start(here, line);
        wait_for_files(&here.join("new/pictures"), 3);
        let output = signalled(child, signal);
        assert_eq!(output.status.code(), Some(code), "{line}: {}", message(&output));
        assert!(message(&output).contains("again to start over"), "{}", message(&output));
        // The folder was its own too.
        assert!(names(here).is_empty(), "{line}: {:?}", names(here));
    }
    // Files of others stay, and so do pictures that were to be replaced.
    std::fs::create_dir_all(here.join("new/pictures")).expect("writable");
    std::fs::write(here.join("new/pictures/mine.txt"), b"mine").expect("writable");
    std::fs::write(here.join("new/pictures/turn_001.s1.png"), b"old").expect("writable");
    let forced = format!("{render} --force");
    let child = start(here, &forced);
    wait_for_files(&here.join("new/pictures"), 4);
    assert_eq!(signalled(child, "-INT").status.code(), Some(130));
    assert_eq!(names(&here.join("new/pictures")), ["mine.txt", "turn_001.s1.png"]);
    let replaced = std::fs::read(here.join("new/pictures/turn_001.s1.png")).expect("there");
    assert!(replaced.starts_with(b"\x89PNG") && replaced.ends_with(b"IEND\xaeB`\x82"));
    let short = forced.replace("300", "3");
    let output = start(here, &short).wait_with_output().expect("ends");
    assert!(output.status.success(), "{}", message(&output));
}

#[test]
fn any_verb_ends_soon_after_a_signal_at_any_moment() {
    let mut random = Random::new(11);
    let lines = [
        "render SCENE --turntable 40 --size 200 -o x.webp",
        "render SCENE --size 1500 --supersample 3 -o x.png",
        "compare SCENE SCENE --turntable 4 --size 300 --scales 1,2 -o x",
        "bake SCENE --stepsize 0.5 -o x.mipvog --zstd-level 22",
        "bake SCENE --stepsize 0.5 -o x.mipvog --turntable 9 --size 400",
        "inspect SCENE",
        "validate SCENE",
        "unpack BAKED -o x.safetensors",
        "view BAKED --no-open",
    ];
    for line in lines {
        for (signal, code) in [("-INT", 130), ("-TERM", 143)] {
            let folder = folder();
            let here = folder.path();
            let child = start(here, line);
            let wait = random.between(0.03, 0.7);
            std::thread::sleep(Duration::from_secs_f32(wait));
            let output = signalled(child, signal);
            // Short ones were done.
            let ended = output.status.code();
            assert!([Some(code), Some(0)].contains(&ended), "{line}: {}", message(&output));
            if ended != Some(0) {
                assert!(names(here).is_empty(), "{line} after {wait} s: {:?}", names(here));
            }
        }
    }
}

#[test]
fn every_other_verb_ends_soon_too_and_runs_again() {
    let inputs = folder();
    let room = inputs.path().join("room.glb");
    std::fs::write(&room, glb("{\"asset\":{\"version\":\"2.0\"}}", &[])).expect("writable");
    let both = inputs.path().join("both.glb");
    let attach = format!("attach {} BAKED -o", room.display());
    let output = start(inputs.path(), &format!("{attach} {}", both.display()));
    assert!(output.wait_with_output().expect("ends").status.success());
    let lines = [
        format!("{attach} new/x.glb"),
        format!("detach {} -o new/x.glb", both.display()),
        format!("inspect {} BAKED TINY", both.display()),
        "bake TINY -o new/x.mipvog --gltf new/x.glb --depfile new/x.d".to_owned(),
        "bake TINY -o x.mipvog --dry-run".to_owned(),
        "bake BAKED -o new/x.mipvog --bits 6".to_owned(),
        "transcode BAKED -o new/x.mipvog --max-bytes 20kB".to_owned(),
        "unpack BAKED -o new/slices/".to_owned(),
        "unpack BAKED -o new/x.npz".to_owned(),
        "render BAKED --spiral 3 --size 90 --scales 1,2 --exr --sheet -o new/pictures".to_owned(),
        "render BAKED --turntable 5 --size 90 -o new/x.gif".to_owned(),
        "compare BAKED TINY --turntable 2 --size 90 --scales 1,2 -o new/errors".to_owned(),
        "sweep TINY --turntable 1 --size 20 --bits 8 --scales 1 --repeat 1 -o new/x".to_owned(),
        "man".to_owned(),
        "completions bash".to_owned(),
        "version".to_owned(),
    ];
    let mut random = Random::new(13);
    for line in &lines {
        let folder = folder();
        let here = folder.path();
        let clock = Instant::now();
        assert!(start(here, line).wait().expect("ends").success(), "{line}");
        let time = clock.elapsed();
        for (signal, code) in [("-INT", 130), ("-TERM", 143), ("-INT", 130), ("-TERM", 143)] {
            std::fs::remove_dir_all(here.join("new")).ok();
            let child = start(here, line);
            // Before the first thing it does a program has no handlers; then a signal ends it.
            let share = random.between(0.1, 1.0);
            std::thread::sleep(time.mul_f32(share).max(Duration::from_millis(8)));
            let output = signalled(child, signal);
            let ended = output.status.code();
            assert!([Some(code), Some(0), None].contains(&ended), "{line}: {}", message(&output));
            if ended != Some(0) && !line.starts_with("sweep") {
                assert!(names(here).is_empty(), "{line} at {share}: {:?}", names(here));
            }
        }
        std::fs::remove_dir_all(here.join("new")).ok();
        let output = start(here, line).wait_with_output().expect("ends");
        assert!(output.status.success(), "{line}: {}", message(&output));
    }
}

#[test]
fn a_standard_input_that_never_ends_leaves_no_copy() {
    for (signal, code) in [("-INT", 130), ("-TERM", 143)] {
        let folder = folder();
        let here = folder.path();
        let mut command = program();
        command.env("TMPDIR", here).current_dir(here).args(["bake", "-", "-o", "x.mipvog"]);
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("starts");
        let _held = child.stdin.take();
        wait_for(|| !names(here).is_empty());
        let output = signalled(child, signal);
        assert_eq!(output.status.code(), Some(code), "{}", message(&output));
        assert!(names(here).is_empty(), "{:?}", names(here));
    }
}

#[test]
fn a_sweep_goes_on_after_a_signal_at_any_moment() {
    let mut random = Random::new(12);
    let folder = folder();
    let here = folder.path();
    let line = "sweep TINY --turntable 2 --size 40 --bits 6,8,10,12 --repeat 1 -o x";
    let clock = Instant::now();
    assert!(start(here, line).wait().expect("ends").success());
    let time = clock.elapsed();
    let whole = names(&here.join("x"));
    for number in 0..16 {
        if number % 4 == 0 {
            std::fs::remove_dir_all(here.join("x")).expect("own");
        }
        let child = start(here, line);
        std::thread::sleep(time.mul_f32(random.between(0.05, 0.9)));
        let signal = if number % 2 == 0 { "-INT" } else { "-TERM" };
        let output = signalled(child, signal);
        let code = output.status.code();
        assert!([Some(0), Some(130), Some(143)].contains(&code), "{}", message(&output));
        let left = names(&here.join("x"));
        assert!(left.iter().all(|name| whole.contains(name)), "{left:?}");
    }
    let output = start(here, line).wait_with_output().expect("ends");
    assert!(output.status.success(), "{}", message(&output));
    assert_eq!(names(&here.join("x")), whole);
}

#[test]
fn a_fit_that_has_not_begun_says_so() {
    let folder = folder();
    let here = folder.path();
    let line = "bake SCENE --stepsize 0.5 --filter fit -o x.mipvog --progress always";
    let mut child = start(here, line);
    let mut stderr = child.stderr.take().expect("a pipe");
    let (mut seen, mut buffer) = (Vec::new(), [0; 256]);
    while !String::from_utf8_lossy(&seen).contains("reference pictures") {
        let count = std::io::Read::read(&mut stderr, &mut buffer).expect("readable");
        assert!(count > 0, "it ended: {}", String::from_utf8_lossy(&seen));
        seen.extend_from_slice(&buffer[..count]);
    }
    child.stderr = Some(stderr);
    let output = signalled(child, "-INT");
    assert_eq!(output.status.code(), Some(130));
    assert!(
        message(&output).contains("nothing is fitted, nothing written"),
        "{}",
        message(&output)
    );
    assert!(names(here).is_empty());
}
