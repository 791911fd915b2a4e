//! Parsers for values of options.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use crate::bake::Preset;
use crate::base::limits::LimitName;
use crate::model::grid::Bounds;
use crate::model::harmonics::Harmonics;
use crate::quantize::Bits;
use mipvog_inputs::{AppearanceChoice, MlpChoice, ViewChoice};

/// Colour behind the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Background(pub [f32; 3]);

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

/// Three numbers with commas between.
pub fn parse_vector(text: &str) -> std::result::Result<[f32; 3], String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let numbers = numbers.and_then(|numbers| <[f32; 3]>::try_from(numbers).ok());
    let numbers = numbers.filter(|numbers| numbers.iter().all(|number| number.is_finite()));
    numbers.ok_or_else(|| "expected three numbers with commas between: x,y,z".to_owned())
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

/// `mean`, `zero`, or the number of a picture.
pub fn parse_appearance(text: &str) -> std::result::Result<AppearanceChoice, String> {
    match (text, text.parse()) {
        ("mean", _) => Ok(AppearanceChoice::Mean),
        ("zero", _) => Ok(AppearanceChoice::Zero),
        (_, Ok(number)) => Ok(AppearanceChoice::Picture(number)),
        _ => Err("expected mean, zero, or the number of a training picture, from 0".to_owned()),
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
    let names: Vec<_> = LimitName::ALL.iter().map(|limit| limit.name()).collect();
    let known = LimitName::ALL.iter().copied().find(|limit| limit.name() == name);
    let limit = known.ok_or_else(|| format!("expected one of {}", names.join(", ")))?;
    let count =
        count.parse().map_err(|_| "expected a whole number after =, of bytes for memory")?;
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

/// Values that have names, as arguments take them.
pub trait Named: Clone + Send + Sync + 'static {
    /// Each value, by its name.
    fn named() -> Vec<(PossibleValue, Self)>;
}

impl Named for Bits {
    fn named() -> Vec<(PossibleValue, Self)> {
        let parsed = Self::NAMES.iter().filter_map(|name| Some((name, name.parse().ok()?)));
        parsed.map(|(name, bits)| (PossibleValue::new(*name), bits)).collect()
    }
}

impl Named for Preset {
    fn named() -> Vec<(PossibleValue, Self)> {
        let help = |preset: Self| PossibleValue::new(preset.name()).help(preset.purpose());
        Self::ALL.into_iter().map(|preset| (help(preset), preset)).collect()
    }
}

/// Parses a value by its name.
pub fn by_name<T: Named>() -> impl TypedValueParser<Value = T> {
    let names = T::named().into_iter().map(|(name, _)| name);
    PossibleValuesParser::new(names).try_map(|text| {
        let mut values = T::named().into_iter();
        values.find(|(name, _)| name.get_name() == text).map(|(_, value)| value).ok_or(text)
    })
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
}
