//! Tables of blocks and metadata, as they follow from options and visible nodes.

use super::BakeOptions;
use crate::base::error::Result;
use crate::codec::quantize::{color_encoding, density_encoding};
use crate::levels::Visible;
use crate::model::baked::{ColorSpace, LevelMetadata, Metadata, Occupancy, Table, ViewMetadata};
use crate::model::field::RadianceField;
use crate::model::grid::{BlockGrid, NodeMask};

/// The blocks of `edge` nodes that hold a retained node, by level.
pub fn tables(visible: &Visible, edge: usize) -> Result<Vec<Table>> {
    let occupancy = |kept: bool| if kept { Occupancy::Stored } else { Occupancy::Empty };
    let table = |retained: &NodeMask| {
        let blocks = retained.blocks(edge)?.into_iter().map(occupancy).collect();
        Table::new(BlockGrid { nodes: retained.nodes(), edge }, blocks)
    };
    visible.levels.iter().map(|level| table(&level.retained)).collect()
}

/// The metadata of a bake, with the encodings that `options.bits` gives.
pub fn metadata(
    field: &RadianceField,
    options: &BakeOptions,
    visible: &Visible,
    tables: &[Table],
) -> Metadata {
    let scene = &field.scene;
    let features = field.color_channels() - 3;
    let filter = &*options.filter;
    let density = |level: usize| {
        density_encoding(options.bits, filter.density_domain(level), &scene.activation)
    };
    let color = color_encoding(options.bits);
    let level = |(number, table): (usize, &Table)| LevelMetadata {
        dimensions: table.grid().nodes.0,
        block_size: options.block_size,
        blocks_stored: table.frames(),
        blocks_filled: 0,
        density: (number == 0 || filter.has_density()).then(|| density(number)),
        diffuse: Some(color.clone()),
        features: (features > 0).then(|| color.clone()),
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
        features,
        view: field.view_mlp.as_ref().map(|network| ViewMetadata {
            widths: network.widths(),
            frequencies: network.frequencies,
            input: network.input,
        }),
        free_space: visible.mask_is_required,
        alpha_threshold: options.alpha_threshold,
        filter: filter.name().to_owned(),
        levels: tables.iter().enumerate().map(level).collect(),
    }
}
