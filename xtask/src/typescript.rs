//! TypeScript: types and rules of the metadata, chunk types, groups and required features.

use std::fmt::Write as _;

use crate::description::{Channels, Description, Field, Object, Range, Type};

pub fn format(description: &Description) -> String {
    let mut out = "/** Written by `cargo xtask generate` from `formats/container.toml`. */\n\n\
                   import { boolean, choice, finite, fromZero, list, nullable, oneOf, optional, positive, record, share, text, whole } from \"./rules.js\";\n\n\
                   export type Triple = [number, number, number];\n\n"
        .to_owned();
    let quoted = |names: Vec<&str>| {
        names.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ")
    };
    writeln!(
        out,
        "/** The major version that this reader knows. */\nexport const MAJOR = {};",
        description.version[0]
    )
    .ok();
    let features =
        quoted(description.feature.iter().map(|feature| feature.name.as_str()).collect());
    writeln!(out, "/** Required features, from bit 0 on. */\nexport const FEATURES = [{features}] as const;\nexport type Feature = (typeof FEATURES)[number];").ok();
    let kinds = description.chunk.iter().map(|chunk| chunk.kind.as_str());
    let kinds =
        quoted(kinds.chain(description.group.iter().map(|group| group.kind.as_str())).collect());
    writeln!(out, "/** Every chunk type. */\nexport const KNOWN: readonly string[] = [{kinds}];")
        .ok();
    out += "/** Groups of values, in the order of their atlases: the encoding is a level's `key`, of a list the `item` of it. */\n\
            export const GROUPS = [\n";
    for group in &description.group {
        let item = group.item.map_or_else(String::new, |item| format!(", item: {item}"));
        let channels = match &group.channels {
            Channels::Count(count) => count.to_string(),
            Channels::Key(key) => format!("\"{key}\""),
        };
        let (name, key, kind, color) = (&group.name, group.key(), &group.kind, group.color);
        writeln!(out, "  {{ name: \"{name}\", kind: \"{kind}\", key: \"{key}\"{item}, channels: {channels}, color: {color} }},").ok();
    }
    out += "] as const;\n\n";
    for object in &description.object {
        out += &interface(object, description);
    }
    for object in &description.object {
        let export = if object.name == "metadata" { "export " } else { "" };
        writeln!(out, "{export}const {}_RULE = record({{", object.name.to_uppercase()).ok();
        for field in &object.fields {
            let rule = rule(&field.form(), description);
            let rule = if field.since.is_some() { format!("optional({rule})") } else { rule };
            writeln!(out, "  {}: {rule},", field.key).ok();
        }
        out += "});\n";
    }
    out
}

fn interface(object: &Object, description: &Description) -> String {
    let mut out = String::new();
    if !object.doc.is_empty() {
        writeln!(out, "/** {} */", doc(&object.doc)).ok();
    }
    writeln!(out, "export interface {} {{", object.ts).ok();
    for field in &object.fields {
        if !field.doc.is_empty() {
            writeln!(out, "  /** {} */", doc(&field.doc)).ok();
        }
        writeln!(out, "  {}: {};", key(field), name_of(&field.form(), description)).ok();
    }
    out + "}\n\n"
}

/// A key that may be missing.
fn key(field: &Field) -> String {
    let mark = if field.since.is_some() { "?" } else { "" };
    format!("{}{mark}", field.key)
}

fn doc(text: &str) -> String {
    text.replace("`None`", "null")
}

fn name_of(form: &Type, description: &Description) -> String {
    match form {
        Type::F32(_) | Type::Whole(..) => "number".to_owned(),
        Type::Bool => "boolean".to_owned(),
        Type::Text => "string".to_owned(),
        Type::Nullable(inner) => format!("{} | null", name_of(inner, description)),
        Type::List(item, least, most) => {
            let item = name_of(item, description);
            match (least == most, most) {
                (true, 3) if item == "number" => "Triple".to_owned(),
                (true, most) => format!("[{}]", vec![item; *most as usize].join(", ")),
                (false, _) => format!("{item}[]"),
            }
        }
        Type::Named(name) => match (description.find_object(name), description.find_choice(name)) {
            (Some(object), _) => object.ts.clone(),
            (_, Some(choice)) => {
                let names = [&choice.with, &choice.without]
                    .map(|name| name_of(&Type::Named(name.clone()), description));
                names.join(" | ")
            }
            _ => variants(name, description).join(" | "),
        },
    }
}

/// Quoted names of the variants that are written.
fn variants(name: &str, description: &Description) -> Vec<String> {
    let variants = description.find_enum(name).into_iter().flat_map(|one| &one.variants);
    variants
        .filter(|variant| !variant.unwritten)
        .map(|variant| format!("\"{}\"", variant.name))
        .collect()
}

fn rule(form: &Type, description: &Description) -> String {
    match form {
        Type::F32(Range::Finite) => "finite".to_owned(),
        Type::F32(Range::Positive) => "positive".to_owned(),
        Type::F32(Range::FromZero) => "fromZero".to_owned(),
        Type::F32(Range::Share) => "share".to_owned(),
        Type::Whole(least, most) => format!("whole({least}, {most})"),
        Type::Bool => "boolean".to_owned(),
        Type::Text => "text".to_owned(),
        Type::Nullable(inner) => format!("nullable({})", rule(inner, description)),
        Type::List(item, least, most) => {
            format!("list({least}, {most}, {})", rule(item, description))
        }
        Type::Named(name) => match (description.find_object(name), description.find_choice(name)) {
            (Some(object), _) => format!("{}_RULE", object.name.to_uppercase()),
            (_, Some(choice)) => {
                let rules = [&choice.with, &choice.without]
                    .map(|name| rule(&Type::Named(name.clone()), description));
                format!("choice(\"{}\", {})", choice.key, rules.join(", "))
            }
            _ => format!("oneOf({})", variants(name, description).join(", ")),
        },
    }
}
