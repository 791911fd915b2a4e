//! A bounds-checked reader over bytes of a file.

use crate::base::error::{Error, ErrorKind, Place, Result};

/// Reads little-endian numbers from a slice; no other code indexes file bytes.
#[derive(Debug, Clone)]
pub struct ByteReader<'a> {
    bytes: &'a [u8],
    at: usize,
    /// File offset of `bytes[0]`, so a reader over one chunk still reports file offsets.
    base: u64,
}

impl<'a> ByteReader<'a> {
    /// A reader over `bytes`, which start at `base` in their file.
    pub fn new(bytes: &'a [u8], base: u64) -> Self {
        Self { bytes, at: 0, base }
    }

    /// The next byte's offset in the file.
    pub fn offset(&self) -> u64 {
        self.base + self.at as u64
    }

    /// The next byte's place.
    pub fn place(&self) -> Place {
        Place::Offset(self.offset())
    }

    /// Bytes not yet read.
    pub fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    /// The next `count` bytes.
    pub fn take(&mut self, count: usize) -> Result<&'a [u8]> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let (head, _) = rest.split_at_checked(count).ok_or_else(|| {
            let kind = ErrorKind::Truncated { wanted: count as u64, left: rest.len() as u64 };
            Error::new(kind, self.place())
        })?;
        self.at += count;
        Ok(head)
    }

    /// The next `N` bytes.
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    /// One byte.
    pub fn u8(&mut self) -> Result<u8> {
        self.array::<1>().map(|[byte]| byte)
    }

    /// Two bytes, little-endian.
    pub fn u16(&mut self) -> Result<u16> {
        self.array().map(u16::from_le_bytes)
    }

    /// Four bytes, little-endian.
    pub fn u32(&mut self) -> Result<u32> {
        self.array().map(u32::from_le_bytes)
    }

    /// Eight bytes, little-endian.
    pub fn u64(&mut self) -> Result<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Four bytes, little-endian, two's complement.
    pub fn i32(&mut self) -> Result<i32> {
        self.array().map(i32::from_le_bytes)
    }

    /// The bytes up to a newline, which is read too and not returned.
    pub fn line(&mut self) -> Result<&'a [u8]> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let Some(length) = rest.iter().position(|&byte| byte == b'\n') else {
            let left = rest.len() as u64;
            return Err(Error::new(ErrorKind::Truncated { wanted: left + 1, left }, self.place()));
        };
        let line = self.take(length)?;
        self.take(1)?;
        Ok(line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_little_endian_and_reports_file_offsets() {
        let mut reader = ByteReader::new(&[1, 0, 2, 0, 0, 0, b'a', b'\n', 9], 100);
        assert_eq!(reader.u16().expect("two bytes"), 1);
        assert_eq!(reader.u32().expect("four bytes"), 2);
        assert_eq!(reader.line().expect("a line"), b"a");
        assert_eq!((reader.offset(), reader.left()), (108, 1));
        let error = reader.u64().expect_err("one byte left");
        assert_eq!(error.place(), &Place::Offset(108));
        assert!(matches!(error.kind(), ErrorKind::Truncated { wanted: 8, left: 1 }));
        assert_eq!(reader.u8().expect("untouched by the failure"), 9);
        assert!(reader.line().is_err());
    }
}
