//! `bake --manifest`, and `report` of its results.

use std::path::Path;
use std::process::{Command, Output};

use crate::common::{assert_follows, assert_schema, fixture, folder, program};
use serde_json::{Value, json};

pub fn run(here: &Path, arguments: &[&str]) -> Output {
    program().current_dir(here).args(arguments).output().expect("starts")
}

pub fn code(output: &Output) -> i32 {
    output.status.code().expect("a code")
}

pub fn words(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The results on stdout, held to their schema.
fn results(output: &Output) -> Vec<Value> {
    let text = String::from_utf8(output.stdout.clone()).expect("text");
    let results = text.lines().map(|line| serde_json::from_str(line).expect("a line of JSON"));
    results.inspect(|result| assert_follows("scene-result", result)).collect()
}

pub fn write(path: &Path, lines: &[Value]) {
    let text: String = lines.iter().map(|line| format!("{line}\n")).collect();
    std::fs::write(path, text).expect("writable");
}

/// A catalogue: `in/scenes.jsonl` of six scenes, the fourth of which is damaged, beside its inputs.
pub fn catalogue(here: &Path) {
    let inputs = here.join("in");
    std::fs::create_dir(&inputs).expect("a folder");
    let tiny = fixture("trained/tiny/fine_last.tar");
    std::fs::copy(&tiny, inputs.join("tiny.tar")).expect("copied");
    let whole = std::fs::read(&tiny).expect("a checkpoint");
    std::fs::write(inputs.join("cut.tar"), &whole[..whole.len() / 2]).expect("writable");
    let scene = |number: usize| {
        let input = if number == 3 { "cut.tar" } else { "tiny.tar" };
        let options = json!({ "stepsize": 0.5, "bits": 6 + number });
        json!({ "input": input, "output": format!("{number}/scene.mipvog"), "options": options })
    };
    write(&inputs.join("scenes.jsonl"), &(0..6).map(scene).collect::<Vec<_>>());
}

/// The bytes of a single bake.
fn single(here: &Path, bits: usize) -> Vec<u8> {
    let bits = bits.to_string();
    let output = format!("single-{bits}.mipvog");
    let arguments =
        ["bake", "in/tiny.tar", "--stepsize", "0.5", "--bits", &bits, "-o", &output, "--quiet"];
    assert_eq!(code(&run(here, &arguments)), 0);
    std::fs::read(here.join(output)).expect("a container")
}

#[test]
fn shards_bake_every_scene_once_and_go_on_after_a_failure() {
    let folder = folder();
    let here = folder.path();
    catalogue(here);
    let manifest = "in/scenes.jsonl";
    let mut told = Vec::new();
    for (shard, want) in [("0/2", 0), ("1/2", 1)] {
        let file = format!("results-{}.jsonl", &shard[..1]);
        let arguments =
            ["bake", "--manifest", manifest, "--shard", shard, "-o", "out", "--results", &file];
        let output = run(here, &arguments);
        assert_eq!(code(&output), want, "{}", words(&output));
        let results = results(&output);
        let written = std::fs::read(here.join(file)).expect("results");
        assert_eq!(written, output.stdout);
        assert_eq!(results.len(), 3);
        told.extend(results);
    }
    told.sort_by_key(|result| result["output"].to_string());
    for (number, result) in told.iter().enumerate() {
        let path = here.join(format!("out/{number}/scene.mipvog"));
        assert_eq!(result["output"], format!("{number}/scene.mipvog"));
        if number == 3 {
            assert_eq!((&result["status"], &result["exit_code"]), (&json!("failed"), &json!(3)));
            assert!(!path.exists());
            continue;
        }
        assert_eq!(result["status"], "baked");
        let bytes = std::fs::read(path).expect("a container");
        assert_eq!(result["output_bytes"], bytes.len());
        assert!(bytes == single(here, 6 + number), "scene {number}");
    }
    // Again: what is there is current, and only the input that was mended is baked.
    std::fs::copy(here.join("in/tiny.tar"), here.join("in/cut.tar")).expect("copied");
    let all = ["bake", "--manifest", manifest, "-o", "out", "--if-changed", "--quiet"];
    let output = run(here, &all);
    assert_eq!(code(&output), 0, "{}", words(&output));
    let results = results(&output);
    let baked = results.iter().filter(|result| result["status"] == "baked");
    assert_eq!(baked.map(|result| &result["output"]).collect::<Vec<_>>(), ["3/scene.mipvog"]);
    assert_eq!(results.iter().filter(|result| result["status"] == "current").count(), 5);

    std::fs::write(here.join("results-2.jsonl"), &output.stdout).expect("writable");
    let files = ["results-0.jsonl", "results-1.jsonl", "results-2.jsonl"];
    let output = run(here, &["report", files[0], files[1], "--format", "json"]);
    assert_eq!(code(&output), 1);
    let report: Value = serde_json::from_slice(&output.stdout).expect("a report");
    assert_schema("report", &report);
    assert_eq!(
        (&report["scenes"], &report["baked"], &report["failed"]),
        (&json!(6), &json!(5), &json!(1))
    );
    assert_eq!(report["failures"][0]["output"], "3/scene.mipvog");
    assert_eq!(report["failures"][0]["retry"], "no");
    let output = run(here, &["report", files[0], files[1], "--junit", "results.xml"]);
    assert_eq!(code(&output), 1, "{}", words(&output));
    let xml = std::fs::read_to_string(here.join("results.xml")).expect("written");
    assert!(xml.contains("<testsuite name=\"mipvog-bake\" tests=\"6\" failures=\"1\""), "{xml}");
    assert_eq!(xml.matches("<testcase ").count(), 6, "{xml}");
    assert!(
        xml.contains("name=\"3/scene.mipvog\"") && xml.contains("<failure type=\"exit code 3\"")
    );
    // A later result counts.
    let output = run(here, &["report", files[0], files[1], files[2]]);
    assert_eq!(code(&output), 0, "{}", words(&output));
    let text = String::from_utf8(output.stdout).expect("text");
    assert!(text.starts_with("6 scenes: 1 baked, 5 unchanged, 0 failed"), "{text}");
}

#[test]
fn a_scene_by_its_number_has_its_own_exit_code() {
    let folder = folder();
    let here = folder.path();
    catalogue(here);
    let bake =
        |number: &str| run(here, &["bake", "--manifest", "in/scenes.jsonl", "--index", number]);
    let output = bake("0");
    assert_eq!(code(&output), 0, "{}", words(&output));
    assert_eq!(results(&output)[0]["status"], "baked");
    assert!(here.join("in/0/scene.mipvog").is_file(), "outputs lie beside the manifest");
    let again = bake("0");
    assert_eq!(code(&again), 7);
    assert_eq!(results(&again)[0]["exit_code"], 7);
    let damaged = bake("3");
    assert_eq!(code(&damaged), 3);
    let result = &results(&damaged)[0];
    assert!(result["error"].as_str().expect("words").contains("cut.tar"), "{result}");
    let beyond = bake("6");
    assert_eq!(code(&beyond), 2);
    assert!(words(&beyond).contains("expected one of 0 to 5"), "{}", words(&beyond));
    let forecast = ["bake", "--manifest", "in/scenes.jsonl", "--index", "1", "--dry-run"];
    let forecast = run(here, &forecast);
    let result = &results(&forecast)[0];
    assert_eq!(result["status"], "forecast");
    assert!(result["peak_memory_bytes"].as_u64() > Some(1 << 20), "{result}");
    assert!(!here.join("in/1").exists());
}

#[test]
fn schedulers_set_the_number_of_a_task() {
    let folder = folder();
    let here = folder.path();
    catalogue(here);
    let bake = |variables: &[(&str, &str)]| -> Command {
        let mut command = program();
        command.current_dir(here).envs(variables.iter().copied());
        command.args(["bake", "--manifest", "in/scenes.jsonl", "--index-from-env", "--force"]);
        command
    };
    for (variable, value) in [
        ("SLURM_ARRAY_TASK_ID", "1"),
        ("AWS_BATCH_JOB_ARRAY_INDEX", "1"),
        ("PBS_ARRAY_INDEX", "1"),
        ("SGE_TASK_ID", "2"),
        ("LSB_JOBINDEX", "2"),
        ("CLOUD_RUN_TASK_INDEX", "1"),
        ("JOB_COMPLETION_INDEX", "1"),
    ] {
        let output = bake(&[(variable, value)]).output().expect("starts");
        assert_eq!(code(&output), 0, "{variable}: {}", words(&output));
        assert_eq!(results(&output)[0]["output"], "1/scene.mipvog", "{variable}");
    }
    for variables in [
        &[][..],
        &[("SGE_TASK_ID", "undefined")],
        &[("LSB_JOBINDEX", "0")],
        &[("PBS_ARRAY_INDEX", "x")],
    ] {
        let output = bake(variables).output().expect("starts");
        assert_eq!(code(&output), 2, "{variables:?}");
        assert!(words(&output).contains("array of tasks"), "{}", words(&output));
    }
}

#[test]
fn options_of_the_command_line_count_for_all_and_those_of_a_line_override_them() {
    let folder = folder();
    let here = folder.path();
    catalogue(here);
    let lines = [
        json!({ "input": "tiny.tar", "output": "a.mipvog" }),
        json!({ "input": "tiny.tar", "output": "b.mipvog", "options": { "bits": "9", "near": null } }),
        json!({ "input": "tiny.tar", "output": "c.mipvog", "options": { "cameras": "none.json" } }),
        json!({ "input": "tiny.tar", "output": "d.mipvog", "options": { "if_changed": true } }),
    ];
    write(&here.join("in/some.jsonl"), &lines);
    let arguments = ["bake", "--manifest", "in/some.jsonl", "--stepsize", "0.5", "--bits", "7"];
    let output = run(here, &arguments);
    assert_eq!(code(&output), 1, "{}", words(&output));
    let results = results(&output);
    let codes: Vec<_> = results.iter().map(|result| result["exit_code"].as_u64()).collect();
    // What a line alone lacks is a fault of that scene alone.
    assert_eq!(codes, [Some(0), Some(0), Some(5), Some(0)]);
    assert!(std::fs::read(here.join("in/a.mipvog")).expect("a container") == single(here, 7));
    assert!(std::fs::read(here.join("in/b.mipvog")).expect("a container") == single(here, 9));
    // A value that no bake takes is wrong usage of the whole: nothing is baked.
    let line = json!({ "input": "tiny.tar", "output": "e.mipvog", "options": { "max_error": [0.1, 0.2] } });
    write(&here.join("in/some.jsonl"), &[line]);
    let output = run(here, &arguments);
    assert_eq!(code(&output), 2, "{}", words(&output));
    assert!(words(&output).contains("line 1") && !here.join("in/e.mipvog").exists());
}

#[test]
fn results_replace_results_and_nothing_else() {
    let folder = folder();
    let here = folder.path();
    catalogue(here);
    let arguments =
        ["bake", "--manifest", "in/scenes.jsonl", "--index", "0", "--if-changed", "--results", "r"];
    assert_eq!(code(&run(here, &arguments)), 0);
    assert_eq!(code(&run(here, &arguments)), 0);
    let text = std::fs::read_to_string(here.join("r")).expect("results");
    assert_eq!((text.lines().count(), text.contains("current")), (1, true));
    std::fs::write(here.join("r"), "a letter\n").expect("writable");
    assert_eq!(code(&run(here, &arguments)), 7);
    assert_eq!(std::fs::read_to_string(here.join("r")).expect("a letter"), "a letter\n");
    let report = run(here, &["report", "r"]);
    assert_eq!(code(&report), 3);
    assert!(words(&report).contains("r: line 1: found no result of a scene"), "{}", words(&report));
}

#[test]
#[cfg(target_os = "linux")]
fn memory_holds_no_more_than_the_names_of_a_long_manifest() {
    let folder = folder();
    let here = folder.path();
    let scenes = 100_000;
    let line = |number: usize| {
        let options = json!({ "cameras": "x".repeat(1000), "stepsize": 0.5 });
        json!({ "input": format!("{number}.tar"), "output": format!("{number}.mipvog"),
                "options": options })
    };
    let text: String = (0..scenes).map(|number| format!("{}\n", line(number))).collect();
    std::fs::write(here.join("long.jsonl"), &text).expect("writable");
    let bytes = text.len() as u64;
    drop(text);
    // A bound on the address space: the manifest's bytes do not fit beside the program.
    let script = format!(
        "ulimit -v {}; exec \"$0\" bake --manifest long.jsonl --shard 99999/100000 --threads 1",
        (bytes + (20 << 20)) / 1024
    );
    let mut command = Command::new("sh");
    command.args(["-c", &script, env!("CARGO_BIN_EXE_mipvog-bake")]).current_dir(here);
    // The C library would reserve more for a second thread than all else takes.
    command.env("MALLOC_ARENA_MAX", "1");
    let output = command.output().expect("starts");
    assert_eq!(code(&output), 1, "{}", words(&output));
    let results = results(&output);
    assert_eq!(results.len(), 1);
    assert_eq!((&results[0]["exit_code"], &results[0]["input"]), (&json!(5), &json!("99999.tar")));
}
