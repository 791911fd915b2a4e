//! Values of options, as they are typed.

use crate::quantize::Bits;
use crate::source::MlpChoice;

/// Colour behind the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Background(pub [f32; 3]);

/// 4 to 16, or a type.
pub fn parse_bits(text: &str) -> std::result::Result<Bits, String> {
    match text {
        "f16" => Ok(Bits::F16),
        "f32" => Ok(Bits::F32),
        _ => match text.parse() {
            Ok(bits @ 4..=16) => Ok(Bits::Integer(bits)),
            _ => Err("expected 4 to 16, f16 or f32".to_owned()),
        },
    }
}

/// One number or three.
pub fn parse_background(text: &str) -> std::result::Result<Background, String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match *numbers.unwrap_or_default() {
        [grey] => Ok(Background([grey; 3])),
        [red, green, blue] => Ok(Background([red, green, blue])),
        _ => Err("expected one number or three with commas between, 0 to 1".to_owned()),
    }
}

/// A word or a file.
pub fn parse_mlp(text: &str) -> std::result::Result<MlpChoice, String> {
    Ok(match text {
        "auto" => MlpChoice::Auto,
        "none" => MlpChoice::None,
        file => MlpChoice::File(file.into()),
    })
}
