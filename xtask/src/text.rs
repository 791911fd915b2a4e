//! Lines and comments.

const WIDTH: usize = 100;

/// A comment of `mark` lines, each within the width.
pub fn doc_comment(mark: &str, text: &str, indent: usize) -> String {
    let start = format!("{}{mark} ", " ".repeat(indent));
    let mut out = String::new();
    let mut line = start.clone();
    for word in text.split_whitespace() {
        if line.len() > start.len() && line.chars().count() + word.chars().count() > WIDTH {
            out += line.trim_end();
            out.push('\n');
            line.clone_from(&start);
        }
        line += word;
        line.push(' ');
    }
    out + line.trim_end() + "\n"
}
