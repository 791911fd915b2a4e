//! Things of kinds that are not read: they stay closed until somebody needs them.

use crate::base::error::{Error, Place};

/// A tensor that is not read.
#[derive(Debug)]
pub struct Unread {
    /// Its name.
    pub tensor: String,
    /// Its kind, in a few words.
    pub what: String,
}

impl Unread {
    /// The error for those who need its numbers.
    pub fn error(&self) -> Error {
        unread(Place::Tensor(self.tensor.clone()), &self.what)
    }
}

/// The error for something at `place` that is needed, and of a kind that is not read.
pub(super) fn unread(place: Place, what: &str) -> Error {
    let expected = "plain numbers, texts, and tensors of float16 to float64, bfloat16, bool, uint8 \
                    or int8 to int64";
    Error::unsupported(place, what, expected).advise(
        "save it again as one of these, such as the state_dict of a model and its plain settings",
    )
}
