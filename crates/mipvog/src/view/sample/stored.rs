//! A field's values, trained or baked.

use super::{Dense, Sparse};

/// Values of either kind.
#[derive(Debug)]
pub enum Stored<const C: usize> {
    /// As trained.
    Dense(Dense<C>),
    /// Baked.
    Sparse(Sparse<C>),
}
