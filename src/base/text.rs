//! Texts from elsewhere.

use std::borrow::Cow;

/// A text without the byte order mark that some editors put before it.
pub fn without_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text)
}

/// JSON in which numbers that JSON has no spelling for stand in quotes: Python writes `NaN`,
/// `Infinity` and `-Infinity` as they are. All else stays, in its line.
pub fn quoted_numbers(json: &str) -> Cow<'_, str> {
    const WORDS: [&str; 3] = ["NaN", "-Infinity", "Infinity"];
    if !json.contains("NaN") && !json.contains("Infinity") {
        return json.into();
    }
    let (mut quoted, mut rest, mut is_text) = (String::with_capacity(json.len()), json, false);
    while let Some(letter) = rest.chars().next() {
        let word = WORDS.iter().find(|word| !is_text && rest.starts_with(**word));
        let length = match (word, letter) {
            (Some(word), _) => {
                quoted.extend(["\"", word, "\""]);
                rest = &rest[word.len()..];
                continue;
            }
            // What is escaped is no end of a text.
            (_, '\\') if is_text => 1 + rest[1..].chars().next().map_or(0, char::len_utf8),
            (_, '"') => {
                is_text = !is_text;
                1
            }
            _ => letter.len_utf8(),
        };
        let (letters, left) = rest.split_at(length);
        quoted.push_str(letters);
        rest = left;
    }
    quoted.into()
}

/// True of a text that [`quoted_numbers`] has put in the place of a number.
pub fn is_quoted_number(text: &str) -> bool {
    matches!(text, "NaN" | "Infinity" | "-Infinity")
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
    fn numbers_that_python_alone_spells_are_quoted() {
        let json = r#"{"a": [NaN, -Infinity,Infinity], "NaN": "x \" NaN \\", "b":NaN}"#;
        let wanted = r#"{"a": ["NaN", "-Infinity","Infinity"], "NaN": "x \" NaN \\", "b":"NaN"}"#;
        assert_eq!(quoted_numbers(json), wanted);
        assert!(matches!(quoted_numbers("{\"a\": 1}"), Cow::Borrowed(_)));
        for odd in ["\"NaN\\", "NaN", "\\NaN", "\"\u{e9}\\\u{e9}Infinity"] {
            quoted_numbers(odd);
        }
    }

    #[test]
    fn marks_and_control_characters_go() {
        assert_eq!(without_mark(b"\xEF\xBB\xBF{}"), b"{}");
        assert_eq!(without_mark(b"{}"), b"{}");
        assert_eq!(printable("a\u{1b}[31m\0b\nc"), "a\\u{1b}[31m\\u{0}b\nc");
        assert!(matches!(printable("plain \u{e9}"), Cow::Borrowed(_)));
    }
}
