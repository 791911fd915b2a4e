//! The storages of a pickle's tensors.

use crate::base::error::Result;
use crate::model::grid::Element;
use crate::tensor::zip::Data;

/// Storages that a pickle's tensors refer to by key.
pub(in crate::tensor) trait Storages {
    /// The storage of this key, which holds `count` elements, or bytes if it has no type.
    fn find(&self, key: &str, element: Option<Element>, count: u64) -> Result<Data>;
}
