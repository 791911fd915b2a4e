//! Python: the tables of the second reader, as data alone.

use std::fmt::Write as _;

use crate::description::{Channels, Description, Range, Type};

pub fn tables(description: &Description) -> String {
    let mut out = "\"\"\"Tables of the format, written by `cargo xtask generate` from formats/container.toml.\n\n\
                   A form is (\"f32\", range), (\"whole\", least, most), (\"bool\",), (\"text\",), (\"enum\", names), (\"object\", name),\n\
                   (\"choice\", key, with it, without it), (\"list\", form, least, most) or (\"null\", form).\n\"\"\"\n\n"
        .to_owned();
    writeln!(out, "MAJOR = {}", description.version[0]).ok();
    out += "# Required features, from bit 0 on.\nFEATURES = (\n";
    for feature in &description.feature {
        writeln!(out, "    \"{}\",", feature.name).ok();
    }
    out += ")\n# Chunk types that are no atlases.\nCHUNKS = (\n";
    for chunk in &description.chunk {
        writeln!(out, "    \"{}\",", chunk.kind).ok();
    }
    out += ")\n# Groups of values in the order of their atlases: chunk type, name, key and item of the encoding, channels, decodes.\nGROUPS = (\n";
    for group in &description.group {
        let item = group.item.map_or_else(|| "None".to_owned(), |item| item.to_string());
        let channels = match &group.channels {
            Channels::Count(count) => count.to_string(),
            Channels::Key(key) => format!("\"{key}\""),
        };
        let (kind, name, key) = (&group.kind, &group.name, group.key());
        writeln!(
            out,
            "    (\"{kind}\", \"{name}\", \"{key}\", {item}, {channels}, {}),",
            tuple(&group.decodes)
        )
        .ok();
    }
    out += ")\n# Keys of objects, and whether they may be missing.\nOBJECTS = {\n";
    for object in &description.object {
        writeln!(out, "    \"{}\": {{", object.name).ok();
        for field in &object.fields {
            let optional = if field.since.is_some() { "True" } else { "False" };
            writeln!(
                out,
                "        \"{}\": ({}, {optional}),",
                field.key,
                form(&field.form(), description)
            )
            .ok();
        }
        out += "    },\n";
    }
    out + "}\n"
}

fn tuple(names: &[String]) -> String {
    let names: Vec<String> = names.iter().map(|name| format!("\"{name}\"")).collect();
    match names.as_slice() {
        [one] => format!("({one},)"),
        names => format!("({})", names.join(", ")),
    }
}

fn form(form_of: &Type, description: &Description) -> String {
    match form_of {
        Type::F32(range) => {
            let range = match range {
                Range::Finite => "finite",
                Range::Positive => "positive",
                Range::FromZero => "from zero",
                Range::Share => "share",
            };
            format!("(\"f32\", \"{range}\")")
        }
        Type::Whole(least, most) => format!("(\"whole\", {least}, {most})"),
        Type::Bool => "(\"bool\",)".to_owned(),
        Type::Text => "(\"text\",)".to_owned(),
        Type::Nullable(inner) => format!("(\"null\", {})", form(inner, description)),
        Type::List(item, least, most) => {
            format!("(\"list\", {}, {least}, {most})", form(item, description))
        }
        Type::Named(name) => match (description.find_enum(name), description.find_choice(name)) {
            (Some(one), _) => {
                let written = one.variants.iter().filter(|variant| !variant.unwritten);
                let names: Vec<String> = written.map(|variant| variant.name.clone()).collect();
                format!("(\"enum\", {})", tuple(&names))
            }
            (_, Some(choice)) => {
                format!(
                    "(\"choice\", \"{}\", \"{}\", \"{}\")",
                    choice.key, choice.with, choice.without
                )
            }
            _ => format!("(\"object\", \"{name}\")"),
        },
    }
}
