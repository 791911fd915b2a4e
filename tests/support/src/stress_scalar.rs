//! Single numbers and the network: the stages that take no field, against their reference
//! implementations.

use mipvog::base::error::Place;
use mipvog::levels::AlphaDomain;
use mipvog::model::activate::{self, lanes};
use mipvog::model::baked::DensityDomain;
use mipvog::model::field::Activation;
use mipvog::model::view_mlp::{Layer, RAYS, ViewMlp};

use super::plain_shade::specular;
use super::stress::Worst;
use super::{Random, plain};

/// Raw values that hurt.
pub fn raws() -> impl Iterator<Item = f32> {
    let fine = (-1280..=1280).map(|i| i as f32 * 0.0817);
    let ends = [1e30, 1e-30, 1e-40, 1e-45, 0.0, 65504.0, 6.1e-5, 6e-8, 87.3, 88.8, 127.99];
    fine.chain(ends.into_iter().flat_map(|end: f32| [end, -end]))
}

pub const INTERVALS: [f32; 6] = [1e-7, 1e-3, 0.5, 4.0, 100.0, 1e5];
pub const SHIFTS: [f32; 2] = [0.0, -4.595_12];

/// As a stage's activation.
pub fn activation(shift: f32, interval: f32) -> Activation {
    Activation::logits(shift, interval)
}

pub fn stored_activation() -> Worst {
    let mut worst = Worst::default();
    for raw in raws().map(f64::from) {
        let at = || format!("raw {raw}");
        for (got, want) in [
            (activate::softplus(raw), plain::softplus(raw)),
            (activate::sigmoid(raw), plain::sigmoid(raw)),
        ] {
            // Both are exact for the largest.
            worst.take(got, want, want, &at);
        }
    }
    let nearly = [1e-12, 1e-6, 0.5, 1.0 - 1e-6, 1.0 - 1e-12];
    for (shift, interval) in activations() {
        let activation = Activation::logits(shift, interval);
        let (shift, interval) = (f64::from(shift), f64::from(interval));
        for raw in raws().map(f64::from) {
            let want = plain::opacity(raw, shift, interval);
            let at = || format!("raw {raw}, shift {shift}, interval {interval}");
            worst.take(activation.opacity(raw), want, want, &at);
        }
        for alpha in nearly {
            let raw = activation.raw_at_opacity(alpha);
            let at = || format!("opacity {alpha}, shift {shift}, interval {interval}");
            worst.take(plain::opacity(raw, shift, interval), alpha, alpha, &at);
        }
    }
    worst
}

fn activations() -> impl Iterator<Item = (f32, f32)> {
    SHIFTS.into_iter().flat_map(|shift| INTERVALS.map(|interval| (shift, interval)))
}

/// Inputs of the f32 functions in a loop: finite values and both infinities.
fn lane_inputs() -> impl Iterator<Item = f32> {
    raws().chain([f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN])
}

/// An absolute error, and a relative one where the result is at least `floor`.
fn above(floor: f64, want: f64) -> f64 {
    if want >= floor { want } else { 0.0 }
}

pub fn softplus() -> Worst {
    let mut worst = Worst::default();
    for x in lane_inputs() {
        let want = plain::softplus(x.into());
        worst.take(lanes::softplus(x).into(), want, above(4e-35, want), &|| format!("{x}"));
    }
    worst
}

pub fn opacity() -> Worst {
    let mut worst = Worst::default();
    let fine = lane_inputs().map(f32::abs).chain((0..2000).map(|i| i as f32 * 0.000_517));
    for depth in fine {
        let want = -(-f64::from(depth)).exp_m1();
        worst.take(lanes::opacity(depth).into(), want, want, &|| format!("{depth}"));
    }
    worst
}

pub fn sigmoid() -> Worst {
    let mut worst = Worst::default();
    for x in lane_inputs() {
        let want = plain::sigmoid(x.into());
        worst.take(lanes::sigmoid(x).into(), want, above(4e-35, want), &|| format!("{x}"));
    }
    worst
}

pub fn node_opacity() -> Worst {
    let mut worst = Worst::default();
    let raw: Vec<f32> = raws().collect();
    for (shift, interval) in activations() {
        let activation = activation(shift, interval);
        let domain = AlphaDomain::new(activation, 1.0, DensityDomain::Opacity);
        let mut alphas = vec![0.0; raw.len()];
        domain.density_to_alpha(&raw, &mut alphas);
        for (&raw, alpha) in raw.iter().zip(alphas) {
            let want = plain::opacity(raw.into(), shift.into(), interval.into());
            if raw <= domain.empty_up_to() {
                // Too faint to count.
                assert!(alpha == 0.0 && want <= 1.000_1e-7, "raw {raw}: {alpha} for {want}");
                continue;
            }
            let scale = want;
            let at = || format!("raw {raw}, shift {shift}, interval {interval}");
            worst.take(alpha.into(), want, scale, &at);
        }
    }
    worst
}

pub fn network() -> Worst {
    let mut worst = Worst::default();
    let half = 0.5f64.sqrt();
    let directions = [
        [1.0, 0.0, -0.0],
        [-1.0, 1e-310, -1e-40],
        [half, -half, 0.0],
        [1.0 / 3.0, 2.0 / 3.0, -2.0 / 3.0],
        [0.0, -0.0, 1.0],
    ];
    let accumulated = [[0.0; 7], [1.0; 7], [1e-30; 7], [0.5, 0.25, 1.0, 0.0, 1e-7, 0.9, 1e-45]];
    for (seed, frequencies) in [0, 1, 4, 8, 16, 24, 32].into_iter().enumerate() {
        for size in [1e-30f32, 0.05, 0.5, 1e30] {
            let mut random = Random::new(seed as u64);
            let widths = [3 + 6 * frequencies + 7, 16, 16, 3];
            let layers: Vec<Layer> = widths
                .windows(2)
                .enumerate()
                .map(|(number, pair)| {
                    // Only the first layer is of this size; of 1e30, it is scaled back after.
                    let size = match number {
                        0 => size,
                        1 if size > 1.0 => 1.0 / size,
                        _ => 0.5,
                    };
                    let count = pair[0] * pair[1];
                    let weights = (0..count).map(|_| random.between(-size, size)).collect();
                    let bias = (0..pair[1]).map(|_| random.between(-1.0, 1.0)).collect();
                    Layer { inputs: pair[0], outputs: pair[1], weights, bias }
                })
                .collect();
            let network = ViewMlp::new(layers, frequencies, 4, &Place::File).expect("joined");
            for direction in directions {
                let rows: Vec<&[f32]> = accumulated.iter().map(|row| row.as_slice()).collect();
                let got = network.colors(&[direction; RAYS][..rows.len()], &rows);
                for (row, got) in rows.iter().zip(got) {
                    let wide: Vec<f64> = row.iter().map(|&value| value.into()).collect();
                    let want = specular(&network, direction, &wide);
                    let at = || format!("{frequencies} octaves, weights {size}, {direction:?}");
                    for (got, want) in got.into_iter().zip(want) {
                        worst.take(got.into(), want, 0.0, &at);
                    }
                }
            }
        }
    }
    worst
}
