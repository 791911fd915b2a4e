//! Manifests that are refused, and where outputs may lie.

use crate::common::folder;
use crate::manifest::{catalogue, code, run, words, write};
use serde_json::{Value, json};

#[test]
fn a_bad_manifest_is_refused_before_any_scene_is_baked() {
    let folder = folder();
    let here = folder.path();
    catalogue(here);
    let sound = r#"{"input": "tiny.tar", "output": "x.mipvog", "options": {"stepsize": 0.5}}"#;
    for (line, found) in [
        ("{", "no JSON"),
        ("[]", "found a list"),
        (r#"{"output": "a"}"#, "found no input"),
        (r#"{"input": "a"}"#, "found no output"),
        (r#"{"input": 1, "output": "a"}"#, "found input: a number"),
        (r#"{"input": "", "output": "a"}"#, "found input \"\""),
        (r#"{"input": "-", "output": "a"}"#, "found input \"-\""),
        (r#"{"input": "a", "output": "b", "option": {}}"#, "found key option"),
        (r#"{"input": "a", "output": "b", "options": []}"#, "found options: a list"),
        (r#"{"input": "a", "output": "b", "options": {"bit": 8}}"#, "found option bit"),
        (r#"{"input": "a", "output": "b", "options": {"manifest": "c"}}"#, "found option manifest"),
        (r#"{"input": "a", "output": "b", "options": {"dry_run": true}}"#, "found option dry_run"),
        (r#"{"input": "a", "output": "b", "options": {"threads": 2}}"#, "found option threads"),
        (
            r#"{"input": "a", "output": "b", "options": {"bits": {}}}"#,
            "found option bits: an object",
        ),
        (sound, "found output x.mipvog, which line 1 writes too"),
        (
            r#"{"input": "a", "output": "./x.mipvog"}"#,
            "found output ./x.mipvog, which line 1 writes too",
        ),
        ("\u{1}\u{fe}", "no JSON"),
        (
            r#"{"input": "a", "output": "b", "options": {"alpha_threshold": 0.1, "alpha-threshold": 0.2}}"#,
            "in two spellings",
        ),
        (r#"{"input": "a", "output": "b", "output": "c"}"#, "found key output twice"),
        (
            r#"{"input": "a", "output": "b", "options": {"bits": 8, "bits": 4}}"#,
            "found key bits twice",
        ),
        (r#"{"input": "a", "output": "b/"}"#, "found output b/, a folder"),
        (r#"{"input": "a", "output": "b\u0000c"}"#, "a name with a NUL character"),
        (r#"{"input": "x.mipvog", "output": "b"}"#, "found input x.mipvog, which line 1 writes"),
        (r#"{"input": "a", "output": "tiny.tar"}"#, "found output tiny.tar, which line 1 reads"),
        (
            r#"{"input": "a", "output": "b", "options": {"depfile": "./tiny.tar"}}"#,
            "found depfile ./tiny.tar, which line 1 reads",
        ),
    ] {
        std::fs::write(here.join("in/bad.jsonl"), format!("{sound}\n\n{line}\n"))
            .expect("writable");
        let output = run(here, &["bake", "--manifest", "in/bad.jsonl"]);
        let words = words(&output);
        assert_eq!(code(&output), 3, "{line}: {words}");
        assert!(words.contains("in/bad.jsonl: line 3: "), "{line}: {words}");
        assert!(words.contains(found) && words.contains("expected"), "{line}: {words}");
        assert!(words.contains("help: correct this line"), "{words}");
        assert!(output.stdout.is_empty() && !here.join("in/x.mipvog").exists());
    }
    // Nor are results written over a scene's files.
    std::fs::write(here.join("in/one.jsonl"), format!("{sound}\n")).expect("writable");
    for results in ["in/tiny.tar", "in/x.mipvog"] {
        let arguments = ["bake", "--manifest", "in/one.jsonl", "--force", "--results", results];
        let output = run(here, &arguments);
        assert_eq!(code(&output), 3, "{}", words(&output));
        assert!(words(&output).contains("--results writes"), "{}", words(&output));
        assert!(!here.join("in/x.mipvog").exists());
    }
    // Only a folder of the command line bounds the outputs: a line may name any place by itself.
    for output in ["../x.mipvog", "/x.mipvog", "a/../../x.mipvog"] {
        let line = format!(r#"{{"input": "tiny.tar", "output": "{output}"}}"#);
        std::fs::write(here.join("in/bad.jsonl"), line).expect("writable");
        let output = run(here, &["bake", "--manifest", "in/bad.jsonl", "-o", "out"]);
        assert_eq!(code(&output), 3, "{}", words(&output));
        assert!(words(&output).contains("expected a path below the folder of --output"));
        assert!(!here.join("out").exists());
    }
    std::fs::write(here.join("in/bad.jsonl"), b"\xff\n").expect("writable");
    assert_eq!(code(&run(here, &["bake", "--manifest", "in/bad.jsonl"])), 3);
    std::fs::write(here.join("in/bad.jsonl"), "\n\n").expect("writable");
    assert_eq!(code(&run(here, &["bake", "--manifest", "in/bad.jsonl"])), 3);
    assert_eq!(code(&run(here, &["bake", "--manifest", "in/none.jsonl"])), 5);
    let both = ["bake", "in/tiny.tar", "-o", "x.mipvog", "--manifest", "in/scenes.jsonl"];
    assert_eq!(code(&run(here, &both)), 2);
    assert_eq!(code(&run(here, &["bake", "in/tiny.tar"])), 2);
    assert_eq!(code(&run(here, &["bake", "-o", "x.mipvog"])), 2);
    assert_eq!(code(&run(here, &["bake", "in/tiny.tar", "-o", "x.mipvog", "--shard", "0/2"])), 2);
    let shard = ["bake", "--manifest", "in/scenes.jsonl", "--shard", "2/2"];
    assert_eq!(code(&run(here, &shard)), 2);
}

/// A scene's line with these options.
fn scene_with(output: &str, options: &Value) -> Value {
    json!({ "input": "tiny.tar", "output": output, "options": options })
}

#[test]
fn every_file_of_a_line_lies_below_the_folder_and_is_its_own() {
    let folder = folder();
    let here = folder.path();
    catalogue(here);
    let manifest = here.join("in/scenes.jsonl");
    let elsewhere = here.join("elsewhere.glb");
    let elsewhere = elsewhere.to_str().expect("text");
    let beside = json!({ "gltf": "a.glb", "depfile": "a.d" });
    let wrong: [(&[Value], i32, &str); 9] = [
        (&[json!({ "gltf": elsewhere })], 3, "gltf"),
        (&[json!({ "gltf": "../a.glb" })], 3, "gltf ../a.glb"),
        (&[json!({ "depfile": "x/../../a.d" })], 3, "depfile"),
        (&[beside.clone(), beside.clone()], 3, "which line 1 writes too"),
        (&[json!({ "gltf": "1.mipvog" }), json!({})], 3, "line 2"),
        (&[json!({}), json!({ "bits": 99 })], 2, "line 2"),
        (&[json!({}), json!({ "alpha_threshold": 7 })], 2, "line 2"),
        (&[json!({}), json!({ "block_size": "many" })], 2, "line 2"),
        (&[json!({}), json!({ "gltf": "s3://bucket/a.glb" })], 2, "line 2"),
    ];
    for (options, want, says) in wrong {
        let lines = (0..).zip(options);
        let lines = lines.map(|(number, own)| scene_with(&format!("{number}.mipvog"), own));
        write(&manifest, &lines.collect::<Vec<_>>());
        let output = run(here, &["bake", "--manifest", "in/scenes.jsonl", "-o", "out", "--force"]);
        let told = words(&output);
        assert_eq!(code(&output), want, "{options:?}: {told}");
        assert!(told.contains(says), "{options:?}: {told}");
        // Nothing was baked before the line was refused.
        assert!(!here.join("out").exists() && !here.join("elsewhere.glb").exists(), "{told}");
    }
    // Sound ones lie beside their container.
    write(
        &manifest,
        &[scene_with("b/scene.mipvog", &json!({ "gltf": "b/a.glb", "depfile": "b/a.d" }))],
    );
    let output = run(here, &["bake", "--manifest", "in/scenes.jsonl", "-o", "out"]);
    assert_eq!(code(&output), 0, "{}", words(&output));
    for name in ["scene.mipvog", "a.glb", "a.d"] {
        assert!(here.join("out/b").join(name).is_file(), "{name}");
    }
    // Without -o they lie beside the manifest, and two lines still have files of their own.
    write(&manifest, &[scene_with("a.mipvog", &beside), scene_with("x/../b.mipvog", &beside)]);
    let output = run(here, &["bake", "--manifest", "in/scenes.jsonl", "--force"]);
    assert_eq!(code(&output), 3, "{}", words(&output));
}
