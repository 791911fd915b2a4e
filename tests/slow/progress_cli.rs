//! Progress as lines, where there is no terminal: labels, counts, and a share that only grows.

use crate::common::{fixture, folder, program};

/// The lines of progress of a run, which must succeed.
fn lines(arguments: &[&str]) -> Vec<String> {
    let folder = folder();
    let mut command = program();
    command.current_dir(folder.path()).args(arguments).args(["--progress", "always"]);
    let output = command.output().expect("starts");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments:?}: {message}");
    let lines = message.lines().filter(|line| !line.starts_with("warning"));
    lines.map(str::to_owned).collect()
}

/// The shares that lines tell, in percent; the first line has none.
fn assert_grows(lines: &[String]) {
    assert_eq!(lines[0], "open", "{lines:?}");
    let share = |line: &String| -> u32 {
        let words: Vec<&str> = line.split(' ').collect();
        let unit = words.iter().position(|word| *word == "%").expect("a share");
        words[unit - 1].parse().expect("a number")
    };
    let shares: Vec<u32> = lines[1..].iter().map(share).collect();
    assert!(shares.is_sorted() && shares.iter().all(|share| *share <= 100), "{lines:?}");
}

#[test]
fn every_verb_names_its_steps_and_its_share_only_grows() {
    let tiny = fixture("trained/tiny/fine_last.tar").display().to_string();
    let baked = fixture("baked/tiny.rate.mipvog").display().to_string();
    let view = ["--turntable", "2", "--size", "24"];
    let bake = ["bake", &tiny, "-o", "a.mipvog", "--max-error", "0.02", "--min-weight", "0.001"];
    let bake = lines(&[&bake[..], &view].concat());
    assert_grows(&bake);
    let starts = ["open", "prune, 0 %", "look from the cameras", "find ranges", "encode", "write"];
    for start in starts.into_iter().chain(["render, "]) {
        assert!(bake.iter().any(|line| line.starts_with(start)), "no {start} in {bake:?}");
    }
    let fit = ["bake", &tiny, "-o", "a.mipvog", "--filter", "fit", "--fit-steps", "60"];
    let fit = lines(&fit);
    assert_grows(&fit);
    for start in ["prune", "reference pictures, ", "fit, "] {
        assert!(fit.iter().any(|line| line.starts_with(start)), "no {start} in {fit:?}");
    }
    assert_grows(&lines(&[&["render", &baked, "-o", "x"], &view[..]].concat()));
    assert_grows(&lines(&[&["compare", &baked, &baked], &view[..]].concat()));
    let sweep = ["sweep", &tiny, "-o", "x", "--bits", "6,8", "--repeat", "1"];
    assert_grows(&lines(&[&sweep[..], &view].concat()));
}

#[test]
fn parts_of_long_steps_are_named() {
    let folder = folder();
    let here = folder.path();
    let lego = fixture("trained/lego64/fine_last.tar").display().to_string();
    let bake = ["bake", &lego, "--stepsize", "0.5", "-o", "a.mipvog"];
    let said = |arguments: &[&str]| {
        let output = program()
            .current_dir(here)
            .args(arguments)
            .args(["--progress", "always"])
            .output()
            .expect("starts");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let fit =
        said(&[&bake[..], &["--filter", "fit", "--fit-steps", "30", "--levels", "3"]].concat());
    // Of 64 and 128 pictures and of some hundred steps, one a second is told.
    assert!(fit.contains("reference pictures: picture ") && fit.contains("/176, "), "{fit}");
    assert!(fit.contains("fit: all levels, step "), "{fit}");
    assert!(fit.contains("/30, ") && fit.contains(" dB, ") && fit.contains(" left"), "{fit}");
    // Time is up before the first step.
    let tiny = fixture("trained/tiny/fine_last.tar").display().to_string();
    let short =
        said(&["bake", &tiny, "-o", "b.mipvog", "--filter", "fit", "--fit-seconds", "0.01"]);
    assert!(short.contains("warning: level 2 took no step before the fit ended"), "{short}");
    let view = ["--turntable", "40", "--size", "200", "-o", "x"];
    let render = said(&[&["render", &lego, "--stepsize", "0.5"], &view[..]].concat());
    assert!(render.contains("render: picture ") && render.contains("/40, "), "{render}");
}
