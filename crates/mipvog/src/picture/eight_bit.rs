//! PNG and JPEG.

use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read as _, Seek, SeekFrom};
use std::path::Path;

use imagesize::ImageType;
use png::{BitDepth, ColorType};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::{colorspace::ColorSpace, options::DecoderOptions};

use super::Rgba;
use super::sides::{MOST_PIXELS, failed, sides};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, LimitName};

/// The pictures that can be decoded.
const READ: &str = "a PNG or a JPEG";
/// The letter of a JPEG's segment that coded values follow.
const START_OF_SCAN: u8 = 0xda;
/// Bytes that tell the format.
const HEAD: u64 = 64;
/// Bytes that one byte of deflated data stands for, at most (RFC 1951: a match of 258 bytes takes
/// two bits). JPEGs have fewer: a bit or more stands for a block of 64 values.
const MOST_INFLATED: u64 = 1032;

/// A PNG of 8-bit grey (`values` one a pixel), RGB (three a pixel) or RGBA (four, alpha not
/// multiplied in), rows from the top.
pub fn png(width: usize, height: usize, values: &[u8]) -> Result<Vec<u8>> {
    let color = match values.len().checked_div(width * height) {
        Some(3) => ColorType::Rgb,
        Some(4) => ColorType::Rgba,
        _ => ColorType::Grayscale,
    };
    let [w, h] = sides(width, height)?;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, w, h);
    encoder.set_color(color);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.set_filter(png::Filter::Adaptive);
    let write = |encoder: png::Encoder<_>| encoder.write_header()?.write_image_data(values);
    write(encoder).map_err(|error| failed(error.to_string()))?;
    Ok(bytes)
}

/// Width and height of a picture file, as it is stored, from its header: a mark that a viewer should
/// turn it (EXIF's orientation) does not count. Formats that [`read`] refuses have a size too.
pub fn size(path: &Path) -> Result<[usize; 2]> {
    let unreadable = |error| match error {
        imagesize::ImageError::IoError(error)
            if !matches!(
                error.kind(),
                std::io::ErrorKind::UnexpectedEof | std::io::ErrorKind::InvalidData
            ) =>
        {
            Error::io(error, path)
        }
        error => not_a_picture(error.to_string(), path),
    };
    let found = imagesize::size(path).map_err(unreadable)?;
    Ok([found.width, found.height])
}

/// Reads a PNG or a JPEG, at most `max_bytes` of it once decoded.
pub fn read(path: &Path, max_bytes: u64) -> Result<Rgba> {
    let file = File::open(path).map_err(|error| Error::io(error, path))?;
    decode(BufReader::new(file), path, max_bytes)
}

/// The same from bytes, which errors say are the file `path`.
pub fn decode(mut from: impl BufRead + Seek, path: &Path, max_bytes: u64) -> Result<Rgba> {
    let io = |error| Error::io(error, path);
    let length = from.seek(SeekFrom::End(0)).map_err(io)?;
    from.rewind().map_err(io)?;
    let mut head = Vec::new();
    from.by_ref().take(HEAD).read_to_end(&mut head).map_err(io)?;
    from.rewind().map_err(io)?;
    match imagesize::image_type(&head) {
        Ok(ImageType::Png) => decode_png(from, length, path, max_bytes),
        Ok(ImageType::Jpeg) => decode_jpeg(from, length, path, max_bytes),
        Ok(other) => {
            let found = format!("a picture in the format {other:?}");
            let error = Error::unsupported(Place::File, found, READ);
            Err(error.advise("make PNG or JPEG of it").in_file(path))
        }
        Err(_) => Err(not_a_picture("no format that is known".to_owned(), path)),
    }
}

fn decode_png(from: impl BufRead + Seek, length: u64, path: &Path, max_bytes: u64) -> Result<Rgba> {
    let unreadable = |error: png::DecodingError| not_a_picture(error.to_string(), path);
    let most = usize::try_from(max_bytes).unwrap_or(usize::MAX);
    let mut decoder = png::Decoder::new_with_limits(from, png::Limits { bytes: most });
    // Fewer bits than eight become eight; 16 are rounded below.
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(unreadable)?;
    let (width, height) = reader.info().size();
    let stored = reader.output_buffer_size().unwrap_or(usize::MAX);
    let pixels = check_size([width, height], stored, path, max_bytes)?;
    // Pixels may have a bit each.
    check_data([width, height], pixels / 8, length, path)?;
    let mut values = vec![0; stored];
    let frame = reader.next_frame(&mut values).map_err(unreadable)?;
    values.truncate(frame.buffer_size());
    if frame.bit_depth == BitDepth::Sixteen {
        values = values.as_chunks().0.iter().map(|&bytes| eight_bits(bytes)).collect();
    }
    Ok(rgba([width, height], frame.color_type.samples(), values))
}

/// The nearest code of 8 bits.
fn eight_bits(bytes: [u8; 2]) -> u8 {
    let rounded = (u32::from(u16::from_be_bytes(bytes)) + 128) / 257;
    u8::try_from(rounded).unwrap_or(u8::MAX)
}

fn decode_jpeg(
    mut from: impl BufRead + Seek,
    length: u64,
    path: &Path,
    max_bytes: u64,
) -> Result<Rgba> {
    let unreadable =
        |error: zune_jpeg::errors::DecodeErrors| not_a_picture(error.to_string(), path);
    let bytes = whole_jpeg(&mut from, length, max_bytes).map_err(|error| error.in_file(path))?;
    let options = DecoderOptions::default()
        .set_strict_mode(false)
        .set_max_width(usize::MAX)
        .set_max_height(usize::MAX);
    let mut decoder = JpegDecoder::new_with_options(Cursor::new(bytes), options);
    decoder.decode_headers().map_err(unreadable)?;
    let grey = decoder.input_colorspace() == Some(ColorSpace::Luma);
    let (samples, color) = if grey { (1, ColorSpace::Luma) } else { (3, ColorSpace::RGB) };
    decoder.set_options(options.jpeg_set_out_colorspace(color));
    let size = decoder.dimensions().map_or([0; 2], |(w, h)| [w, h]);
    let size = size.map(|side| u32::try_from(side).unwrap_or(u32::MAX));
    let [width, height] = size.map(|side| side as usize);
    let stored = width.saturating_mul(height).saturating_mul(samples);
    check_size(size, stored, path, max_bytes)?;
    check_data(size, stored as u64, length, path)?;
    Ok(rgba(size, samples, decoder.decode().map_err(unreadable)?))
}

/// Holds a picture to the limits: once as stored, and once as RGBA. Returns its pixels.
fn check_size(size: [u32; 2], stored: usize, path: &Path, max_bytes: u64) -> Result<u64> {
    let [width, height] = size.map(u64::from);
    let pixels = width * height;
    let bytes = (stored as u64).saturating_add(pixels.saturating_mul(4));
    let longest = width.max(height);
    limits::check_fixed("pixels along a side", longest, MOST_PIXELS, &Place::File)
        .and_then(|()| {
            limits::check(LimitName::Memory, "bytes of a picture", bytes, max_bytes, &Place::File)
        })
        .map_err(|error| error.in_file(path))?;
    Ok(pixels)
}

/// Refuses a size that the data cannot fill: memory is asked for by the header's word.
fn check_data([width, height]: [u32; 2], least: u64, length: u64, path: &Path) -> Result<()> {
    if least / MOST_INFLATED > length {
        let found = format!("{width} x {height} pixels in {length} bytes");
        let expected = "the data of all its pixels";
        return Err(Error::malformed(Place::File, found, expected).in_file(path));
    }
    Ok(())
}

/// Pixels of grey, grey and alpha, RGB or RGBA as RGBA.
fn rgba(size: [u32; 2], samples: usize, values: Vec<u8>) -> Rgba {
    let [width, height] = size.map(|side| side as usize);
    let bytes = match samples {
        1 => values.iter().flat_map(|&grey| [grey, grey, grey, u8::MAX]).collect(),
        2 => values.as_chunks().0.iter().flat_map(|&[grey, a]| [grey, grey, grey, a]).collect(),
        3 => values.as_chunks().0.iter().flat_map(|&[r, g, b]| [r, g, b, u8::MAX]).collect(),
        _ => values,
    };
    Rgba { width, height, bytes }
}

fn not_a_picture(why: String, path: &Path) -> Error {
    let found = format!("a picture that cannot be read ({why})");
    Error::malformed(Place::File, found, READ).in_file(path)
}

/// The bytes of a JPEG. One that is cut short is refused: its decoder would make the rest grey.
fn whole_jpeg(from: &mut (impl BufRead + Seek), length: u64, max_bytes: u64) -> Result<Vec<u8>> {
    limits::check(LimitName::Memory, "bytes of a picture", length, max_bytes, &Place::File)?;
    let io = |error| Error::new(ErrorKind::Io(error), Place::File);
    let mut bytes = Vec::new();
    from.take(length).read_to_end(&mut bytes).map_err(io)?;
    // Segments: FF, a letter, two bytes of length. Thumbnails in them have ends of their own.
    let mut at = 2;
    while let Some(&[0xff, kind, high, low]) = bytes.get(at..).and_then(|rest| rest.first_chunk()) {
        if kind == 0xff {
            at += 1;
            continue;
        }
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
        if kind == START_OF_SCAN {
            break;
        }
    }
    // FF stands in coded values only before 0 and before marks of restarts.
    match bytes.get(at..).is_some_and(|rest| rest.windows(2).any(|pair| pair == [0xff, 0xd9])) {
        true => Ok(bytes),
        false => {
            Err(Error::new(ErrorKind::Truncated { wanted: length + 2, left: length }, Place::File))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    /// A PNG whose header says another size.
    fn lying(width: u32, height: u32) -> Vec<u8> {
        let mut bytes = png(2, 2, &[0; 12]).expect("a picture");
        // The first chunk: length, name, width, height, five bytes, CRC-32 from the name on.
        bytes[16..20].copy_from_slice(&width.to_be_bytes());
        bytes[20..24].copy_from_slice(&height.to_be_bytes());
        let sum = crc32fast::hash(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&sum.to_be_bytes());
        bytes
    }

    /// A PNG of 1600 x 1600 pixels of one bit, all of them 0.
    fn blank(color: u8) -> Vec<u8> {
        use std::io::Write as _;

        let mut deflated = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
        deflated.write_all(&[0; 1600 * (1 + 1600 / 8)]).expect("pixels");
        let side = 1600_u32.to_be_bytes();
        let header = [&side[..], &side[..], &[1, color, 0, 0, 0]].concat();
        let deflated = deflated.finish().expect("an end");
        let chunks =
            [(b"IHDR", &header[..]), (b"PLTE", &[0; 6]), (b"IDAT", &deflated), (b"IEND", &[])];
        let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
        for (name, data) in chunks.into_iter().filter(|(name, _)| color == 3 || *name != b"PLTE") {
            bytes.extend((data.len() as u32).to_be_bytes());
            let body = [&name[..], data].concat();
            bytes.extend_from_slice(&body);
            bytes.extend(crc32fast::hash(&body).to_be_bytes());
        }
        bytes
    }

    #[test]
    fn blank_pictures_of_few_bits_are_read() {
        for (color, what) in [(0, "grey"), (3, "of a palette")] {
            let read = decode(Cursor::new(blank(color)), Path::new("a.png"), 1 << 40);
            let read = read.unwrap_or_else(|error| panic!("{what}: {error}"));
            assert!(read.bytes == [0, 0, 0, 255].repeat(1600 * 1600), "{what}");
        }
    }

    #[test]
    fn every_colour_type_is_read_as_rgba() {
        let read = |color: ColorType, values: &[u8]| {
            let mut bytes = Vec::new();
            let mut encoder = png::Encoder::new(&mut bytes, 1, 1);
            encoder.set_color(color);
            let wide = values.len() > color.samples();
            encoder.set_depth(if wide { BitDepth::Sixteen } else { BitDepth::Eight });
            let mut writer = encoder.write_header().expect("a header");
            writer.write_image_data(values).expect("pixels");
            writer.finish().expect("an end");
            decode(Cursor::new(bytes), Path::new("a.png"), 1 << 20).expect("a picture").bytes
        };
        assert_eq!(read(ColorType::Grayscale, &[7]), [7, 7, 7, 255]);
        assert_eq!(read(ColorType::GrayscaleAlpha, &[7, 9]), [7, 7, 7, 9]);
        assert_eq!(read(ColorType::Rgb, &[1, 2, 3]), [1, 2, 3, 255]);
        // 128 of 257 and less are rounded down.
        let wide = [0, 128, 0, 129, 255, 126, 255, 127];
        assert_eq!(read(ColorType::Rgba, &wide), [0, 1, 254, 255]);
    }

    #[test]
    fn memory_is_asked_for_only_where_the_data_can_fill_it() {
        let read = |bytes: Vec<u8>| decode(Cursor::new(bytes), Path::new("a.png"), 1 << 40);
        assert_eq!(read(lying(2, 2)).expect("a picture").bytes.len(), 16);
        for (size, told) in [
            ([65_536, 65_536], "the data of all its pixels"),
            ([40_000, 4_000], "the data of all its pixels"),
            ([100_000, 3], "pixels along a side"),
            ([u32::MAX >> 1, 1], "pixels along a side"),
        ] {
            let error = read(lying(size[0], size[1])).expect_err("a lie").to_string();
            assert!(error.contains(told) && error.contains("a.png"), "{size:?}: {error}");
        }
        // Small lies are found by the data.
        read(lying(3, 2)).expect_err("a lie");
    }

    /// 48 x 16 pixels of two colours, left and right.
    const JPEG: &[u8] = include_bytes!("../../../../fixtures/pictures/two_colors.jpg");

    #[test]
    fn jpegs_are_read_as_stored_and_whole() {
        let mut bytes = JPEG.to_vec();
        // A camera that was held upright: viewers turn it, training codes do not.
        let turned = b"\xff\xe1\x00\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\
                       \x06\0\0\0\0\0\0\0";
        bytes.splice(2..2, turned.iter().copied());
        let read = |bytes: &[u8]| decode(Cursor::new(bytes), Path::new("a.jpg"), 1 << 30);
        let picture = read(&bytes).expect("a picture");
        assert_eq!((picture.width, picture.height), (48, 16));
        for (pixel, wanted) in [(0, [200, 100, 50, 255]), (47, [20, 40, 220, 255])] {
            let found = &picture.bytes[4 * pixel..4 * pixel + 4];
            let far = found.iter().zip(wanted).map(|(&a, b)| a.abs_diff(b)).max();
            assert!(far <= Some(3), "{found:?} for {wanted:?}");
        }
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("named.png");
        std::fs::write(&path, &bytes).expect("writable");
        assert_eq!(size(&path).expect("a size"), [48, 16]);
        let error = read(&bytes[..bytes.len() - 2]).expect_err("cut");
        assert!(matches!(error.kind(), ErrorKind::Truncated { .. }), "{error}");
        for cut in 0..bytes.len() - 2 {
            read(&bytes[..cut]).expect_err("cut");
        }
    }

    #[test]
    fn other_pictures_have_a_size_and_are_refused_by_their_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut tiff = b"II*\0\x08\0\0\0\x02\0".to_vec();
        for (tag, side) in [(0x100u16, 200u32), (0x101, 150)] {
            tiff.extend(
                [&tag.to_le_bytes()[..], b"\x04\0\x01\0\0\0", &side.to_le_bytes()].concat(),
            );
        }
        // 14 bits for each side less 1, from the lowest.
        let sides = (199u32 | 149 << 14).to_le_bytes();
        let webp = [b"RIFF\x1a\0\0\0WEBPVP8L\x0d\0\0\0\x2f", &sides[..], &[0; 8]].concat();
        for (name, bytes) in [("Tiff", tiff), ("Webp", webp)] {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).expect("writable");
            assert_eq!(size(&path).expect("a size"), [200, 150], "{name}");
            let error = read(&path, 1 << 30).expect_err("not decoded");
            assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
            assert!(error.to_string().contains(name), "{error}");
        }
        let path = folder.path().join("text.png");
        std::fs::write(&path, b"version https://git-lfs.github.com/spec/v1\n").expect("writable");
        size(&path).expect_err("no picture");
        assert!(matches!(
            size(&folder.path().join("none")).expect_err("none").kind(),
            ErrorKind::Io(_)
        ));
    }
}
