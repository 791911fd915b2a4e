//! The numbers that packets hold.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Mul};

use crate::model::activate::{self, lanes};

/// Positions, or directions, that are computed together.
pub const LANES: usize = 16;

/// Densities beyond this are opaque at any length.
const DENSEST: f64 = 1e30;

/// A value for each of them.
pub type Lanes<T> = [T; LANES];

/// float32 or float64.
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Mul<Output = Self>
    + AddAssign
    + 'static
{
    /// The nearest one to a number.
    fn of(value: f64) -> Self;

    /// One of a table.
    fn of_stored(value: f32) -> Self;

    /// As float64.
    fn wide(self) -> f64;

    /// Its exponential, 0 to 1e30.
    fn exponential(self) -> f64;

    /// `1 / (1 + exp(-x))`.
    fn sigmoid(self) -> f64;
}

/// Implements [`Real`].
macro_rules! real {
    ($real:ty, $exp:path, $sigmoid:path) => {
        impl Real for $real {
            // One of the two needs the first, the other one the second.
            #[allow(clippy::cast_possible_truncation, clippy::unnecessary_cast)]
            #[inline(always)]
            fn of(value: f64) -> Self {
                value as $real
            }

            #[inline(always)]
            fn of_stored(value: f32) -> Self {
                value.into()
            }

            #[inline(always)]
            fn wide(self) -> f64 {
                self.into()
            }

            #[inline(always)]
            fn exponential(self) -> f64 {
                f64::from($exp(self)).min(DENSEST)
            }

            #[inline(always)]
            fn sigmoid(self) -> f64 {
                $sigmoid(self).into()
            }
        }
    };
}

real!(f32, lanes::exp, lanes::sigmoid);
real!(f64, libm::exp, activate::sigmoid);
