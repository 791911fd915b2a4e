//! Scenes that no training made, each with one kind of content that levels find hard.

use mipvog::model::field::RadianceField;

use crate::common::Random;

/// Nodes of most scenes; odd shares of the box, so that levels do not line up with it.
const NODES: [usize; 3] = [112, 120, 104];
/// Nodes of boxes without an inside.
const STICK: [usize; 3] = [2, 2, 65];
const SLAB: [usize; 3] = [65, 65, 2];
/// Raw densities of empty space and of opaque space.
const EMPTY: f32 = -30.0;
const OPAQUE: f32 = 12.0;

/// Names of the scenes.
pub const SCENES: [&str; 7] = ["foliage", "wires", "fog", "full", "empty", "stick", "slab"];

/// One of [`SCENES`].
pub fn scene(name: &str) -> RadianceField {
    let mut nodes = Painted::empty(match name {
        "stick" => STICK,
        "slab" => SLAB,
        _ => NODES,
    });
    let mut random = Random::new(11);
    match name {
        "foliage" => (0..500).for_each(|_| nodes.leaf(&mut random)),
        "wires" => (0..60).for_each(|_| nodes.wire(&mut random)),
        "fog" => nodes.fill(|[x, y, z]| {
            let wave = libm::sinf(9.0 * x + 4.0 * z) * libm::sinf(7.0 * y) * libm::sinf(5.0 * z);
            let middle = (x - 0.5).powi(2) + (y - 0.5).powi(2) + (z - 0.5).powi(2);
            1.5 + 1.5 * wave - 30.0 * middle
        }),
        "full" | "stick" | "slab" => nodes.fill(|_| OPAQUE),
        "empty" => {}
        _ => panic!("{name} is none of {SCENES:?}"),
    }
    nodes.built()
}

/// Values of nodes.
struct Painted {
    nodes: [usize; 3],
    density: Vec<f32>,
    color: Vec<f32>,
}

impl Painted {
    fn empty(nodes: [usize; 3]) -> Self {
        let count = nodes.iter().product();
        Self { nodes, density: vec![EMPTY; count], color: vec![0.0; 3 * count] }
    }

    /// Matter of this raw density at each place, `0..1`, in waves of colour.
    fn fill(&mut self, density: impl Fn([f32; 3]) -> f32) {
        let [nx, ny, nz] = self.nodes;
        for node in 0..nx * ny * nz {
            let at = [node / nz / ny, node / nz % ny, node % nz];
            let place = [0, 1, 2].map(|axis| at[axis] as f32 / (self.nodes[axis] - 1) as f32);
            let [x, y, z] = place;
            let color = [23.0 * x + 9.0 * y, 31.0 * y + 7.0 * z, 27.0 * z + 11.0 * x];
            self.put(at, density(place), color.map(|phase| 3.0 * libm::sinf(phase)));
        }
    }

    /// A thin disc of one colour, anywhere and any way round.
    fn leaf(&mut self, random: &mut Random) {
        let middle = self.nodes.map(|nodes| random.between(8.0, nodes as f32 - 9.0));
        let normal = direction(random);
        let radius = random.between(3.0, 7.0);
        let color = [0; 3].map(|_| random.between(-3.0, 3.0));
        self.around(middle, radius + 1.0, |off| {
            let along = dot(off, normal);
            let across = (dot(off, off) - along * along).max(0.0).sqrt();
            (across <= radius).then_some((OPAQUE * (1.2 - along.abs()), color))
        });
    }

    /// A straight wire about a node thick, from face to face of the box's inside.
    fn wire(&mut self, random: &mut Random) {
        let middle = self.nodes.map(|nodes| random.between(20.0, nodes as f32 - 21.0));
        let way = direction(random);
        let color = [0; 3].map(|_| random.between(-3.0, 3.0));
        self.around(middle, 45.0, |off| {
            let along = dot(off, way);
            let across = (dot(off, off) - along * along).max(0.0).sqrt();
            (across < 1.5).then_some((OPAQUE * (1.1 - across), color))
        });
    }

    /// Puts density and colour by the offset from `middle`, where there is less.
    fn around(
        &mut self,
        middle: [f32; 3],
        reach: f32,
        content: impl Fn([f32; 3]) -> Option<(f32, [f32; 3])>,
    ) {
        let [xs, ys, zs] = [0, 1, 2].map(|axis| {
            let low = (middle[axis] - reach).max(0.0) as usize;
            low..((middle[axis] + reach) as usize + 1).min(self.nodes[axis])
        });
        for x in xs {
            for y in ys.clone() {
                for z in zs.clone() {
                    let at = [x, y, z];
                    let off = [0, 1, 2].map(|axis| at[axis] as f32 - middle[axis]);
                    if let Some((density, color)) = content(off) {
                        self.put(at, density, color);
                    }
                }
            }
        }
    }

    fn put(&mut self, [x, y, z]: [usize; 3], density: f32, color: [f32; 3]) {
        let node = (x * self.nodes[1] + y) * self.nodes[2] + z;
        if density > self.density[node] {
            self.density[node] = density;
            for (channel, value) in color.into_iter().enumerate() {
                self.color[channel * self.density.len() + node] = value;
            }
        }
    }

    fn built(self) -> RadianceField {
        let half = self.nodes.map(|nodes| (nodes - 1) as f32 / 100.0);
        let builder = RadianceField::builder(self.nodes, self.density, self.color);
        let builder = builder.bounds(half.map(|half| -half), half).shift(-4.0);
        builder.stepsize(0.5).background([1.0; 3]).build().expect("a field")
    }
}

fn direction(random: &mut Random) -> [f32; 3] {
    loop {
        let way = [0; 3].map(|_| random.between(-1.0, 1.0));
        let square = dot(way, way);
        if (0.01..1.0).contains(&square) {
            return way.map(|along| along / square.sqrt());
        }
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
