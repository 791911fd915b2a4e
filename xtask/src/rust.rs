//! Rust: structs and names of the metadata, chunk types and ranges.

use std::fmt::Write as _;

use crate::description::{Description, Enum, Field, Object, Range, Type, camel};
use crate::text::doc_comment;

const HEAD: &str = "//! Written by `cargo xtask generate` from `formats/container.toml`.\n";

/// Reports of the program hold these objects, and their schemas follow from them.
const SCHEMA: &str = "#[cfg_attr(feature = \"schemas\", derive(schemars::JsonSchema))]\n";

/// What the attributes of fields name.
const HELPERS: &str = "\
/// True for a value that says nothing, whose key is left out.
pub(super) fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// A key that must be there, though its value may be null.
pub(super) fn nullable<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    from: D,
) -> std::result::Result<Option<T>, D::Error> {
    Option::deserialize(from)
}
";

/// Enums of the metadata, and objects that trained fields have too.
pub fn model(description: &Description) -> String {
    let mut out = format!(
        "//! Objects of a container's metadata that trained fields have too, and enums.\n//!\n{HEAD}\n\
         use serde::{{Deserialize, Deserializer, Serialize}};\n\nuse crate::model::grid::Bounds;\n\n"
    );
    for one in &description.enums {
        out += &rust_enum(one);
    }
    for object in description.object.iter().filter(|object| object.trained) {
        out += &rust_struct(object, description);
    }
    out + HELPERS
}

/// The other objects of the metadata.
pub fn baked(description: &Description) -> String {
    let mut out = format!(
        "//! Objects of a container's metadata.\n//!\n{HEAD}\nuse serde::{{Deserialize, Serialize}};\n\n\
         use super::bends::Bends;\nuse super::domain::Decode;\nuse super::harmonics::HarmonicsMetadata;\n\
         use crate::model::generated::{{\n    Activation, Blend, ColorSpace, FootprintNeighbour, March, NumberType, StepRule,\n    \
         ViewInput, is_default, nullable,\n}};\nuse crate::model::grid::Bounds;\n\n"
    );
    for object in description.object.iter().filter(|object| !object.trained) {
        out += &rust_struct(object, description);
    }
    for choice in &description.choice {
        let [with, without] = [&choice.with, &choice.without].map(|name| {
            let own = description.find_object(name).and_then(|object| object.rust.clone());
            own.unwrap_or_else(|| format!("{}Metadata", camel(name)))
        });
        out += &doc_comment("///", &choice.doc, 0);
        out += "#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]\n";
        out += SCHEMA;
        out += "#[serde(untagged)]\n";
        let (one, other) = (camel(&choice.with), camel(&choice.without));
        writeln!(out, "pub enum {} {{", choice.rust).ok();
        writeln!(
            out,
            "    /// {one}.\n    {one}({with}),\n    /// {other}.\n    {other}({without}),\n}}\n"
        )
        .ok();
    }
    out
}

fn rust_enum(one: &Enum) -> String {
    let Some(name) = &one.rust else { return String::new() };
    let has_default = one.variants.iter().any(|variant| variant.unwritten);
    let default = if has_default { "Default, " } else { "" };
    let mut out = doc_comment("///", &one.doc, 0);
    writeln!(out, "#[derive(Debug, Clone, Copy, PartialEq, Eq, {default}Serialize, Deserialize)]")
        .ok();
    out += SCHEMA;
    writeln!(out, "#[serde(rename_all = \"snake_case\")]\npub enum {name} {{").ok();
    for variant in &one.variants {
        out += &doc_comment("///", &variant.doc, 4);
        if variant.unwritten {
            out += "    #[default]\n";
        }
        writeln!(out, "    {},", camel(&variant.name)).ok();
    }
    out + "}\n\n"
}

fn rust_struct(object: &Object, description: &Description) -> String {
    let Some(name) = &object.rust else { return String::new() };
    let copy = if object.copy { "Copy, " } else { "" };
    let mut out = doc_comment("///", &object.doc, 0);
    writeln!(out, "#[derive(Debug, Clone, {copy}PartialEq, Serialize, Deserialize)]").ok();
    out += SCHEMA;
    writeln!(out, "#[serde(deny_unknown_fields)]\npub struct {name} {{").ok();
    for field in &object.fields {
        let of = rust_type(field, description);
        out += &doc_comment("///", &field.doc, 4);
        let mut rules = Vec::new();
        if field.name() != field.key {
            rules.push(format!("rename = \"{}\"", field.key));
        }
        if field.since.is_some() {
            let absent = match of.split_once('<') {
                Some((outer, _)) => {
                    format!("{outer}::is_{}", if outer == "Option" { "none" } else { "empty" })
                }
                None => "is_default".to_owned(),
            };
            rules.push(format!("default, skip_serializing_if = \"{absent}\""));
        } else if of.starts_with("Option<") {
            // The key is there even where the value is null.
            rules.push("deserialize_with = \"nullable\"".to_owned());
        }
        // Types that are written by hand have a form of their own.
        let own_form = match field.rust.as_deref() {
            Some("Decode") => Some("String"),
            Some("Bends") => Some("Vec<[f32; 2]>"),
            _ => None,
        };
        if let Some(form) = own_form {
            writeln!(out, "    #[cfg_attr(feature = \"schemas\", schemars(with = \"{form}\"))]")
                .ok();
        }
        if !rules.is_empty() {
            writeln!(out, "    #[serde({})]", rules.join(", ")).ok();
        }
        writeln!(out, "    pub {}: {of},", field.name()).ok();
    }
    out + "}\n\n"
}

/// The Rust type of a field. A key that may be missing is an option, unless its type has a value
/// that says nothing: an empty list, a count of 0, or the variant that is not written.
fn rust_type(field: &Field, description: &Description) -> String {
    if let Some(own) = &field.rust {
        return own.clone();
    }
    let form = field.form();
    let says_nothing = match &form {
        Type::Whole(..) => true,
        Type::List(_, least, most) => least != most,
        Type::Named(name) => {
            description.find_enum(name).is_some_and(|one| one.variants.iter().any(|v| v.unwritten))
        }
        _ => false,
    };
    let of = name_of(&form, description);
    if field.since.is_some() && !says_nothing { format!("Option<{of}>") } else { of }
}

fn name_of(form: &Type, description: &Description) -> String {
    match form {
        Type::F32(_) => "f32".to_owned(),
        Type::Whole(..) => "usize".to_owned(),
        Type::Bool => "bool".to_owned(),
        Type::Text => "String".to_owned(),
        Type::Nullable(inner) => format!("Option<{}>", name_of(inner, description)),
        Type::List(item, least, most) => {
            let item = name_of(item, description);
            if least == most { format!("[{item}; {most}]") } else { format!("Vec<{item}>") }
        }
        Type::Named(name) => {
            let own = description.find_enum(name).and_then(|one| one.rust.as_ref());
            let own =
                own.or_else(|| description.find_object(name).and_then(|one| one.rust.as_ref()));
            let own = own.or_else(|| description.find_choice(name).map(|one| &one.rust));
            own.map_or_else(|| "Bounds".to_owned(), Clone::clone)
        }
    }
}

/// Chunk types, required features and ranges of values.
pub fn container(description: &Description) -> String {
    let mut out = format!(
        "//! Chunk types, required features, and ranges of the metadata's values.\n//!\n{HEAD}\n\
         use super::held::Rules;\n\
         use crate::base::error::Result;\nuse crate::model::baked::{{GROUPS, Metadata, ViewMetadata}};\n\n"
    );
    let [major, minor] = description.version;
    out += "/// Version of the format: readers refuse another major one, and ignore a higher minor one.\n";
    writeln!(out, "pub const VERSION: [u16; 2] = [{major}, {minor}];").ok();
    for (bit, feature) in description.feature.iter().enumerate() {
        let doc = format!("Required feature, since 1.{}: {}", feature.since, lower(&feature.doc));
        out += &doc_comment("///", &doc, 0);
        writeln!(out, "pub const {}: u64 = {};", feature.name.to_uppercase(), 1u64 << bit).ok();
    }
    let all = (1u64 << description.feature.len()) - 1;
    let known: Vec<String> = description
        .feature
        .iter()
        .enumerate()
        .map(|(bit, one)| format!("{bit} ({})", one.label))
        .collect();
    writeln!(out, "/// Features that a reader must know.\npub const KNOWN_FEATURES: u64 = {all};")
        .ok();
    writeln!(
        out,
        "/// The same for messages.\npub const KNOWN_FEATURE_BITS: &str = \"bits {}\";",
        known.join(", ")
    )
    .ok();
    let since: Vec<String> = description.feature.iter().map(|one| one.since.to_string()).collect();
    writeln!(
        out,
        "/// The minor version that added each feature.\npub const FEATURES_SINCE: [u16; {}] = [{}];",
        since.len(),
        since.join(", ")
    )
    .ok();
    out += "/// Type of a chunk. The first letter is lower case in ancillary chunks, which readers may skip.\n\
            pub type ChunkKind = [u8; 4];\n";
    for chunk in &description.chunk {
        out += &doc_comment("///", &chunk.doc, 0);
        writeln!(out, "pub const {}: ChunkKind = *b\"{}\";", chunk.name, chunk.kind).ok();
    }
    let names: Vec<&str> = description.chunk.iter().map(|chunk| chunk.name.as_str()).collect();
    writeln!(
        out,
        "/// Every chunk type but those of atlases.\npub const CHUNKS: [ChunkKind; {}] = [{}];",
        names.len(),
        names.join(", ")
    )
    .ok();
    let kinds: Vec<String> =
        description.group.iter().map(|group| format!("*b\"{}\"", group.kind)).collect();
    writeln!(
        out,
        "/// Atlases of a level, in the order of [`crate::model::baked::Group::ALL`].\n\
         pub const ATLASES: [ChunkKind; GROUPS] = [{}];\n",
        kinds.join(", ")
    )
    .ok();
    out + &ranges(description)
}

/// A function that holds the values of the metadata, but of levels, to their ranges.
fn ranges(description: &Description) -> String {
    let mut out =
        "/// Holds values to their ranges.\n///\n/// # Errors\n/// The first of a strict reader.\n\
                   pub(super) fn ranges(metadata: &Metadata, rules: &mut Rules) -> Result<()> {\n"
            .to_owned();
    let metadata = description.find_object("metadata").expect("the metadata");
    for field in &metadata.fields {
        match field.form() {
            Type::Named(name) => {
                let object = description.find_object(&name);
                for inner in object
                    .filter(|object| object.ranges)
                    .into_iter()
                    .flat_map(|object| &object.fields)
                {
                    let value = format!("metadata.{}.{}", field.name(), inner.name());
                    out += &check(&value, &format!("{}.{}", field.key, inner.key), inner);
                }
            }
            Type::Nullable(inner) => {
                let Type::Named(name) = *inner else { continue };
                let Some(choice) = description.find_choice(&name) else { continue };
                let network = description.find_object(&choice.without).expect("it is described");
                writeln!(
                    out,
                    "    if let Some({}::Network(view)) = &metadata.{} {{",
                    choice.rust,
                    field.name()
                )
                .ok();
                for inner in &network.fields {
                    out += &check(
                        &format!("view.{}", inner.name()),
                        &format!("{}.{}", field.key, inner.key),
                        inner,
                    );
                }
                out += "    }\n";
            }
            _ => out += &check(&format!("metadata.{}", field.name()), &field.key, field),
        }
    }
    out + "    Ok(())\n}\n"
}

/// Calls of `require` for one field; none where any value will do.
fn check(value: &str, key: &str, field: &Field) -> String {
    let form = field.form();
    let is_option = field.since.is_some() || matches!(form, Type::Nullable(_));
    let form = match form {
        Type::Nullable(inner) => *inner,
        form => form,
    };
    if field.limited {
        return String::new();
    }
    let require = |holds: String, found: String, expected: String| {
        format!("    rules.require({holds}, \"{key}\", {found}, \"{expected}\")?;\n")
    };
    match form {
        Type::F32(range) => {
            let (test, expected) = range_test(range);
            let expected =
                if is_option { format!("{expected}, or null") } else { expected.to_owned() };
            match is_option {
                true => {
                    let holds = format!("{value}.is_none_or(|value| {})", test("value"));
                    require(holds, format!("{value}.unwrap_or_default()"), expected)
                }
                false => require(test(value), value.to_owned(), expected),
            }
        }
        Type::Whole(least, most) => {
            let holds = format!("({least}..={most}).contains(&{value})");
            require(holds, value.to_owned(), format!("{least} to {most}"))
        }
        Type::List(item, least, most) => {
            list_check(value, &item, [least, most], is_option, &require)
        }
        _ => String::new(),
    }
}

fn list_check(
    value: &str,
    item: &Type,
    [least, most]: [u64; 2],
    is_option: bool,
    require: &dyn Fn(String, String, String) -> String,
) -> String {
    let mut out = String::new();
    if least != most {
        let expected = format!("{least} to {most} of them");
        // A list that may be left out is empty then.
        let least = if is_option { 0 } else { least };
        let holds = format!("({least}..={most}).contains(&{value}.len())");
        out += &require(holds, format!("{value}.len()"), expected);
    }
    let (test, expected) = match item {
        Type::F32(range) => {
            let (test, expected) = range_test(*range);
            (test("value"), expected.to_owned())
        }
        Type::Whole(least, most) => {
            (format!("({least}..={most}).contains(&value)"), format!("{least} to {most}"))
        }
        _ => return out,
    };
    let items =
        if is_option { format!("{value}.iter().flatten()") } else { format!("{value}.iter()") };
    out + &require(
        format!("{items}.all(|&value| {test})"),
        format!("format!(\"{{:?}}\", {value})"),
        format!("each {expected}"),
    )
}

type Test = fn(&str) -> String;

fn range_test(range: Range) -> (Test, &'static str) {
    match range {
        Range::Finite => (|value| format!("{value}.is_finite()"), "a finite number"),
        Range::Positive => {
            (|value| format!("{value} > 0.0 && {value}.is_finite()"), "a positive number")
        }
        Range::FromZero => {
            (|value| format!("{value} >= 0.0 && {value}.is_finite()"), "a number from 0")
        }
        Range::Share => (|value| format!("(0.0..1.0).contains(&{value})"), "0 to below 1"),
    }
}

fn lower(sentence: &str) -> String {
    let mut letters = sentence.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}
