//! `.spz` (github.com/nianticlabs/spz), version 3: a header of 16 bytes and six arrays, in gzip.
//!
//! | array | of each splat |
//! |---|---|
//! | positions | x, y, z: signed fixed point of 24 bits, with as many after the point as the header says |
//! | alphas | opacity times 255 |
//! | colours | band 0 times 0.15, plus 0.5, times 255 |
//! | scales | 16 times (logarithm + 10) along x, y, z |
//! | rotations | the number of the largest part of the quaternion, and 10 bits of each other one |
//! | harmonics | 128 times a coefficient, plus 128: function by function, each red, green, blue |
//!
//! Axes are right, up, back. Version 4 compresses with zstd, which older readers do not support.

use super::axes::Turn;
use super::project::{COLOR, GaussianSplat, OPACITY, PARAMETERS, SIZE};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::model::activate::lanes;
use crate::model::harmonics::FUNCTIONS;

const MAGIC: [u8; 4] = *b"NGSP";
const VERSION: u32 = 3;
const HEADER: usize = 16;
const DEGREE: u8 = 3;
/// Bytes of a splat: of its position, opacity, colour, scales, rotation and harmonics.
const PARTS: [usize; 6] = [9, 1, 3, 3, 4, 3 * (FUNCTIONS - 1)];
const BYTES: usize = PARTS[0] + PARTS[1] + PARTS[2] + PARTS[3] + PARTS[4] + PARTS[5];
/// The quaternion (0, 0, 0, 1): the last part is the largest, and the others are 0.
const UPRIGHT: [u8; 4] = [0, 0, 0, 3 << 6];
/// Bits of a coordinate before the point and after it, its sign not counted.
const BITS: i32 = 23;
/// Usual and maximum bits after the point.
const USUAL_BITS: i32 = 12;
const MOST_BITS: i32 = 20;
/// Position steps per standard deviation of the smallest splat.
const STEPS: f64 = 32.0;
/// Range of log sizes in a byte.
const SIZES: [f64; 2] = [-10.0, -10.0 + 255.0 / 16.0];
const COLOR_SCALE: f32 = 0.15;

/// gzip: deflate, no name, no time, unknown system.
const GZIP: [u8; 10] = [0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 255];
const GZIP_END: usize = 8;
/// Effort of deflate.
const EFFORT: u8 = 6;

/// Bits after the point of positions up to `farthest` from the origin along an axis, for splats
/// with standard deviations of at least `smallest`.
///
/// # Errors
/// `Unsupported` for splats that the format cannot place.
pub(super) fn bits(farthest: f64, smallest: f64) -> Result<i32> {
    let fits = |bits: i32| farthest * libm::ldexp(1.0, bits) < libm::ldexp(1.0, BITS) - 1.0;
    let fine = |bits: i32| libm::ldexp(1.0, -bits) * STEPS <= smallest;
    let wanted = (USUAL_BITS..MOST_BITS).find(|&bits| fine(bits)).unwrap_or(MOST_BITS);
    let bits = (0..=wanted).rev().find(|&bits| fits(bits)).unwrap_or(0);
    if fits(bits) && libm::ldexp(1.0, -bits) <= smallest {
        return Ok(bits);
    }
    let found =
        format!("splats of {smallest:.3e} world units up to {farthest:.3e} from the origin");
    let expected = "a ratio below 8 million, which .spz can place: write .ply or .glb, or move the \
                    scene with transcode --translate";
    Err(Error::unsupported(Place::File, found, expected))
}

/// Refuses sizes outside the range of a byte.
///
/// # Errors
/// `Unsupported`.
pub(super) fn check_sizes(smallest: f64, largest: f64) -> Result<()> {
    let [low, high] = SIZES.map(libm::exp);
    if smallest >= low && largest <= high {
        return Ok(());
    }
    let found = format!("splats of {smallest:.3e} to {largest:.3e} world units");
    let expected = format!(
        "{low:.1e} to {high:.0}, which .spz holds: write .ply or .glb, or scale the scene with \
         transcode --scale"
    );
    Err(Error::unsupported(Place::File, found, expected))
}

/// The bytes of a file of splats in training axes.
pub(super) fn bytes(splats: &[GaussianSplat], bits: i32) -> Vec<u8> {
    let turn = Turn::z_up_to_y_up();
    let turned: Vec<GaussianSplat> = splats.iter().map(|splat| turn.splat(splat)).collect();
    let count = u32::try_from(splats.len()).unwrap_or(u32::MAX);
    let mut raw = Vec::with_capacity(HEADER + BYTES * splats.len());
    raw.extend(MAGIC);
    raw.extend(VERSION.to_le_bytes());
    raw.extend(count.to_le_bytes());
    raw.extend([DEGREE, bits as u8, 0, 0]);
    let step = libm::ldexp(1.0, bits);
    for splat in &turned {
        for &at in &splat[..3] {
            let [a, b, c, _] = (libm::rint(f64::from(at) * step) as i32).to_le_bytes();
            raw.extend([a, b, c]);
        }
    }
    raw.extend(turned.iter().map(|splat| byte(255.0 * lanes::sigmoid(splat[OPACITY]))));
    for splat in &turned {
        let color = &splat[COLOR..COLOR + 3];
        raw.extend(color.iter().map(|value| byte(255.0 * (COLOR_SCALE * value + 0.5))));
    }
    for splat in &turned {
        raw.extend([byte(16.0 * (splat[SIZE] + 10.0)); 3]);
    }
    turned.iter().for_each(|_| raw.extend(UPRIGHT));
    for splat in &turned {
        raw.extend(splat[COLOR + 3..].iter().map(|value| byte(128.0 * value + 128.0)));
    }
    let mut out = GZIP.to_vec();
    out.extend(miniz_oxide::deflate::compress_to_vec(&raw, EFFORT));
    out.extend(crc32fast::hash(&raw).to_le_bytes());
    out.extend((raw.len() as u32).to_le_bytes());
    out
}

/// The nearest byte.
fn byte(value: f32) -> u8 {
    libm::roundf(value).clamp(0.0, 255.0) as u8
}

/// Reads a file that [`bytes`] wrote back, into training axes.
///
/// # Errors
/// `Malformed` for any other file, and more memory than the limits allow.
pub(super) fn read(file: &SourceFile, limits: &Limits) -> Result<Vec<GaussianSplat>> {
    let check = |bytes: u64| {
        limits::check(LimitName::Memory, "bytes of splats", bytes, limits.memory, &Place::File)
    };
    check(file.length())?;
    let bytes = file.read(0, file.length(), file.length())?;
    let wrong = || {
        let expected = "splats with harmonics of degree 3 in gzip";
        Error::malformed(Place::File, "another .spz", expected).in_file(file.path())
    };
    let (packed, end) = bytes.split_last_chunk::<GZIP_END>().ok_or_else(wrong)?;
    let packed = packed.strip_prefix(&GZIP).ok_or_else(wrong)?;
    let [.., a, b, c, d] = *end;
    let length = u32::from_le_bytes([a, b, c, d]) as usize;
    check(length as u64)?;
    let inflated = miniz_oxide::inflate::decompress_to_vec_with_limit(packed, length);
    let raw = inflated.map_err(|_| wrong())?;
    if raw.len() != length || !end.starts_with(&crc32fast::hash(&raw).to_le_bytes()) {
        return Err(wrong());
    }
    let (header, mut rest) = raw.split_at_checked(HEADER).ok_or_else(wrong)?;
    let count = rest.len() / BYTES;
    let mut expected = [&MAGIC[..], &VERSION.to_le_bytes(), &(count as u32).to_le_bytes()].concat();
    let bits = header.get(13).copied().unwrap_or(0);
    expected.extend([DEGREE, bits, 0, 0]);
    if header != expected || rest.len() != BYTES * count || i32::from(bits) > MOST_BITS {
        return Err(wrong());
    }
    let mut parts = Vec::new();
    for size in PARTS {
        let (part, behind) = rest.split_at(size * count);
        parts.push((part, size));
        rest = behind;
    }
    let turn = Turn::y_up_to_z_up();
    let step = libm::ldexpf(1.0, -i32::from(bits));
    let splat = |number: usize| {
        let part = |place: usize| {
            let (bytes, size): &(&[u8], usize) = parts.get(place)?;
            bytes.get(number * size..(number + 1) * size)
        };
        let mut splat = [0.0f32; PARAMETERS];
        for (out, bytes) in splat.iter_mut().zip(part(0)?.as_chunks::<3>().0) {
            let [a, b, c] = *bytes;
            *out = step * (i32::from_le_bytes([0, a, b, c]) >> 8) as f32;
        }
        // An opacity of 1 has no finite logit.
        let opacity = (f32::from(*part(1)?.first()?) / 255.0).clamp(1e-6, 1.0 - 1e-6);
        splat[OPACITY] = lanes::ln(f64::from(opacity / (1.0 - opacity))) as f32;
        splat[SIZE] = f32::from(*part(3)?.first()?) / 16.0 - 10.0;
        for (out, byte) in splat[COLOR..].iter_mut().zip(part(2)?) {
            *out = (f32::from(*byte) / 255.0 - 0.5) / COLOR_SCALE;
        }
        for (out, byte) in splat[COLOR + 3..].iter_mut().zip(part(5)?) {
            *out = (f32::from(*byte) - 128.0) / 128.0;
        }
        Some(turn.splat(&splat))
    };
    (0..count).map(splat).collect::<Option<_>>().ok_or_else(wrong)
}
