//! Arguments of benchmarks: a scene, the settings that it leaves unsaid, and each benchmark's own
//! options.

use std::path::PathBuf;
use std::str::FromStr;

use mipvog::base::limits::Limits;
use mipvog::model::field::RadianceField;
use mipvog_inputs::SourceOptions;

/// A scene and further options.
pub struct Arguments {
    /// The scene; without one it is `fixtures/trained/lego64`.
    pub scene: PathBuf,
    options: SourceOptions,
    own: Vec<(String, String)>,
}

impl Arguments {
    /// The command line's arguments. `own` names the benchmark's own options.
    pub fn read(own: &[&str]) -> Self {
        let fixture =
            PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures/trained/lego64/fine_last.tar");
        let options = SourceOptions { stepsize: Some(0.5), ..SourceOptions::default() };
        let mut read = Self { scene: fixture, options, own: Vec::new() };
        let mut words = std::env::args().skip(1);
        while let Some(word) = words.next() {
            // `cargo bench` adds this itself.
            if word == "--bench" {
                continue;
            }
            if !word.starts_with("--") {
                read.scene = PathBuf::from(word);
                continue;
            }
            let value = words.next().unwrap_or_else(|| panic!("{word} needs a value"));
            match word.as_str() {
                "--stepsize" => read.options.stepsize = Some(number(&value)),
                "--near" => read.options.near = Some(number(&value)),
                "--far" => read.options.far = Some(number(&value)),
                word if own.contains(&word) => read.own.push((word.to_owned(), value)),
                _ => panic!("{word} is no option"),
            }
        }
        read
    }

    /// One of the benchmark's own options.
    pub fn own(&self, name: &str) -> Option<&str> {
        self.own.iter().rfind(|(word, _)| word == name).map(|(_, value)| value.as_str())
    }

    /// The scene, opened.
    pub fn field(&self) -> RadianceField {
        mipvog_inputs::open_with(&self.scene, &self.options, &Limits::default())
            .expect("a scene")
            .field
    }
}

/// A number from the command line.
pub fn number<T: FromStr>(text: &str) -> T {
    text.parse().unwrap_or_else(|_| panic!("{text} is no number of the right kind"))
}
