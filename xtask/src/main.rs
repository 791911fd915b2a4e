//! `cargo xtask generate` writes everything that follows from `formats/container.toml`;
//! `cargo xtask generate --check` says what is stale.

mod description;
mod markdown;
mod python;
mod rust;
mod text;
mod typescript;

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};

use description::Description;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let check = match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["generate"] => false,
        ["generate", "--check"] => true,
        _ => {
            eprintln!("usage: cargo xtask generate [--check]");
            return ExitCode::from(2);
        }
    };
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the repository");
    let read = |name: &str| std::fs::read_to_string(root.join(name)).unwrap_or_default();
    let description = Description::parse(&read("formats/container.toml"));
    let spec = "formats/mipvog.md";
    let files = [
        ("crates/format/src/model/generated.rs", formatted(root, &rust::model(&description))),
        ("crates/format/src/model/baked/generated.rs", formatted(root, &rust::baked(&description))),
        (
            "crates/format/src/container/generated.rs",
            formatted(root, &rust::container(&description)),
        ),
        ("viewer/src/format/generated.ts", typescript::format(&description)),
        ("tests/second_reader/tables.py", python::tables(&description)),
        (spec, markdown::page(&read(spec), &description)),
    ];
    let stale: Vec<_> = files.iter().filter(|(name, text)| read(name) != *text).collect();
    for (name, text) in &stale {
        match check {
            true => eprintln!("{name} is stale: cargo xtask generate"),
            false => {
                std::fs::write(root.join(name), text)
                    .unwrap_or_else(|error| panic!("{name}: {error}"));
                println!("{name}");
            }
        }
    }
    if check && !stale.is_empty() { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

/// Rust as `cargo fmt` writes it.
fn formatted(root: &Path, text: &str) -> String {
    let mut rustfmt = Command::new("rustfmt")
        .args(["--edition", "2024", "--emit", "stdout", "--config-path"])
        .arg(root)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("rustfmt is installed with Rust");
    rustfmt.stdin.take().expect("a pipe").write_all(text.as_bytes()).expect("it reads");
    let output = rustfmt.wait_with_output().expect("it ends");
    assert!(output.status.success(), "rustfmt refused what was generated");
    String::from_utf8(output.stdout).expect("text")
}
