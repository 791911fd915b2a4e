//! Options of a bake: what they stand for, what is kept of them, and what a sweep makes of them.

use crate::common::{fixture, folder};
use crate::verbs::{against_schema, entries, refused, report, run, scene, stderr};
use serde_json::Value;

#[test]
fn an_option_on_an_unpacked_container_leaves_the_others_as_they_are() {
    let folder = folder();
    let here = folder.path();
    let shape = ["--filter", "paper", "--bits", "12", "--alpha-threshold", "0.01"];
    report(here, &[&["bake", &scene(), "-o", "a.mipvog"], &shape[..]].concat());
    report(here, &["unpack", "a.mipvog", "-o", "a.safetensors"]);
    report(here, &["bake", "a.safetensors", "-o", "b.mipvog", "--block-size", "4"]);
    let metadata = report(here, &["inspect", "b.mipvog"])["metadata"].clone();
    assert_eq!(metadata["filter"], "paper");
    assert_eq!(metadata["levels"][0]["density"]["bits"], 12);
    assert_eq!(metadata["levels"][0]["block_size"], 4);
    for bad in [["--near", "nan"], ["--background", "inf"], ["--color-threshold", "2"]] {
        refused(
            here,
            &[&["bake", "a.safetensors", "-o", "x.mipvog"], &bad[..]].concat(),
            2,
            &[bad[0]],
        );
    }
}

#[test]
fn a_missed_gate_writes_nothing() {
    let folder = folder();
    let here = folder.path();
    let cameras = fixture("trained/lego64/transforms_test.json").display().to_string();
    let scene = scene();
    let bake = ["bake", &scene, "-o", "a.mipvog", "--stepsize", "0.5"];
    let view = ["--cameras", &cameras, "--size", "32x32", "--frames", "0"];
    let gate = |least| [&bake[..], &view, &["--require-psnr", least]].concat();
    let missed = run(here, &[&gate("90")[..], &["--format", "json"]].concat());
    assert_eq!(missed.status.code(), Some(1), "{}", stderr(&missed));
    let quality = &against_schema("bake", &missed.stdout)["quality"];
    assert_eq!(quality["passed"], false);
    assert!(entries(here).is_empty());
    let passed = report(here, &gate("10"));
    assert_eq!(passed["quality"]["passed"], true);
    assert_eq!(passed["quality"]["errors"].as_array().map(Vec::len), Some(4));
    assert!(here.join("a.mipvog").is_file());
    // Cameras alone measure without a gate; a gate needs cameras, and a trained input.
    assert!(report(here, &[&bake[..], &view, &["--force"]].concat())["quality"]["passed"] == true);
    refused(here, &[&bake[..], &["--require-psnr", "3"]].concat(), 2, &["--cameras"]);
    report(here, &["unpack", "a.mipvog", "-o", "a.safetensors"]);
    let again = ["bake", "a.safetensors", "-o", "b.mipvog", "--turntable", "2"];
    refused(here, &again, 2, &["trained input"]);
}

#[test]
fn a_quality_stands_for_other_options() {
    let folder = folder();
    let here = folder.path();
    let scene = scene();
    let bake =
        |out: &'static str| ["bake", &scene, "-o", out, "--stepsize", "0.5"].map(str::to_owned);
    let baked = |out: &'static str, options: &[&str]| {
        let arguments = bake(out);
        let own: Vec<&str> =
            arguments.iter().map(String::as_str).chain(options.iter().copied()).collect();
        report(here, &own)
    };
    let bytes = |name: &str| std::fs::read(here.join(name)).expect("a container");
    baked("web.mipvog", &["--preset", "web"]);
    baked("75.mipvog", &["--quality", "75"]);
    assert!(bytes("web.mipvog") == bytes("75.mipvog"));
    baked("50.mipvog", &["--quality", "50"]);
    assert!(bytes("50.mipvog").len() < bytes("75.mipvog").len());
    // Cameras are used, and an option that is given counts.
    let view = ["--turntable", "2", "--size", "16x16", "--quality", "50"];
    let seen = baked("seen.mipvog", &[&view[..], &["--coarseness", "3"]].concat());
    let option = |name: &str| seen["options"][name].as_f64().expect("a number");
    let found = ["min_weight", "fill_error", "coarseness"].map(option);
    assert_eq!(found, [0.002, 0.5, 3.0]);
    assert!(bytes("seen.mipvog").len() < bytes("50.mipvog").len());
    // A container takes it too; it does not know any more what viewers nearby see.
    report(here, &["bake", "75.mipvog", "-o", "again.mipvog", "--quality", "25"]);
    assert!(bytes("again.mipvog").len() < bytes("75.mipvog").len());
    for more in [["--bits", "8"], ["--max-error", "0.1"], ["--max-bytes", "1MB"]] {
        let arguments =
            [&["bake", &scene, "-o", "no.mipvog", "--quality", "50"][..], &more].concat();
        refused(here, &arguments, 2, &["--quality"]);
    }
    let wrong = ["bake", &scene, "-o", "no.mipvog", "--quality", "0"];
    refused(here, &wrong, 2, &["1 to 100"]);
}

#[test]
fn an_error_instead_of_bits_is_kept_and_told() {
    let folder = folder();
    let here = folder.path();
    let scene = scene();
    let bake = |more: &[&str]| report(here, &[&["bake", &scene, "--force"], more].concat());
    // Explicit options override a preset's bits.
    let lossy = bake(&["-o", "a.mipvog", "--max-error", "0.02", "--preset", "archive"]);
    assert_eq!(lossy["options"]["max_error"].as_f64(), Some(0.02));
    assert!(lossy["options"]["bits"].is_null());
    let groups = |report: &Value| -> Vec<Value> {
        let levels = report["levels"].as_array().expect("levels");
        levels
            .iter()
            .flat_map(|level| level["groups"].as_array().expect("groups"))
            .cloned()
            .collect()
    };
    for group in groups(&lossy) {
        assert!(group["max_error"].as_f64() <= Some(0.02f32.into()), "{group}");
        assert!(group["bits"].as_str().expect("bits").parse().is_ok_and(|bits: u32| bits <= 8));
    }
    assert!(lossy["stages"].as_array().expect("stages").iter().any(|s| s["name"] == "ranges"));
    let usual = bake(&["-o", "b.mipvog"]);
    assert!(usual["options"].get("max_error").is_none());
    assert!(lossy["output_bytes"].as_u64() < usual["output_bytes"].as_u64());

    // People see the same with three digits, none too few.
    let text = run(here, &["inspect", "b.mipvog", "-v"]);
    let text = String::from_utf8_lossy(&text.stdout).into_owned();
    let cells: Vec<&str> = text.split(" bit ").skip(1).collect();
    assert_eq!(cells.len(), groups(&usual).len(), "{text}");
    for (cell, group) in cells.into_iter().zip(groups(&usual)) {
        let shown = cell.split_whitespace().next().and_then(|shown| shown.parse::<f64>().ok());
        let (shown, error) = (shown.expect("a number"), group["max_error"].as_f64().expect("one"));
        assert!((error..error * 1.01).contains(&shown), "{shown} for {error}");
    }

    // An unpacked container keeps its error where it is baked anew, unless bits are asked for.
    report(here, &["unpack", "a.mipvog", "-o", "a.safetensors"]);
    let again = |more: &[&str]| {
        report(here, &[&["bake", "a.safetensors", "-o", "c.mipvog", "--force"], more].concat())
    };
    let same = again(&[]);
    assert_eq!((&same["output_bytes"], groups(&same)), (&lossy["output_bytes"], groups(&lossy)));
    assert_eq!(
        again(&["--block-size", "4"])["options"]["max_error"],
        lossy["options"]["max_error"]
    );
    let deep = again(&["--block-size", "4", "--bits", "12"]);
    assert!(deep["options"].get("max_error").is_none());
    assert_eq!(deep["levels"][0]["groups"][0]["bits"], "12");
    let coarse = again(&["--max-error", "0.1"]);
    assert!(coarse["output_bytes"].as_u64() < lossy["output_bytes"].as_u64());
    // Errors add up: those of the first bake are still there.
    for (coarse, lossy) in groups(&coarse).iter().zip(groups(&lossy)) {
        let [after, before] = [coarse, &lossy].map(|g| g["max_error"].as_f64().expect("an error"));
        assert!(before <= after && after <= before + 0.1 + 1e-6, "{coarse}");
    }

    // One error for each group.
    let apart = bake(&["-o", "d.mipvog", "--max-error", "0.02:0.01:0.06"]);
    assert_eq!(apart["options"]["max_error"], "0.02:0.01:0.06");
    for group in groups(&apart) {
        let most = match group["group"].as_str() {
            Some("density" | "anisotropy") => Some(0.02),
            Some("diffuse" | "directional") => Some(0.01),
            Some("features") => Some(0.06),
            _ => None,
        };
        assert!(group["max_error"].as_f64() <= most.map(|most: f32| most.into()), "{group}");
    }
    report(here, &["unpack", "d.mipvog", "-o", "a.safetensors", "--force"]);
    assert_eq!(again(&["--block-size", "4"])["options"]["max_error"], "0.02:0.01:0.06");

    let bad = ["bake", &scene, "-o", "x.mipvog", "--max-error"];
    refused(here, &[&bad[..], &["0.1:0.2"]].concat(), 2, &["--max-error", "colons"]);
    for error in ["0", "0.5", "nan", "1e-7", "0.01:0.5:0.01"] {
        refused(here, &[&bad[..], &[error]].concat(), 2, &["--max-error", "1e-6 to 0.25"]);
    }
    refused(here, &[&bad[..], &["0.01", "--bits", "8"]].concat(), 2, &["--bits", "--max-error"]);
}

#[test]
fn settings_are_swept_and_resumed() {
    let folder = folder();
    let here = folder.path();
    let tiny = fixture("trained/tiny/fine_last.tar").display().to_string();
    let view = ["--turntable", "2", "--size", "16x16", "--scales", "1,4"];
    let lists = ["--bits", "6,f16", "--filter", "code,mean3", "--preset", "web", "-o", "out"];
    let arguments = [&["sweep", &tiny], &view[..], &lists].concat();
    let first = report(here, &arguments);
    let settings = first["settings"].as_array().expect("settings");
    assert_eq!(settings.len(), 5);
    assert_eq!(settings[4]["preset"], "web");
    for setting in settings {
        let file = here.join("out").join(setting["file"].as_str().expect("a name"));
        let bytes = std::fs::metadata(file).expect("baked").len();
        assert_eq!((&setting["output_bytes"], &setting["resumed"]), (&bytes.into(), &false.into()));
        // The first thing that the front must have is the smallest.
        let smallest = settings.iter().all(|other| other["output_bytes"].as_u64() >= Some(bytes));
        assert!(!smallest || setting["fronts"][0]["bytes"] == true, "{setting}");
    }
    let again = report(here, &arguments);
    assert!(again["settings"].as_array().expect("settings").iter().all(|s| s["resumed"] == true));
    let text = run(here, &arguments);
    let text = String::from_utf8_lossy(&text.stdout).into_owned();
    assert!(text.contains("code-6bit-t1e-3-b8-z1 ") && text.contains("*"), "{text}");
    assert!(text.contains("5 of 5 settings were finished before"), "{text}");

    let bad = |more: &[&str], code: i32, says: &str| {
        let arguments = [&["sweep", &tiny, "-o", "new"], &view[..], more].concat();
        refused(here, &arguments, code, &[says]);
    };
    bad(&["--bits", "8,3"], 2, "--bits");
    bad(&["--max-error", "0.01,1"], 2, "--max-error");
    bad(&["--filter", "code,sharp"], 2, "mean5");
    bad(&["--alpha-threshold", "1e-3,2"], 2, "--alpha-threshold");
    bad(&["--scales", "99"], 2, "--scales");
    bad(&["--repeat", "0"], 2, "--repeat");
    report(here, &["bake", &tiny, "-o", "a.mipvog"]);
    report(here, &["unpack", "a.mipvog", "-o", "a.safetensors"]);
    let unpacked = [&["sweep", "a.safetensors", "-o", "new"], &view[..]].concat();
    refused(here, &unpacked, 2, &["a.safetensors", "trained"]);
    std::fs::create_dir(here.join("new")).expect("writable");
    std::fs::write(here.join("new/sweep.csv"), "mine").expect("writable");
    bad(&[], 7, "sweep.csv");
    assert_eq!(entries(&here.join("new")), ["sweep.csv"]);

    // An input that cannot be rendered has nothing to compare with: no setting's fault, and nothing
    // is written.
    let mut bytes = std::fs::read(fixture("trained/dvgo/flat.safetensors")).expect("a fixture");
    let header = usize::from(u16::from_le_bytes([bytes[0], bytes[1]]));
    let density = 8 + header + 44..8 + header + 1304;
    bytes[density].as_chunks_mut().0.fill(f32::NAN.to_le_bytes());
    std::fs::write(here.join("nan.safetensors"), bytes).expect("writable");
    let nan = [&["sweep", "nan.safetensors", "-o", "nan"], &view[..]].concat();
    refused(here, &nan, 3, &["nan.safetensors", "not finite"]);
}

#[test]
fn no_option_of_a_bake_is_ignored() {
    let folder = folder();
    let here = folder.path();
    let tiny = fixture("baked/tiny.rate.filled.mipvog").display().to_string();
    report(here, &["unpack", &tiny, "-o", "a.safetensors"]);
    let bake = ["bake", "a.safetensors", "-o", "x.mipvog"];
    let refuse = |options: &[&str]| {
        refused(here, &[&bake[..], options].concat(), 2, &[options[0]]);
    };
    refuse(&["--fill-error", "0.1"]);
    refuse(&["--nonfinite", "empty"]);
    refuse(&["--fit-steps", "3"]);
    refuse(&["--fit-seconds", "3"]);
    refuse(&["--stepsize", "0.25"]);
    refuse(&["--mlp", "none"]);
    refuse(&["--coarse", "a.safetensors"]);
    refuse(&["--memory", "1G"]);
    refuse(&["--turntable", "1"]);
    refuse(&["--size", "8x8"]);
    refuse(&["--frames", "1"]);
    refuse(&["--min-weight", "0.1"]);
    refuse(&["--coarseness", "1"]);
    refuse(&["--dry-run"]);
    // The finest level is baked anew, and the option counts.
    let anew = ["--filter", "mean3", "--nonfinite", "empty", "--fill-error", "0.1"];
    report(here, &[&bake[..], &anew].concat());
    let trained = ["bake", &scene(), "-o", "y.mipvog"];
    refused(here, &[&trained[..], &["--fit-steps", "3"]].concat(), 2, &["--fit-steps"]);
    refused(here, &[&trained[..], &["--size", "8x8"]].concat(), 2, &["--size"]);
    // Level 0 alone can be filtered again.
    report(here, &["unpack", &tiny, "-o", "b.safetensors", "--levels", "1"]);
    let coarse = ["bake", "b.safetensors", "-o", "z.mipvog", "--filter", "mean3"];
    let output = run(here, &coarse);
    assert!(!output.status.success());
}
