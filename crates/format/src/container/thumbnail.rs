//! The thumbnail: a small PNG picture of the scene, for file managers and asset libraries.
//!
//! Pixels are not decoded here: readers that show the picture use their own decoder.

use super::layout::THUMBNAIL;
use super::open::Container;
use crate::base::error::{Error, Place, Result};
use crate::base::finding::strict;

/// Maximum number of pixels along the longer side.
pub const LARGEST_THUMBNAIL: usize = 1024;

/// The start of a PNG file: its signature, and the length and the type of its header.
const START: [u8; 16] = *b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR";

/// Width and height of a thumbnail in pixels.
///
/// # Errors
/// `Malformed` for bytes without the start of a PNG file, and for a side of 0 or more than
/// [`LARGEST_THUMBNAIL`] pixels.
pub fn thumbnail_size(png: &[u8], place: &Place) -> Result<[usize; 2]> {
    let malformed =
        |found: String, expected: String| Err(Error::malformed(place.clone(), found, expected));
    let sides = png.strip_prefix(&START).and_then(|rest| rest.first_chunk::<8>());
    let Some([a, b, c, d, e, f, g, h]) = sides.copied() else {
        return malformed("other bytes".to_owned(), "a PNG file".to_owned());
    };
    let sides = [[a, b, c, d], [e, f, g, h]].map(|side| u32::from_be_bytes(side) as usize);
    if sides.iter().any(|side| !(1..=LARGEST_THUMBNAIL).contains(side)) {
        let [width, height] = sides;
        let expected = format!("1 to {LARGEST_THUMBNAIL} pixels along each side");
        return malformed(format!("{width} x {height} pixels"), expected);
    }
    Ok(sides)
}

impl Container {
    /// The thumbnail as a PNG file, if the container has one.
    ///
    /// # Errors
    /// `Malformed` if the chunk is damaged or no PNG file.
    pub fn thumbnail(&self) -> Result<Option<Vec<u8>>> {
        let Some(entry) = self.entry(THUMBNAIL, None) else { return Ok(None) };
        self.in_file(self.chunk(entry, &mut strict).and_then(|bytes| {
            bytes.iter().try_for_each(|bytes| thumbnail_size(bytes, &entry.place()).map(|_| ()))?;
            Ok(bytes)
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_stand_behind_the_start() {
        let png =
            |sides: [u32; 2]| [&START[..], sides.map(u32::to_be_bytes).as_flattened()].concat();
        assert_eq!(thumbnail_size(&png([320, 200]), &Place::File).expect("a PNG file"), [320, 200]);
        for wrong in [[0, 1], [1, 1025], [u32::MAX, 1]] {
            assert!(thumbnail_size(&png(wrong), &Place::File).is_err(), "{wrong:?}");
        }
        assert!(thumbnail_size(&png([1, 1])[..23], &Place::File).is_err());
        assert!(thumbnail_size(b"GIF89a", &Place::File).is_err());
    }
}
