//! Objects of unsupported kinds: an error only if they are needed.

use crate::base::error::{Error, Place};

/// An unsupported tensor.
#[derive(Debug)]
pub struct Unread {
    /// Its name.
    pub tensor: String,
    /// Its kind, in a few words.
    pub what: String,
}

impl Unread {
    /// The error if its numbers are needed.
    pub fn error(&self) -> Error {
        unread(Place::Tensor(self.tensor.clone()), &self.what)
    }
}

/// The error for an object at `place` that is needed, but of an unsupported kind.
pub(super) fn unread(place: Place, what: &str) -> Error {
    let expected = "plain numbers, texts, and tensors of float16 to float64, bfloat16, bool, uint8 \
                    or int8 to int64";
    Error::unsupported(place, what, expected).advise(
        "save it again as one of these, such as the state_dict of a model and its plain settings",
    )
}
