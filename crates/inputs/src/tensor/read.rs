//! Values of tensors: all in C order, or as a grid that is read in place.

use super::array::Tensor;
use crate::base::bytes::Storage;
use crate::base::error::{Error, Result};
use crate::base::limits::{self, Budget, LimitName, Limits};
use crate::model::field::Volume;
use crate::model::grid::{Element, Nodes};

impl Tensor {
    /// All values in C order, as float32. Verifies the checksum of small storages, and of storages
    /// that the tensor covers.
    pub fn read_f32(&self, budget: &mut Budget) -> Result<Vec<f32>> {
        let packed = self.packed(budget)?;
        let mut out = budget.zeroed(self.length()?, "tensor bytes", &self.place())?;
        self.element.decode(&packed, &mut out);
        Ok(out)
    }

    /// All values in C order, as float64; see [`Tensor::read_f32`].
    pub fn read_f64(&self, budget: &mut Budget) -> Result<Vec<f64>> {
        let packed = self.packed(budget)?;
        let wide = self.count.saturating_mul(size_of::<f64>() as u64);
        budget.spend(wide, "tensor bytes", &self.place())?;
        Ok(match self.element {
            Element::F64 => {
                packed.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect()
            }
            Element::I64 => {
                packed.as_chunks::<8>().0.iter().map(|b| i64::from_le_bytes(*b) as f64).collect()
            }
            Element::I32 => {
                packed.as_chunks::<4>().0.iter().map(|b| i32::from_le_bytes(*b).into()).collect()
            }
            element => {
                let mut out = budget.zeroed(self.length()?, "tensor bytes", &self.place())?;
                element.decode(&packed, &mut out);
                out.into_iter().map(f64::from).collect()
            }
        })
    }

    /// All values in C order of a tensor of bools or bytes; see [`Tensor::read_f32`].
    pub fn read_bool(&self, budget: &mut Budget) -> Result<Vec<bool>> {
        self.check_read()?;
        if !matches!(self.element, Element::Bool | Element::U8) {
            return Err(Error::malformed(
                self.place(),
                format!("{} values", self.element.name()),
                "bool values",
            ));
        }
        Ok(self.packed(budget)?.into_iter().map(|byte| byte != 0).collect())
    }

    /// The tensor as a grid `[1, channels, x, y, z]`, `[channels, x, y, z]` or `[x, y, z]` that is
    /// read in place. It is copied into memory only if it is compressed, or if z is not its fastest
    /// axis.
    ///
    /// # Errors
    /// `Malformed` for another shape or numbers other than floats, `OverLimit` if it is too large.
    pub fn volume(&self, limits: &Limits) -> Result<Volume> {
        self.check_read()?;
        let place = self.place();
        if !matches!(self.element, Element::F16 | Element::BF16 | Element::F32 | Element::F64) {
            return Err(Error::malformed(
                place,
                format!("a grid of {}", self.element.name()),
                "float16, bfloat16, float32 or float64",
            ));
        }
        let (sizes, strides) = match (self.shape.as_slice(), self.strides.as_slice()) {
            (&[1, c, x, y, z], &[_, sc, sx, sy, sz]) | (&[c, x, y, z], &[sc, sx, sy, sz]) => {
                ([c, x, y, z], [sc, sx, sy, sz])
            }
            (&[x, y, z], &[sx, sy, sz]) => ([1, x, y, z], [0, sx, sy, sz]),
            _ => {
                return Err(Error::malformed(
                    place,
                    format!("shape {:?}", self.shape),
                    "a grid [1, channels, x, y, z], [channels, x, y, z] or [x, y, z]",
                ));
            }
        };
        let [channels, x, y, z] = sizes;
        let nodes = Nodes::checked([x, y, z], limits, &place)?;
        limits::check(LimitName::Channels, "channels", channels, limits.channels, &place)?;
        if channels == 0 {
            return Err(Error::malformed(place, "a grid of 0 channels", "at least one"));
        }
        let channels = limits::product(&[channels], "channel count", &place)?;
        let element = self.element;
        let mut budget = Budget::new(limits);
        let [sc, sx, sy, sz] = strides;
        if sz == 1 {
            let storage = self.data.storage(&mut budget)?;
            let strides = [sc, sx, sy];
            return Ok(Volume { nodes, channels, element, storage, first: self.first, strides });
        }
        let storage = Storage::Memory(self.packed(&mut budget)?.into());
        // The product of all sizes fits in memory.
        let strides = [x * y * z, y * z, z];
        Ok(Volume { nodes, channels, element, storage, first: 0, strides })
    }
}
