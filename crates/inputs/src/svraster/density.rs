//! The density of a raw value.

/// Where the curve turns into a line.
const BEND: f64 = 1.1;
/// Slope and offset of the exponent below it: value and slope of the line continue at the bend.
const SLOPE: f64 = 0.909_090_909_091;
const OFFSET: f64 = 0.904_689_820_196;
/// Optical depth per world unit of a density of 1.
const PER_UNIT: f64 = 100.0;

/// Optical depth per world unit.
#[inline]
pub(super) fn density(raw: f64) -> f64 {
    let value = if raw > BEND { raw } else { libm::exp(SLOPE * raw - OFFSET) };
    PER_UNIT * value
}

/// The raw value between eight corners, x slowest, at shares of the voxel's edges.
#[inline]
pub(super) fn between(corners: &[f32; 8], [x, y, z]: [f64; 3]) -> f64 {
    let [a, b, c, d, e, f, g, h] = corners.map(f64::from);
    let mix = |low: f64, high: f64, share: f64| low + (high - low) * share;
    let low = mix(mix(a, b, z), mix(c, d, z), y);
    let high = mix(mix(e, f, z), mix(g, h, z), y);
    mix(low, high, x)
}

/// Densities of a field.
#[derive(Debug)]
pub(super) struct EvenDensities {
    /// Logits at distinct corners.
    pub(super) logits: Vec<f32>,
    /// Mean optical depths per world unit of voxels; 0 for those at least as large as any cell.
    pub(super) means: Vec<f32>,
}

impl EvenDensities {
    /// The mean optical depth per world unit of a voxel smaller than a cell.
    #[inline]
    pub(super) fn mean(&self, voxel: u32) -> f64 {
        self.means.get(voxel as usize).copied().unwrap_or(0.0).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_and_its_slope_are_continuous() {
        let [below, above] = [BEND - 1e-9, BEND + 1e-9].map(density);
        assert!((below - above).abs() < 1e-5, "{below} {above}");
        assert!((density(BEND) / PER_UNIT - BEND).abs() < 1e-9);
        let slope = (density(BEND) - density(BEND - 1e-6)) / 1e-6 / PER_UNIT;
        assert!((slope - 1.0).abs() < 1e-4, "{slope}");
    }

    #[test]
    fn corners_count_x_slowest() {
        let corners = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        let at = [0.25, 0.5, 0.75];
        assert!((between(&corners, at) - (4.0 * 0.25 + 2.0 * 0.5 + 0.75)).abs() < 1e-12);
    }
}
