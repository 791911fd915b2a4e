//! Reads a container, samples it at the middle of its box on every level, and renders a picture.
//!
//! `cargo run --release --example read_and_sample -- scene.mipvog picture.ppm`

use std::io::Write;
use std::path::Path;

use mipvog::{Camera, Container, Frame, Limits, Renderer};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(input), Some(output)) = (arguments.next(), arguments.next()) else {
        return Err("usage: read_and_sample SCENE.mipvog PICTURE.ppm".into());
    };
    let container = Container::open_path(Path::new(&input), &Limits::default())?;
    let bounds = container.metadata().bounds;
    let renderer = Renderer::of_container(&container)?;

    let at = |share: f64| {
        [0, 1, 2].map(|axis| {
            let [min, max] = [bounds.min[axis], bounds.max[axis]].map(f64::from);
            min + share * (max - min)
        })
    };
    let center = at(0.5);
    for level in 0..renderer.levels() {
        let sample = renderer.sample(center, level)?;
        println!("level {level}: opacity {:.4}, colour {:.3?}", sample.opacity, sample.color);
    }

    // From outside the box, along its diagonal.
    let camera = Camera::look_at(at(2.0), center, 45.0, [320, 240])?;
    write_ppm(&renderer.picture(&camera)?, Path::new(&output))?;
    Ok(())
}

/// Writes a portable pixmap, which needs no library.
fn write_ppm(picture: &Frame, path: &Path) -> std::io::Result<()> {
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    writeln!(file, "P6 {} {} 255", picture.width, picture.height)?;
    for pixel in &picture.color {
        file.write_all(&pixel.map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8))?;
    }
    file.flush()
}
