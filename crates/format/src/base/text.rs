//! Text from external sources.

use std::borrow::Cow;

/// A text without the byte order mark that some editors put before it.
pub fn without_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text)
}

/// JSON with non-finite numbers in quotes: Python writes bare `NaN`, `Infinity` and `-Infinity`,
/// which JSON does not allow. Everything else stays, on the same line.
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
            // An escaped quote does not end a string.
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

/// True for a string that [`quoted_numbers`] made from a number.
pub fn is_quoted_number(text: &str) -> bool {
    matches!(text, "NaN" | "Infinity" | "-Infinity")
}

/// Text with control characters escaped, except line ends, because names from files must not
/// control a terminal.
pub fn printable(text: &str) -> Cow<'_, str> {
    let steers = |c: char| c.is_control() && c != '\n';
    if !text.contains(steers) {
        return text.into();
    }
    let shown = |c: char| if steers(c) { c.escape_default().to_string() } else { c.to_string() };
    text.chars().map(shown).collect::<String>().into()
}

/// Units of bytes. A K, M or G alone is a power of 1024.
const UNITS: [(&str, u64); 13] = [
    ("kB", 1000),
    ("KB", 1000),
    ("MB", 1_000_000),
    ("GB", 1_000_000_000),
    ("KiB", 1 << 10),
    ("MiB", 1 << 20),
    ("GiB", 1 << 30),
    ("B", 1),
    ("k", 1 << 10),
    ("K", 1 << 10),
    ("M", 1 << 20),
    ("G", 1 << 30),
    ("", 1),
];

/// A number of bytes: `1500`, `30MB`, `1.5 MiB`, `2G`. Fractions of a byte are dropped.
pub fn parse_bytes(text: &str) -> std::result::Result<u64, String> {
    let wrong = || "expected bytes such as 1500, 30MB, 1.5MiB or 2G".to_owned();
    let units = UNITS.iter().find_map(|&(unit, bytes)| Some((text.strip_suffix(unit)?, bytes)));
    let (number, unit) = units.ok_or_else(wrong)?;
    let (whole, part) = number.trim_end().split_once('.').unwrap_or((number.trim_end(), "0"));
    let is_number =
        |digits: &str| !digits.is_empty() && digits.bytes().all(|digit| digit.is_ascii_digit());
    if !is_number(whole) || !is_number(part) {
        return Err(wrong());
    }
    // Leading digits are more informative than exact bytes.
    let part = &part[..part.len().min(12)];
    let scaled = |digits: &str, of: u64| -> Option<u128> {
        Some(digits.parse::<u128>().ok()? * u128::from(unit) / u128::from(of))
    };
    let bytes = scaled(whole, 1).zip(scaled(part, 10u64.pow(part.len() as u32)));
    bytes
        .and_then(|(whole, part)| u64::try_from(whole + part).ok())
        .ok_or_else(|| "more bytes than there can be".to_owned())
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

    #[test]
    fn bytes_come_in_powers_of_1000_and_1024() {
        let all = [
            ("0", 0),
            ("1500", 1500),
            ("7B", 7),
            ("30MB", 30_000_000),
            ("30MiB", 30 << 20),
            ("30M", 30 << 20),
            ("30K", 30 << 10),
            ("30k", 30 << 10),
            ("30G", 30 << 30),
            ("30kB", 30_000),
            ("30KB", 30_000),
            ("2 GB", 2_000_000_000),
            ("2GiB", 2 << 30),
            ("1.5MB", 1_500_000),
            ("0.5KiB", 512),
            ("57.123456MB", 57_123_456),
            ("0.0009kB", 0),
            ("18446744073709551615", u64::MAX),
        ];
        for (text, bytes) in all {
            assert_eq!(parse_bytes(text), Ok(bytes), "{text}");
        }
        for text in
            ["", "MB", "much", "-1", "+1", "1e3", ".5MB", "1.", "1.5.2", "30 M B", "30mb", "0x10"]
        {
            assert!(parse_bytes(text).is_err(), "{text}");
        }
        for text in ["18446744073709551616", "99999999999999999999999999999999999999999", "1e20G"] {
            assert!(parse_bytes(text).is_err(), "{text}");
        }
    }
}
