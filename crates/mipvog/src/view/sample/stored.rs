//! The values of a trained or baked field.

use super::{Dense, Sparse};

/// Values of a field.
#[derive(Debug)]
pub enum Stored<const C: usize> {
    /// A trained field.
    Dense(Dense<C>),
    /// A baked field.
    Sparse(Sparse<C>),
}
