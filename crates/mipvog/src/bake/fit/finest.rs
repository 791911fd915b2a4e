//! Level 0's colours in half the bytes. A fit does not change them, and memory latency dominates
//! the time of its rays.

use crate::view::sample::{Cell, Dense};

/// Colours of all nodes, each channel the upper half of an f32 (bfloat16): to a part in 512.
#[derive(Debug)]
pub struct Finest<const C: usize> {
    color: Vec<[u16; C]>,
    /// Distances of neighbours along x and y.
    strides: [usize; 2],
}

impl<const C: usize> Finest<C> {
    /// Takes the colours out of `field`.
    pub fn taken_from(field: &mut Dense<C>) -> Self {
        let strides = field.strides(0);
        let color = field.take_colors(0);
        let half = |color: &[f32; C]| {
            let mut halves = [0; C];
            halves.iter_mut().zip(color).for_each(|(half, value)| *half = upper_half(*value));
            halves
        };
        Self { color: color.iter().map(half).collect(), strides }
    }

    /// Interpolated colour.
    #[inline(always)]
    pub fn color(&self, cell: &Cell) -> [f32; C] {
        let [fx, fy, fz] = cell.fraction;
        let [x, y] = self.strides;
        let mut sum = [0.0; C];
        for (from, weight) in [
            (cell.node, (1.0 - fx) * (1.0 - fy)),
            (cell.node + y, (1.0 - fx) * fy),
            (cell.node + x, fx * (1.0 - fy)),
            (cell.node + x + y, fx * fy),
        ] {
            let pair = &self.color[from..from + 2];
            let (near, far) = (weight * (1.0 - fz), weight * fz);
            for lane in 0..C {
                sum[lane] += near * whole(pair[0][lane]) + far * whole(pair[1][lane]);
            }
        }
        sum
    }
}

/// The upper half of an f32's bits, rounded to nearest, halves to even. The field's values are
/// finite; those next to infinity stay below it.
fn upper_half(value: f32) -> u16 {
    let bits = value.to_bits();
    let rounded = (bits + 0x7fff + (bits >> 16 & 1)) >> 16;
    if f32::from_bits(rounded << 16).is_finite() { rounded as u16 } else { (bits >> 16) as u16 }
}

#[inline(always)]
fn whole(half: u16) -> f32 {
    f32::from_bits(u32::from(half) << 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_near_and_finite() {
        for value in [0.0, -0.0, 1.0, -3.1, 0.1, 1e-30, 7.77e20, f32::MAX, f32::MIN] {
            let back = whole(upper_half(value));
            assert!((back - value).abs() <= value.abs() / 256.0, "{back} for {value}");
        }
        for (value, expected) in [(1.0 + 1.0 / 256.0, 1.0), (1.0 + 3.0 / 256.0, 1.0 + 4.0 / 256.0)]
        {
            assert_eq!(whole(upper_half(value)), expected, "halves go to even");
        }
    }
}
