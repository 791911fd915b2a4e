//! Signals at named moments: a verb ends within a second, leaves nothing half or in the way, and the
//! same command runs again.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::asset::glb;
use crate::common::{fixture, folder, program, send};
use crate::paused::{END, Paused};

/// Signals that ask a program to end, with the exit codes that say so.
const SIGNALS: [(&str, i32); 2] = [("-INT", 130), ("-TERM", 143)];

fn command(here: &Path, line: &str) -> Command {
    let words = line.split(' ').map(|word| match word {
        "SCENE" => fixture("trained/lego64/fine_last.tar").display().to_string(),
        "TINY" => fixture("trained/tiny/fine_last.tar").display().to_string(),
        "BAKED" => fixture("baked/tiny.rate.mipvog").display().to_string(),
        word => word.to_owned(),
    });
    let mut command = program();
    command.current_dir(here).args(words).stdin(Stdio::null());
    command
}

/// Runs a command to its end.
fn runs(here: &Path, line: &str) {
    let output = command(here, line).output().expect("starts");
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> =
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
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
        let (ended, said) = Paused::at(&mut command(here, line), "renamed 3").signal(signal);
        assert_eq!(ended, Some(code), "{line}: {said}");
        assert!(said.contains("run the same command again"), "{said}");
        // The folder was its own too.
        assert!(names(here).is_empty(), "{line}: {:?}", names(here));
    }
    // Files of others stay, and so do pictures that were to be replaced.
    std::fs::create_dir_all(here.join("new/pictures")).expect("writable");
    std::fs::write(here.join("new/pictures/mine.txt"), b"mine").expect("writable");
    std::fs::write(here.join("new/pictures/turn_001.s1.png"), b"old").expect("writable");
    let forced = format!("{render} --force");
    let (ended, said) = Paused::at(&mut command(here, &forced), "renamed 4").signal("-INT");
    assert_eq!(ended, Some(130), "{said}");
    assert_eq!(names(&here.join("new/pictures")), ["mine.txt", "turn_001.s1.png"]);
    let replaced = std::fs::read(here.join("new/pictures/turn_001.s1.png")).expect("there");
    assert!(replaced.starts_with(b"\x89PNG") && replaced.ends_with(b"IEND\xaeB`\x82"));
    runs(here, &forced.replace("300", "3"));
}

#[test]
fn long_work_ends_soon_after_a_signal() {
    for (line, words) in [
        ("render SCENE --turntable 40 --size 200 -o x.webp", "render, "),
        ("render SCENE --size 1500 --supersample 3 -o x.png", "render, "),
        ("compare SCENE SCENE --turntable 4 --size 300 --scales 1,2 -o x", "render, "),
        ("bake SCENE --stepsize 0.5 -o x.mipvog --zstd-level 22", "encode"),
        ("bake SCENE --stepsize 0.5 -o x.mipvog --turntable 9 --size 400", "render, "),
    ] {
        for (signal, code) in SIGNALS {
            let folder = folder();
            let here = folder.path();
            let mut command = command(here, line);
            let run = Paused::after(command.args(["--progress", "always"]), words);
            let (ended, said) = run.signal(signal);
            assert_eq!(ended, Some(code), "{line}: {said}");
            assert!(names(here).is_empty(), "{line}: {:?}", names(here));
        }
    }
}

#[test]
fn a_server_ends_at_a_signal_and_calls_it_no_error() {
    for (signal, _) in SIGNALS {
        let folder = folder();
        let mut view = command(folder.path(), "view BAKED --no-open");
        let (ended, said) = Paused::after(&mut view, "serving").signal(signal);
        assert_eq!(ended, Some(0), "{said}");
        assert!(!said.contains("error"), "{said}");
    }
}

#[test]
fn every_verb_that_writes_ends_soon_and_runs_again() {
    let inputs = folder();
    let room = inputs.path().join("room.glb");
    std::fs::write(&room, glb("{\"asset\":{\"version\":\"2.0\"}}", &[])).expect("writable");
    let both = inputs.path().join("both.glb");
    let attach = format!("attach {} BAKED -o", room.display());
    runs(inputs.path(), &format!("{attach} {}", both.display()));
    let bake = "bake TINY -o new/x.mipvog --gltf new/x.glb --depfile new/x.d";
    let render = "render BAKED --spiral 3 --size 90 --scales 1,2 --exr --sheet -o new/pictures";
    let compare = "compare BAKED TINY --turntable 2 --size 90 --scales 1,2 -o new/errors";
    let mut ended_by_signal = 0;
    for (line, points) in [
        (&format!("{attach} new/x.glb")[..], ["created 1", "appended 1"]),
        (&format!("detach {} -o new/x.glb", both.display()), ["created 1", "appended 1"]),
        (bake, ["created 3", "appended 4"]),
        ("bake BAKED -o new/x.mipvog --bits 6", ["created 1", "appended 4"]),
        ("transcode BAKED -o new/x.mipvog --max-bytes 20kB", ["created 1", "appended 4"]),
        ("unpack BAKED -o new/slices/", ["appended 5", "renamed 7"]),
        ("unpack BAKED -o new/x.safetensors", ["created 1", "appended 3"]),
        ("unpack BAKED -o new/x.npz", ["created 1", "appended 3"]),
        (render, ["appended 5", "renamed 3"]),
        ("render BAKED --turntable 5 --size 90 -o new/x.gif", ["created 1", "appended 3"]),
        (compare, ["appended 2", "renamed 3"]),
    ] {
        let folder = folder();
        let here = folder.path();
        let new = here.join("new");
        for (point, (signal, code)) in points.into_iter().zip(SIGNALS) {
            let (ended, said) = Paused::at(&mut command(here, line), point).signal(signal);
            // Behind its last look at signals a run is done, and all is there.
            let done = ended == Some(0);
            assert!(done || ended == Some(code), "{line}, {point}: {ended:?} {said}");
            ended_by_signal += usize::from(!done);
            let left = names(&new);
            std::fs::remove_dir_all(&new).ok();
            assert!(names(here).is_empty(), "{line}, {point}: {:?}", names(here));
            runs(here, line);
            let whole = if done { names(&new) } else { Vec::new() };
            assert_eq!(left, whole, "{line}, {point}");
            std::fs::remove_dir_all(&new).expect("written");
        }
    }
    assert!(ended_by_signal >= 11, "{ended_by_signal} runs");
}

/// What is done soon and writes nothing is ended or done, in the middle of its time.
#[test]
fn verbs_that_write_nothing_end_soon() {
    let folder = folder();
    let here = folder.path();
    for line in [
        "inspect SCENE BAKED TINY",
        "validate SCENE",
        "bake TINY -o x.mipvog --dry-run",
        "man",
        "completions bash",
        "version",
    ] {
        let clock = Instant::now();
        runs(here, line);
        let time = clock.elapsed();
        for (signal, code) in SIGNALS {
            let mut child = command(here, line).stdout(Stdio::null()).spawn().expect("starts");
            std::thread::sleep(time / 2);
            let clock = Instant::now();
            send(signal, child.id());
            // Before the first thing it does a program has no handlers; then a signal ends it.
            let ended = child.wait().expect("ends").code();
            assert!([Some(code), Some(0), None].contains(&ended), "{line}: {ended:?}");
            assert!(clock.elapsed() < END, "{line}");
            assert!(names(here).is_empty(), "{line}: {:?}", names(here));
        }
    }
}

#[test]
fn a_standard_input_that_never_ends_leaves_no_copy() {
    for (signal, code) in SIGNALS {
        let folder = folder();
        let here = folder.path();
        let mut command = program();
        command.env("TMPDIR", here).current_dir(here).args(["bake", "-", "-o", "x.mipvog"]);
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = command.spawn().expect("starts");
        let _held = child.stdin.take();
        let clock = Instant::now();
        while names(here).is_empty() {
            assert!(clock.elapsed() < Duration::from_secs(60), "it never comes");
            std::thread::sleep(Duration::from_millis(2));
        }
        let clock = Instant::now();
        send(signal, child.id());
        assert_eq!(child.wait().expect("ends").code(), Some(code));
        assert!(clock.elapsed() < END);
        assert!(names(here).is_empty(), "{:?}", names(here));
    }
}

#[test]
fn a_sweep_goes_on_after_a_signal() {
    let folder = folder();
    let here = folder.path();
    let line = "sweep TINY --turntable 2 --size 40 --bits 6,8,10,12 --repeat 1 -o x";
    runs(here, line);
    let whole = names(&here.join("x"));
    std::fs::remove_dir_all(here.join("x")).expect("own");
    let points = ["created 2", "appended 5", "renamed 3", "renamed 2", "created 1"];
    for (point, (signal, code)) in points.into_iter().zip(SIGNALS.into_iter().cycle()) {
        let (ended, said) = Paused::at(&mut command(here, line), point).signal(signal);
        assert_eq!(ended, Some(code), "{point}: {said}");
        let left = names(&here.join("x"));
        assert!(left.iter().all(|name| whole.contains(name)), "{point}: {left:?}");
    }
    runs(here, line);
    assert_eq!(names(&here.join("x")), whole);
}

#[test]
fn a_fit_that_has_not_begun_says_so() {
    let folder = folder();
    let here = folder.path();
    let line = "bake SCENE --stepsize 0.5 --filter fit -o x.mipvog --progress always";
    let run = Paused::after(&mut command(here, line), "reference pictures");
    let (ended, said) = run.signal("-INT");
    assert_eq!(ended, Some(130), "{said}");
    assert!(said.contains("nothing is fitted, nothing written"), "{said}");
    assert!(names(here).is_empty());
}
