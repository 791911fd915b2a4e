//! Writes `formats/numerics.md`: every stage's worst error against its reference implementation in
//! float64.
//!
//! ```text
//! cargo bench --bench numerics > formats/numerics.md
//! ```
//!
//! The place of each error goes to stderr.

use mipvog_testing as common;

use common::stress::{ROWS, document, measured};

fn main() {
    for row in &ROWS {
        let worst = measured(row);
        let found = [worst.absolute, worst.relative, worst.ulps];
        for ((found, bound), at) in found.into_iter().zip(row.bound).zip(&worst.at) {
            eprintln!("{}: {found:.2e} of {bound:.2e} at {at}", row.stage);
        }
    }
    print!("{}", document());
}
