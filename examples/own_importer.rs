//! Imports a model that the tool does not know: reads its file, makes a field of the arrays, and
//! bakes it into a container beside it.
//!
//! The file of this example is text: three sizes, then for each node red, green, blue (0 to 1) and
//! opacity over one step (0 to below 1), z fastest.
//!
//! `cargo run --release --example own_importer -- volume.txt volume.mipvog`

use mipvog::{BakeOptions, Baker, RadianceField};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(input), Some(output)) = (arguments.next(), arguments.next()) else {
        return Err("usage: own_importer VOLUME.txt SCENE.mipvog".into());
    };
    let field = import(&std::fs::read_to_string(input)?)?;
    let report = Baker::new(BakeOptions::default()).to_file(&field, &output, false)?;
    println!("{output}: {} bytes", report.output_bytes);
    Ok(())
}

fn import(text: &str) -> Result<RadianceField, Box<dyn std::error::Error>> {
    let mut numbers = text.split_whitespace();
    let mut sizes = [0; 3];
    for size in &mut sizes {
        *size = numbers.next().ok_or("three sizes are missing")?.parse::<usize>()?;
    }
    let values = numbers.map(str::parse).collect::<Result<Vec<f32>, _>>()?;
    // Colours are stored as logits. Density is stored before softplus.
    let logit =
        |value: f32| (value.clamp(1e-4, 1.0 - 1e-4) / (1.0 - value.clamp(1e-4, 0.9999))).ln();
    let stepsize = 0.5;
    let raw = |opacity: f32| {
        let density = -(-opacity.clamp(0.0, 0.999_999)).ln_1p() / stepsize;
        if density > 1e-6 { density.exp_m1().ln() } else { -20.0 }
    };
    let density = values.chunks_exact(4).map(|node| raw(node[3])).collect();
    let channel = |c: usize| values.chunks_exact(4).map(move |node| logit(node[c]));
    let diffuse = (0..3).flat_map(channel).collect();
    Ok(RadianceField::builder(sizes, density, diffuse).stepsize(stepsize).build()?)
}
