//! Texts from elsewhere.

use std::borrow::Cow;

/// A text without the byte order mark that some editors put before it.
pub fn without_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text)
}

/// A text whose control characters are escaped, but for ends of lines: names from files must not
/// steer a terminal.
pub fn printable(text: &str) -> Cow<'_, str> {
    let steers = |c: char| c.is_control() && c != '\n';
    if !text.contains(steers) {
        return text.into();
    }
    let shown = |c: char| if steers(c) { c.escape_default().to_string() } else { c.to_string() };
    text.chars().map(shown).collect::<String>().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_and_control_characters_go() {
        assert_eq!(without_mark(b"\xEF\xBB\xBF{}"), b"{}");
        assert_eq!(without_mark(b"{}"), b"{}");
        assert_eq!(printable("a\u{1b}[31m\0b\nc"), "a\\u{1b}[31m\\u{0}b\nc");
        assert!(matches!(printable("plain \u{e9}"), Cow::Borrowed(_)));
    }
}
