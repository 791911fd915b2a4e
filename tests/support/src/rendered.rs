//! Fields as the renderer's reference implementation takes them, and how far pictures are from the
//! reference's.

use mipvog::model::baked::{BakedField, BakedLevel, DensityDomain, Group, LevelMetadata};
use mipvog::model::camera::Camera;
use mipvog::model::field::{Nonfinite, RadianceField};
use mipvog::model::grid::NodeMask;

use mipvog::base::parallel;
use mipvog::base::progress::Silent;
use mipvog::levels::LevelFilter;
use mipvog::levels::visible::masked_planes;
use mipvog::quantize::decode_codes;
use mipvog::view::render::{Frame, LevelChoice};

use super::plain::{all_nodes, halved, index, next_level};
use super::plain_render::{PlainField, PlainLevel, Pruned};
use super::{grid_values, plain_alpha};

/// Level 0 of a trained field, and the levels that a filter makes of it, at most so many in all.
pub fn trained_levels(
    field: &RadianceField,
    filter: Option<(&dyn LevelFilter, usize)>,
) -> Vec<PlainLevel> {
    let mut nodes = field.scene.nodes.0;
    let wide = |values: Vec<f32>| values.into_iter().map(f64::from).collect::<Vec<f64>>();
    let mut density = wide(grid_values(&field.density));
    let mut color: Vec<Vec<f64>> = Vec::new();
    for volume in &field.color {
        let values = wide(grid_values(volume));
        color.extend(values.chunks_exact(field.scene.nodes.count()).map(<[f64]>::to_vec));
    }
    let finest = PlainLevel {
        nodes,
        density: Some(density.clone()),
        domain: DensityDomain::Raw,
        anisotropy: Vec::new(),
        color: color.clone(),
        pruned: None,
    };
    let mut all = vec![finest];
    let Some((filter, count)) = filter else { return all };
    let weights = &filter.weights();
    // Coarser levels are made from the nodes inside the mask.
    if count > 1 && filter.has_density() {
        density = masked_density(field);
    }
    let mut linear = Vec::new();
    let domain = filter.alpha(&field.scene.activation);
    if let Some(domain) = &domain {
        let extent = plain_alpha::extent(&field.scene);
        let seen = plain_alpha::visibility(nodes, domain, weights, &density, extent);
        let channels = [vec![density.clone()], color.clone()].concat();
        linear = plain_alpha::premultiply(domain, field.color_domain, &channels, &seen);
    }
    while all.len() < count && halved(nodes) != nodes {
        let next = |values: &[f64]| next_level(nodes, values, weights);
        let mut kind = DensityDomain::Raw;
        if let Some(domain) = &domain {
            linear = linear.iter().map(|channel| next(channel)).collect();
            let mut stored =
                plain_alpha::unpremultiply(halved(nodes), domain, field.color_domain, &linear);
            density = stored.remove(0);
            color = stored;
            kind = domain.stored;
        } else {
            color = color.iter().map(|channel| next(channel)).collect();
            density = if filter.has_density() { next(&density) } else { density };
        }
        nodes = halved(nodes);
        let density = filter.has_density().then(|| density.clone());
        let (color, anisotropy) = (color.clone(), Vec::new());
        all.push(PlainLevel { nodes, density, domain: kind, anisotropy, color, pruned: None });
    }
    all
}

/// Level 0 alone.
pub fn finest_level(field: &RadianceField) -> Vec<PlainLevel> {
    trained_levels(field, None)
}

fn masked_density(field: &RadianceField) -> Vec<f64> {
    let planes = masked_planes(field, Nonfinite::Refuse, &Silent).expect("a mask");
    let [nx, ny, nz] = field.scene.nodes.0;
    let whole = NodeMask::full(field.scene.nodes);
    let plane = |x: usize| {
        let mut plane = vec![0.0; ny * nz];
        planes.read(0, x, whole.plane(x), &mut plane, false).expect("readable");
        plane
    };
    (0..nx).flat_map(plane).map(f64::from).collect()
}

/// Levels of a baked field.
pub fn baked_levels(field: &BakedField) -> Vec<PlainLevel> {
    let metadata = &field.metadata;
    let level = |(level, level_metadata): (&BakedLevel, &LevelMetadata)| {
        let (grid, nodes) = (level_metadata.grid(), level_metadata.dimensions);
        let counts = grid.counts();
        let mut stored = vec![false; grid.total()];
        level.table.stored().for_each(|place| stored[index(counts, place)] = true);
        let is_stored = |at: [usize; 3]| stored[index(counts, at.map(|node| node / grid.edge))];
        let channels = |group: Group| -> Vec<Vec<f64>> {
            let count = group.channels(metadata.layout());
            (0..count)
                .map(|channel| dense(level, level_metadata, group, (channel, count)))
                .collect()
        };
        let empty = |group: Group| level_metadata.encoding(group).map(|of| f64::from(of.empty));
        let empty_color = Group::COLORS
            .map(|group| vec![empty(group).unwrap_or(0.0); group.channels(metadata.layout())]);
        PlainLevel {
            nodes,
            density: level_metadata.density.is_some().then(|| channels(Group::Density).remove(0)),
            domain: level_metadata.density_domain(),
            anisotropy: match &level_metadata.anisotropy {
                Some(_) => channels(Group::Anisotropy),
                None => Vec::new(),
            },
            color: Group::COLORS.map(channels).concat(),
            pruned: Some(Pruned {
                stored: all_nodes(nodes).map(is_stored).collect(),
                density: empty(Group::Density).unwrap_or(0.0),
                color: empty_color.concat(),
            }),
        }
    };
    field.levels.iter().zip(&metadata.levels).map(level).collect()
}

/// One channel of a level; blocks that are not stored hold the empty value.
fn dense(
    level: &BakedLevel,
    metadata: &LevelMetadata,
    group: Group,
    (channel, channels): (usize, usize),
) -> Vec<f64> {
    let (grid, nodes) = (metadata.grid(), metadata.dimensions);
    let (Some(encoding), Some(codes)) = (metadata.encoding(group), &level.atlases[group.index()])
    else {
        return vec![0.0; grid.nodes.count()];
    };
    let mut values = vec![f64::from(encoding.empty); grid.nodes.count()];
    let mut block = vec![0.0; grid.block_nodes()];
    for (frame, place) in level.table.stored().enumerate() {
        let first = (frame * channels + channel) * grid.block_nodes();
        decode_codes(encoding, codes, first..first + grid.block_nodes(), &mut block);
        for (inside, &value) in all_nodes([grid.edge; 3]).zip(&block) {
            let at = [0, 1, 2].map(|axis| place[axis] * grid.edge + inside[axis]);
            if (0..3).all(|axis| at[axis] < nodes[axis]) {
                values[index(nodes, at)] = f64::from(value);
            }
        }
    }
    values
}

/// The largest differences between a picture and its reference's, beyond the doubt at thresholds.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Differences {
    pub color: f64,
    pub transmittance: f64,
    pub accumulated: f64,
    pub distance: f64,
    pub level: f64,
    /// The most that thresholds left open.
    pub doubt: f64,
}

impl Differences {
    /// Of these pixels.
    pub fn of(
        plain: &PlainField,
        camera: &Camera,
        choice: LevelChoice,
        frame: &Frame,
        pixels: &[usize],
    ) -> Self {
        let all = parallel::map(pixels.len(), |i| {
            let pixel = pixels[i];
            let want = plain.pixel(camera, [pixel % frame.width, pixel / frame.width], choice);
            let beyond = |got: &[f32], want_values: &[f64]| {
                let errors =
                    got.iter().zip(want_values).map(|(got, w)| (f64::from(*got) - w).abs());
                // A NaN is no small difference.
                let most =
                    errors.fold(0.0, |most, e| if e > most || e.is_nan() { e } else { most });
                // The network and distances enlarge the change by a sample on a threshold.
                let open = 10.0 * want.doubt;
                if most <= open { 0.0 } else { most - open }
            };
            let channels = frame.channels;
            Ok(Self {
                color: beyond(&frame.color[pixel], &want.color),
                transmittance: beyond(&[frame.transmittance[pixel]], &[want.transmittance]),
                accumulated: beyond(
                    &frame.accumulated[pixel * channels..][..channels],
                    &want.accumulated,
                ),
                distance: beyond(&[frame.distance[pixel]], &[want.distance]),
                level: beyond(&[frame.level[pixel]], &[want.level]),
                doubt: want.doubt,
            })
        });
        all.expect("no errors").into_iter().fold(Self::default(), Self::larger)
    }

    /// The larger of each.
    pub fn larger(self, other: Self) -> Self {
        let larger = |a: f64, b: f64| if a > b || a.is_nan() { a } else { b };
        Self {
            color: larger(self.color, other.color),
            transmittance: larger(self.transmittance, other.transmittance),
            accumulated: larger(self.accumulated, other.accumulated),
            distance: larger(self.distance, other.distance),
            level: larger(self.level, other.level),
            doubt: larger(self.doubt, other.doubt),
        }
    }
}
