//! Every row of `formats/numerics.md` keeps its bound, and the page is the benchmark's output.

use std::path::Path;

use crate::common::stress::{ROWS, document, measured};
use crate::common::{assert_golden, stress_ray};

fn holds(stage: &str) {
    let row = ROWS.iter().find(|row| row.stage == stage).expect("a row of the table");
    let worst = measured(row);
    let found = [worst.absolute, worst.relative, worst.ulps];
    for ((found, bound), at) in found.into_iter().zip(row.bound).zip(&worst.at) {
        assert!(found <= bound, "{stage}: {found:e} is more than {bound:e}, at {at}");
    }
}

/// A test for each row, and the list of the rows that have one.
macro_rules! rows {
    ($($name:ident: $stage:literal,)*) => {
        $(#[test]
        fn $name() {
            holds($stage);
        })*

        const TESTED: &[&str] = &[$($stage),*];
    };
}

rows! {
    stored_activation_keeps_its_bound: "activation, stored",
    softplus_keeps_its_bound: "softplus",
    opacity_keeps_its_bound: "opacity",
    activation_of_a_node_keeps_its_bound: "activation, of a node",
    sigmoid_keeps_its_bound: "sigmoid",
    filters_keep_their_bound: "filters",
    resize_keeps_its_bound: "resize",
    constant_and_linear_fields_are_exact: "constant and linear fields",
    twenty_levels_keep_their_bound: "20 levels",
    averaged_densities_keep_their_bound: "weighted averages, density",
    averaged_colours_keep_their_bound: "weighted averages, colour",
    quantize_keeps_its_bound: "quantize",
    decode_keeps_its_bound: "decode",
    floats_keep_their_bound: "float16 and float32",
    interpolation_keeps_its_bound: "interpolation",
    transmittance_keeps_its_bound: "transmittance",
    accumulated_colour_keeps_its_bound: "accumulated colour",
    network_keeps_its_bound: "MLP",
    level_blend_keeps_its_bound: "level blend",
}

#[test]
fn the_largest_numbers_give_pictures_without_nan() {
    stress_ray::look_at_the_largest(|frame| {
        let values = [frame.color.as_flattened(), &frame.transmittance, &frame.distance];
        assert!(values.into_iter().flatten().all(|value| value.is_finite()));
    });
}

#[test]
fn every_row_has_its_test() {
    let stages: Vec<&str> = ROWS.iter().map(|row| row.stage).collect();
    assert_eq!(stages, TESTED);
}

/// `cargo bench --bench numerics > formats/numerics.md` writes the page; so does BLESS.
#[test]
fn the_page_is_what_the_benchmark_writes() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("formats/numerics.md");
    assert_golden(&page, document().as_bytes());
}
