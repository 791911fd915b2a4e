//! The tensors of an unpacked file.

use crate::base::error::{Error, ErrorKind, Place, Result};

/// A tensor of the header, in the order of its bytes.
pub struct Row {
    /// Its name.
    pub name: String,
    /// `U8`, `F32` or `F64`, as safetensors names them.
    pub dtype: &'static str,
    /// Sizes of its axes.
    pub shape: Vec<usize>,
    /// Bytes of its values.
    pub bytes: u64,
}

impl Row {
    /// A tensor whose bytes follow from its type and shape.
    ///
    /// # Errors
    ///
    /// `Overflow` for more bytes than can be counted.
    pub fn new(name: String, dtype: &'static str, shape: &[usize]) -> Result<Self> {
        let size = match dtype {
            "U8" => 1,
            "F64" => 8,
            _ => 4,
        };
        let bytes = shape.iter().try_fold(size, |bytes: u64, &n| bytes.checked_mul(n as u64));
        let overflow =
            || Error::new(ErrorKind::Overflow { what: "tensor" }, Place::Tensor(name.clone()));
        let bytes = bytes.ok_or_else(overflow)?;
        Ok(Self { name, dtype, shape: shape.to_vec(), bytes })
    }

    /// Its element type as NumPy names it.
    pub fn numpy_type(&self) -> &'static str {
        match self.dtype {
            "U8" => "|u1",
            "F64" => "<f8",
            _ => "<f4",
        }
    }
}
