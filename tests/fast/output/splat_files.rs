//! Files of splats, read by readers that are written from the formats' specifications alone.

use std::io::Read as _;

use mipvog::base::limits::Limits;
use mipvog::model::harmonics::basis_f64;
use mipvog_outputs::export_files::ExportFiles;
use mipvog_outputs::splat::{FileKind, GaussianSplat, Origin, PARAMETERS};
use serde_json::Value;

use crate::common::{Random, folder};

/// A splat as a file states it, in the file's axes.
struct Read {
    position: [f64; 3],
    /// Standard deviations, in world units.
    scale: [f64; 3],
    /// x, y, z, w.
    rotation: [f64; 4],
    opacity: f64,
    /// Function by function, each red, green, blue.
    harmonics: Vec<[f64; 3]>,
}

/// Bits of positions after the point.
const BITS: i32 = 14;

/// Splats of any sizes and opacities, on both sides of 0.
fn splats(count: usize) -> Vec<GaussianSplat> {
    let mut random = Random::new(7);
    let splat = |_| {
        let mut splat: GaussianSplat = [0.0; PARAMETERS];
        splat[..3].iter_mut().for_each(|at| *at = random.between(-90.0, 90.0));
        splat[3] = random.between(-9.5, 5.5);
        splat[4] = random.between(-5.0, 8.0);
        splat[5..8].iter_mut().for_each(|color| *color = random.between(-3.0, 3.0));
        splat[8..].iter_mut().for_each(|color| *color = random.between(-0.98, 0.98));
        splat
    };
    (0..count).map(splat).collect()
}

/// The bytes of the files of a kind, the first one first; and what the program's own reader makes
/// of them.
fn written(kind: FileKind, splats: &[GaussianSplat]) -> (Vec<Vec<u8>>, Vec<GaussianSplat>) {
    let folder = folder();
    let path = folder.path().join(format!("a b.{}", kind.extension()));
    let mut files = ExportFiles::new(&path, false);
    let origin = Origin { name: "a\nscene", sha256: "00" };
    kind.write(splats, BITS, &origin, &mut files).expect("written");
    let back = kind.read(&files.written(), &Limits::default()).expect("read back");
    let report = files.written().report().expect("a report");
    files.finish().expect("finished");
    let bytes = |file: &_| -> Vec<u8> {
        let mipvog_outputs::export_files::FileReport { path, .. } = file;
        std::fs::read(path).expect("a file")
    };
    (report.iter().map(bytes).collect(), back)
}

fn floats(bytes: &[u8]) -> Vec<f64> {
    bytes.as_chunks().0.iter().map(|bytes| f64::from(f32::from_le_bytes(*bytes))).collect()
}

/// The layout of github.com/nianticlabs/spz, version 3.
fn read_spz(bytes: &[u8]) -> Vec<Read> {
    let mut raw = Vec::new();
    flate2::read::GzDecoder::new(bytes).read_to_end(&mut raw).expect("gzip, whole");
    assert_eq!(raw[..8], *b"NGSP\x03\0\0\0");
    let count = u32::from_le_bytes([raw[8], raw[9], raw[10], raw[11]]) as usize;
    assert_eq!(raw[12..16], [3, BITS as u8, 0, 0], "degree, fractional bits, flags, reserved");
    let mut rest = &raw[16..];
    let mut part = |size: usize| {
        let (part, behind) = rest.split_at(size * count);
        rest = behind;
        part.chunks(size).map(<[u8]>::to_vec).collect::<Vec<_>>()
    };
    let [positions, alphas, colors, scales, rotations, harmonics] =
        [9, 1, 3, 3, 4, 45].map(&mut part);
    assert!(rest.is_empty());
    let splat = |i: usize| {
        let coordinate = |axis: usize| {
            let low = |at: usize| i64::from(positions[i][3 * axis + at]);
            let unsigned = low(0) + 256 * low(1) + 65536 * low(2);
            let signed = if unsigned >= 1 << 23 { unsigned - (1 << 24) } else { unsigned };
            signed as f64 / f64::from(1 << BITS)
        };
        // The two highest bits are the number of the largest part; the others follow from w down,
        // ten bits each: a sign and nine of the size, of which 511 are one over the root of 2.
        let mut packed = u32::from_le_bytes(rotations[i][..].try_into().expect("four bytes"));
        let largest = (packed >> 30) as usize;
        let mut rotation = [0.0; 4];
        for at in (0..4).rev().filter(|&at| at != largest) {
            let size = f64::from(packed & 511) / 511.0 * 0.5f64.sqrt();
            rotation[at] = if packed >> 9 & 1 == 1 { -size } else { size };
            packed >>= 10;
        }
        let others: f64 = rotation.iter().map(|part| part * part).sum();
        rotation[largest] = (1.0 - others).sqrt();
        let first = [0, 1, 2].map(|at| (f64::from(colors[i][at]) / 255.0 - 0.5) / 0.15);
        let others = harmonics[i].as_chunks::<3>().0.iter();
        let others = others.map(|bytes| bytes.map(|byte| (f64::from(byte) - 128.0) / 128.0));
        Read {
            position: [0, 1, 2].map(coordinate),
            scale: [0, 1, 2].map(|at| (f64::from(scales[i][at]) / 16.0 - 10.0).exp()),
            rotation,
            opacity: f64::from(alphas[i][0]) / 255.0,
            harmonics: std::iter::once(first).chain(others).collect(),
        }
    };
    (0..count).map(splat).collect()
}

/// The attributes of `KHR_gaussian_splatting`.
fn read_gltf(document: &Value, buffer: &[u8]) -> Vec<Read> {
    assert_eq!(document["extensionsUsed"], serde_json::json!(["KHR_gaussian_splatting"]));
    assert!(document.get("extensionsRequired").is_none(), "others draw points");
    assert!(document["nodes"][0].get("rotation").is_none());
    let primitive = &document["meshes"][0]["primitives"][0];
    assert_eq!(primitive["mode"], 0);
    let own = &primitive["extensions"]["KHR_gaussian_splatting"];
    assert_eq!(
        (&own["kernel"], &own["colorSpace"]),
        (&"ellipse".into(), &"srgb_rec709_display".into())
    );
    let attributes = primitive["attributes"].as_object().expect("attributes");
    assert_eq!(attributes.len(), 2 + 3 + 16);
    let accessor =
        |name: &str| &document["accessors"][attributes[name].as_u64().expect(name) as usize];
    let bytes = |name: &str| {
        let view = accessor(name)["bufferView"].as_u64().expect("a view") as usize;
        let view = &document["bufferViews"][view];
        let [start, length] =
            ["byteOffset", "byteLength"].map(|key| view[key].as_u64().expect(key) as usize);
        assert!(start.is_multiple_of(4));
        &buffer[start..start + length]
    };
    let vectors = |name: &str, width: usize| {
        let kind = ["SCALAR", "", "VEC3", "VEC4"][width - 1];
        assert_eq!(
            (&accessor(name)["type"], &accessor(name)["componentType"]),
            (&kind.into(), &5126.into())
        );
        floats(bytes(name)).chunks(width).map(<[f64]>::to_vec).collect::<Vec<_>>()
    };
    let three = |values: &[f64]| [values[0], values[1], values[2]];
    let named = |name: &str, width| vectors(&format!("KHR_gaussian_splatting:{name}"), width);
    let positions = vectors("POSITION", 3);
    let bound = |pick: fn(f64, f64) -> f64, axis: usize| {
        positions.iter().map(|at| at[axis]).reduce(pick).expect("splats")
    };
    for axis in 0..3 {
        assert_eq!(accessor("POSITION")["min"][axis], bound(f64::min, axis));
        assert_eq!(accessor("POSITION")["max"][axis], bound(f64::max, axis));
    }
    let (scales, rotations, opacities) =
        (named("SCALE", 3), named("ROTATION", 4), named("OPACITY", 1));
    let degrees = (0..4).flat_map(|degree| (0..2 * degree + 1).map(move |own| (degree, own)));
    let harmonics: Vec<_> =
        degrees.map(|(degree, own)| named(&format!("SH_DEGREE_{degree}_COEF_{own}"), 3)).collect();
    let color = accessor("COLOR_0");
    assert_eq!((&color["type"], &color["normalized"]), (&"VEC4".into(), &true.into()));
    let shorts: Vec<f64> = bytes("COLOR_0")
        .as_chunks()
        .0
        .iter()
        .map(|two| f64::from(u16::from_le_bytes(*two)) / 65535.0)
        .collect();
    let splat = |i: usize| {
        let read = Read {
            position: three(&positions[i]),
            scale: three(&scales[i]),
            rotation: rotations[i][..].try_into().expect("four"),
            opacity: opacities[i][0],
            harmonics: harmonics.iter().map(|values| three(&values[i])).collect(),
        };
        // Band 0 in linear light, with opacity.
        for channel in 0..3 {
            let shown =
                (0.5 + 0.282_094_791_773_878_14 * read.harmonics[0][channel]).clamp(0.0, 1.0);
            let linear =
                if shown <= 0.04045 { shown / 12.92 } else { ((shown + 0.055) / 1.055).powf(2.4) };
            assert!((shorts[4 * i + channel] - linear).abs() < 1e-4);
        }
        assert!((shorts[4 * i + 3] - read.opacity).abs() < 1e-4);
        read
    };
    (0..positions.len()).map(splat).collect()
}

/// The layout of the training code: names of columns in the header, then rows of float32.
fn read_ply(bytes: &[u8]) -> Vec<Read> {
    let end = b"end_header\n";
    let at =
        bytes.windows(end.len()).position(|window| window == end).expect("a header") + end.len();
    let header = std::str::from_utf8(&bytes[..at]).expect("text");
    let names: Vec<&str> =
        header.lines().filter_map(|line| line.strip_prefix("property float ")).collect();
    let rows = floats(&bytes[at..]);
    let splat = |row: &[f64]| {
        let value = |name: &str| row[names.iter().position(|own| *own == name).expect(name)];
        let rest = |function: usize| {
            [0, 1, 2].map(|channel| value(&format!("f_rest_{}", 15 * channel + function)))
        };
        let first = ["f_dc_0", "f_dc_1", "f_dc_2"].map(value);
        Read {
            position: ["x", "y", "z"].map(value),
            scale: ["scale_0", "scale_1", "scale_2"].map(|name| value(name).exp()),
            rotation: ["rot_1", "rot_2", "rot_3", "rot_0"].map(value),
            opacity: 1.0 / (1.0 + (-value("opacity")).exp()),
            harmonics: std::iter::once(first).chain((0..15).map(rest)).collect(),
        }
    };
    rows.chunks(names.len()).map(splat).collect()
}

/// From training axes, whose z is up, to axes whose y is up.
fn up([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, z, -y]
}

/// Holds splats that were read to those that were written. `steps` are largest errors: of
/// positions, of logarithms of sizes, of opacities, of band 0, of other coefficients.
fn check(read: &[Read], splats: &[GaussianSplat], axes: fn([f64; 3]) -> [f64; 3], steps: [f64; 5]) {
    assert_eq!(read.len(), splats.len());
    let ways = [[0.6, 0.0, 0.8], [-0.36, 0.48, -0.8], [0.0, -1.0, 0.0], [0.48, 0.64, 0.6]];
    for (read, splat) in read.iter().zip(splats) {
        let splat = splat.map(f64::from);
        let place = axes([splat[0], splat[1], splat[2]]);
        for axis in 0..3 {
            let off = (read.position[axis] - place[axis]).abs();
            assert!(off <= steps[0], "{:?} {place:?}", read.position);
            let off = (read.scale[axis].ln() - splat[3]).abs();
            assert!(off <= steps[1], "{:?} {}", read.scale, splat[3].exp());
        }
        assert_eq!(read.rotation.map(f64::abs), [0.0, 0.0, 0.0, 1.0], "upright");
        let opacity = 1.0 / (1.0 + (-splat[4]).exp());
        assert!((read.opacity - opacity).abs() <= steps[2], "{} {opacity}", read.opacity);
        // Colours are those of the same side: the direction turns with the axes.
        for way in ways {
            let (before, after) = (basis_f64(way), basis_f64(axes(way)));
            let most: f64 = after[1..].iter().map(|value| value.abs()).sum::<f64>() * steps[4]
                + after[0] * steps[3];
            for channel in 0..3 {
                let own =
                    after.iter().zip(&read.harmonics).map(|(y, c)| y * c[channel]).sum::<f64>();
                let of = |(function, y): (usize, &f64)| y * splat[5 + 3 * function + channel];
                let expected = before.iter().enumerate().map(of).sum::<f64>();
                // Turned coefficients may be beyond 1, where .spz cuts them off.
                let cut = read.harmonics[1..].iter().any(|c| c[channel].abs() > 0.99);
                assert!((own - expected).abs() <= most || cut, "{own} {expected} {most}");
            }
        }
    }
}

#[test]
fn files_of_splats_hold_what_their_formats_can() {
    for count in [1, 2, 777] {
        let splats = splats(count);
        let (files, back) = written(FileKind::Ply, &splats);
        check(&read_ply(&files[0]), &splats, |at| at, [1e-6, 1e-6, 1e-6, 1e-6, 1e-6]);
        assert_eq!(back, splats);
        let (files, _) = written(FileKind::Spz, &splats);
        let half = 0.5001;
        let steps = [
            half / f64::from(1 << BITS),
            half / 16.0,
            half / 255.0,
            half / 255.0 / 0.15,
            half / 128.0,
        ];
        check(&read_spz(&files[0]), &splats, up, steps);
        let (files, _) = written(FileKind::Glb, &splats);
        let length = u32::from_le_bytes(files[0][12..16].try_into().expect("four")) as usize;
        let document: Value = serde_json::from_slice(&files[0][20..20 + length]).expect("JSON");
        let single = [1e-5, 1e-5, 1e-6, 1e-6, 1e-5];
        check(&read_gltf(&document, &files[0][28 + length..]), &splats, up, single);
        let (files, _) = written(FileKind::Gltf, &splats);
        let document: Value = serde_json::from_slice(&files[0]).expect("JSON");
        assert_eq!(document["buffers"][0]["uri"], "a%20b.bin");
        assert_eq!(document["buffers"][0]["byteLength"], files[1].len());
        check(&read_gltf(&document, &files[1]), &splats, up, single);
    }
}

/// What is read back for the report is what other readers find.
#[test]
fn own_readers_agree_with_those_of_the_specifications() {
    let splats = splats(50);
    for kind in [FileKind::Spz, FileKind::Glb, FileKind::Gltf] {
        let (_, back) = written(kind, &splats);
        assert_eq!(back.len(), splats.len());
        // Half a step of each number of .spz, and the cut of harmonics at 1.
        for (back, splat) in back.iter().zip(&splats) {
            let opacity = |splat: &GaussianSplat| 1.0 / (1.0 + (-splat[4]).exp());
            assert!((0..3).all(|axis| (back[axis] - splat[axis]).abs() < 4e-5), "{kind:?}");
            assert!((back[3] - splat[3]).abs() < 0.032, "{kind:?}");
            assert!((opacity(back) - opacity(splat)).abs() < 0.002, "{kind:?}");
            assert!((5..8).all(|at| (back[at] - splat[at]).abs() < 0.0132), "{kind:?}");
        }
    }
}
