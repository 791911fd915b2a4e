//! The specification's tables against the code. `BLESS=1 cargo test --test spec` writes the
//! catalogue of findings anew.

use std::path::Path;

use crate::common::assert_golden;
use mipvog::bake::BAKE_OPTIONS;
use mipvog::base::error::Place;
use mipvog::base::finding::{Code, Severity};
use mipvog::base::limits::{LimitName, Limits};
use mipvog::container::layout::{
    ALIGNMENT, ATLASES, ENTRY_BYTES, HEADER_BYTES, MASK, META, PROVENANCE, SIGNATURE, TABLE,
    VERSION, VMLP,
};
use mipvog::model::baked::{Codes, Decode, NumberType};
use mipvog::quantize::{Frame, FrameShape, run_bytes, run_codes};

const SPEC: &str = include_str!("../../formats/mipvog.md");
const CATALOGUE: &str = include_str!("../../formats/validation.md");

fn name(value: impl serde::Serialize) -> String {
    let value = serde_json::to_value(value).expect("a name");
    value.as_str().expect("text").to_owned()
}

#[test]
fn number_types_have_their_rows() {
    for number in [NumberType::U8, NumberType::U16, NumberType::F16, NumberType::F32] {
        let row = format!("| `{}` | {} |", name(number), number.bytes());
        assert_eq!(SPEC.matches(&row).count(), 1, "formats/mipvog.md should hold {row}");
    }
    for decode in Decode::ALL {
        let row = format!("| `{}` | ", name(decode));
        assert_eq!(SPEC.matches(&row).count(), 1, "formats/mipvog.md should hold {row}");
    }
}

#[test]
fn constants_are_those_of_the_page() {
    let hex: Vec<String> = SIGNATURE.iter().map(|byte| format!("{byte:02X}")).collect();
    assert!(SPEC.contains(&format!("signature `{}`", hex.join(" "))));
    assert!(SPEC.contains(&format!("version {}.{}", VERSION[0], VERSION[1])));
    assert_eq!((HEADER_BYTES, ENTRY_BYTES, ALIGNMENT), (64, 64, 64));
    for kind in [META, VMLP, MASK, PROVENANCE, TABLE].into_iter().chain(ATLASES) {
        assert!(SPEC.contains(&kind.escape_ascii().to_string()), "no chunk {kind:?}");
    }
}

#[test]
fn the_page_of_limits_has_those_of_the_code() {
    let page = include_str!("../../formats/limits.md");
    let head = "| name | bounds | default |\n|---|---|---|\n";
    let start = page.find(head).expect("the table") + head.len();
    let end = start + page[start..].find("\n\n").map_or(0, |end| end + 1);
    let mut limits = Limits::default();
    let rows = LimitName::ALL.iter().map(|&limit| {
        let (name, bounds, most) = (limit.name(), limit.meaning(), *limits.get_mut(limit));
        let power = match most.is_power_of_two() && most > 1 << 12 {
            true => format!(" (2^{})", most.ilog2()),
            false => String::new(),
        };
        format!("| `{name}` | {bounds} | {most}{power} |\n")
    });
    let wanted = [&page[..start], &rows.collect::<String>(), &page[end..]].concat();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("formats/limits.md");
    assert_golden(&path, wanted.as_bytes());
}

/// A help text as a cell of a table: options in backquotes, and the default apart.
fn cell(help: &str) -> [String; 2] {
    let (text, default) = help.split_once(" [default: ").unwrap_or((help, ""));
    let quoted = |text: &str| {
        let words = text.split(' ').map(|word| match word.strip_prefix("--") {
            Some(name) => {
                let end = name.find(|c: char| !c.is_ascii_lowercase() && c != '-');
                let (name, rest) = name.split_at(end.unwrap_or(name.len()));
                format!("`--{name}`{rest}")
            }
            None => word.to_owned(),
        });
        words.collect::<Vec<_>>().join(" ")
    };
    [quoted(text), default.trim_end_matches(']').to_owned()]
}

#[test]
fn the_page_of_bake_has_the_options_of_the_code() {
    let page = include_str!("../../docs/verbs/bake.md");
    let (before, rest) = page.split_once("<!-- generated: options -->\n").expect("the mark");
    let (_, after) = rest.split_once("<!-- end -->").expect("its end");
    let rows = BAKE_OPTIONS.iter().map(|option| {
        let [text, default] = cell(option.help);
        let values = option.choices.map_or(Vec::new(), |choices| choices());
        let values: Vec<String> = values.iter().map(|(name, _)| format!("`{name}`")).collect();
        let values = match values.len() {
            1..=8 => format!(": {}", values.join(", ")),
            _ => String::new(),
        };
        format!("| `--{}` | {text}{values} | {default} |\n", option.key)
    });
    let table =
        format!("\n| option | purpose | default |\n|---|---|---|\n{}\n", rows.collect::<String>());
    let wanted = [before, "<!-- generated: options -->\n", &table, "<!-- end -->", after].concat();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/verbs/bake.md");
    assert_golden(&path, wanted.as_bytes());
}

#[test]
fn the_options_of_python_follow_from_the_parser() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/mipvog_bake/_bake_options.py");
    assert_golden(&path, mipvog_bake::cli::python_options().as_bytes());
}

#[test]
fn schemas_of_reports_follow_from_their_types() {
    use mipvog_bake::cli::{schema_text, schemas};
    for (name, schema) in schemas() {
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("formats/{name}.schema.json"));
        assert_golden(&path, schema_text(&schema).as_bytes());
    }
}

/// The table of findings, as the code lists them.
fn catalogue() -> String {
    let mut table =
        "| code | severity | meaning | place | remedy |\n|---|---|---|---|---|\n".to_owned();
    for &code in Code::ALL {
        let severity = match code.severity() {
            Severity::Error => "error",
            Severity::Warning => "warning",
        };
        let [name, meaning, place, remedy] =
            [code.name(), code.meaning(), code.place(), code.remedy()];
        table += &format!("| `{name}` | {severity} | {meaning} | {place} | {remedy} |\n");
    }
    table
}

#[test]
fn the_catalogue_lists_every_finding_and_no_other() {
    let start = CATALOGUE.find("| code |").expect("the table");
    let rest = &CATALOGUE[start..];
    let end = start + rest.find("\n\n").map_or(rest.len(), |end| end + 1);
    let page = [&CATALOGUE[..start], &catalogue(), &CATALOGUE[end..]].concat();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("formats/validation.md");
    assert_golden(&path, page.as_bytes());
}

/// The codes of the worked example: one frame of one channel, in blocks of 2 nodes a side.
const EXAMPLE: [u8; 8] = [10, 12, 10, 11, 10, 11, 13, 14];

#[test]
fn the_worked_example_is_what_the_code_makes_and_reads() {
    let shape = FrameShape { number: NumberType::U8, channels: 1, edge: 2 };
    let frame = Frame { codes: Codes::U8(EXAMPLE.to_vec()), retained: vec![true; 8].into() };
    let bytes = run_bytes(shape, &[frame], 0).bytes;
    let start = SPEC.find("bytes  meaning").expect("the example's table of bytes");
    let table = SPEC[start..].split("```").next().expect("it ends");
    let mut stated = Vec::new();
    for row in table.lines().skip(1) {
        let cells = row.split("  ").next().unwrap_or_default().split_whitespace();
        stated.extend(cells.map(|byte| u8::from_str_radix(byte, 16).expect("a byte")));
    }
    assert_eq!(stated, bytes, "{bytes:02X?}");
    let mut codes = [0u8; 8];
    run_codes(shape, &stated, &mut codes, &Place::File).expect("a run");
    assert_eq!(codes, EXAMPLE);
    let listed = EXAMPLE.map(|code| code.to_string()).join(", ");
    assert!(SPEC.contains(&format!("codes are `{listed}`")), "the page should list {listed}");
}
