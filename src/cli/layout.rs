//! Lines and tables of reports, as wide as the terminal.

use std::fmt::Write;

use terminal_size::{Height, Width, terminal_size_of};

/// Default maximum width of a line.
const WIDEST: usize = 100;
/// Minimum width: narrower terminals wrap lines themselves.
const NARROWEST: usize = 40;
/// Words that stay on the line of the number in front of them.
const UNITS: [&str; 10] = ["x", "%", "s", "B", "kB", "MB", "GB", "TB", "bit", "dB"];

/// Columns of a report: those of the terminal, else of `COLUMNS`, else 100.
pub fn columns() -> usize {
    columns_of(terminal_size_of(std::io::stdout()))
}

/// Columns of messages on stderr, likewise.
pub fn message_columns() -> usize {
    columns_of(terminal_size_of(std::io::stderr()))
}

fn columns_of(terminal: Option<(Width, Height)>) -> usize {
    let terminal = terminal.map(|(Width(width), _)| usize::from(width).min(WIDEST));
    let stated = || std::env::var("COLUMNS").ok()?.parse().ok();
    terminal.or_else(stated).unwrap_or(WIDEST).max(NARROWEST)
}

/// A non-breaking space.
pub const TIE: char = '\u{a0}';

/// Wraps a line to at most `width` columns, if its words allow that. All but the first begin with
/// `indent` spaces. A number stays with its unit, and so do words with a [`TIE`] between them.
pub fn folded(line: &str, width: usize, indent: usize) -> String {
    let start = line.len() - line.trim_start().len();
    let mut text = line[..start].to_owned();
    let mut column = start;
    let mut words = line.split(' ').filter(|word| !word.is_empty()).peekable();
    let mut is_first = true;
    while let Some(word) = words.next() {
        let mut part = word.to_owned();
        while let Some(next) = words.next_if(|next| stays(&part, next)) {
            part.push(' ');
            part += next;
        }
        let length = part.chars().count();
        match is_first {
            true => {}
            false if column + 1 + length > width => {
                write!(text, "\n{:indent$}", "").ok();
                column = indent;
            }
            false => {
                text.push(' ');
                column += 1;
            }
        }
        is_first = false;
        text += &part;
        column += length;
    }
    text.replace(TIE, " ")
}

/// True if a line must not break between these words.
fn stays(before: &str, word: &str) -> bool {
    let is_digit = |letter: Option<char>| letter.is_some_and(|letter| letter.is_ascii_digit());
    let bare = word.trim_end_matches([',', ';', ':', '.', ')']);
    let is_times = before.ends_with(" x") && is_digit(word.chars().next());
    (is_digit(before.chars().next_back()) && UNITS.contains(&bare)) || is_times
}

/// A whole number with commas between thousands.
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A table whose first column names the rows.
#[derive(Debug, Default)]
pub struct Table {
    rows: Vec<Vec<String>>,
    /// Columns that are flush left.
    left: usize,
}

impl Table {
    /// A table with these heads. This many columns from the left are flush left, the others flush
    /// right.
    pub fn new<T: Into<String>>(heads: impl IntoIterator<Item = T>, left: usize) -> Self {
        let mut table = Self { rows: Vec::new(), left };
        table.add(heads);
        table
    }

    /// Adds a row.
    pub fn add<T: Into<String>>(&mut self, cells: impl IntoIterator<Item = T>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// The heads.
    pub fn heads(&self) -> &[String] {
        self.rows.first().map_or(&[], Vec::as_slice)
    }

    /// The rows below the heads.
    pub fn rows(&self) -> &[Vec<String>] {
        self.rows.get(1..).unwrap_or_default()
    }

    /// The lines, indented by two. Columns that do not fit into `width` follow below, with the
    /// first column repeated.
    pub fn text(&self, width: usize) -> String {
        let count = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let cell = |row: &[String], column: usize| row.get(column).cloned().unwrap_or_default();
        let widths: Vec<usize> = (0..count)
            .map(|column| {
                let lengths = self.rows.iter().map(|row| cell(row, column).chars().count());
                lengths.max().unwrap_or(0)
            })
            .collect();
        let first = widths.first().copied().unwrap_or(0);
        let mut text = String::new();
        let mut next = 1;
        while next < count || text.is_empty() {
            let start = next;
            let mut taken = 2 + first;
            while next < count && (next == start || taken + 2 + widths[next] <= width) {
                taken += 2 + widths[next];
                next += 1;
            }
            for row in &self.rows {
                let mut line = format!("  {:first$}", cell(row, 0));
                for (column, &width) in widths.iter().enumerate().take(next).skip(start) {
                    let value = cell(row, column);
                    match column < self.left {
                        true => write!(line, "  {value:width$}").ok(),
                        false => write!(line, "  {value:>width$}").ok(),
                    };
                }
                text += line.trim_end();
                text.push('\n');
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_break_between_words_but_not_within_a_figure() {
        assert_eq!(folded("  one two", 60, 4), "  one two");
        assert_eq!(folded("  one two three", 10, 4), "  one two\n    three");
        assert_eq!(folded("a 3.62 MB, 24 x smaller", 8, 0), "a\n3.62 MB,\n24 x\nsmaller");
        assert_eq!(folded("of 64 x 64 x 64 voxels", 13, 1), "of\n 64 x 64 x 64\n voxels");
        assert_eq!(folded("unbreakable/path/of/a/file", 10, 2), "unbreakable/path/of/a/file");
        assert_eq!(folded("", 10, 2), "");
        assert_eq!(folded("one near\u{a0}2\u{a0}(file)", 12, 0), "one\nnear 2 (file)");
    }

    #[test]
    fn thousands_have_commas() {
        let all = [0, 999, 1000, 65_536, 2_097_152].map(grouped);
        assert_eq!(all, ["0", "999", "1,000", "65,536", "2,097,152"]);
    }

    #[test]
    fn columns_that_do_not_fit_follow_below() {
        let mut table = Table::new(["level", "size", "bytes", "prefix"], 2);
        table.add(["0", "8 x 8", "1.5 MB", "2 MB"]);
        let wide = "  level  size    bytes  prefix\n  0      8 x 8  1.5 MB    2 MB\n";
        assert_eq!(table.text(100), wide);
        let narrow =
            "  level  size    bytes\n  0      8 x 8  1.5 MB\n  level  prefix\n  0        2 MB\n";
        assert_eq!(table.text(23), narrow);
        // A column wider than the terminal is shown anyway.
        assert_eq!(table.text(1).lines().count(), 6);
    }
}
