//! Every stage's worst error against its reference implementation in float64, over hard inputs.
//! `formats/numerics.md` lists the errors, and `tests/slow/numerics.rs` holds their bounds.

use std::fmt::Write;
use std::sync::OnceLock;

use super::{stress_field, stress_quantize, stress_ray, stress_scalar};

/// The largest errors of a stage.
#[derive(Debug, Clone, Default)]
pub struct Worst {
    pub absolute: f64,
    pub relative: f64,
    /// Spacings of float32 numbers at the magnitude that errors are relative to.
    pub ulps: f64,
    /// Places of these errors, in this order.
    pub at: [String; 3],
}

impl Worst {
    /// Takes a result. Relative errors and ulps are those of `scale`, and count where it is normal.
    pub fn take(&mut self, got: f64, want: f64, scale: f64, at: &dyn Fn() -> String) {
        // Equal infinities are no error; a NaN is the largest.
        let error = if got == want { 0.0 } else { (got - want).abs() };
        let error = if error.is_nan() { f64::INFINITY } else { error };
        let mut relative = 0.0;
        let mut ulps = 0.0;
        if scale >= f64::from(f32::MIN_POSITIVE) && error > 0.0 {
            relative = error / scale;
            let exponent = (scale.to_bits() >> 52) as i32 - 1023;
            ulps = error / 2f64.powi(exponent - 23);
        }
        let worst = [&mut self.absolute, &mut self.relative, &mut self.ulps];
        for (i, (worst, found)) in worst.into_iter().zip([error, relative, ulps]).enumerate() {
            if found > *worst {
                *worst = found;
                self.at[i] = at();
            }
        }
    }
}

/// A stage's row of the table.
pub struct Row {
    pub stage: &'static str,
    /// The inputs, and the reference of relative errors.
    pub inputs: &'static str,
    /// Most absolute error, relative error and ulps; infinity where a figure says nothing.
    pub bound: [f64; 3],
    /// The reason for this bound.
    pub reason: &'static str,
    /// True if every platform measures the same: none of its own functions is in the stage.
    pub portable: bool,
    pub run: fn() -> Worst,
}

/// A figure that says nothing.
const ANY: f64 = f64::INFINITY;

/// Every row, in the order of the table.
pub const ROWS: [Row; 19] = [
    Row {
        stage: "activation, stored",
        inputs: "softplus, opacity and sigmoid of raw values up to 1e30, subnormals and -0, shifts 0 and -4.6, intervals 1e-7 to 1e5; thresholds from 1e-12 to 1 - 1e-12 there and back",
        bound: [4e-16, 1e-14, 1e-7],
        reason: "both are float64; there and back, the spacing of a raw value near 40 is 7e-15",
        portable: false,
        run: stress_scalar::stored_activation,
    },
    Row {
        stage: "softplus",
        inputs: "the f32 function, raw values from -78; below, it ends at 2e-35",
        bound: [1e-6, 4e-7, 4.0],
        reason: "the exponential's Taylor remainder, 1.2e-7, and a few roundings",
        portable: true,
        run: stress_scalar::softplus,
    },
    Row {
        stage: "opacity",
        inputs: "the f32 function, optical depths 0 to infinity",
        bound: [1.2e-7, 3e-7, 3.0],
        reason: "the exponential's remainder, or the series' last term",
        portable: true,
        run: stress_scalar::opacity,
    },
    Row {
        stage: "activation, of a node",
        inputs: "raw values to opacity, shifts 0 and -4.6, intervals 1e-7 to 1e5; below 1e-7 it counts as 0",
        bound: [5e-7, 1e-6, 14.0],
        reason: "raw + shift is rounded once; half a spacing of the sum, 4.8e-7 from 8 on, is the relative error of a faint opacity",
        portable: true,
        run: stress_scalar::node_opacity,
    },
    Row {
        stage: "sigmoid",
        inputs: "the f32 function; relative from -78",
        bound: [1.2e-7, 3e-7, 4.0],
        reason: "the exponential's remainder, a sum and a division",
        portable: true,
        run: stress_scalar::sigmoid,
    },
    Row {
        stage: "filters",
        inputs: "one step of every kernel: checkerboards of 1e30 and -1e30, single voxels, subnormals, f16 extremes, random values; 2-node axes, 2 x 2 x 2000; relative to the weighted sum of magnitudes",
        bound: [ANY, 1.5e-7, 2.0],
        reason: "f64 sums, rounded to f32 after y and z and after x",
        portable: true,
        run: stress_field::filters,
    },
    Row {
        stage: "resize",
        inputs: "the same without a low-pass, all sizes from 2 to 70",
        bound: [ANY, 1.5e-7, 2.0],
        reason: "as filters",
        portable: true,
        run: stress_field::resize,
    },
    Row {
        stage: "constant and linear fields",
        inputs: "constants under every kernel on every level, and linear fields under the resize and, away from faces, under every kernel; against the exact value",
        bound: [0.0; 3],
        reason: "weights sum to 1 within 2e-16, far below half a spacing of f32",
        portable: true,
        run: stress_field::exact,
    },
    Row {
        stage: "20 levels",
        inputs: "2 x 2 x 2^20 nodes of 1e30 or -1e30 at random, through all 20 levels",
        bound: [ANY, 3e-7, 4.0],
        reason: "two roundings per level, which coarser levels average",
        portable: true,
        run: stress_field::twenty_levels,
    },
    Row {
        stage: "weighted averages, density",
        inputs: "alpha of `rate-tent` and `coverage`, all levels, intervals 1e-7 to 1e5, amounts up to the clamp; opacity over the level's own step",
        bound: [1e-4, ANY, ANY],
        reason: "amounts are f32: near 1, the remaining light is known to 3e-8, and level 1's step takes its square root",
        portable: true,
        run: stress_field::density_of_levels,
    },
    Row {
        stage: "weighted averages, colour",
        inputs: "their colours, raw from -1e30 to 1e30, where alpha is above 0",
        bound: [4e-5, ANY, ANY],
        reason: "light behind many nodes is a product of as many exponentials, each with an error of 2e-7; then the quotient of two f32 means",
        portable: true,
        run: stress_field::color_of_levels,
    },
    Row {
        stage: "quantize",
        inputs: "4 to 16 bits and f16, every meaning, intervals 1e-7 to 1e5, every border between codes; activated values, relative to `max_error`",
        bound: [ANY, 1.0, ANY],
        reason: "`max_error` is proved, and reached at borders",
        portable: true,
        run: stress_quantize::quantize,
    },
    Row {
        stage: "decode",
        inputs: "every integer code of the same; relative to the sum of the formula's terms",
        bound: [ANY, 3e-7, 3.0],
        reason: "five roundings",
        portable: true,
        run: stress_quantize::decode,
    },
    Row {
        stage: "float16 and float32",
        inputs: "f32 unchanged, f16 to nearest and at most 65504; relative from 2^-14, where f16 is normal",
        bound: [16.0, 4.9e-4, 4096.0],
        reason: "half a spacing of f16, which is 32 at its top; f32 loses nothing, not even the sign of zero",
        portable: true,
        run: stress_quantize::floats,
    },
    Row {
        stage: "interpolation",
        inputs: "checkerboards and random values up to 1e30, at nodes, faces and within 1e-12 of them; relative to the largest corner",
        bound: [ANY, 3e-7, 4.0],
        reason: "seven differences, and an f32 place in the cell",
        portable: true,
        run: stress_ray::interpolation,
    },
    Row {
        stage: "transmittance",
        inputs: "rays of 10^5 samples, along faces and edges and 5e-10 beside them, boxes 1:1000, intervals 1e-7 to 1e5, opacity within 1e-12 of 0 and 1; relative from 2e-5",
        bound: [1.2e-5, 4e-6, 40.0],
        reason: "rays end at an optical depth of 11.6, transmittance 9.2e-6; until then, depths add up in f64, and f32 holds a depth of 11 to 5e-7",
        portable: true,
        run: stress_ray::transmittance,
    },
    Row {
        stage: "accumulated colour",
        inputs: "the same rays' sums of colour, and of distance (relative where it is above 1); relative from 1e-4",
        bound: [2e-5, 2e-5, 250.0],
        reason: "the end of opaque rays, 9.2e-6; f64 sums of f32 products",
        portable: true,
        run: stress_ray::accumulated,
    },
    Row {
        stage: "MLP",
        inputs: "directions along axes, negative zeros and subnormals, 0 to 32 octaves, first layers of 1e-30 to 1e30",
        bound: [1e-6, ANY, ANY],
        reason: "f32 sums of up to 202 products; doubled angles lose one of f64's 53 bits per octave",
        portable: false,
        run: stress_scalar::network,
    },
    Row {
        stage: "level blend",
        inputs: "12 levels of 2 x 2 x 4096 nodes, both orders, every pixel size; colour and transmittance",
        bound: [2e-5, ANY, ANY],
        reason: "the end of opaque rays; the level is f32, as are mixed values",
        portable: false,
        run: stress_ray::level_blend,
    },
];

/// A row's errors, measured once.
pub fn measured(row: &Row) -> &'static Worst {
    static ALL: [OnceLock<Worst>; ROWS.len()] = [const { OnceLock::new() }; ROWS.len()];
    let at = ROWS.iter().position(|other| other.stage == row.stage).expect("a row of the table");
    ALL[at].get_or_init(row.run)
}

/// A number with two digits, none of them less than it is.
fn rounded_up(value: f64) -> String {
    if value == 0.0 || value.is_infinite() {
        return if value == 0.0 { "0" } else { "-" }.to_owned();
    }
    let text = format!("{value:.1e}");
    let near: f64 = text.parse().expect("a number");
    if near >= value {
        return text;
    }
    let (_, exponent) = text.split_once('e').expect("an exponent");
    let exponent: i32 = exponent.parse().expect("an exponent");
    format!("{:.1e}", near + 10f64.powi(exponent - 1))
}

/// `formats/numerics.md`.
pub fn document() -> String {
    let mut text = include_str!("numerics_head.md").to_owned();
    for row in &ROWS {
        let worst = measured(row);
        let found = [worst.absolute, worst.relative, worst.ulps];
        let cell = |i: usize| {
            let [found, bound] = [found[i], row.bound[i]].map(rounded_up);
            match (row.bound[i].is_finite(), row.portable) {
                (false, _) => "-".to_owned(),
                (true, true) => format!("{found} of {bound}"),
                (true, false) => format!("within {bound}"),
            }
        };
        let [absolute, relative, ulps] = [0, 1, 2].map(cell);
        let Row { stage, inputs, reason, .. } = row;
        writeln!(text, "| {stage} | {inputs} | {absolute} | {relative} | {ulps} | {reason} |")
            .expect("text");
    }
    text.push_str(include_str!("numerics_tail.md"));
    text
}
