//! Bakes arrays into a vector of bytes, without a file.
//!
//! `cargo run --release --example bake_in_memory`

use mipvog::{BakeOptions, Baker, Container, Limits, RadianceField, Result};

const NODES: [usize; 3] = [48, 40, 32];

fn main() -> Result<()> {
    let (density, diffuse) = torus();
    let field = RadianceField::builder(NODES, density, diffuse)
        .bounds([-1.2, -1.0, -0.8], [1.2, 1.0, 0.8])
        .background([0.0; 3])
        .build()?;
    for max_error in [0.05, 0.01, 0.002] {
        let options = BakeOptions::default().with_max_error(max_error);
        let bytes = Baker::new(options).to_vec(&field)?;
        let container = Container::from_bytes(bytes, &Limits::default())?;
        let levels = container.metadata().levels.len();
        let length = container.header().file_length;
        println!("largest error {max_error}: {levels} levels in {length} bytes");
    }
    Ok(())
}

/// Raw density and three colour logits of a torus around the z axis.
fn torus() -> (Vec<f32>, Vec<f32>) {
    let [nx, ny, nz] = NODES;
    let (mut density, mut diffuse) = (Vec::new(), vec![Vec::new(); 3]);
    for i in 0..nx * ny * nz {
        let node = [i / (ny * nz), i / nz % ny, i % nz];
        let half = [1.2, 1.0, 0.8];
        let [x, y, z] =
            [0, 1, 2].map(|a| (2.0 * node[a] as f32 / (NODES[a] - 1) as f32 - 1.0) * half[a]);
        let to_ring = (x * x + y * y).sqrt() - 0.7;
        let distance = (to_ring * to_ring + z * z).sqrt() - 0.2;
        density.push(12.0 - 80.0 * distance.max(0.0));
        for (channel, value) in diffuse.iter_mut().zip([x, y, z]) {
            channel.push(4.0 * value);
        }
    }
    (density, diffuse.concat())
}
