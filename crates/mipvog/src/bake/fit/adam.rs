//! Steps of the visible nodes of one level.

use super::gradient::{Gradient, NOT_FITTED, NodeValues};
use super::moments::{Means, fade, lacks};
use crate::base::error::Result;
use crate::base::parallel;
use crate::model::anisotropy::ANISOTROPY;
use crate::model::directional::DIRECTIONAL;
use crate::model::field::ColorDomain;
use crate::model::grid::NodeMask;
use crate::view::render::View;
use crate::view::sample::{Dense, NodesMut};

/// Step length at the start of the square root of optical depth, in fits of up to [`FEW_STEPS`].
const DENSITY_RATE: f32 = 0.014;
/// In longer fits, the steps of density shrink with the root of their number, so that densities can
/// move equally far. Without that, 1000 steps gain 0.15 dB less at a quarter of the size.
const FEW_STEPS: f32 = 130.0;
/// Step lengths at the start of logits, and of linear colours and coefficients. A step of a logit
/// moves a colour by at most as much as one of a linear colour.
const COLOR_RATES: [f32; 2] = [0.07, 0.0175];
/// Step length of directional brightness, as a share of that of logits: longer ones follow the
/// noise of the few directions that a step has.
const DIRECTIONAL_SHARE: f32 = 0.5;
/// Step length of anisotropy, as a share of that of density.
const ANISOTROPY_SHARE: f32 = 0.5;
/// Derivatives below this share of a level's root mean square count as noise: a node that few rays
/// meet must not move as far as one that many rays meet.
const LEAST_SHARE: f32 = 0.3;
/// Initial density of empty nodes: at 0, the derivative would be 0 too.
const SEED_DENSITY: f32 = 0.003;
/// Largest square root of optical depth, and largest anisotropy: codes end there.
const MAX_DENSITY: f32 = 3.9;
/// Nodes that are updated together.
const CHUNK: usize = 4096;

/// A node's running means.
#[derive(Debug, Clone, Copy)]
struct Moments<const C: usize> {
    node: usize,
    density: Means,
    anisotropy: [Means; ANISOTROPY],
    color: [Means; C],
    /// Steps in which the node got a derivative.
    steps: u32,
}

/// Step lengths, as fractions of the initial ones.
#[derive(Debug, Clone, Copy)]
pub struct StepLength {
    density: f32,
    color: f32,
}

impl StepLength {
    /// In a fit of this many steps, of which the fraction `done` (0 to 1) is over.
    pub fn of(steps: usize, done: f32) -> Self {
        let color = fade(done);
        Self { density: color * (FEW_STEPS / steps as f32).min(1.0).sqrt(), color }
    }
}

/// The values of a level's fitted nodes.
pub type State<const C: usize> = Vec<NodeValues<C>>;

/// The optimizer's state.
#[derive(Debug)]
pub struct Adam<const C: usize> {
    level: usize,
    numbers: Vec<u32>,
    moments: Vec<Moments<C>>,
    /// Step lengths of colours at the start.
    color_rates: [f32; C],
    /// Mean squares of the first derivatives, by density and by colour.
    squares: Option<[f32; 2]>,
    /// The state after this many steps.
    lacks: Vec<[f32; 2]>,
}

impl<const C: usize> Adam<C> {
    /// For the `retained` nodes of a level.
    pub fn new(field: &mut Dense<C>, level: usize, retained: &NodeMask, view: &View) -> Self {
        let color_rate = COLOR_RATES[usize::from(view.color_domain == ColorDomain::Linear)];
        let mut color_rates = [color_rate; C];
        if view.directional {
            let last = color_rates.iter_mut().skip(C - DIRECTIONAL);
            last.for_each(|rate| *rate *= DIRECTIONAL_SHARE);
        }
        let [nx, ny, nz] = retained.nodes().0;
        let NodesMut { density, .. } = field.values_mut(level);
        let mut numbers = vec![NOT_FITTED; nx * ny * nz];
        let mut moments = Vec::new();
        for (node, number) in numbers.iter_mut().enumerate() {
            if retained.contains([node / nz / ny, node / nz % ny, node % nz]) {
                *number = moments.len() as u32;
                density[node] = density[node].max(SEED_DENSITY);
                moments.push(Moments {
                    node,
                    density: Means::default(),
                    anisotropy: [Means::default(); ANISOTROPY],
                    color: [Means::default(); C],
                    steps: 0,
                });
            } else {
                density[node] = 0.0;
            }
        }
        Self { level, numbers, moments, color_rates, squares: None, lacks: vec![[0.0; 2]] }
    }

    /// Nodes that are fitted.
    pub fn nodes(&self) -> usize {
        self.moments.len()
    }

    /// The number of each node among those that are fitted.
    pub fn numbers(&self) -> &[u32] {
        &self.numbers
    }

    /// The values of the fitted nodes.
    pub fn state(&self, field: &Dense<C>) -> State<C> {
        let (density, color) = field.values(self.level);
        let anisotropy = field.anisotropy(self.level);
        let values = |moments: &Moments<C>| NodeValues {
            density: density[moments.node],
            anisotropy: anisotropy[moments.node],
            color: color[moments.node],
        };
        self.moments.iter().map(values).collect()
    }

    /// Restores a state of the fitted nodes.
    pub fn restore(&self, field: &mut Dense<C>, state: &State<C>) {
        let NodesMut { density, anisotropy, color } = field.values_mut(self.level);
        for (moments, values) in self.moments.iter().zip(state) {
            density[moments.node] = values.density;
            anisotropy[moments.node] = values.anisotropy;
            color[moments.node] = values.color;
        }
    }

    /// Takes a step against the sum of the `gradients` of level `index + 1`, and clears them.
    pub fn step(
        &mut self,
        field: &mut Dense<C>,
        gradients: &mut [Gradient<C>],
        index: usize,
        length: StepLength,
    ) -> Result<()> {
        let density_rate = DENSITY_RATE * length.density;
        let color_rates = self.color_rates.map(|rate| rate * length.color);
        let nodes = self.moments.len();
        let parts: Vec<_> = gradients.iter().map(|gradient| &gradient.levels[index][..]).collect();
        let squares = *self.squares.get_or_insert_with(|| mean_squares(&parts, nodes));
        let least = squares.map(|square| LEAST_SHARE * square.sqrt() + f32::MIN_POSITIVE);
        let rates = (density_rate, &color_rates);
        self.lacks.push(lacks(self.lacks.len() as u32));
        let lacks = &self.lacks;
        let mut work = chunks(&mut self.moments, field.values_mut(self.level));
        parallel::map_mut(&mut work, |number, Chunk { moments, first_node, nodes }| {
            let NodesMut { density, anisotropy, color } = nodes;
            for (i, moments) in moments.iter_mut().enumerate() {
                let by = total(&parts, number * CHUNK + i);
                // A node that no ray met stays.
                if by.density == 0.0 && by.color.iter().all(|&by| by == 0.0) {
                    continue;
                }
                let step = moments.advance(&by, rates, least, lacks);
                let at = moments.node - *first_node;
                density[at] = (density[at] - step.density).clamp(0.0, MAX_DENSITY);
                for (value, step) in anisotropy[at].iter_mut().zip(step.anisotropy) {
                    *value = (*value - step).clamp(-MAX_DENSITY, MAX_DENSITY);
                }
                color[at].iter_mut().zip(step.color).for_each(|(raw, step)| *raw -= step);
            }
            Ok(())
        })?;
        parallel::map_mut(gradients, |_, gradient| {
            gradient.levels[index].fill(NodeValues::ZERO);
            Ok(())
        })?;
        Ok(())
    }
}

/// Fitted nodes that are updated together, and the level's nodes from the first of them to the next
/// chunk's first.
struct Chunk<'a, const C: usize> {
    moments: &'a mut [Moments<C>],
    first_node: usize,
    nodes: NodesMut<'a, C>,
}

/// All fitted nodes, which rise, with their values.
fn chunks<'a, const C: usize>(
    moments: &'a mut [Moments<C>],
    mut nodes: NodesMut<'a, C>,
) -> Vec<Chunk<'a, C>> {
    // From the last chunk on, which ends where the nodes do.
    let mut chunks = Vec::new();
    for moments in moments.chunks_mut(CHUNK).rev() {
        let first_node = moments.first().map_or(0, |first| first.node);
        let NodesMut { density, anisotropy, color } = nodes;
        let (density, own_density) = density.split_at_mut(first_node);
        let (anisotropy, own_anisotropy) = anisotropy.split_at_mut(first_node);
        let (color, own_color) = color.split_at_mut(first_node);
        nodes = NodesMut { density, anisotropy, color };
        let own = NodesMut { density: own_density, anisotropy: own_anisotropy, color: own_color };
        chunks.push(Chunk { moments, first_node, nodes: own });
    }
    chunks.reverse();
    chunks
}

/// The sum of all parts' derivatives by a node's values.
fn total<const C: usize>(parts: &[&[NodeValues<C>]], node: usize) -> NodeValues<C> {
    let mut total = NodeValues::ZERO;
    for part in parts {
        let NodeValues { density, anisotropy, color } = part[node];
        total.density += density;
        total.anisotropy.iter_mut().zip(anisotropy).for_each(|(sum, part)| *sum += part);
        total.color.iter_mut().zip(color).for_each(|(sum, part)| *sum += part);
    }
    total
}

/// Mean squares of derivatives that are not zero, by density and by colour.
fn mean_squares<const C: usize>(gradients: &[&[NodeValues<C>]], nodes: usize) -> [f32; 2] {
    let (mut sums, mut counts) = ([0.0f64; 2], [0.0f64; 2]);
    let mut add = |kind: usize, derivative: f32| {
        sums[kind] += f64::from(derivative).powi(2);
        counts[kind] += f64::from(u8::from(derivative != 0.0));
    };
    for node in 0..nodes {
        let NodeValues { density, color, .. } = total(gradients, node);
        add(0, density);
        color.into_iter().for_each(|color| add(1, color));
    }
    [0, 1].map(|kind| (sums[kind] / counts[kind].max(1.0)) as f32)
}

impl<const C: usize> Moments<C> {
    /// Updates the means with a derivative, and returns the step.
    fn advance(
        &mut self,
        by: &NodeValues<C>,
        (density_rate, color_rates): (f32, &[f32; C]),
        least: [f32; 2],
        lacks: &[[f32; 2]],
    ) -> NodeValues<C> {
        self.steps += 1;
        let lacks = lacks[self.steps as usize];
        let mut steps = NodeValues::ZERO;
        for (lane, means) in self.color.iter_mut().enumerate() {
            steps.color[lane] = means.advance(by.color[lane], lacks, [color_rates[lane], least[1]]);
        }
        let rate = ANISOTROPY_SHARE * density_rate;
        for (lane, means) in self.anisotropy.iter_mut().enumerate() {
            steps.anisotropy[lane] = means.advance(by.anisotropy[lane], lacks, [rate, least[0]]);
        }
        steps.density = self.density.advance(by.density, lacks, [density_rate, least[0]]);
        steps
    }
}
