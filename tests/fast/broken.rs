//! Broken files, one for each finding: `validate` names the exact fault of each, strict readers
//! refuse it. `BLESS=1 cargo test broken` writes them anew.

use crate::common;
use std::collections::BTreeSet;
use std::path::Path;

use crate::common::broken::{SOUND, files, said};
use crate::common::{
    Random, Schema, assert_golden, chunks, fixture, folder, grid_values, open_bytes, random_field,
};
use mipvog::base::error::ErrorKind;
use mipvog::base::finding::{Code, Severity};
use mipvog::base::limits::Limits;
use mipvog_bake::check::{CheckOptions, Report, check_with, health, sarif};
use serde_json::{Value, json};

fn options() -> CheckOptions {
    let mut options = CheckOptions::default();
    options.source = said();
    options
}

fn checked(path: &Path) -> Report {
    check_with(path, &options(), &Limits::default()).expect("a file that can be read")
}

/// The committed files, by name.
fn committed() -> Vec<String> {
    let folder = std::fs::read_dir(fixture("broken")).expect("the folder of broken files");
    let mut names: Vec<String> =
        folder.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn broken_files_are_what_their_generator_makes() {
    let mut made = files();
    made.sort();
    for (name, bytes) in &made {
        assert_golden(&fixture("broken").join(name), bytes);
    }
    let made: Vec<String> = made.into_iter().map(|(name, _)| name).collect();
    assert_eq!(committed(), made);
}

#[test]
fn every_finding_has_a_file_that_gives_it_and_no_other() {
    let mut missed: BTreeSet<&str> = Code::ALL.iter().map(|code| code.name()).collect();
    for name in committed() {
        let report = checked(&fixture("broken").join(&name));
        let found: BTreeSet<&str> = report.findings.iter().map(|f| f.code.name()).collect();
        if name == SOUND {
            assert!(report.valid && found.is_empty(), "{found:?}");
            continue;
        }
        let code = name.split_once('.').expect("a name with an extension").0;
        assert_eq!(found, BTreeSet::from([code]), "{name}: {:?}", report.findings);
        let severity = report.findings[0].code.severity();
        assert_eq!(report.valid, severity == Severity::Warning, "{name}");
        assert!(missed.remove(code), "{name}: no such code, or a second file");
    }
    assert!(missed.is_empty(), "no file gives {missed:?}");
}

#[test]
fn strict_readers_refuse_broken_containers() {
    for name in committed().iter().filter(|name| name.ends_with(".mipvog") && *name != SOUND) {
        let bytes = std::fs::read(fixture("broken").join(name)).expect("a file");
        let read = open_bytes(&bytes).and_then(|container| {
            container.verify()?;
            container.provenance()?;
            container.read()
        });
        assert!(read.is_err(), "{name} was read");
    }
}

#[test]
fn validation_does_not_stop_at_the_first_finding() {
    let folder = folder();
    let path = folder.path().join("x.mipvog");
    let sound = std::fs::read(fixture("broken").join(SOUND)).expect("a container");
    let mut parts = chunks::chunks(&sound);
    let end = parts.len() - 1;
    parts.remove(end);
    for (kind, junk) in [(*b"prov", &b" "[..]), (*b"VMLP", &[0; 4]), (*b"TABL", &[0])] {
        let chunk = parts.iter_mut().find(|chunk| chunk.kind == kind).expect("a chunk");
        chunk.bytes.extend(junk);
    }
    let entries = chunks::entries(&parts);
    let mut bytes = chunks::file(&entries, &parts);
    let atlas = entries.iter().rfind(|entry| entry.kind == *b"DIFF").expect("colour");
    bytes[atlas.offset as usize] ^= 1;
    bytes.push(0);
    std::fs::write(&path, bytes).expect("writable");
    let report = checked(&path);
    let found: BTreeSet<&str> = report.findings.iter().map(|f| f.code.name()).collect();
    let expected = ["chunk-checksum", "chunk-missing", "length", "network", "provenance", "table"];
    assert_eq!(found, BTreeSet::from(expected), "{:?}", report.findings);
    // A checkpoint too.
    let mut checkpoint = common::checkpoint::Checkpoint::sound();
    checkpoint.settings.retain(|setting| setting.0 != "num_voxels");
    checkpoint.values("k0.grid")[0] = f32::INFINITY;
    checkpoint.values("density.grid")[0] = -1e9;
    let path = folder.path().join("x.safetensors");
    std::fs::write(&path, checkpoint.to_bytes()).expect("writable");
    let found: Vec<&str> = checked(&path).findings.iter().map(|f| f.code.name()).collect();
    assert_eq!(found, ["unstated", "values-range", "values-nonfinite"]);
}

#[test]
fn health_is_what_a_plain_count_finds() {
    let mut random = Random::new(12);
    for nodes in [[2, 2, 2], [7, 2, 5], [13, 9, 70]] {
        let field = random_field(&mut random, nodes, 5);
        let mut broken = Vec::new();
        let health = health::check(&field, &mut |finding| {
            broken.push(finding.code);
            Ok(())
        });
        let health = health.expect("no findings stop it").expect("readable");
        let (density, color) = (grid_values(&field.density), grid_values(&field.color[0]));
        let activation = &field.scene.activation;
        let opacity = |raw: f32| {
            let sigma = (f64::from(raw) + f64::from(activation.shift)).exp().ln_1p();
            1.0 - (-sigma * f64::from(activation.interval)).exp()
        };
        let seen: Vec<bool> = density.iter().map(|&raw| opacity(raw) > 1e-3).collect();
        let empty = seen.iter().filter(|seen| !**seen).count();
        assert_eq!(health.empty_share, empty as f64 / seen.len() as f64);
        assert_eq!((health.nodes, health.nonfinite), (seen.len() as u64, 0));
        let range = |values: &mut dyn Iterator<Item = f32>| {
            let mut values: Vec<f32> = values.collect();
            values.sort_by(f32::total_cmp);
            Some([*values.first()?, *values.last()?])
        };
        let all: Vec<&[f32]> =
            std::iter::once(&density[..]).chain(color.chunks(seen.len())).collect();
        assert_eq!(health.channels.len(), all.len());
        for (channel, values) in health.channels.iter().zip(all) {
            assert_eq!(channel.range, range(&mut values.iter().copied()));
            let visible = values.iter().zip(&seen).filter(|(_, seen)| **seen);
            assert_eq!(channel.seen_range, range(&mut visible.map(|(&value, _)| value)));
        }
        assert_eq!(broken.contains(&Code::SpaceEmpty), empty == seen.len());
    }
}

#[test]
fn broken_values_are_counted_and_the_first_is_told() {
    let nodes = [4, 3, 5];
    let density: Vec<f32> = (0..60).map(|node| if node % 2 == 0 { 25.0 } else { -50.0 }).collect();
    let mut color: Vec<f32> = (0..180).map(|value| value as f32 * 0.01).collect();
    let at = |channel: usize, [x, y, z]: [usize; 3]| ((channel * 4 + x) * 3 + y) * 5 + z;
    color[at(1, [2, 1, 3])] = f32::NAN;
    color[at(1, [3, 2, 4])] = f32::INFINITY;
    let reported = |color: &[f32]| {
        let mut errors = Vec::new();
        let health = health::check(&common::field(nodes, &density, color), &mut |finding| {
            errors.push((finding.code, finding.error));
            Ok(())
        });
        assert_eq!(health.expect("no findings stop it").expect("readable").nonfinite, 2);
        errors
    };
    // The largest value that training may end with is none too many.
    (color[at(2, [0, 0, 0])], color[at(0, [3, 2, 4])]) = (10_000.0, -10_000.0);
    let errors = reported(&color);
    let [(Code::ValuesNonfinite, error)] = &errors[..] else { panic!("{errors:?}") };
    assert!(
        matches!(error.kind(), ErrorKind::NonFinite { count: 2, first: [1, 2, 1, 3] }),
        "{error}"
    );
    color[at(2, [0, 0, 0])] = 10_000.001;
    let errors = reported(&color);
    assert!(matches!(errors[..], [_, (Code::ValuesRange, _)]), "{errors:?}");
    // Nor has a checkpoint whose checksums are right a finding of them.
    let codes: Vec<Code> = checked(&fixture("trained/tiny/fine_last.tar"))
        .findings
        .iter()
        .map(|finding| finding.code)
        .collect();
    assert!(!codes.contains(&Code::ValuesChecksum), "{codes:?}");
}

#[test]
fn numbers_of_nothing_are_told_as_such() {
    let folder = folder();
    let path = folder.path().join("x.gltf");
    let text = json!({
        "asset": { "version": "2.0" },
        "accessors": [{ "componentType": 5126, "count": 3, "type": "VEC3",
                        "min": [0, 0, 0], "max": [1, 1, 1] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 1 } }] }],
        "scene": 5,
    });
    std::fs::write(&path, text.to_string()).expect("writable");
    let report = checked(&path);
    let told = |place: &str, message: &str| {
        let mut findings = report.findings.iter();
        findings.any(|finding| finding.place.ends_with(place) && finding.message.contains(message))
    };
    let place = "/meshes/0/primitives/0/attributes/POSITION";
    assert!(told(place, "accessor 1") && told("/scene", "index out of range"), "{report:?}");
}

/// An asset with a thousand broken rules.
fn thousandfold(path: &Path) {
    let nodes: Vec<Value> = (0..1000).map(|node| json!({ "mesh": node })).collect();
    let text = json!({ "asset": { "version": "2.0" }, "nodes": nodes });
    std::fs::write(path, text.to_string()).expect("writable");
}

#[test]
fn findings_beyond_the_bound_are_counted() {
    let folder = folder();
    let path = folder.path().join("x.gltf");
    thousandfold(&path);
    let mut options = options();
    for most in [0, 10, 1000, 2000] {
        options.max_findings = most;
        let report = check_with(&path, &options, &Limits::default()).expect("readable");
        assert_eq!(report.findings.len(), most.min(1000));
        assert_eq!(report.unlisted, 1000 - report.findings.len());
    }
    // A message does not grow with the file.
    let asset = std::fs::read(fixture("broken/field-hash.gltf")).expect("an asset");
    let long = common::asset::changed(&asset, |document| {
        let field = &mut document["extensions"][common::asset::NAME]["radianceFields"][0];
        field["sha256"] = "é".repeat(100_000).into();
    });
    std::fs::copy(fixture("broken").join(SOUND), folder.path().join(SOUND)).expect("copied");
    std::fs::write(&path, long).expect("writable");
    let report = checked(&path);
    assert_eq!(report.findings[0].code, Code::FieldHash);
    assert!(report.findings[0].message.len() < 2000, "{}", report.findings[0].message);
}

#[test]
fn logs_are_sarif() {
    let schema = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/sarif/sarif-schema-2.1.0.json");
    let mut schema: Value =
        serde_json::from_slice(&std::fs::read(schema).expect("a schema")).expect("JSON");
    // As published it is no regular expression that every engine takes; the errata mend it so.
    for part in ["run", "toolComponent"] {
        schema["definitions"][part]["properties"]["language"]["pattern"] =
            json!("^[a-zA-Z]{2}(-[a-zA-Z]{2})?$");
    }
    let schema = Schema::new([("memory:///sarif".to_owned(), schema)]);
    let errors = |log: &Value| schema.error(log);
    let bytes = |path: &Path| path.metadata().expect("a file").len();
    let folder = folder();
    let many = folder.path().join("a file with 100%.gltf");
    thousandfold(&many);
    let broken = committed().into_iter().map(|name| fixture("broken").join(name));
    for path in broken.chain([many]) {
        let mut options = options();
        options.max_findings = 500;
        let report = check_with(&path, &options, &Limits::default()).expect("readable");
        let (found, unlisted) = (report.findings.clone(), report.unlisted);
        let log = sarif::log(&[(path.clone(), Ok(report))]);
        assert_eq!(errors(&log), None, "{}", path.display());
        let run = &log["runs"][0];
        let rules = run["tool"]["driver"]["rules"].as_array().expect("rules");
        assert_eq!(rules.len(), Code::ALL.len());
        let results = run["results"].as_array().expect("results");
        assert_eq!(results.len(), found.len());
        // Sections 3.27.5 and 3.27.6: the index is that of the rule of the same name.
        for (result, finding) in results.iter().zip(&found) {
            let index = result["ruleIndex"].as_u64().expect("an index") as usize;
            assert_eq!(rules[index]["id"], result["ruleId"]);
            assert_eq!(result["ruleId"], finding.code.name());
            let region = &result["locations"][0]["physicalLocation"]["region"];
            assert_eq!(region["byteOffset"].as_u64(), Some(finding.offset.unwrap_or(0)));
            let length = if finding.offset.is_some() { 1 } else { bytes(&path) };
            assert_eq!(region["byteLength"].as_u64(), Some(length));
        }
        let told = &run["invocations"][0]["toolExecutionNotifications"];
        assert_eq!(told.as_array().map(Vec::len), Some(usize::from(unlisted > 0)));
        let uri = run["artifacts"][0]["location"]["uri"].as_str().expect("a URI");
        assert!(!uri.contains(' ') && !uri.ends_with("100%.gltf"), "{uri}");
    }
    // Several files are one run, for services refuse a second one of the same tool; a file that
    // cannot be read is told of there.
    let files = ["asset-rule.gltf", "gone"].map(|name| fixture("broken").join(name));
    let report = check_with(&files[0], &options(), &Limits::default()).expect("readable");
    let results = report.findings.len();
    let [first, gone] = files;
    let log = sarif::log(&[(first.clone(), Ok(report)), (gone, Err("gone".to_owned()))]);
    assert_eq!(errors(&log), None);
    let runs = log["runs"].as_array().expect("runs");
    assert_eq!(runs.len(), 1);
    assert_eq!(runs[0]["results"].as_array().map(Vec::len), Some(results));
    assert_eq!(runs[0]["artifacts"].as_array().map(Vec::len), Some(2));
    assert_eq!(runs[0]["invocations"][0]["executionSuccessful"], false);
    let rules = runs[0]["tool"]["driver"]["rules"].as_array().expect("rules");
    assert!(rules.iter().all(|rule| rule["fullDescription"]["text"].is_string()));
    // The schema is one that can refuse.
    assert!(errors(&json!({ "version": "2.1.0" })).is_some());
}
