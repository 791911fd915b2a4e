//! The background spheres of a model: concentric layers for everything beyond the unit sphere.
//!
//! | key | shape | meaning |
//! |---|---|---|
//! | `background_links` | i32 `[2 R, R]` | the row of each direction; any negative number is an empty one |
//! | `background_data` | `[n, L, 4]` | by layer: red, green, blue as coefficients of band 0, then density |
//!
//! Positions are in half edges of the box from its middle, so the first sphere, of radius 1, lies
//! within the box. The radius `r` of a position is its coordinate along the layers, and its
//! direction `d` the two others:
//!
//! ```text
//! layer = (1 - 1/r) L - 1/2
//! u = 2 R (1/2 + atan2(d_x, d_z) / 2 pi)      v = R (1/2 - asin(d_y) / pi)
//! ```
//!
//! Values are linear between rows and layers. Both directions wrap around, as in svox2; poles do,
//! too.
//!
//! **Density.** A layer absorbs the same light at any radius, so its optical depth per world unit
//! falls with the square of the radius, and depends on the angle at which a ray leaves the sphere.

use std::sync::Arc;

use crate::base::error::{Error, Result};
use crate::base::limits::{Budget, Limits};
use crate::lazy::Lazy;
use crate::model::harmonics::BAND_0;
use crate::sparse::{RowArray, whole};
use crate::tensor::Tensor;

/// Red, green, blue and density.
const CHANNELS: usize = 4;
/// Layers, at least and at most.
const LAYERS: [u64; 2] = [2, 1024];
/// Rows of directions along a meridian, at most.
const MOST_ROWS: u64 = 1 << 14;
/// Added to a colour's coefficient of band 0 times its function.
const OFFSET: f64 = 0.5;
/// Stands for no row.
const NO_ROW: u32 = u32::MAX;

/// Spheres in a file.
#[derive(Debug)]
pub(super) struct SphereFile {
    links: Tensor,
    data: RowArray,
    layers: usize,
    limits: Limits,
    loaded: Lazy<Spheres>,
}

impl SphereFile {
    /// The spheres of two arrays. `row` makes rows of the second one, each this many numbers.
    ///
    /// # Errors
    /// `Malformed` for other shapes.
    pub(super) fn new(
        links: &Tensor,
        data: &Tensor,
        limits: &Limits,
        rows: impl FnOnce(&Tensor, usize) -> Result<RowArray>,
    ) -> Result<Self> {
        let [least, most] = LAYERS;
        let layers = match data.shape() {
            &[_, layers, 4] if (least..=most).contains(&layers) => layers,
            shape => {
                let found = format!("shape {shape:?}");
                let expected = format!("[rows, {least} to {most} layers, 4 numbers]");
                return Err(Error::malformed(data.place(), found, expected));
            }
        };
        match links.shape() {
            &[around, along] if (1..=MOST_ROWS).contains(&along) && around == 2 * along => {}
            shape => {
                let found = format!("shape {shape:?}");
                let expected = format!("[2 R, R] directions, R from 1 to {MOST_ROWS}");
                return Err(Error::malformed(links.place(), found, expected));
            }
        }
        #[expect(clippy::cast_possible_truncation, reason = "at most 1024")]
        let layers = layers as usize;
        let data = rows(data, layers * CHANNELS)?;
        let (links, limits) = (links.clone(), limits.clone());
        Ok(Self { links, data, layers, limits, loaded: Lazy::default() })
    }

    /// Layers.
    pub(super) fn layers(&self) -> usize {
        self.layers
    }

    /// Rows of directions along a meridian.
    pub(super) fn along(&self) -> usize {
        self.links.shape().last().map_or(1, |&along| usize::try_from(along).unwrap_or(1))
    }

    /// Bytes in memory.
    pub(super) fn memory_bytes(&self) -> u64 {
        4 * self.links.count() + 4 * self.data.rows() * self.data.width() as u64
    }

    /// Feeds a digest with samples of the values.
    ///
    /// # Errors
    /// Errors of reading.
    pub(super) fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        self.data.sample(hash)
    }

    /// All values.
    ///
    /// # Errors
    /// Errors of reading, links to no row, values that are not finite, and more memory than the
    /// limits allow.
    pub(super) fn load(&self) -> Result<Arc<Spheres>> {
        self.loaded.get(|| {
            let mut budget = Budget::new(&self.limits);
            let numbers = self.links.read_f64(&mut budget)?;
            let place = self.links.place();
            let mut links: Vec<u32> = budget.zeroed(numbers.len(), "directions", &place)?;
            for (at, (out, link)) in links.iter_mut().zip(numbers).enumerate() {
                *out = match link {
                    _ if link < 0.0 => NO_ROW,
                    _ if link < self.data.rows() as f64 => {
                        u32::try_from(whole(link)).unwrap_or(NO_ROW)
                    }
                    _ => {
                        let along = self.along();
                        let found = format!(
                            "link {link} of direction {}, {} in {} rows",
                            at / along,
                            at % along,
                            self.data.rows()
                        );
                        let expected = "links below the number of rows";
                        return Err(Error::malformed(place, found, expected));
                    }
                };
            }
            let rows = self.data.values(&mut budget)?;
            self.data.check_finite(&rows)?;
            Ok(Spheres { links, rows, along: self.along(), layers: self.layers })
        })
    }
}

/// Spheres in memory.
#[derive(Debug)]
pub(super) struct Spheres {
    links: Vec<u32>,
    rows: Vec<f32>,
    along: usize,
    layers: usize,
}

/// The value at a position beyond the unit sphere.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SpherePoint {
    /// Coefficients of band 0.
    pub(super) coefficients: [f64; 3],
    /// Optical depth per unit of `1 - 1/r`, at least 0.
    pub(super) density: f64,
}

impl SpherePoint {
    /// The colour.
    pub(super) fn color(&self) -> [f64; 3] {
        self.coefficients.map(|value| (value * f64::from(BAND_0) + OFFSET).max(0.0))
    }
}

impl Spheres {
    /// Layers.
    pub(super) fn layers(&self) -> usize {
        self.layers
    }

    /// Values in a unit direction, at an inverse radius.
    pub(super) fn at(&self, [x, y, z]: [f64; 3], inverse: f64) -> SpherePoint {
        let (across, along) = (2 * self.along, self.along);
        let turn = 0.5 + libm::atan2(x, z) / std::f64::consts::TAU;
        let height = 0.5 - libm::asin(y.clamp(-1.0, 1.0)) / std::f64::consts::PI;
        let layers = self.layers as f64;
        let layer = ((1.0 - inverse) * layers - 0.5).clamp(0.0, layers - 1.0);
        let below = |at: f64, last: usize| {
            let low = whole(at).min(last);
            (low, at - low as f64)
        };
        let (u, u_share) = below(turn * across as f64, across - 1);
        let (v, v_share) = below(height * along as f64, along - 1);
        let (layer, layer_share) = below(layer, self.layers - 2);
        let next = |at: usize, count: usize| if at + 1 < count { at + 1 } else { 0 };
        let (u_next, v_next) = (next(u, across), next(v, along));
        let mut sums = [0.0; CHANNELS];
        for (u, u_share) in [(u, 1.0 - u_share), (u_next, u_share)] {
            for (v, v_share) in [(v, 1.0 - v_share), (v_next, v_share)] {
                let row = self.links.get(u * along + v).copied().unwrap_or(NO_ROW);
                if row == NO_ROW {
                    continue;
                }
                let first = (row as usize * self.layers + layer) * CHANNELS;
                let own = self.rows.get(first..first + 2 * CHANNELS).unwrap_or_default();
                let (low, high) = own.split_at(CHANNELS.min(own.len()));
                let weight = u_share * v_share;
                for (sum, (low, high)) in sums.iter_mut().zip(low.iter().zip(high)) {
                    let (low, high) = (f64::from(*low), f64::from(*high));
                    *sum += weight * (low + (high - low) * layer_share);
                }
            }
        }
        let [red, green, blue, density] = sums;
        SpherePoint { coefficients: [red, green, blue], density: density.max(0.0) }
    }
}

impl Spheres {
    /// Radius of a world position, in half edges of the box, and the spheres' value there; density
    /// is per world unit, as seen by `viewers`.
    pub(super) fn seen_at(
        &self,
        space: &SphereSpace,
        position: [f64; 3],
        viewers: &Viewers,
        step_size: f64,
    ) -> (f64, SpherePoint) {
        let at = space.place(position);
        let radius = dot(at, at).sqrt();
        if radius <= 0.0 {
            return (0.0, SpherePoint::default());
        }
        let direction = at.map(|at| at / radius);
        let mut found = self.at(direction, 1.0 / radius.max(1.0));
        found.density *= match radius > 1.0 && radius <= farthest(self.layers, step_size) {
            true => viewers.cosine(direction, radius) / (radius * radius),
            false => 0.0,
        };
        (radius, found)
    }
}

/// Second moments of camera positions, which densities depend on: mean products of coordinates, in
/// half edges from the middle.
///
/// ```text
/// density = sigma cos / r^2,  cos = 1 / sqrt(1 + p / r^2)
/// p: mean squared distance of the cameras from the line through the middle and the position
/// ```
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Viewers([[f64; 3]; 3]);

impl Viewers {
    /// Of places.
    pub(super) fn of(places: &[[f64; 3]]) -> Self {
        let mut products = [[0.0; 3]; 3];
        for place in places {
            for (row, a) in products.iter_mut().zip(place) {
                row.iter_mut().zip(place).for_each(|(sum, b)| *sum += a * b / places.len() as f64);
            }
        }
        Self(products)
    }

    /// The cosine between a radius and rays through its end.
    fn cosine(&self, direction: [f64; 3], radius: f64) -> f64 {
        let [x, y, z] = self.0;
        let along = dot(direction, [x, y, z].map(|row| dot(row, direction)));
        let [[square_x, ..], [_, square_y, _], [.., square_z]] = self.0;
        let aside = (square_x + square_y + square_z - along).max(0.0);
        1.0 / (1.0 + aside / (radius * radius)).sqrt()
    }
}

/// The product of two vectors.
pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.into_iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The place of the spheres in the world: an ellipsoid if the box is not a cube.
#[derive(Debug, Clone, Copy)]
pub(super) struct SphereSpace {
    /// Middle of the box, in world units.
    pub(super) center: [f64; 3],
    /// Half its edges.
    pub(super) radius: [f64; 3],
}

impl SphereSpace {
    /// A world position in half edges from the middle.
    pub(super) fn place(&self, world: [f64; 3]) -> [f64; 3] {
        let mut at = world;
        let axes = self.center.into_iter().zip(self.radius);
        at.iter_mut().zip(axes).for_each(|(at, (center, radius))| *at = (*at - center) / radius);
        at
    }

    /// A world direction, likewise.
    pub(super) fn direction(&self, world: [f64; 3]) -> [f64; 3] {
        let mut by = world;
        by.iter_mut().zip(self.radius).for_each(|(by, radius)| *by /= radius);
        by
    }
}

/// Samples along a ray: the spheres of radius `n / (n - i - 1/2)`, `i` from 0.
pub(super) fn sphere_count(layers: usize, step_size: f64) -> f64 {
    (layers as f64 / step_size).floor() + 2.0
}

/// The radius of the last sphere, in half edges of the box.
pub(super) fn farthest(layers: usize, step_size: f64) -> f64 {
    2.0 * sphere_count(layers, step_size)
}
