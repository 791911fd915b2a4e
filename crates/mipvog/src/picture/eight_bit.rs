//! PNG and JPEG.

use std::fs::File;
use std::io::{BufRead, BufReader, Read as _, Seek, SeekFrom};
use std::path::Path;

use image::{
    ExtendedColorType, ImageDecoder as _, ImageEncoder, ImageFormat, codecs::png::PngEncoder,
};

use super::Rgba;
use super::sides::{MOST_PIXELS, failed, sides};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::limits::{self, LimitName};

/// The pictures that can be decoded.
const READ: &str = "a PNG or a JPEG";
/// The marker of the JPEG segment that precedes coded values.
const START_OF_SCAN: u8 = 0xda;
/// Maximum expansion of deflated data, in bytes per byte (RFC 1951: a match of 258 bytes takes two
/// bits). JPEGs have fewer: a bit or more stands for a block of 64 values.
const MOST_INFLATED: u64 = 1032;

/// A PNG of 8-bit grey (`values` one a pixel), RGB (three a pixel) or RGBA (four, alpha not
/// multiplied in), rows from the top.
pub fn png(width: usize, height: usize, values: &[u8]) -> Result<Vec<u8>> {
    let color = match values.len().checked_div(width * height) {
        Some(3) => ExtendedColorType::Rgb8,
        Some(4) => ExtendedColorType::Rgba8,
        _ => ExtendedColorType::L8,
    };
    let [w, h] = sides(width, height)?;
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(values, w, h, color)
        .map_err(|error| failed(error.to_string()))?;
    Ok(bytes)
}

/// Width and height of a picture file as stored, from its header. EXIF's orientation is ignored.
/// Formats that [`read`] refuses have a size too.
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

/// The same from bytes; errors name the file `path`.
pub fn decode(mut from: impl BufRead + Seek, path: &Path, max_bytes: u64) -> Result<Rgba> {
    let io = |error| Error::io(error, path);
    let length = from.seek(SeekFrom::End(0)).map_err(io)?;
    from.rewind().map_err(io)?;
    let mut reader = image::ImageReader::new(from).with_guessed_format().map_err(io)?;
    let is_png = reader.format() == Some(ImageFormat::Png);
    match reader.format() {
        Some(ImageFormat::Png) => {}
        Some(ImageFormat::Jpeg) => {
            let mut from = reader.into_inner();
            check_jpeg_end(&mut from, length, max_bytes).map_err(|error| error.in_file(path))?;
            from.rewind().map_err(io)?;
            reader = image::ImageReader::with_format(from, ImageFormat::Jpeg);
        }
        Some(other) => {
            let found = format!("a picture in the format {other:?}");
            let error = Error::unsupported(Place::File, found, READ);
            return Err(error.advise("make PNG or JPEG of it").in_file(path));
        }
        None => return Err(not_a_picture("no format that is known".to_owned(), path)),
    }
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(max_bytes);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|error| unreadable(error, path))?;
    let (width, height) = decoder.dimensions();
    let longest = u64::from(width.max(height));
    let pixels = u64::from(width) * u64::from(height);
    // Once as stored, and once as RGBA.
    let bytes = decoder.total_bytes().saturating_add(pixels.saturating_mul(4));
    limits::check_fixed("pixels along a side", longest, MOST_PIXELS, &Place::File)
        .and_then(|()| {
            limits::check(LimitName::Memory, "bytes of a picture", bytes, max_bytes, &Place::File)
        })
        .map_err(|error| error.in_file(path))?;
    // Memory is allocated as the header states, so the data must be able to fill it. PNG pixels can
    // have one bit each.
    let least = if is_png { pixels / 8 } else { decoder.total_bytes() };
    if least / MOST_INFLATED > length {
        let found = format!("{width} x {height} pixels in {length} bytes");
        let expected = "the data of all its pixels";
        return Err(Error::malformed(Place::File, found, expected).in_file(path));
    }
    let picture = image::DynamicImage::from_decoder(decoder);
    let picture = picture.map_err(|error| unreadable(error, path))?.into_rgba8();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    Ok(Rgba { width, height, bytes: picture.into_raw() })
}

fn unreadable(error: image::ImageError, path: &Path) -> Error {
    match error {
        image::ImageError::IoError(error) if error.kind() == std::io::ErrorKind::NotFound => {
            Error::io(error, path)
        }
        error => not_a_picture(error.to_string(), path),
    }
}

fn not_a_picture(why: String, path: &Path) -> Error {
    let found = format!("a picture that cannot be read ({why})");
    Error::malformed(Place::File, found, READ).in_file(path)
}

/// Refuses a truncated JPEG: its decoder would fill the rest with grey.
fn check_jpeg_end(from: &mut (impl BufRead + Seek), length: u64, max_bytes: u64) -> Result<()> {
    limits::check(LimitName::Memory, "bytes of a picture", length, max_bytes, &Place::File)?;
    let io = |error| Error::new(ErrorKind::Io(error), Place::File);
    from.rewind().map_err(io)?;
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
    // In coded values, FF appears only before 0 and before restart markers.
    match bytes.get(at..).is_some_and(|rest| rest.windows(2).any(|pair| pair == [0xff, 0xd9])) {
        true => Ok(()),
        false => {
            Err(Error::new(ErrorKind::Truncated { wanted: length + 2, left: length }, Place::File))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    /// A PNG whose header states another size.
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
        // Small false sizes are detected from the data.
        read(lying(3, 2)).expect_err("a lie");
    }

    /// A picture of two colours, left and right.
    fn jpeg(width: u32, height: u32) -> Vec<u8> {
        let color = |x| if 2 * x < width { [200, 100, 50] } else { [20, 40, 220] };
        let picture = image::RgbImage::from_fn(width, height, |x, _| image::Rgb(color(x)));
        let mut bytes = Vec::new();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95)
            .encode_image(&picture)
            .expect("a picture");
        bytes
    }

    #[test]
    fn jpegs_are_read_as_stored_and_whole() {
        let mut bytes = jpeg(48, 16);
        // A picture in portrait orientation: viewers rotate it, training codes do not.
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
        for (name, bytes) in [("Tiff", tiff), ("WebP", webp)] {
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
