//! Nested boxes as `formats/mipvog.md`, section 6, says them, in float64 over dense arrays: every
//! sample of every ray is visited, and no space is skipped. Levels are alike from all sides, and
//! their level of detail is the same number everywhere.

use mipvog::container::Container;
use mipvog::model::baked::{DensityDomain, Metadata, StepRule};
use mipvog::model::camera::Ray;
use mipvog::model::grid::Bounds;
use mipvog::unpacked::fill_plane;

use super::plain::{density, sigmoid};
use mipvog::model::baked::Group;

/// A sample this close to a face of a box, in shares of the box, lies on it.
const ON_FACE: f64 = 1e-9;

/// A level or a shell.
struct Part {
    bounds: Bounds,
    nodes: [usize; 3],
    edge: usize,
    domain: DensityDomain,
    /// Optical depths that are stored, times this, are those over one interval.
    scale: f64,
    /// Whether each block is stored.
    stored: Vec<bool>,
    density: Vec<f32>,
    color: [Vec<f32>; 3],
}

/// A container whose parts are dense.
pub struct PlainWorld {
    metadata: Metadata,
    parts: Vec<Part>,
    boxes: Vec<Bounds>,
}

/// A sample as the rule places it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlainSample {
    /// Its number.
    pub k: f64,
    /// The smallest box that holds it.
    pub number: usize,
    /// The steps that it covers.
    pub covers: f64,
}

fn share(bounds: &Bounds, at: [f64; 3]) -> [f64; 3] {
    let extent = bounds.extent();
    std::array::from_fn(|axis| (at[axis] - f64::from(bounds.min[axis])) / extent[axis])
}

fn holds(bounds: &Bounds, at: [f64; 3]) -> bool {
    share(bounds, at).iter().all(|at| (-ON_FACE..=1.0 + ON_FACE).contains(at))
}

impl PlainWorld {
    pub fn new(container: &Container) -> Self {
        let field = container.read().expect("levels");
        let metadata = field.metadata.clone();
        let boxes = metadata.boxes();
        let part = |(number, level): (usize, &mipvog::model::baked::BakedLevel)| {
            let own = metadata.part(number).expect("a part");
            let box_number = metadata.box_of_part(number);
            let [nx, ny, nz] = own.dimensions;
            let values = |group, channel| {
                let mut all = Vec::new();
                for x in 0..nx {
                    let mut plane = vec![0.0; ny * nz];
                    fill_plane(level, own, group, channel, x, &mut plane);
                    all.extend(plane);
                }
                all
            };
            let domain = own.density_domain();
            Part {
                bounds: boxes[box_number],
                nodes: own.dimensions,
                edge: own.block_size,
                domain,
                scale: match domain {
                    DensityDomain::Raw => 1.0,
                    _ => (-(box_number as f64)).exp2(),
                },
                stored: level.table.occupancy().iter().map(|block| block.id() > 0).collect(),
                density: values(Group::Density, 0),
                color: [0, 1, 2].map(|channel| values(Group::Diffuse, channel)),
            }
        };
        let parts = field.levels.iter().enumerate().map(part).collect();
        Self { metadata, parts, boxes }
    }

    /// The samples of a ray whose direction has unit length, each with its position.
    pub fn samples(&self, ray: &Ray, lambda: f64) -> Vec<(PlainSample, [f64; 3])> {
        let march = &self.metadata.march;
        let outer = self.boxes.last().expect("a box");
        let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
        let crossing = |bounds: &Bounds| {
            let axes = (0..3).filter(|&axis| direction[axis] != 0.0).map(|axis| {
                let at = |face: f32| (f64::from(face) - origin[axis]) / direction[axis];
                let (a, b) = (at(bounds.min[axis]), at(bounds.max[axis]));
                [a.min(b), a.max(b)]
            });
            axes.fold([f64::NEG_INFINITY, f64::INFINITY], |[enters, leaves], [a, b]| {
                [enters.max(a), leaves.min(b)]
            })
        };
        let step = f64::from(march.stepsize) * f64::from(march.voxel_size);
        let start = crossing(outer)[0].max(f64::from(march.near));
        let at = |k: f64| -> [f64; 3] {
            std::array::from_fn(|axis| origin[axis] + (start + k * step) * direction[axis])
        };
        let enters: Vec<Option<f64>> = self
            .boxes
            .iter()
            .map(|bounds| {
                let [enters, leaves] = crossing(bounds);
                (enters <= leaves).then(|| (enters - start) / step)
            })
            .collect();
        let mut samples = Vec::new();
        let mut k = 0.0;
        while k < 1e6 {
            let position = at(k);
            let Some(number) = self.boxes.iter().position(|bounds| holds(bounds, position)) else {
                if samples.is_empty() && k < 2.0 {
                    k += 1.0;
                    continue;
                }
                break;
            };
            let mut covers = match self.metadata.step_rule {
                StepRule::Constant => (number as f64).exp2(),
                StepRule::LevelOfDetail => lambda.max(number as f64).exp2(),
            };
            let entered = enters[..number].iter().flatten().filter(|&&enter| enter > k + ON_FACE);
            if let Some(first) =
                entered.copied().reduce(f64::min).filter(|&first| first < k + covers)
            {
                covers = (first - k - ON_FACE).ceil().max(1.0).min(covers);
            }
            samples.push((PlainSample { k, number, covers }, position));
            k += covers;
        }
        samples
    }

    /// Optical depth over one interval and colour of a part at a position.
    fn value(&self, part: usize, at: [f64; 3]) -> Option<(f64, [f64; 3])> {
        let part = &self.parts[part];
        let place = share(&part.bounds, at).map(|at| at.clamp(0.0, 1.0));
        let mut low = [0; 3];
        let mut fraction = [0.0; 3];
        for axis in 0..3 {
            let cells = part.nodes[axis] - 1;
            let at = place[axis] * cells as f64;
            low[axis] = (at as usize).min(cells - 1);
            fraction[axis] = at - low[axis] as f64;
        }
        let counts = part.nodes.map(|size| size.div_ceil(part.edge));
        let block = low.map(|node| node / part.edge);
        if !part.stored[(block[0] * counts[1] + block[1]) * counts[2] + block[2]] {
            return None;
        }
        let mut sums = [0.0; 4];
        for corner in 0..8usize {
            let up = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let weight: f64 = (0..3)
                .map(|axis| if up[axis] == 1 { fraction[axis] } else { 1.0 - fraction[axis] })
                .product();
            let [x, y, z] = [0, 1, 2].map(|axis| low[axis] + up[axis]);
            let node = (x * part.nodes[1] + y) * part.nodes[2] + z;
            let values = [&part.density, &part.color[0], &part.color[1], &part.color[2]];
            for (sum, values) in sums.iter_mut().zip(values) {
                *sum += weight * f64::from(values[node]);
            }
        }
        let [value, color @ ..] = sums;
        let activation = &self.metadata.activation;
        let depth = match part.domain {
            DensityDomain::Raw => density(value, activation) * f64::from(activation.interval),
            DensityDomain::SqrtOpticalDepth => value * value,
            DensityDomain::Opacity => -(-value).ln_1p(),
        };
        Some((depth * part.scale, color.map(sigmoid)))
    }

    /// The light along a ray: colour over the background, and transmittance.
    pub fn light(&self, ray: &Ray, lambda: f64) -> ([f64; 3], f64) {
        let levels = self.metadata.levels.len();
        let (mut color, mut left) = ([0.0; 3], 1.0);
        for (PlainSample { number, covers, .. }, at) in self.samples(ray, lambda) {
            let lambda = lambda.min(levels as f64 - 1.0).max(number as f64);
            let (level, blend) = (lambda.floor() as usize, lambda.fract());
            let own = if level == number && number > 0 { levels + number - 1 } else { level };
            let fine = self.value(own, at).unwrap_or((0.0, [0.5; 3]));
            let coarse = match blend > 0.0 {
                true => self.value(level + 1, at).unwrap_or((0.0, [0.5; 3])),
                false => fine,
            };
            let depth = fine.0 + (coarse.0 - fine.0) * blend;
            let alpha = -(-depth * covers).exp_m1();
            let weight = left * alpha;
            left *= 1.0 - alpha;
            if weight <= f64::from(self.metadata.march.color_threshold) {
                continue;
            }
            for (sum, (fine, coarse)) in color.iter_mut().zip(fine.1.into_iter().zip(coarse.1)) {
                *sum += weight * (fine + (coarse - fine) * blend);
            }
        }
        let background = self.metadata.background.map(f64::from);
        (std::array::from_fn(|channel| color[channel] + left * background[channel]), left)
    }
}
