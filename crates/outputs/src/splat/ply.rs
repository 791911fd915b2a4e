//! The file: `binary_little_endian`, one row of float32 for each splat, with the names that the
//! training code of 3D Gaussian Splatting writes.

use super::project::{COLOR, GaussianSplat, OPACITY, PARAMETERS, SIZE};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, LimitName, Limits};
use crate::model::harmonics::FUNCTIONS;

/// Numbers of a row: centre, normal, harmonics, opacity, three sizes, a rotation.
const ROW: usize = 3 + 3 + 3 * FUNCTIONS + 1 + 3 + 4;

fn header(count: usize, comment: &str) -> String {
    let mut text = format!(
        "ply\nformat binary_little_endian 1.0\ncomment {comment}\ncomment Vertical Axis: z\nelement vertex {count}\n"
    );
    let rest = 3 * (FUNCTIONS - 1);
    let names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"].map(str::to_owned);
    let rest = (0..rest).map(|number| format!("f_rest_{number}"));
    let last = ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
    for name in names.into_iter().chain(rest).chain(last.map(str::to_owned)) {
        text += &format!("property float {name}\n");
    }
    text + "end_header\n"
}

/// The bytes of a file.
pub(super) fn bytes(splats: &[GaussianSplat], comment: &str) -> Vec<u8> {
    let mut out = header(splats.len(), comment).into_bytes();
    out.reserve(4 * ROW * splats.len());
    for splat in splats {
        let mut row = [0.0f32; ROW];
        row[..3].copy_from_slice(&splat[..3]);
        for (function, color) in splat[COLOR..].as_chunks::<3>().0.iter().enumerate() {
            for (channel, value) in color.iter().enumerate() {
                // Band 0 comes first; the others channel by channel.
                row[place(function, channel)] = *value;
            }
        }
        let last = 6 + 3 * FUNCTIONS;
        row[last] = splat[OPACITY];
        row[last + 1..last + 4].fill(splat[SIZE]);
        row[last + 4] = 1.0;
        out.extend(row.iter().flat_map(|value| value.to_le_bytes()));
    }
    out
}

/// The place in a row of a coefficient.
fn place(function: usize, channel: usize) -> usize {
    match function {
        0 => 6 + channel,
        _ => 9 + channel * (FUNCTIONS - 1) + function - 1,
    }
}

/// Reads a file that [`bytes`] wrote back.
///
/// # Errors
/// `Malformed` for any other header, and for a length that is not that of the rows.
pub(super) fn read(file: &SourceFile, limits: &Limits) -> Result<Vec<GaussianSplat>> {
    limits::check(
        LimitName::Memory,
        "bytes of splats",
        file.length(),
        limits.memory,
        &Place::File,
    )?;
    let bytes = file.read(0, file.length(), file.length())?;
    let malformed = |found: &str, expected: &str| {
        Error::malformed(Place::Offset(0), found, expected).in_file(file.path())
    };
    let end = b"end_header\n";
    let at = bytes.windows(end.len()).position(|window| window == end);
    let (head, rows) = match at {
        Some(at) => bytes.split_at(at + end.len()),
        None => return Err(malformed("no end of the header", "a .ply")),
    };
    let head = String::from_utf8_lossy(head);
    let value = |name: &str| head.lines().find_map(|line| line.strip_prefix(name)).unwrap_or("");
    let count: usize = value("element vertex ").parse().unwrap_or(0);
    if head != header(count, value("comment ")) || rows.len() != 4 * ROW * count {
        return Err(malformed("another header", "that of splats with harmonics of degree 3"));
    }
    let numbers: Vec<f32> =
        rows.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    let splats = numbers.chunks_exact(ROW).map(|row| {
        let mut splat = [0.0; PARAMETERS];
        splat[..3].copy_from_slice(&row[..3]);
        splat[OPACITY] = row[6 + 3 * FUNCTIONS];
        splat[SIZE] = row[7 + 3 * FUNCTIONS];
        for function in 0..FUNCTIONS {
            for channel in 0..3 {
                splat[COLOR + 3 * function + channel] = row[place(function, channel)];
            }
        }
        splat
    });
    Ok(splats.collect())
}
