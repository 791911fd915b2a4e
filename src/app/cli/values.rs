//! Values of options, as they are typed.

use std::sync::OnceLock;

use clap::ValueEnum;
use clap::builder::PossibleValue;

use crate::bake::{Filter, LevelRule, Preset};
use crate::base::limits::LimitName;
use crate::codec::quantize::Bits;
use crate::input::{MlpChoice, ViewChoice};
use crate::model::grid::Bounds;
use crate::model::harmonics::Harmonics;

/// Every number of bits, by name.
const BITS: [&str; 15] =
    ["4", "5", "6", "7", "8", "9", "10", "11", "12", "13", "14", "15", "16", "f16", "f32"];

/// Colour behind the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Background(pub [f32; 3]);

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

/// A number of bytes: `1500`, `30MB`, `1.5 MiB`, `2G`. Parts of a byte are left out.
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
    // The first digits say more than a byte does.
    let part = &part[..part.len().min(12)];
    let scaled = |digits: &str, of: u64| -> Option<u128> {
        Some(digits.parse::<u128>().ok()? * u128::from(unit) / u128::from(of))
    };
    let bytes = scaled(whole, 1).zip(scaled(part, 10u64.pow(part.len() as u32)));
    bytes
        .and_then(|(whole, part)| u64::try_from(whole + part).ok())
        .ok_or_else(|| "more bytes than there can be".to_owned())
}

/// A box: six numbers with commas between.
pub fn parse_box(text: &str) -> std::result::Result<Bounds, String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match *numbers.unwrap_or_default() {
        [x0, y0, z0, x1, y1, z1] if x0 < x1 && y0 < y1 && z0 < z1 => {
            Ok(Bounds { min: [x0, y0, z0], max: [x1, y1, z1] })
        }
        _ => {
            let expected = "expected six numbers with commas between, the lowest corner first";
            Err(expected.to_owned())
        }
    }
}

/// One number or three, a colour as web pages write it, `white` or `black`.
pub fn parse_background(text: &str) -> std::result::Result<Background, String> {
    match text.strip_prefix('#') {
        Some(digits) => return hexadecimal(digits).map(Background),
        None if text == "white" => return Ok(Background([1.0; 3])),
        None if text == "black" => return Ok(Background([0.0; 3])),
        None => {}
    }
    let numbers: Option<Vec<f32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match *numbers.unwrap_or_default() {
        [grey] => Ok(Background([grey; 3])),
        [red, green, blue] => Ok(Background([red, green, blue])),
        _ => Err("expected one number or three with commas between, 0 to 1, or a colour such as \
                  #369, white or black"
            .to_owned()),
    }
}

/// `keep`, `none`, or the degree of harmonics.
pub fn parse_view(text: &str) -> std::result::Result<ViewChoice, String> {
    let degree = text.strip_prefix("sh:").and_then(|degree| degree.parse().ok());
    match (text, degree) {
        ("keep", _) => Ok(ViewChoice::Keep),
        ("none", _) => Ok(ViewChoice::None),
        (_, Some(degree @ 0..=Harmonics::MAX_DEGREE)) => Ok(ViewChoice::Harmonics(degree)),
        _ => Err("expected keep, none, or sh:D with a degree from 0 to 3".to_owned()),
    }
}

/// Three or six hexadecimal digits.
fn hexadecimal(digits: &str) -> std::result::Result<[f32; 3], String> {
    let digit = |character: char| character.to_digit(16);
    let digits: Option<Vec<u32>> = digits.chars().map(digit).collect();
    let bytes = match *digits.unwrap_or_default() {
        [r, g, b] => [17 * r, 17 * g, 17 * b],
        [r, s, g, h, b, c] => [16 * r + s, 16 * g + h, 16 * b + c],
        _ => return Err("expected three or six hexadecimal digits after #".to_owned()),
    };
    Ok(bytes.map(|byte| byte as f32 / 255.0))
}

/// The name of a limit and a count.
pub fn parse_limit(text: &str) -> std::result::Result<(LimitName, u64), String> {
    let (name, count) = text.split_once('=').ok_or("expected NAME=COUNT")?;
    let names = LimitName::ALL.map(LimitName::name);
    let known = LimitName::ALL.into_iter().find(|limit| limit.name() == name);
    let limit = known.ok_or_else(|| format!("expected one of {}", names.join(", ")))?;
    let count = count.parse().map_err(|_| "expected a whole number after =")?;
    Ok((limit, count))
}

/// A word or a file.
pub fn parse_mlp(text: &str) -> std::result::Result<MlpChoice, String> {
    Ok(match text {
        "auto" => MlpChoice::Auto,
        "none" => MlpChoice::None,
        file => MlpChoice::File(file.into()),
    })
}

impl ValueEnum for Filter {
    fn value_variants<'a>() -> &'a [Self] {
        static ALL: OnceLock<Vec<Filter>> = OnceLock::new();
        ALL.get_or_init(Self::all)
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.label()).help(self.purpose()))
    }
}

impl ValueEnum for Bits {
    fn value_variants<'a>() -> &'a [Self] {
        static ALL: OnceLock<Vec<Bits>> = OnceLock::new();
        ALL.get_or_init(|| BITS.iter().filter_map(|name| name.parse().ok()).collect())
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let name = BITS.into_iter().find(|name| name.parse() == Ok(*self));
        name.map(PossibleValue::new)
    }
}

impl ValueEnum for Preset {
    fn value_variants<'a>() -> &'a [Self] {
        &Self::ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.name()).help(self.purpose()))
    }
}

impl ValueEnum for LevelRule {
    fn value_variants<'a>() -> &'a [Self] {
        &Self::ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let (factor, bound) = self.constants();
        let bound = bound.map_or(String::new(), |bound| format!(", at most {bound}"));
        let help = format!("{factor:.3} times the footprint's logarithm to base 2{bound}");
        Some(PossibleValue::new(self.name()).help(help))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backgrounds_are_numbers_or_web_colors() {
        let parse = |text| parse_background(text).map(|Background(color)| color);
        assert_eq!(parse("0.5"), Ok([0.5; 3]));
        assert_eq!(parse("0, 0.25,1"), Ok([0.0, 0.25, 1.0]));
        assert_eq!(parse("#369"), Ok([0.2, 0.4, 0.6]));
        assert_eq!(parse("#336699"), Ok([0.2, 0.4, 0.6]));
        assert_eq!(parse("white"), Ok([1.0; 3]));
        for wrong in ["", "#36", "#xyz", "1,2", "1,2,3,4", "grey"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
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
