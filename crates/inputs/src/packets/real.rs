//! The numbers that packets hold.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Mul};

use multiversion::multiversion;

use super::encode::{self, Coordinates};
use super::levels::Levels;
use super::perceptron::{self, Both, Perceptron};
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
    fn exp(self) -> f64;

    /// `1 / (1 + exp(-x))`.
    fn sigmoid(self) -> f64;

    /// The network of these numbers.
    fn of_both(both: &Both) -> &Perceptron<Self>;

    /// Adds products of weights and inputs to sums, [`TILE`](perceptron::TILE) of them at a time.
    fn multiply(weights: &[Self], rows: usize, inputs: &[Lanes<Self>], sums: &mut [Lanes<Self>]);

    /// The features of positions, level by level.
    fn encode(levels: &Levels, table: &[f32], at: &Coordinates, out: &mut [Lanes<Self>]);
}

/// Implements [`Real`]: functions for each kind of processor cannot be generic.
macro_rules! real {
    ($real:ty, $field:ident, $multiply:ident, $encode:ident, $exp:path, $sigmoid:path) => {
        #[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
        fn $multiply(
            weights: &[$real],
            rows: usize,
            inputs: &[Lanes<$real>],
            sums: &mut [Lanes<$real>],
        ) {
            perceptron::multiply(weights, rows, inputs, sums);
        }

        #[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
        fn $encode(levels: &Levels, table: &[f32], at: &Coordinates, out: &mut [Lanes<$real>]) {
            encode::encode(levels, table, at, out);
        }

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
            fn exp(self) -> f64 {
                f64::from($exp(self)).min(DENSEST)
            }

            #[inline(always)]
            fn sigmoid(self) -> f64 {
                $sigmoid(self).into()
            }

            fn of_both(both: &Both) -> &Perceptron<Self> {
                &both.$field
            }

            fn multiply(
                weights: &[Self],
                rows: usize,
                inputs: &[Lanes<Self>],
                sums: &mut [Lanes<Self>],
            ) {
                $multiply(weights, rows, inputs, sums);
            }

            fn encode(levels: &Levels, table: &[f32], at: &Coordinates, out: &mut [Lanes<Self>]) {
                $encode(levels, table, at, out);
            }
        }
    };
}

real!(f32, narrow, multiply_f32, encode_f32, lanes::exp, lanes::sigmoid);
real!(f64, wide, multiply_f64, encode_f64, libm::exp, activate::sigmoid);
