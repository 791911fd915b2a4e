//! Values of options, as they are typed.

use clap::ValueEnum;
use clap::builder::PossibleValue;

use crate::bake::{LevelRule, Preset};
use crate::base::limits::Limits;
use crate::input::checkpoint::MlpChoice;

/// Colour behind the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Background(pub [f32; 3]);

/// A whole number of bytes, or of K, M or G of them: powers of 1024.
pub fn parse_bytes(text: &str) -> std::result::Result<u64, String> {
    let units = [("K", 10), ("M", 20), ("G", 30)];
    let unit = units.iter().find_map(|&(unit, bits)| Some((text.strip_suffix(unit)?, bits)));
    let (number, bits) = unit.unwrap_or((text, 0));
    let bytes = number.parse::<u64>().ok().and_then(|number| number.checked_mul(1 << bits));
    bytes.ok_or_else(|| "expected a whole number, with K, M or G after it if need be".to_owned())
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

/// The name of a limit and a count.
pub fn parse_limit(text: &str) -> std::result::Result<(String, u64), String> {
    let (name, count) = text.split_once('=').ok_or("expected NAME=COUNT")?;
    let mut limits = Limits::default();
    let names = limits.named().map(|(name, ..)| name);
    if !names.contains(&name) {
        return Err(format!("expected one of {}", names.join(", ")));
    }
    let count = count.parse().map_err(|_| "expected a whole number after =")?;
    Ok((name.to_owned(), count))
}

/// A word or a file.
pub fn parse_mlp(text: &str) -> std::result::Result<MlpChoice, String> {
    Ok(match text {
        "auto" => MlpChoice::Auto,
        "none" => MlpChoice::None,
        file => MlpChoice::File(file.into()),
    })
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
