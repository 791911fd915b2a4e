//! Reports as pages: self-contained files without scripts.

mod escape;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

pub use escape::escaped;

/// An error of this much is white in heat maps.
pub const FULL_HEAT: f32 = 0.25;

const STYLE: &str = include_str!("page.css");

/// The start of a page, up to its heading.
pub fn start(title: &str) -> String {
    let title = escaped(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <meta name=\"color-scheme\" content=\"light dark\"/>\n\
         <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n"
    )
}

/// Its end.
pub const END: &str = "</body>\n</html>\n";

/// A command to select and copy.
pub fn command(text: &str) -> String {
    format!("<pre class=\"command\"><code>{}</code></pre>\n", escaped(text))
}

/// An embedded picture from a PNG's bytes. `about` describes it.
pub fn picture(png: &[u8], [width, height]: [usize; 2], about: &str) -> String {
    let (data, about) = (STANDARD.encode(png), escaped(about));
    format!(
        "<img width=\"{width}\" height=\"{height}\" alt=\"{about}\" \
         src=\"data:image/png;base64,{data}\"/>"
    )
}

/// A table's head, and the start of its body.
pub fn table_start<T: AsRef<str>>(heads: impl IntoIterator<Item = T>) -> String {
    let heads = heads.into_iter().map(|head| format!("<th>{}</th>", escaped(head.as_ref())));
    format!("<table>\n<thead><tr>{}</tr></thead>\n<tbody>\n", heads.collect::<String>())
}

/// The end of a table.
pub const TABLE_END: &str = "</tbody></table>\n";

/// Colours from 0 to 1 as bytes.
pub fn bytes_of(colors: &[[f32; 3]]) -> Vec<u8> {
    let colors = colors.as_flattened().iter();
    colors.map(|color| (color.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect()
}
