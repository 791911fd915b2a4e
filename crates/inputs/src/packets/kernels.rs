//! The loops of packets, for each kind of processor.

use multiversion::multiversion;

use super::encode::{self, Coordinates};
use super::levels::Levels;
use super::multiply;
use super::real::{Lanes, Real};

/// Number types with their own loops, because functions that are compiled per processor cannot be
/// generic.
pub trait Kernels: Real {
    /// Adds products of weights and inputs to sums; see `multiply`.
    fn multiply(weights: &[Self], rows: usize, inputs: &[Lanes<Self>], sums: &mut [Lanes<Self>]);

    /// Replaces negative numbers and NaN by 0.
    fn relu(values: &mut [Lanes<Self>]);

    /// The features of positions, level by level.
    fn encode(levels: &Levels, table: &[f32], at: &Coordinates, out: &mut [Lanes<Self>]);
}

/// Implements [`Kernels`].
macro_rules! kernels {
    ($real:ty, $multiply:ident, $relu:ident, $encode:ident) => {
        #[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
        fn $multiply(
            weights: &[$real],
            rows: usize,
            inputs: &[Lanes<$real>],
            sums: &mut [Lanes<$real>],
        ) {
            multiply::multiply(weights, rows, inputs, sums);
        }

        #[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
        fn $relu(values: &mut [Lanes<$real>]) {
            multiply::relu(values);
        }

        #[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
        fn $encode(levels: &Levels, table: &[f32], at: &Coordinates, out: &mut [Lanes<$real>]) {
            encode::encode(levels, table, at, out);
        }

        impl Kernels for $real {
            fn multiply(
                weights: &[Self],
                rows: usize,
                inputs: &[Lanes<Self>],
                sums: &mut [Lanes<Self>],
            ) {
                $multiply(weights, rows, inputs, sums);
            }

            fn relu(values: &mut [Lanes<Self>]) {
                $relu(values);
            }

            fn encode(levels: &Levels, table: &[f32], at: &Coordinates, out: &mut [Lanes<Self>]) {
                $encode(levels, table, at, out);
            }
        }
    };
}

kernels!(f32, multiply_f32, relu_f32, encode_f32);
kernels!(f64, multiply_f64, relu_f64, encode_f64);
