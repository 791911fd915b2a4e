//! Bakes the same scene with a built-in filter and with one of its own, and compares the levels.
//!
//! `cargo run --release --example own_filter -- fine_last.tar`

use mipvog::{BakeOptions, Baker, Container, Filter, FilterDomain, LevelFilter, Limits, Renderer};
use mipvog_inputs::open;

/// Means of logits under a binomial of five nodes. It blurs more than the paper's mean of three and
/// less than its mean of five.
#[derive(Debug)]
struct Binomial;

impl LevelFilter for Binomial {
    fn name(&self) -> &str {
        "binomial5"
    }

    fn weights(&self) -> Vec<f64> {
        [1.0, 4.0, 6.0, 4.0, 1.0].map(|weight| weight / 16.0).to_vec()
    }

    fn domain(&self) -> FilterDomain {
        FilterDomain::Logits { density: true }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let input = std::env::args().nth(1).ok_or("usage: own_filter CHECKPOINT")?;
    let source = open(&input)?;
    let own = BakeOptions::default().with_filter(Binomial);
    let paper = BakeOptions::default().with_filter(Filter::Paper);
    for options in [own, paper] {
        let name = options.filter.name().to_owned();
        let bytes = Baker::new(options).to_vec(&source)?;
        let container = Container::from_bytes(bytes, &Limits::default())?;
        let renderer = Renderer::of_container(&container)?;
        let bounds = container.metadata().bounds;
        let center = [0, 1, 2].map(|axis| f64::from(bounds.min[axis] + bounds.max[axis]) / 2.0);
        for level in 0..renderer.levels() {
            let opacity = renderer.sample(center, level)?.opacity;
            println!("{name}, level {level}: opacity {opacity:.5} at the box's centre");
        }
    }
    Ok(())
}
