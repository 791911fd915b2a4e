//! Display-referred sRGB and linear light (IEC 61966-2-1).

/// Linear light of an sRGB value from 0 to 1; values beyond are clamped.
pub fn linear(value: f64) -> f64 {
    let value = value.clamp(0.0, 1.0);
    if value <= 0.040_45 { value / 12.92 } else { libm::pow((value + 0.055) / 1.055, 2.4) }
}

/// The sRGB value of linear light. Light above 1 gives more than 1; light below 0 gives 0.
pub fn display(light: f64) -> f64 {
    let light = light.max(0.0);
    if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * libm::pow(light, 1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_are_inverses() {
        for i in 0..=1000 {
            let value = f64::from(i) / 1000.0;
            assert!((display(linear(value)) - value).abs() < 1e-6, "{value}");
        }
        assert!((linear(0.5) - 0.214_041).abs() < 1e-6);
        assert!(display(4.0) > 1.0 && display(-1.0) == 0.0);
    }
}
