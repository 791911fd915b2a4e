//! A field's level as a sparse volume of activated values.
//!
//! 1. Densities at the points of a lattice, leaf by leaf; empty leaves are dropped.
//! 2. Colours of occupied points: the mean over directions, converted to linear light.
//! 3. Points beside occupied ones get the colour of their nearest occupied neighbour. Programs
//!    interpolate colours independently of density, so colours would fade to black at every surface
//!    without these points.

use std::collections::HashMap;

use super::leaf::{Leaf, LeafMask, POINTS, SIDE, contains, insert, place_of, points};
use super::mean_colors::MeanColors;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::parallel;
use crate::base::progress::{Progress, Step};
use crate::base::srgb::linear;
use crate::model::grid::Nodes;
use crate::view::Lattice;
use crate::view::render::{Directions, Renderer};

/// Points that absorb less than this share of light over the distance of two points count as empty:
/// a ray through 30 such points loses a hundredth.
const LEAST_OPACITY: f64 = 3e-4;
/// Directions that a colour is averaged over.
const DIRECTIONS: usize = 16;

/// Quantization steps of a mean colour from 0 to 1, display-referred. They are finer than those of
/// training pictures, and equal neighbours compress.
const MEAN_STEPS: u16 = 511;

/// The content of a volume.
#[derive(Debug, Clone, Copy)]
pub struct VolumeOptions {
    /// The level, 0 being the finest.
    pub level: usize,
    /// True to include features.
    pub features: bool,
    /// True to include colours beyond the lattice, for programs that interpolate towards them.
    pub beyond: bool,
}

/// Leaves with density or colours, by their numbers: x slowest.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseVolume {
    /// The points.
    pub lattice: Lattice,
    /// In order of their numbers.
    pub leaves: Vec<Leaf>,
    /// Channels of features.
    pub features: usize,
}

impl SparseVolume {
    /// Evaluates a field at the points of a lattice. [`Step::Encode`] advances by slabs of leaves.
    ///
    /// # Errors
    ///
    /// More memory than the limits allow, and a request to stop.
    pub fn new(
        field: &Renderer,
        lattice: Lattice,
        options: VolumeOptions,
        limits: &Limits,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let features = if options.features { field.view().features } else { 0 };
        let counts = lattice.counts().map(|count| count.div_ceil(SIDE));
        progress.begin(Step::Encode, 2 * counts[0] as u64);
        let mut budget = Budget::new(limits);
        let mut leaves = Vec::new();
        for x in 0..counts[0] {
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            let slab = parallel::map(counts[1], |y| {
                let leaf = |z| leaf_of(field, &lattice, options.level, [x, y, z]);
                Ok((0..counts[2]).filter_map(leaf).collect::<Vec<_>>())
            })?;
            let slab: Vec<Leaf> = slab.into_iter().flatten().collect();
            spend(&mut budget, slab.len() * Leaf::bytes(features))?;
            leaves.extend(slab);
            progress.advance(Step::Encode, 1);
        }
        let mut volume = Self { lattice, leaves, features };
        volume.find_colors(field, options, progress)?;
        volume.color_neighbours(options.beyond, &mut budget)?;
        progress.advance(Step::Encode, counts[0] as u64);
        Ok(volume)
    }

    /// Occupied points.
    pub fn occupied(&self) -> u64 {
        let bits =
            |leaf: &Leaf| leaf.occupied.iter().map(|word| u64::from(word.count_ones())).sum();
        self.leaves.iter().map(|leaf| -> u64 { bits(leaf) }).sum()
    }

    /// The largest density.
    pub fn largest_density(&self) -> f32 {
        let densities = self.leaves.iter().flat_map(|leaf| &leaf.density);
        densities.copied().fold(0.0, f32::max)
    }

    fn find_colors(
        &mut self,
        field: &Renderer,
        options: VolumeOptions,
        progress: &dyn Progress,
    ) -> Result<()> {
        let (lattice, level, features) = (&self.lattice, options.level, self.features);
        let directions = Directions::spread(field, DIRECTIONS);
        let is_mean = field.is_model() || field.view().view_dependence.is_some();
        let nodes = Nodes(level_nodes(field, level));
        let dense = lattice.counts().iter().zip(nodes.0).all(|(&count, nodes)| count > nodes);
        // Evaluating a network per point would take minutes, so it is evaluated at nodes.
        let means = match field.has_network() && dense {
            true => {
                let least = least_density(lattice);
                Some(MeanColors::new(field, level, nodes, least, &directions, progress)?)
            }
            false => None,
        };
        let steps: Vec<f32> = (0..=MEAN_STEPS)
            .map(|step| linear(f64::from(step) / f64::from(MEAN_STEPS)) as f32)
            .collect();
        parallel::map_mut(&mut self.leaves, |_, leaf| {
            if progress.cancelled() {
                return Err(Error::cancelled());
            }
            leaf.color = vec![[0.0; 3]; POINTS];
            leaf.colored = leaf.occupied;
            leaf.features = vec![0.0; features * POINTS];
            for point in points(&leaf.occupied) {
                let share = lattice.share(place(leaf.at, point));
                let color = match &means {
                    Some(means) => means.at(share),
                    None => field.mean_color(share, level, &directions),
                };
                leaf.color[point] = color.map(|value| {
                    // The nearest step: colours are not negative.
                    let step = value * f32::from(MEAN_STEPS) + 0.5;
                    match steps.get(step as usize).filter(|_| is_mean) {
                        Some(linear) => *linear,
                        None => linear(f64::from(value)) as f32,
                    }
                });
                if features > 0 {
                    let sample = field.sample_at(share, level);
                    let own = sample.features.iter().chain(sample.coefficients.iter().skip(3));
                    for (channel, value) in own.take(features).enumerate() {
                        leaf.features[channel * POINTS + point] = *value;
                    }
                }
            }
            Ok(())
        })
        .map(|_| ())
    }

    /// Gives points beside occupied ones the colour of their nearest occupied neighbour. Among
    /// equally near ones, a neighbour along z is preferred, because equal adjacent bytes compress.
    fn color_neighbours(&mut self, beyond: bool, budget: &mut Budget) -> Result<()> {
        let by_place: HashMap<[i32; 3], &Leaf> =
            self.leaves.iter().map(|leaf| (leaf.at, leaf)).collect();
        let around = |at: [i32; 3]| CUBE.map(|step| [0, 1, 2].map(|axis| at[axis] + step[axis]));
        let mut places: Vec<[i32; 3]> = by_place.keys().flat_map(|&at| around(at)).collect();
        places.sort_unstable();
        places.dedup();
        let (steps, margin) = (neighbours(), i32::from(beyond));
        let ends = self.lattice.counts().map(|count| count as i32 + margin);
        let found = parallel::map(places.len(), |number| {
            let at = places[number];
            let leaves = around(at).map(|at| by_place.get(&at).copied());
            let Some(beside) = beside_occupied(&leaves) else { return Ok(None) };
            let mut colors = Vec::new();
            for point in points(&beside) {
                let own = place_of(point).map(|at| at as i32);
                if (0..3).any(|axis| {
                    let place = at[axis] * SIDE as i32 + own[axis];
                    place < -margin || place >= ends[axis]
                }) {
                    continue;
                }
                let nearest = steps.iter().find_map(|step| {
                    let (home, inside) = home([0, 1, 2].map(|axis| own[axis] - step[axis]));
                    let leaf = leaves[cube_number(home)]?;
                    contains(&leaf.occupied, inside).then(|| leaf.color[inside])
                });
                colors.extend(nearest.map(|color| (point, color)));
            }
            Ok((!colors.is_empty()).then_some(colors))
        })?;
        let numbers: HashMap<[i32; 3], usize> =
            self.leaves.iter().enumerate().map(|(number, leaf)| (leaf.at, number)).collect();
        for (at, colors) in places.iter().zip(found) {
            let Some(colors) = colors else { continue };
            let number = match numbers.get(at) {
                Some(&number) => number,
                None => {
                    spend(budget, Leaf::bytes(self.features))?;
                    let mut leaf = Leaf::empty(*at);
                    leaf.color = vec![[0.0; 3]; POINTS];
                    leaf.features = vec![0.0; self.features * POINTS];
                    self.leaves.push(leaf);
                    self.leaves.len() - 1
                }
            };
            let leaf = &mut self.leaves[number];
            for (point, color) in colors {
                insert(&mut leaf.colored, point);
                leaf.color[point] = color;
            }
        }
        self.leaves.sort_by_key(|leaf| leaf.at);
        Ok(())
    }
}

/// Steps to the 27 leaves around a leaf and to itself.
const CUBE: [[i32; 3]; 27] = {
    let mut cube = [[0; 3]; 27];
    let mut number = 0;
    while number < 27 {
        let at = number as i32;
        cube[number] = [at / 9 - 1, at / 3 % 3 - 1, at % 3 - 1];
        number += 1;
    }
    cube
};

/// The place of a step in [`CUBE`].
fn cube_number([x, y, z]: [i32; 3]) -> usize {
    (9 * (x + 1) + 3 * (y + 1) + z + 1) as usize
}

/// The empty points of a leaf that are beside an occupied point of the leaf or of the leaves around
/// it, which are in the order of [`CUBE`]. None if there are none.
fn beside_occupied(leaves: &[Option<&Leaf>; 27]) -> Option<LeafMask> {
    const ROWS: usize = SIDE + 2;
    // Bit `z + 1` of a row is the point at `z`: rows have a point of the next leaves at both ends.
    let mut rows = [[0u16; ROWS]; ROWS];
    for (x, y) in (0..ROWS).flat_map(|x| (0..ROWS).map(move |y| (x, y))) {
        let own = [x, y].map(|at| at as i32 - 1);
        let row = |z: i32| {
            let (home, inside) = home([own[0], own[1], z]);
            let leaf = leaves[cube_number(home)]?;
            // The eight points of a row are a byte of the mask.
            Some((leaf.occupied[inside / 64] >> (inside / SIDE % 8 * 8) & 0xff) as u16)
        };
        let [before, middle, behind] = [-1, 0, SIDE as i32].map(|z| row(z).unwrap_or(0));
        rows[x][y] = before >> 7 | middle << 1 | (behind & 1) << 9;
    }
    let mut beside: LeafMask = [0; POINTS / 64];
    for (x, y) in (0..SIDE).flat_map(|x| (0..SIDE).map(move |y| (x, y))) {
        let near = rows[x..x + 3].iter().flat_map(|rows| &rows[y..y + 3]);
        let any = near.fold(0, |any, row| any | row);
        let grown = (any | any << 1 | any >> 1) & !rows[x + 1][y + 1];
        let first = (x * SIDE + y) * SIDE;
        beside[first / 64] |= u64::from(grown >> 1 & 0xff) << (first % 64);
    }
    (beside != [0; POINTS / 64]).then_some(beside)
}

/// Takes bytes from the budget of a volume.
fn spend(budget: &mut Budget, bytes: usize) -> Result<()> {
    budget.spend(bytes as u64, "bytes of a volume", &Place::File)
}

/// Steps to the 26 neighbours of a point, nearest first, and along z first among equals.
fn neighbours() -> Vec<[i32; 3]> {
    let step = |number: i32| [number / 9 - 1, number / 3 % 3 - 1, number % 3 - 1];
    let mut steps: Vec<[i32; 3]> = (0..27).filter(|&number| number != 13).map(step).collect();
    let length = |step: &[i32; 3]| step.iter().map(|along| along.abs()).sum::<i32>();
    steps.sort_by_key(|step| (length(step), -step[2].abs()));
    steps
}

/// Nodes of a level along each axis.
pub fn level_nodes(field: &Renderer, level: usize) -> [usize; 3] {
    let sizes = crate::levels::sizes::level_sizes(field.view().nodes, level + 1);
    sizes.last().map_or([2; 3], |nodes| nodes.0)
}

/// The lattice's number of a leaf's point.
fn place(leaf: [i32; 3], point: usize) -> [usize; 3] {
    let inside = place_of(point);
    std::array::from_fn(|axis| leaf[axis] as usize * SIDE + inside[axis])
}

/// The leaf of a point of the lattice, and the point's number in it.
fn home(at: [i32; 3]) -> ([i32; 3], usize) {
    let [x, y, z] = at.map(|at| at.rem_euclid(SIDE as i32) as usize);
    (at.map(|at| at.div_euclid(SIDE as i32)), (x * SIDE + y) * SIDE + z)
}

/// Points of a smaller density are empty, in optical depth per world unit.
fn least_density(lattice: &Lattice) -> f32 {
    let spacing = lattice.spacing.into_iter().fold(f64::INFINITY, f64::min);
    (-libm::log1p(-LEAST_OPACITY) / spacing) as f32
}

/// The densities of a leaf; none if it is empty.
fn leaf_of(field: &Renderer, lattice: &Lattice, level: usize, at: [usize; 3]) -> Option<Leaf> {
    let counts = lattice.counts();
    let first = at.map(|at| at * SIDE);
    let last: [usize; 3] = std::array::from_fn(|axis| (first[axis] + SIDE).min(counts[axis]) - 1);
    if field.is_empty([lattice.share(first), lattice.share(last)], level) {
        return None;
    }
    let least = least_density(lattice);
    let mut leaf = Leaf::empty(at.map(|at| at as i32));
    let mut inside = Vec::with_capacity(POINTS);
    let mut shares = Vec::with_capacity(POINTS);
    for point in 0..POINTS {
        let own = place_of(point);
        let place: [usize; 3] = std::array::from_fn(|axis| first[axis] + own[axis]);
        if (0..3).all(|axis| place[axis] <= last[axis]) {
            inside.push(point);
            shares.push(lattice.share(place));
        }
    }
    let mut any = false;
    for (point, density) in inside.into_iter().zip(field.densities_at(&shares, level)) {
        if density >= least {
            insert(&mut leaf.occupied, point);
            leaf.density[point] = density;
            any = true;
        }
    }
    any.then_some(leaf)
}
