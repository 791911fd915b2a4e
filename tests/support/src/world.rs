//! A world of closed form: a ground with a pattern, balls near the middle, hills, and a sky that is
//! matter far out.

use mipvog::model::field::{Lattice, RadianceField, Shell};
use mipvog::model::grid::{Bounds, Nodes};

use crate::Random;

/// The sky's distance from the middle.
const SKY: f64 = 6.4;

/// Signed distance to the nearest surface, from 0 outwards in free space, and the colour there.
fn scene([x, y, z]: [f64; 3]) -> (f64, [f64; 3]) {
    let wave = |value: f64, by: f64| 0.5 + 0.5 * libm::sin(by * value);
    let radius = libm::sqrt(x * x + y * y + z * z);
    let sky = (SKY - radius, [0.3 + 0.2 * wave(x + y, 0.9), 0.5 + 0.2 * wave(y, 0.7), 0.9]);
    let height = -0.6 + 0.08 * radius.max(1.0) * libm::sin(0.9 * x) * libm::cos(0.8 * y);
    let ground = (0.8 * (z - height), [wave(x, 2.0), wave(y, 2.3), 0.2]);
    let balls = [
        [0.2, 0.1, -0.2, 0.35],
        [-0.9, 0.6, 0.1, 0.4],
        [2.6, -1.4, 0.4, 0.8],
        [-3.0, 3.1, 0.9, 0.9],
    ];
    let ball = |[bx, by, bz, size]: [f64; 4]| {
        let away = [x - bx, y - by, z - bz];
        let distance = libm::sqrt(away.iter().map(|part| part * part).sum()) - size;
        (distance, [0.9, wave(away[2], 6.0 / size), 0.3])
    };
    let all = balls.map(ball).into_iter().chain([ground]);
    all.fold(sky, |nearest, other| if other.0 < nearest.0 { other } else { nearest })
}

/// Raw density and logits of colours at the nodes of a box, as if trained there: surfaces are as
/// sharp as its nodes.
fn values(lattice: &Lattice) -> (Vec<f32>, Vec<f32>) {
    let count = lattice.nodes.count();
    let [nx, ny, nz] = lattice.nodes.0;
    let spacing = lattice.nodes.spacing(&lattice.bounds)[0];
    let (mut density, mut color) = (vec![0.0; count], vec![0.0; 3 * count]);
    for i in 0..count {
        let node = [i / nz / ny, i / nz % ny, i % nz];
        let (distance, seen) = scene(lattice.position(node));
        density[i] = (-8.0 * distance / spacing).clamp(-12.0, 12.0) as f32;
        for (channel, value) in seen.into_iter().enumerate() {
            color[channel * count + i] = libm::log(value / (1.0 - value)).clamp(-6.0, 6.0) as f32;
        }
    }
    assert_eq!(nx * ny * nz, count);
    (density, color)
}

fn built(lattice: &Lattice) -> RadianceField {
    let (density, color) = values(lattice);
    of_values(lattice, density, color)
}

fn of_values(lattice: &Lattice, density: Vec<f32>, color: Vec<f32>) -> RadianceField {
    let Bounds { min, max } = lattice.bounds;
    let builder = RadianceField::builder(lattice.nodes.0, density, color);
    builder.bounds(min, max).stepsize(0.5).shift(0.0).build().expect("a field")
}

/// The world in boxes of about `nodes` nodes along an edge, an odd number, the first of half size
/// 1; `shells` larger ones around it.
pub fn world(nodes: usize, shells: usize) -> RadianceField {
    let bounds = Bounds { min: [-1.0; 3], max: [1.0; 3] };
    let mut lattice = Lattice::new(bounds, Nodes([nodes; 3]));
    let mut field = built(&lattice);
    for _ in 0..shells {
        lattice = lattice.doubled();
        let RadianceField { density, color, .. } = built(&lattice);
        field.shells.push(Shell { lattice, density, color });
    }
    field.check().expect("sound");
    field
}

/// Boxes off centre, of any sizes, some of 2 nodes, with values at random; of which `share` are not
/// empty.
pub fn random_world(random: &mut Random, shells: usize, share: f32) -> RadianceField {
    let min: [f32; 3] = std::array::from_fn(|_| random.between(-3.0, 1.0));
    let sizes: [f32; 3] = std::array::from_fn(|_| random.between(0.5, 2.0));
    let max = std::array::from_fn(|axis| min[axis] + sizes[axis]);
    let nodes = Nodes(std::array::from_fn(|_| 2 + random.below(12)));
    let mut lattice = Lattice::new(Bounds { min, max }, nodes);
    let filled = |random: &mut Random, lattice: &Lattice| {
        let count = lattice.nodes.count();
        let density = (0..count).map(|_| match random.between(0.0, 1.0) < share {
            true => random.between(-6.0, 2.0),
            false => -100.0,
        });
        let density = density.collect();
        let color = (0..3 * count).map(|_| random.between(-3.0, 3.0)).collect();
        of_values(lattice, density, color)
    };
    let mut field = filled(random, &lattice);
    for _ in 0..shells {
        let spacing = lattice.nodes.spacing(&lattice.bounds);
        let (mut bounds, mut nodes) = (lattice.bounds, lattice.nodes);
        for (axis, spacing) in spacing.into_iter().enumerate() {
            let own = f64::from(random.between(1.6, 2.9)) * spacing;
            let extent = f64::from(bounds.max[axis]) - f64::from(bounds.min[axis]);
            nodes.0[axis] = (extent / own).ceil() as usize + 2 + random.below(6);
            let more = (nodes.0[axis] - 1) as f64 * own - extent;
            let low = f64::from(bounds.min[axis]) - more * f64::from(random.between(0.0, 1.0));
            bounds.min[axis] = low as f32;
            bounds.max[axis] = (low + (nodes.0[axis] - 1) as f64 * own) as f32;
        }
        lattice = Lattice::new(bounds, nodes);
        let RadianceField { density, color, .. } = filled(random, &lattice);
        field.shells.push(Shell { lattice, density, color });
    }
    field.check().expect("sound");
    field
}
