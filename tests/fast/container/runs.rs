//! Runs of frames against a plain reference implementation that follows `formats/mipvog.md` number
//! by number.

use crate::common::Random;
use mipvog::base::error::Place;
use mipvog::model::baked::{Codes, NumberType};
use mipvog::quantize::{Code, Frame, FrameShape, run_bytes, run_codes};

const NUMBERS: [NumberType; 4] =
    [NumberType::U8, NumberType::U16, NumberType::F16, NumberType::F32];

/// The codes of a run, `[frame][channel][node]`, one node after the other in 128-bit integers.
fn plain_codes(shape: FrameShape, frames: usize, run: &[u8]) -> Vec<i128> {
    let FrameShape { number, channels, edge } = shape;
    let (nodes, width) = (edge.pow(3), number.bytes());
    let mut bytes = run.iter().copied();
    let mut take = || bytes.next().expect("a byte");
    let modes = take();
    let mut weights = Vec::new();
    for _ in 0..modes {
        let terms = |channel: usize| 2 + channel.min(3);
        let mut mode_weights = Vec::new();
        for channel in 0..channels {
            mode_weights.push((0..terms(channel)).map(|_| take() as i8).collect::<Vec<_>>());
        }
        weights.push(mode_weights);
    }
    let mode_of: Vec<u8> = (0..frames).map(|_| take()).collect();
    let bits: Vec<u8> = (0..frames * nodes.div_ceil(8)).map(|_| take()).collect();
    let live = |frame: usize, node: usize| {
        bits[frame * nodes.div_ceil(8) + node / 8] >> (node % 8) & 1 == 1
    };
    let mut residuals = vec![0i128; frames * channels * nodes];
    for channel in 0..channels {
        for byte in 0..width {
            for mode in 0..modes {
                for frame in (0..frames).filter(|&frame| mode_of[frame] == mode) {
                    for node in (0..nodes).filter(|&node| live(frame, node)) {
                        let at = (frame * channels + channel) * nodes + node;
                        residuals[at] += (i128::from(take()) - 0x80) << (8 * byte);
                    }
                }
            }
        }
    }
    assert_eq!(bytes.next(), None);
    let origin = match number {
        NumberType::U8 | NumberType::U16 => 0,
        NumberType::F16 => 1 << 15,
        NumberType::F32 => 1 << 31,
    };
    let mut codes = vec![0i128; residuals.len()];
    let mut means = codes.clone();
    for frame in 0..frames {
        for channel in 0..channels {
            for node in 0..nodes {
                let place = [node / edge / edge, node / edge % edge, node % edge];
                let start = (frame * channels + channel) * nodes;
                let lower = |offset: [usize; 3]| {
                    let has = (0..3).all(|axis| place[axis] >= offset[axis]);
                    has.then(|| {
                        let [x, y, z] = [0, 1, 2].map(|axis| place[axis] - offset[axis]);
                        codes[start + (x * edge + y) * edge + z]
                    })
                };
                let along = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map(lower);
                let count = along.iter().flatten().count() as i128;
                let sum: i128 = along.iter().flatten().sum();
                let mean = if count == 0 { origin } else { sum.div_euclid(count) };
                let beyond = |offset| lower(offset).map_or(0, |code| code - mean);
                let mut terms = vec![
                    beyond([1, 1, 0]) + beyond([1, 0, 1]) + beyond([0, 1, 1]),
                    beyond([1, 1, 1]),
                ];
                for before in 1..=channel.min(3) {
                    let at = start + node - before * nodes;
                    terms.push(codes[at] - means[at]);
                }
                let weights = &weights[usize::from(mode_of[frame])][channel];
                let sum: i128 = terms.iter().zip(weights).map(|(t, &w)| t * i128::from(w)).sum();
                let code = mean + (sum + 16).div_euclid(32) + residuals[start + node];
                let code = code.rem_euclid(1 << (8 * width));
                codes[start + node] = if live(frame, node) { code } else { mean };
                means[start + node] = mean;
            }
        }
    }
    codes
}

/// Frames of noise around something smooth; a share of nodes is retained.
fn frames(shape: FrameShape, count: usize, random: &mut Random) -> Vec<Frame> {
    let bits = 1 + random.below(8 * shape.number.bytes());
    let share = random.below(5);
    let number = |random: &mut Random, i: usize| {
        let noise = random.bits() as u32 >> (32 - bits);
        let smooth = (i as u32).wrapping_mul(3) >> random.below(4);
        (noise / (1 + random.below(4) as u32)).wrapping_add(smooth) & (u32::MAX >> (32 - bits))
    };
    let nodes = shape.nodes();
    (0..count)
        .map(|_| {
            let codes: Vec<u32> = (0..shape.channels * nodes).map(|i| number(random, i)).collect();
            Frame {
                codes: match shape.number {
                    NumberType::U8 => Codes::U8(codes.iter().map(|&code| code as u8).collect()),
                    NumberType::U16 | NumberType::F16 => {
                        Codes::U16(codes.iter().map(|&code| code as u16).collect())
                    }
                    NumberType::F32 => Codes::U32(codes),
                },
                retained: (0..nodes).map(|_| random.below(4) < share).collect(),
            }
        })
        .collect()
}

fn wide(codes: &Codes) -> Vec<u32> {
    (0..codes.len()).map(|i| codes.code(i)).collect()
}

fn restored(shape: FrameShape, count: usize, run: &[u8]) -> Option<Codes> {
    fn of<T: Code>(shape: FrameShape, count: usize, run: &[u8]) -> Option<Vec<T>> {
        let mut codes = vec![T::default(); count * shape.channels * shape.nodes()];
        run_codes(shape, run, &mut codes, &Place::File).ok().map(|()| codes)
    }
    match shape.number {
        NumberType::U8 => of(shape, count, run).map(Codes::U8),
        NumberType::U16 | NumberType::F16 => of(shape, count, run).map(Codes::U16),
        NumberType::F32 => of(shape, count, run).map(Codes::U32),
    }
}

fn shapes() -> impl Iterator<Item = FrameShape> {
    NUMBERS.into_iter().flat_map(|number| {
        [(1, 8), (3, 5), (4, 4), (7, 2), (2, 1), (1, 9), (3, 3)]
            .map(|(channels, edge)| FrameShape { number, channels, edge })
    })
}

#[test]
fn runs_hold_their_codes_and_agree_with_a_plain_reading() {
    let mut random = Random::new(1);
    for shape in shapes() {
        for count in [1, 2, 9, 33, 70] {
            let made = frames(shape, count, &mut random);
            let dont_care_max = random.bits() as u32;
            let run = run_bytes(shape, &made, dont_care_max);
            assert!(run.sections.is_sorted() && run.sections.last() == Some(&run.bytes.len()));
            assert!(shape.max_bytes(count).expect("small") >= run.bytes.len());
            let back = wide(&restored(shape, count, &run.bytes).expect("a run"));
            let plain = plain_codes(shape, count, &run.bytes);
            assert!(plain.iter().zip(&back).all(|(&plain, &back)| plain == back.into()));
            let channel = shape.nodes();
            for (frame, back) in made.iter().zip(back.chunks(shape.channels * channel)) {
                for (i, (code, back)) in wide(&frame.codes).iter().zip(back).enumerate() {
                    assert!(!frame.retained[i % channel] || code == back, "{shape:?} {count} {i}");
                }
            }
        }
    }
}

#[test]
fn runs_follow_from_their_codes_alone() {
    let mut random = Random::new(2);
    for shape in shapes() {
        for count in [1, 10, 50] {
            let made = frames(shape, count, &mut random);
            // A reader counts all nodes as retained: it knows no others.
            let dont_care_max = u32::MAX >> (1 + random.below(8));
            let run = run_bytes(shape, &made, dont_care_max).bytes;
            let codes = restored(shape, count, &run).expect("a run");
            let size = shape.channels * shape.nodes();
            let again: Vec<Frame> = (0..count)
                .map(|i| Frame {
                    codes: codes.slice(i * size..(i + 1) * size),
                    retained: vec![true; shape.nodes()].into(),
                })
                .collect();
            assert!(run == run_bytes(shape, &again, dont_care_max).bytes, "{shape:?} {count}");
        }
    }
}

#[test]
fn damaged_runs_are_refused_or_read() {
    let mut random = Random::new(3);
    for shape in shapes() {
        let made = frames(shape, 9, &mut random);
        let run = run_bytes(shape, &made, u32::MAX).bytes;
        for end in 0..run.len() {
            assert!(restored(shape, 9, &run[..end]).is_none(), "{shape:?}: {end}");
        }
        assert!(restored(shape, 9, &[&run[..], &[0]].concat()).is_none());
        for _ in 0..50 {
            let mut damaged = run.clone();
            let at = random.below(damaged.len());
            damaged[at] = random.bits() as u8;
            if let Some(codes) = restored(shape, 9, &damaged) {
                let plain = plain_codes(shape, 9, &damaged);
                assert!(plain.iter().zip(wide(&codes)).all(|(&a, b)| a == b.into()), "{shape:?}");
            }
        }
    }
}

#[test]
fn what_nobody_needs_costs_a_bit() {
    let shape = FrameShape { number: NumberType::U8, channels: 3, edge: 8 };
    let mut random = Random::new(4);
    let mut made = frames(shape, 40, &mut random);
    made.iter_mut()
        .for_each(|frame| frame.retained = frame.retained.iter().map(|_| false).collect());
    let run = run_bytes(shape, &made, u32::MAX).bytes;
    assert_eq!(run.len(), 1 + usize::from(run[0]) * (2 + 3 + 4) + 40 * (1 + 64));
}
