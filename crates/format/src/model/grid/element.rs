//! Numbers in tensor files.

use half::slice::HalfFloatSliceExt;

/// The type of a tensor's elements, little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Element {
    /// IEEE binary16.
    F16,
    /// The upper half of a binary32.
    BF16,
    /// IEEE binary32.
    F32,
    /// IEEE binary64.
    F64,
    /// One byte, 0 or not.
    Bool,
    /// Unsigned byte.
    U8,
    /// Signed byte.
    I8,
    /// Two bytes, two's complement.
    I16,
    /// Two bytes, unsigned.
    U16,
    /// Four bytes, two's complement.
    I32,
    /// Eight bytes, two's complement.
    I64,
}

impl Element {
    /// Bytes of one element.
    pub const fn size(self) -> usize {
        match self {
            Self::Bool | Self::U8 | Self::I8 => 1,
            Self::F16 | Self::BF16 | Self::I16 | Self::U16 => 2,
            Self::F32 | Self::I32 => 4,
            Self::F64 | Self::I64 => 8,
        }
    }

    /// From NumPy's code for it, without the byte order.
    pub fn from_numpy(code: &str) -> Option<Self> {
        Some(match code {
            "f2" => Self::F16,
            "f4" => Self::F32,
            "f8" => Self::F64,
            "b1" => Self::Bool,
            "u1" => Self::U8,
            "i1" => Self::I8,
            "i2" => Self::I16,
            "u2" => Self::U16,
            "i4" => Self::I32,
            "i8" => Self::I64,
            _ => return None,
        })
    }

    /// Its name, as reports print it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::F16 => "float16",
            Self::BF16 => "bfloat16",
            Self::F32 => "float32",
            Self::F64 => "float64",
            Self::Bool => "bool",
            Self::U8 => "uint8",
            Self::I8 => "int8",
            Self::I16 => "int16",
            Self::U16 => "uint16",
            Self::I32 => "int32",
            Self::I64 => "int64",
        }
    }

    /// Decodes one element of each row of bytes, `at` bytes after its start.
    pub fn decode_column(self, rows: &[u8], row_bytes: usize, at: usize, out: &mut Vec<f32>) {
        let columns =
            rows.chunks_exact(row_bytes.max(1)).map(|row| row.get(at..).unwrap_or_default());
        out.clear();
        match self {
            Self::F16 => {
                let column = columns.map(|bytes| bytes.first_chunk().copied().unwrap_or_default());
                let column: Vec<_> = column.collect();
                out.resize(column.len(), 0.0);
                halves(&column, out);
            }
            Self::F32 => {
                out.extend(columns.map(|bytes| {
                    f32::from_le_bytes(bytes.first_chunk().copied().unwrap_or_default())
                }))
            }
            other => out.extend(columns.map(|bytes| {
                let mut value = [0.0];
                other.decode(bytes, &mut value);
                value[0]
            })),
        }
    }

    /// Decodes as many elements as `out` holds; `bytes` are at least as many. Values that float32
    /// cannot hold are rounded to nearest.
    pub fn decode(self, bytes: &[u8], out: &mut [f32]) {
        macro_rules! each {
            ($size:literal, $from:expr) => {
                for (value, bytes) in out.iter_mut().zip(bytes.as_chunks::<$size>().0) {
                    *value = $from(*bytes);
                }
            };
        }
        match self {
            Self::F16 => halves(bytes.as_chunks().0, out),
            Self::BF16 => each!(2, |b| half::bf16::from_le_bytes(b).to_f32()),
            Self::F32 => each!(4, f32::from_le_bytes),
            Self::F64 => each!(8, |b| f64::from_le_bytes(b) as f32),
            Self::Bool => each!(1, |[b]: [u8; 1]| f32::from(u8::from(b != 0))),
            Self::U8 => each!(1, |[b]: [u8; 1]| f32::from(b)),
            Self::I8 => each!(1, |b| f32::from(i8::from_le_bytes(b))),
            Self::I16 => each!(2, |b| f32::from(i16::from_le_bytes(b))),
            Self::U16 => each!(2, |b| f32::from(u16::from_le_bytes(b))),
            Self::I32 => each!(4, |b| i32::from_le_bytes(b) as f32),
            Self::I64 => each!(8, |b| i64::from_le_bytes(b) as f32),
        }
    }
}

/// Decodes float16 numbers in batches, because single ones would be a call each. A piece is copied
/// by vectors and converted later, because vector loads stall on numbers that were just stored one
/// by one.
fn halves(bytes: &[[u8; 2]], out: &mut [f32]) {
    let mut piece = [half::f16::ZERO; 512];
    for (bytes, out) in bytes.chunks(piece.len()).zip(out.chunks_mut(piece.len())) {
        let piece = &mut piece[..out.len()];
        for (half, &bytes) in piece.iter_mut().zip(bytes) {
            *half = half::f16::from_le_bytes(bytes);
        }
        piece.convert_to_f32_slice(out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(element: Element, bytes: &[u8]) -> Vec<f32> {
        let mut out = vec![0.0; bytes.len() / element.size()];
        element.decode(bytes, &mut out);
        out
    }

    #[test]
    fn every_element_decodes_its_extremes() {
        assert_eq!(decoded(Element::F16, &[0, 0xbc, 0xff, 0x7b]), [-1.0, 65504.0]);
        assert_eq!(decoded(Element::BF16, &[0x80, 0x3f, 0x49, 0xc1]), [1.0, -12.5625]);
        assert_eq!(decoded(Element::F32, &(-0.1f32).to_le_bytes()), [-0.1]);
        assert_eq!(decoded(Element::F64, &1e300f64.to_le_bytes()), [f32::INFINITY]);
        assert_eq!(decoded(Element::Bool, &[0, 1, 255]), [0.0, 1.0, 1.0]);
        assert_eq!(decoded(Element::U8, &[0, 255]), [0.0, 255.0]);
        assert_eq!(decoded(Element::I8, &[128, 127]), [-128.0, 127.0]);
        assert_eq!(decoded(Element::I16, &(-300i16).to_le_bytes()), [-300.0]);
        assert_eq!(decoded(Element::U16, &[0xff, 0xff]), [65535.0]);
        assert_eq!(decoded(Element::I32, &7i32.to_le_bytes()), [7.0]);
        assert_eq!(decoded(Element::I64, &i64::MIN.to_le_bytes()), [-9.223_372e18]);
    }
}
