//! `formats/container.toml`: what a container consists of.

use std::collections::BTreeMap;

use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    pub version: [u16; 2],
    pub feature: Vec<Feature>,
    pub chunk: Vec<Chunk>,
    pub group: Vec<Group>,
    #[serde(rename = "enum")]
    pub enums: Vec<Enum>,
    pub object: Vec<Object>,
    pub choice: Vec<Choice>,
}

/// A required feature; its bit is its place in the list.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Feature {
    pub name: String,
    pub since: u16,
    pub label: String,
    pub doc: String,
    #[serde(rename = "where")]
    pub condition: String,
}

/// A chunk that is no atlas.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Chunk {
    pub kind: String,
    pub name: String,
    pub doc: String,
}

/// Values that share an encoding and an atlas.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Group {
    pub name: String,
    key: Option<String>,
    /// The place in a list of encodings.
    pub item: Option<usize>,
    pub kind: String,
    pub channels: Channels,
    pub color: bool,
    pub label: String,
    pub decodes: Vec<String>,
}

#[derive(Deserialize)]
#[serde(untagged)]
pub enum Channels {
    Count(usize),
    /// The key of the metadata that counts them.
    Key(String),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Enum {
    pub name: String,
    /// The Rust type, where it is not written by hand.
    pub rust: Option<String>,
    #[serde(default)]
    pub doc: String,
    pub variants: Vec<Variant>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Variant {
    pub name: String,
    #[serde(default)]
    pub doc: String,
    /// True for the variant that a missing key stands for.
    #[serde(default)]
    pub unwritten: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Object {
    pub name: String,
    /// The Rust type, where it is not written by hand.
    pub rust: Option<String>,
    pub ts: String,
    #[serde(default)]
    pub copy: bool,
    /// True for what trained fields have too.
    #[serde(default)]
    pub trained: bool,
    /// False where code holds the values to their ranges, as a whole.
    #[serde(default = "yes")]
    pub ranges: bool,
    #[serde(default)]
    pub doc: String,
    pub fields: Vec<Field>,
}

fn yes() -> bool {
    true
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Field {
    pub key: String,
    #[serde(rename = "type")]
    form: String,
    pub since: Option<u16>,
    pub rust: Option<String>,
    name: Option<String>,
    /// True where a limit that users set bounds the number.
    #[serde(default)]
    pub limited: bool,
    #[serde(default)]
    pub doc: String,
    pub holds: Option<String>,
}

/// An object that is one of two: `key` tells which.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Choice {
    pub name: String,
    pub rust: String,
    pub key: String,
    pub with: String,
    pub without: String,
    pub doc: String,
}

/// The type of a field.
#[derive(Clone, PartialEq, Debug)]
pub enum Type {
    F32(Range),
    Whole(u64, u64),
    Bool,
    Text,
    Named(String),
    List(Box<Type>, u64, u64),
    Nullable(Box<Type>),
}

#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Range {
    Finite,
    Positive,
    FromZero,
    Share,
}

impl Group {
    /// The key of its encoding in a level.
    pub fn key(&self) -> &str {
        self.key.as_deref().unwrap_or(&self.name)
    }
}

impl Field {
    pub fn name(&self) -> &str {
        self.name.as_deref().unwrap_or(&self.key)
    }

    /// # Panics
    /// For a type that the description's grammar does not have.
    pub fn form(&self) -> Type {
        Type::parse(&self.form).unwrap_or_else(|| panic!("{}: no type {}", self.key, self.form))
    }
}

impl Type {
    fn parse(text: &str) -> Option<Self> {
        let text = text.trim();
        if let Some(rest) = text.strip_prefix("null or ") {
            return Some(Self::Nullable(Box::new(Self::parse(rest)?)));
        }
        if let Some(inner) = text.strip_prefix('[') {
            let (item, count) = inner.strip_suffix(']')?.rsplit_once(';')?;
            let (least, most) = span(count).or_else(|| {
                let count = count.trim().parse().ok()?;
                Some((count, count))
            })?;
            return Some(Self::List(Box::new(Self::parse(item)?), least, most));
        }
        if let Some(range) = text.strip_prefix("whole ") {
            return span(range).map(|(least, most)| Self::Whole(least, most));
        }
        Some(match text {
            "f32" => Self::F32(Range::Finite),
            "f32 > 0" => Self::F32(Range::Positive),
            "f32 >= 0" => Self::F32(Range::FromZero),
            "f32 0..<1" => Self::F32(Range::Share),
            "bool" => Self::Bool,
            "text" => Self::Text,
            name if name.chars().all(|letter| letter.is_ascii_lowercase() || letter == '_') => {
                Self::Named(name.to_owned())
            }
            _ => return None,
        })
    }
}

/// `A..B`, both inclusive.
fn span(text: &str) -> Option<(u64, u64)> {
    let (least, most) = text.trim().split_once("..")?;
    Some((least.parse().ok()?, most.parse().ok()?))
}

impl Description {
    /// # Panics
    /// Where the description is not of its form, or names what it does not describe.
    pub fn parse(text: &str) -> Self {
        let description: Self = toml::from_str(text).unwrap_or_else(|error| panic!("{error}"));
        let names: BTreeMap<&str, usize> =
            description.names().fold(BTreeMap::new(), |mut all, name| {
                *all.entry(name).or_default() += 1;
                all
            });
        assert!(names.values().all(|&count| count == 1), "a name is described twice");
        for field in description.object.iter().flat_map(|object| &object.fields) {
            let mut form = field.form();
            while let Type::List(item, ..) | Type::Nullable(item) = form {
                form = *item;
            }
            if let Type::Named(name) = form {
                assert!(
                    names.contains_key(name.as_str()),
                    "{}: nothing describes {name}",
                    field.key
                );
            }
        }
        description
    }

    fn names(&self) -> impl Iterator<Item = &str> {
        let enums = self.enums.iter().map(|one| one.name.as_str());
        let objects = self.object.iter().map(|one| one.name.as_str());
        enums.chain(objects).chain(self.choice.iter().map(|one| one.name.as_str()))
    }

    pub fn find_enum(&self, name: &str) -> Option<&Enum> {
        self.enums.iter().find(|one| one.name == name)
    }

    pub fn find_object(&self, name: &str) -> Option<&Object> {
        self.object.iter().find(|one| one.name == name)
    }

    pub fn find_choice(&self, name: &str) -> Option<&Choice> {
        self.choice.iter().find(|one| one.name == name)
    }
}

/// `Words` of `words_in_snake_case`.
pub fn camel(name: &str) -> String {
    let word = |word: &str| {
        let mut letters = word.chars();
        letters
            .next()
            .map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
    };
    name.split('_').map(word).collect()
}
