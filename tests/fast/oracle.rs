//! Baked levels against vectors of an independent float64 oracle (`fixtures/golden`) and against
//! the reference implementations.

use crate::common;
use crate::common::{
    Random, baked_bytes, field, fixture, open_bytes, plain, plain_alpha, random_field,
    tensor_values, trained, unpack,
};
use mipvog::bake::{BakeOptions, Filter, Preset};
use mipvog::base::limits::Limits;
use mipvog::levels::{Kernel, LevelFilter};
use mipvog::model::baked::DensityDomain;
use mipvog::model::baked::Group;
use mipvog::model::field::{Activation, RadianceField};
use mipvog::quantize::Bits;
use mipvog_inputs::tensor;

fn options(filter: Filter, bits: Bits) -> BakeOptions {
    BakeOptions { filter: filter.into(), bits, ..BakeOptions::default() }
}

fn golden(file: &str, name: &str) -> Vec<f32> {
    let file = tensor::open(&fixture("golden").join(file), &Limits::default()).expect("vectors");
    tensor_values(&file, name).unwrap_or_else(|| panic!("no tensor {name}"))
}

fn density_of(field: &RadianceField) -> Vec<f32> {
    common::grid_values(&field.density)
}

fn color_of(field: &RadianceField) -> Vec<f32> {
    field.color.iter().flat_map(common::grid_values).collect()
}

fn opaque(field: &RadianceField, density: &[f32], threshold: f64) -> Vec<bool> {
    let activation = &field.scene.activation;
    let opacity = |&raw: &f32| {
        plain::opacity(raw.into(), activation.shift.into(), activation.interval.into())
    };
    density.iter().map(|raw| opacity(raw) > threshold).collect()
}

#[test]
fn research_code_levels_equal_the_oracle_at_retained_nodes() {
    let field = trained("tiny/fine_last.tar");
    let nodes = field.scene.nodes.0;
    let cells = plain::cells(nodes, &opaque(&field, &density_of(&field), 1e-3));
    for (bits, in_color) in [(Bits::F32, false), (Bits::Integer(8), true)] {
        let bytes = baked_bytes(&field, &options(Filter::Code, bits)).expect("a bake");
        let unpacked = unpack(&open_bytes(&bytes).expect("valid")).expect("unpacks");
        let mut size = nodes;
        for level in 0..4 {
            let want = golden("render.safetensors", &format!("k0.level{level}"));
            let mut got = unpacked.level(level, Group::Diffuse);
            got.extend(unpacked.level(level, Group::Features));
            assert_eq!(got.len(), want.len());
            let retained = plain::corners(size, &plain::overlapping(nodes, &cells, size));
            let largest = want.iter().fold(1.0, |most: f32, value| most.max(value.abs()));
            let mut checked = 0;
            for (i, (got, want)) in got.iter().zip(&want).enumerate() {
                if !retained[i % retained.len()] {
                    continue;
                }
                checked += 1;
                let (got, want) = (f64::from(*got), f64::from(*want));
                let (error, bound) = match in_color {
                    true => ((plain::sigmoid(got) - plain::sigmoid(want)).abs(), 0.0085),
                    false => ((got - want).abs(), 1e-6 * f64::from(largest)),
                };
                assert!(error <= bound, "level {level}, value {i}: {got} for {want}");
            }
            assert!(checked > 7 * 20, "level {level}: only {checked} retained values");
            size = plain::halved(size);
        }
    }
}

#[test]
fn every_kernel_equals_the_oracle() {
    let nodes = [33, 24, 20];
    let input = golden("pyramid.safetensors", "input");
    let count: usize = nodes.iter().product();
    // All of it opaque, so that every node is retained; density is constant.
    let field = field(nodes, &vec![10.0; count], &input);
    let largest = input.iter().fold(1.0, |most: f32, value| most.max(value.abs()));
    for kernel in Kernel::ALL {
        let bytes =
            baked_bytes(&field, &options(Filter::Kernel(kernel), Bits::F32)).expect("a bake");
        let unpacked = unpack(&open_bytes(&bytes).expect("valid")).expect("unpacks");
        let name = if kernel == Kernel::None { "none1" } else { kernel.name() };
        for level in 1..=2 {
            let want = golden("pyramid.safetensors", &format!("{name}.node.level{level}"));
            let mut got = unpacked.level(level, Group::Diffuse);
            got.extend(unpacked.level(level, Group::Features));
            assert_eq!(got.len(), want.len());
            for (i, (got, want)) in got.iter().zip(&want).enumerate() {
                let error = (got - want).abs();
                assert!(error <= 1e-6 * largest, "{name} {level} {i}: {got} for {want}");
            }
            let density = unpacked.level(level, Group::Density);
            assert!(density.iter().all(|&raw| raw == 10.0), "a constant changed under {name}");
        }
    }
}

#[test]
fn odd_sizes_and_all_levels_equal_the_plain_twin() {
    for seed in 0..24 {
        let mut random = Random::new(seed);
        let nodes = [0; 3].map(|_: usize| 2 + random.below(19));
        let field = random_field(&mut random, nodes, 4);
        let kernel = Kernel::ALL[seed as usize % Kernel::ALL.len()];
        let mut options = options(Filter::Kernel(kernel), Bits::F32);
        options.levels = Some(64);
        options.block_size = 1 + random.below(9);
        let bytes = baked_bytes(&field, &options).expect("a bake");
        let unpacked = unpack(&open_bytes(&bytes).expect("valid")).expect("unpacks");
        let wide = |values: Vec<f32>| -> Vec<f64> { values.into_iter().map(f64::from).collect() };
        let mut channels: Vec<Vec<f64>> = vec![wide(density_of(&field))];
        channels.extend(wide(color_of(&field)).chunks(nodes.iter().product()).map(<[f64]>::to_vec));
        let (mut size, mut level) = (nodes, 0);
        loop {
            let density: Vec<f32> = channels[0].iter().map(|&raw| raw as f32).collect();
            let retained =
                plain::corners(size, &plain::cells(size, &opaque(&field, &density, 1e-3)));
            let mut got = unpacked.level(level, Group::Density);
            got.extend(unpacked.level(level, Group::Diffuse));
            got.extend(unpacked.level(level, Group::Features));
            for (channel, want) in channels.iter().enumerate() {
                for (i, &want) in want.iter().enumerate().filter(|(i, _)| retained[*i]) {
                    let got = f64::from(got[channel * retained.len() + i]);
                    // The largest input is 100 in density, 9 in colour.
                    let bound = if channel == 0 { 1e-4 } else { 9e-6 };
                    let error = (got - want).abs();
                    assert!(
                        error <= bound,
                        "seed {seed} level {level} channel {channel} {i}: {got} for {want}"
                    );
                }
            }
            if plain::halved(size) == size {
                break;
            }
            channels.iter_mut().for_each(|c| *c = plain::next_level(size, c, &kernel.weights()));
            size = plain::halved(size);
            level += 1;
        }
        assert!(unpacked.get(&format!("level{}.density", level + 1)).is_none(), "seed {seed}");
    }
}

#[test]
fn levels_of_alpha_equal_the_plain_twin() {
    for seed in 0..16 {
        let mut random = Random::new(100 + seed);
        let nodes = [0; 3].map(|_: usize| 2 + random.below(19));
        let field = random_field(&mut random, nodes, 4);
        let filter = [Filter::RateTent, Filter::Coverage][seed as usize % 2];
        let rules: &dyn LevelFilter = &filter;
        let domain = rules.alpha(&field.scene.activation).expect("a filter of alpha");
        let weights = &rules.weights();
        let mut options = options(filter, Bits::F32);
        options.levels = Some(64);
        options.block_size = 1 + random.below(9);
        let bytes = baked_bytes(&field, &options).expect("a bake");
        let unpacked = unpack(&open_bytes(&bytes).expect("valid")).expect("unpacks");
        let wide = |values: Vec<f32>| -> Vec<f64> { values.into_iter().map(f64::from).collect() };
        let mut channels: Vec<Vec<f64>> = vec![wide(density_of(&field))];
        channels.extend(wide(color_of(&field)).chunks(nodes.iter().product()).map(<[f64]>::to_vec));
        let extent = plain_alpha::extent(&field.scene);
        let seen = plain_alpha::visibility(nodes, &domain, weights, &channels[0], extent);
        let mut linear = plain_alpha::premultiply(&domain, field.color_domain, &channels, &seen);
        let mut size = nodes;
        for level in 1.. {
            if plain::halved(size) == size {
                break;
            }
            linear.iter_mut().for_each(|c| *c = plain::next_level(size, c, weights));
            size = plain::halved(size);
            let stored = plain_alpha::unpremultiply(size, &domain, field.color_domain, &linear);
            // Opacity over the level's own step: as long as two of the level below.
            let threshold = -(-1e-3f64).ln_1p() / 2f64.powi(level as i32);
            let limit = -(-threshold * f64::from(domain.span)).exp_m1() * (1.0 + 1e-5);
            let visible: Vec<bool> = linear[0].iter().map(|&alpha| alpha > limit).collect();
            let retained = plain::corners(size, &plain::cells(size, &visible));
            let mut got = unpacked.level(level, Group::Density);
            got.extend(unpacked.level(level, Group::Diffuse));
            got.extend(unpacked.level(level, Group::Features));
            for (channel, want) in stored.iter().enumerate() {
                for (i, &want) in want.iter().enumerate().filter(|(i, _)| retained[*i]) {
                    let got = f64::from(got[channel * retained.len() + i]);
                    // Activated colours and opacities: near their ends stored values are steep.
                    let (got, want) = match (channel, domain.stored) {
                        (0, DensityDomain::SqrtOpticalDepth) => {
                            (-(-got * got).exp_m1(), -(-want * want).exp_m1())
                        }
                        (0, DensityDomain::Opacity) => (got, want),
                        _ => (plain::sigmoid(got), plain::sigmoid(want)),
                    };
                    let error = (got - want).abs();
                    assert!(
                        error <= 3e-6,
                        "seed {seed} level {level} channel {channel} {i}: {got} for {want}"
                    );
                }
            }
        }
    }
}

#[test]
fn an_archive_loses_nothing_of_what_it_keeps() {
    for seed in 0..12 {
        let mut random = Random::new(300 + seed);
        let nodes = [0; 3].map(|_: usize| 2 + random.below(23));
        let field = random_field(&mut random, nodes, 7);
        let mut options = Preset::Archive.options();
        options.block_size = 1 + random.below(9);
        let bytes = baked_bytes(&field, &options).expect("a bake");
        let unpacked = unpack(&open_bytes(&bytes).expect("valid")).expect("unpacks");
        let kept = unpacked.occupied(0, nodes, options.block_size);
        let mut got = unpacked.level(0, Group::Density);
        got.extend(unpacked.level(0, Group::Diffuse));
        got.extend(unpacked.level(0, Group::Features));
        let want = [density_of(&field), color_of(&field)].concat();
        for (i, (got, want)) in got.iter().zip(&want).enumerate() {
            let same = got.to_bits() == want.to_bits();
            assert!(same || !kept[i % kept.len()], "seed {seed}, {i}: {got} for {want}");
        }
    }
}

#[test]
fn opaque_nodes_survive_and_keep_the_promised_errors() {
    let field = trained("lego64/fine_last.tar");
    let bytes = baked_bytes(&field, &BakeOptions::default()).expect("a bake");
    let unpacked = unpack(&open_bytes(&bytes).expect("valid")).expect("unpacks");
    let nodes = field.scene.nodes.0;
    let density = density_of(&field);
    let opaque = opaque(&field, &density, 1e-3);
    let occupied = unpacked.occupied(0, nodes, 8);
    let retained = plain::corners(nodes, &plain::cells(nodes, &opaque));
    let activation = &field.scene.activation;
    let alpha =
        |raw: f32| plain::opacity(raw.into(), activation.shift.into(), activation.interval.into());
    let got = unpacked.level(0, Group::Density);
    for (i, &retained) in retained.iter().enumerate().filter(|(_, retained)| **retained) {
        assert!(retained && occupied[i]);
        assert!((alpha(got[i]) - alpha(density[i])).abs() <= 0.0125, "node {i}");
    }
    let color = color_of(&field);
    let mut got = unpacked.level(0, Group::Diffuse);
    got.extend(unpacked.level(0, Group::Features));
    for (i, (&got, &want)) in
        got.iter().zip(&color).enumerate().filter(|(i, _)| retained[i % retained.len()])
    {
        let error = (plain::sigmoid(got.into()) - plain::sigmoid(want.into())).abs();
        assert!(error <= 0.0085, "value {i}: {got} for {want}");
    }
}

#[test]
fn activation_equals_the_oracle() {
    let raw = golden("activation.safetensors", "raw");
    for (name, init) in [("0.01", 0.01f64), ("1e-06", 1e-6), ("0.5", 0.5)] {
        let shift = (1.0 / (1.0 - init) - 1.0).ln();
        for interval in [0.25, 0.5, 1.0, 4.0] {
            let want =
                golden("activation.safetensors", &format!("alpha.init{name}.interval{interval}"));
            for (&raw, &want) in raw.iter().zip(&want) {
                let activation = Activation::logits(shift as f32, interval as f32);
                let got = activation.opacity(raw.into());
                // The vectors were rounded to float32 when they were read.
                let error = (got - f64::from(want)).abs();
                assert!(
                    error <= 1e-5 * f64::from(want).max(1e-30),
                    "{raw} {init} {interval}: {got} {want}"
                );
            }
        }
    }
    let want = golden("activation.safetensors", "sigmoid");
    for (&raw, &want) in raw.iter().zip(&want) {
        let got = mipvog::model::activate::sigmoid(raw.into());
        assert!((got - f64::from(want)).abs() <= 1e-5 * f64::from(want).max(1e-30), "{raw}");
    }
}
