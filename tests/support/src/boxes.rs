//! A field and its shells, marched in float64: the smallest box that holds a point has its values.

use mipvog::base::progress::Silent;
use mipvog::model::camera::Ray;
use mipvog::model::field::{Grid, Lattice, RadianceField};
use mipvog::model::harmonics::basis_f64;

/// Steps between two nodes.
const STEPS: f64 = 6.0;

/// A box with its values.
struct Values {
    lattice: Lattice,
    spacing: [f64; 3],
    /// Density, then colours, channel by channel.
    channels: Vec<Vec<f32>>,
}

/// All boxes of a field, in memory.
pub struct Boxes<'a> {
    field: &'a RadianceField,
    boxes: Vec<Values>,
}

impl Values {
    fn read<'g>(lattice: Lattice, grids: impl Iterator<Item = &'g Grid>) -> Self {
        let [nx, ny, nz] = lattice.nodes.0;
        let mut channels = Vec::new();
        for grid in grids {
            grid.prepare(&Silent).expect("prepared");
            for channel in 0..grid.channels() {
                let mut values = vec![0.0; nx * ny * nz];
                for (x, plane) in values.chunks_exact_mut(ny * nz).enumerate() {
                    grid.read_plane(channel, x, plane, |_| {}).expect("a plane");
                }
                channels.push(values);
            }
        }
        Self { lattice, spacing: lattice.nodes.spacing(&lattice.bounds), channels }
    }

    /// Nodes around a point with their weights; none outside.
    fn corners(&self, at: [f64; 3]) -> Option<[(usize, f64); 8]> {
        let sizes = self.lattice.nodes.0;
        let (mut low, mut share) = ([0; 3], [0.0; 3]);
        for axis in 0..3 {
            let node = (at[axis] - f64::from(self.lattice.bounds.min[axis])) / self.spacing[axis];
            if !(0.0..=(sizes[axis] - 1) as f64).contains(&node) {
                return None;
            }
            low[axis] = (node as usize).min(sizes[axis] - 2);
            share[axis] = node - low[axis] as f64;
        }
        Some(std::array::from_fn(|corner| {
            let up = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let [x, y, z] = [0, 1, 2].map(|axis| low[axis] + up[axis]);
            let weight = (0..3).map(|a| if up[a] == 1 { share[a] } else { 1.0 - share[a] });
            ((x * sizes[1] + y) * sizes[2] + z, weight.product())
        }))
    }

    fn value(&self, channel: usize, corners: &[(usize, f64); 8]) -> f64 {
        let values = &self.channels[channel];
        corners.iter().map(|(at, weight)| weight * f64::from(values[*at])).sum()
    }
}

impl<'a> Boxes<'a> {
    /// Reads the densities of all boxes of a field, and its harmonics where they count.
    pub fn read(field: &'a RadianceField, with_colors: bool) -> Self {
        let grids = if with_colors { usize::MAX } else { 1 };
        let mut boxes = vec![Values::read(field.lattice(), field.grids().take(grids))];
        boxes.extend(
            field.shells.iter().map(|shell| Values::read(shell.lattice, shell.grids().take(grids))),
        );
        Self { field, boxes }
    }

    /// Nodes whose optical depth between two of them is above 0.01, of each box.
    pub fn dense_nodes(&self) -> Vec<usize> {
        let per_unit = self.per_unit();
        let count = |values: &Values| {
            let is_dense = |raw: &&f32| {
                let density = self.field.scene.activation.density(f64::from(**raw)) * per_unit;
                density * values.spacing[0] > 0.01
            };
            values.channels[0].iter().filter(is_dense).count()
        };
        self.boxes.iter().map(count).collect()
    }

    fn per_unit(&self) -> f64 {
        let scene = &self.field.scene;
        f64::from(scene.activation.interval) / scene.march.interval_length()
    }

    /// Colour over the background, and the light that is left.
    pub fn follow(&self, ray: &Ray) -> ([f64; 3], f64) {
        let harmonics = self.field.harmonics().expect("harmonics");
        let basis = basis_f64(ray.direction.to_array());
        self.march(ray, |_, values, corners| {
            [0, 1, 2].map(|channel| {
                let terms = (0..harmonics.functions()).map(|function| {
                    basis[function] * values.value(1 + 3 * function + channel, corners)
                });
                f64::from(harmonics.offset) + terms.sum::<f64>()
            })
        })
    }

    /// The same with colours from elsewhere.
    pub fn follow_colors(
        &self,
        ray: &Ray,
        color: impl Fn([f64; 3]) -> [f64; 3],
    ) -> ([f64; 3], f64) {
        self.march(ray, |at, _, _| color(at))
    }

    fn march(
        &self,
        ray: &Ray,
        color: impl Fn([f64; 3], &Values, &[(usize, f64); 8]) -> [f64; 3],
    ) -> ([f64; 3], f64) {
        let (scene, per_unit) = (&self.field.scene, self.per_unit());
        let (mut passes, mut sum, mut t) = (1.0, [0.0; 3], f64::from(scene.march.near));
        let farthest = self.boxes.last().map_or(0.0, |last| {
            let reach = |face: f32| f64::from(face.abs());
            last.lattice.bounds.min.into_iter().chain(last.lattice.bounds.max).map(reach).sum()
        });
        while t < farthest && passes > 1e-4 {
            let at = (ray.origin + t * ray.direction).to_array();
            let found = self.boxes.iter().find_map(|one| Some((one, one.corners(at)?)));
            let Some((values, corners)) = found else {
                t += self.boxes[0].spacing[0];
                continue;
            };
            let step = values.spacing[0] / STEPS;
            t += step;
            let own = std::ptr::eq(values, &self.boxes[0]);
            if own && self.field.free_space.as_ref().is_some_and(|mask| !mask.contains(at)) {
                continue;
            }
            let density = scene.activation.density(values.value(0, &corners)) * per_unit;
            let alpha = 1.0 - (-density * step).exp();
            if alpha > 1e-6 {
                let seen = color(at, values, &corners);
                sum.iter_mut().zip(seen).for_each(|(sum, seen)| *sum += passes * alpha * seen);
                passes *= 1.0 - alpha;
            }
        }
        let background = scene.background.map(f64::from);
        let color = [0, 1, 2].map(|c| sum[c].max(0.0) + passes * background[c]);
        (color, passes)
    }
}

/// Peak signal to noise ratio in decibels of colours: of all rays, and without the worst hundredth.
pub fn psnr(found: &[[f64; 3]], expected: &[[f64; 3]]) -> [f64; 2] {
    let mut errors: Vec<f64> = found
        .iter()
        .zip(expected)
        .map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>() / 3.0)
        .collect();
    errors.sort_by(f64::total_cmp);
    let decibels =
        |errors: &[f64]| -10.0 * (errors.iter().sum::<f64>() / errors.len() as f64).log10();
    [decibels(&errors), decibels(&errors[..errors.len() - errors.len() / 100])]
}
