//! Tables of blocks and metadata, as they follow from options and visible nodes.

use super::BakeOptions;
use super::fit::Fitted;
use crate::base::error::Result;
use crate::levels::brightness::LARGEST_BRIGHTNESS;
use crate::levels::{Direction, Visible};
use crate::model::anisotropy::LARGEST_FUNCTION;
use crate::model::baked::{
    ColorLayout, ColorSpace, Decode, Encoding, LevelMetadata, Metadata, Occupancy, Table,
    ViewMetadata,
};
use crate::model::field::{Activation, ColorDomain, RadianceField};
use crate::model::grid::{BlockGrid, NodeMask};
use crate::quantize::{ValueRange, encoding_over, planned_encoding};

/// The blocks of `edge` nodes that hold a retained node, by level.
pub fn tables(visible: &Visible, edge: usize) -> Result<Vec<Table>> {
    let occupancy = |kept: bool| if kept { Occupancy::Stored } else { Occupancy::Empty };
    let table = |retained: &NodeMask| {
        let blocks = retained.blocks(edge)?.into_iter().map(occupancy).collect();
        Table::new(BlockGrid { nodes: retained.nodes(), edge }, blocks)
    };
    visible.levels.iter().map(|level| table(&level.retained)).collect()
}

/// Gives coarser levels encodings for the directional brightness and anisotropy that were fitted,
/// and for no others.
pub fn add_fitted(metadata: &mut Metadata, options: &BakeOptions, fitted: &Fitted) {
    let activation = metadata.activation;
    let encoding = |decode: Decode, channels: &[Vec<f32>]| {
        let mut range = ValueRange::new(decode, &activation);
        channels.iter().for_each(|values| range.take(values));
        encoding_over(options.bits, decode, &activation, &range)
    };
    for (number, level) in metadata.levels.iter_mut().enumerate() {
        let directional = fitted.directional(number);
        level.directional = directional.map(|values| encoding(Decode::Directional, values));
        let anisotropy = fitted.anisotropy(number);
        level.anisotropy = anisotropy.map(|values| encoding(Decode::Anisotropy, values));
    }
}

/// The parts of a node's values, with or without directional terms.
pub fn layout(field: &RadianceField, has_direction: bool) -> ColorLayout {
    let features = field.color_channels() - 3;
    let [features, degree] = match field.harmonics() {
        Some(harmonics) => [0, harmonics.degree],
        None => [features, 0],
    };
    ColorLayout { features, degree, directional: has_direction, anisotropy: has_direction }
}

/// Density to opacity over the interval of the box that a part spans.
pub fn activation_of(metadata: &Metadata, part: usize) -> Activation {
    let times = libm::exp2(metadata.box_of_part(part) as f64) as f32;
    let own = metadata.activation;
    Activation { interval: own.interval * times, ..own }
}

/// The metadata of a bake, with the encodings that `options.bits` gives.
pub fn metadata(
    field: &RadianceField,
    options: &BakeOptions,
    visible: &Visible,
    tables: &[Table],
) -> Metadata {
    let scene = &field.scene;
    let filter = &*options.filter;
    let direction = Direction::of(filter, field);
    let layout = layout(field, direction.is_some());
    let planned = |decode| planned_encoding(options.bits, decode, &scene.activation);
    let density = |level: usize| planned(Decode::Density(filter.density_domain(level)));
    let color = planned(match (field.color_domain, field.harmonics()) {
        (_, Some(_)) => Decode::Coefficient(0),
        (ColorDomain::Linear, None) => Decode::Linear,
        (ColorDomain::Logit, None) => Decode::Logit,
    });
    let bands = (1..=layout.degree).map(|band| planned(Decode::Coefficient(band as u8)));
    let bands: Vec<Encoding> = bands.collect();
    let domain = filter.alpha(&scene.activation);
    let most = domain.map_or(0.0, |domain| domain.largest_sqrt_depth());
    let over = |decode: Decode, largest: f32| {
        let mut range = ValueRange::new(decode, &scene.activation);
        range.take(&[-largest, largest]);
        encoding_over(options.bits, decode, &scene.activation, &range)
    };
    let anisotropy = direction.map(|_| over(Decode::Anisotropy, LARGEST_FUNCTION * most));
    let directional = |level: usize| {
        let has_brightness = direction.is_some_and(|direction| direction.has_brightness(level));
        has_brightness.then(|| over(Decode::Directional, LARGEST_BRIGHTNESS))
    };
    let level = |(number, table): (usize, &Table)| LevelMetadata {
        dimensions: table.grid().nodes.0,
        block_size: options.block_size,
        bounds: None,
        blocks_stored: table.frames(),
        blocks_filled: 0,
        density: (number == 0 || filter.has_density()).then(|| density(number)),
        diffuse: Some(color.clone()),
        features: (layout.features > 0).then(|| color.clone()),
        bands: bands.clone(),
        directional: directional(number),
        anisotropy: anisotropy.clone().filter(|_| number > 0),
    };
    Metadata {
        bounds: scene.bounds,
        activation: scene.activation,
        march: scene.march,
        step_rule: filter.step_rule(),
        level_of_detail: options.level_of_detail(),
        blend: filter.blend(),
        background: scene.background,
        color_space: ColorSpace::SrgbDisplay,
        features: field.color_channels() - 3,
        view: field.view.as_ref().map(ViewMetadata::of),
        free_space: visible.mask_is_required,
        alpha_threshold: options.alpha_threshold,
        filter: filter.name().to_owned(),
        levels: tables.iter().enumerate().map(level).collect(),
        shells: Vec::new(),
    }
}
