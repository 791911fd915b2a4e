//! Quantization against its reference implementation.

use mipvog::base::error::Place;
use mipvog::model::baked::{Codes, DensityDomain, Encoding, NumberType};
use mipvog::model::grid::{NodeMask, Nodes};
use mipvog::quantize::{
    Bits, BlockEncoder, BlockSource, Code, CodePlanes, FrameShape, GroupCodes, color_encoding,
    decode_codes, density_encoding, run_bytes, run_codes,
};

use super::plain::{opacity, sigmoid};
use super::stress::Worst;
use super::stress_scalar::{INTERVALS, SHIFTS, activation, raws};

/// The activation of values.
type Activate = Box<dyn Fn(f64) -> f64>;

/// Every encoding of some bits.
fn encodings(bits: Bits) -> Vec<(Encoding, Activate)> {
    let mut all: Vec<(Encoding, Activate)> = vec![(color_encoding(bits), Box::new(sigmoid))];
    for (shift, interval) in SHIFTS.into_iter().flat_map(|s| INTERVALS.map(|i| (s, i))) {
        let encoding = |domain| density_encoding(bits, domain, &activation(shift, interval));
        let raw = move |raw: f64| opacity(raw, shift.into(), interval.into());
        all.push((encoding(DensityDomain::Raw), Box::new(raw)));
        if interval == 0.5 {
            let depth = |root: f64| -(-root.max(0.0).powi(2)).exp_m1();
            all.push((encoding(DensityDomain::SqrtOpticalDepth), Box::new(depth)));
            all.push((encoding(DensityDomain::Opacity), Box::new(|alpha| alpha.clamp(0.0, 1.0))));
        }
    }
    all
}

/// The values as decoded from a stored block.
fn stored(encoding: &Encoding, values: &[f32]) -> Vec<f32> {
    let edge = (1..).find(|edge: &usize| edge.pow(3) >= values.len()).expect("an edge").max(2);
    let mut padded = values.to_vec();
    padded.resize(edge.pow(3), values[0]);
    let retained = NodeMask::full(Nodes([edge; 3]));
    let activation = activation(SHIFTS[0], 0.5);
    let group = GroupCodes { encoding, channels: 1, bound: None, everywhere: false };
    let planes = CodePlanes::new(&retained, activation, [group]);
    for (x, plane) in padded.chunks(edge * edge).enumerate() {
        planes.put(x, 0, plane);
    }
    let slab = planes.take(0..edge);
    let source = BlockSource { slab: &slab, retained: &retained, place: [0; 3] };
    let encoder = BlockEncoder::new(encoding.clone(), 1, edge, &activation);
    let (frame, _) = encoder.frame(source, source.retained_nodes(edge), 0, None);
    let bytes = run_bytes(encoder.shape(), &[frame], encoder.dont_care_max()).bytes;
    let codes = match encoding.number {
        NumberType::U8 => Codes::U8(restored(encoder.shape(), &bytes)),
        NumberType::U16 | NumberType::F16 => Codes::U16(restored(encoder.shape(), &bytes)),
        NumberType::F32 => Codes::U32(restored(encoder.shape(), &bytes)),
    };
    let mut back = vec![0.0; values.len()];
    decode_codes(encoding, &codes, 0..values.len(), &mut back);
    back
}

/// The codes of a run of one frame.
fn restored<T: Code>(shape: FrameShape, bytes: &[u8]) -> Vec<T> {
    let mut codes = vec![T::default(); shape.nodes()];
    run_codes(shape, bytes, &mut codes, &Place::File).expect("a run that was just made");
    codes
}

/// Values to store: those that hurt, and of integers every border's neighbourhood.
fn to_store(encoding: &Encoding) -> Vec<f32> {
    let mut values: Vec<f32> = raws().chain([f32::MAX, f32::MIN]).collect();
    if encoding.number.is_float() {
        // All magnitudes of f16.
        let sizes = (0..3000).map(|i| 3e-8 * 1.0095f32.powi(i));
        values.extend(sizes.flat_map(|size| [size, -size]));
    } else {
        let decoded: Vec<f32> = encoding.values().collect();
        for pair in decoded.windows(2) {
            let border = 0.5 * pair[0] + 0.5 * pair[1];
            values.extend([border.next_down(), border, border.next_up()]);
        }
    }
    let domain = encoding.decode.density();
    if matches!(domain, Some(DensityDomain::SqrtOpticalDepth | DensityDomain::Opacity)) {
        // Neither is below 0, nor opacity above 1.
        let most = if domain == Some(DensityDomain::Opacity) { 1.0 } else { f32::MAX };
        values.iter_mut().for_each(|value| *value = value.abs().min(most));
    }
    values
}

pub fn quantize() -> Worst {
    let mut worst = Worst::default();
    for bits in (4..=16).map(Bits::Integer).chain([Bits::F16]) {
        for (encoding, activate) in encodings(bits) {
            let values = to_store(&encoding);
            for (&value, back) in values.iter().zip(stored(&encoding, &values)) {
                let (got, want) = (activate(back.into()), activate(value.into()));
                let at = || format!("{value} as {back}, {encoding:?}");
                // Sums of the reference are right to 1e-15.
                let scale = f64::from(encoding.max_error) + 1e-14;
                worst.take(got, want, scale, &at);
            }
        }
    }
    worst
}

pub fn decode() -> Worst {
    let mut worst = Worst::default();
    for (encoding, _) in (4..=16).map(Bits::Integer).flat_map(encodings) {
        let values: Vec<f32> = encoding.values().collect();
        for (code, got) in stored(&encoding, &values).into_iter().enumerate() {
            let x = code as f64 - 2f64.powi(encoding.bits as i32 - 1);
            let [center, step, curve] =
                [encoding.center, encoding.step, encoding.curve].map(f64::from);
            let value = match (encoding.empty_code, code) {
                (true, 0) => encoding.empty.into(),
                _ => center + x * (step + curve * x * x),
            };
            let scale = center.abs() + x.abs() * (step + curve * x * x);
            worst.take(got.into(), value, scale, &|| format!("code {code}, {encoding:?}"));
        }
    }
    worst
}

pub fn floats() -> Worst {
    let mut worst = Worst::default();
    let values: Vec<f32> = to_store(&color_encoding(Bits::F16));
    let exact = stored(&color_encoding(Bits::F32), &values);
    for (value, back) in values.iter().zip(exact) {
        assert_eq!(value.to_bits(), back.to_bits(), "f32 is stored as it is");
    }
    for (&value, back) in values.iter().zip(stored(&color_encoding(Bits::F16), &values)) {
        let want = f64::from(value.clamp(-65504.0, 65504.0));
        let scale = if want.abs() >= 2f64.powi(-14) { want.abs() } else { 0.0 };
        assert_eq!(value.is_sign_negative(), back.is_sign_negative(), "{value}");
        worst.take(back.into(), want, scale, &|| format!("{value}"));
    }
    worst
}
