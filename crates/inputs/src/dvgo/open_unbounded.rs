//! Opens an unbounded scene with all of its space.

use std::sync::Arc;

use super::contraction::Contraction;
use super::fitted::{harmonics, network};
use super::unbounded_model::{REACH, Unloaded};
use super::world::WorldFile;
use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::checkpoint::{NamedValues, StoredGrid, Whole};
use crate::lazy::Lazy;
use crate::model::field::{ColorDomain, FreeSpace, Grid, Lattice, Lookup};
use crate::model::grid::Nodes;
use crate::model::view_dependence::ViewDependence;
use crate::nested::{self, Colors, SampledDensity};
use crate::network::fit_assumption;
use crate::options::{MlpChoice, SourceOptions, ViewChoice};
use crate::source::{Family, Source};
use crate::tensor::TensorFile;

/// The field of an unbounded scene: nested boxes.
pub(super) fn open(
    file: &TensorFile,
    whole: Whole,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<Source> {
    let Whole { mut source, inner, mask, contracted } = whole;
    let names = NamedValues::new(file);
    let (density, features) =
        (StoredGrid::find(&names, "density", limits)?, StoredGrid::find(&names, "k0", limits)?);
    let network = match names.tensor("rgbnet.0.weight") {
        Some(_) => Some(network(&names, features.channels)?),
        None => None,
    };
    let is_plain =
        options.view == ViewChoice::None || options.mlp == MlpChoice::None || network.is_none();
    let inner_box = inner.bounds();
    let world = Arc::new(WorldFile {
        contraction: Contraction::new(inner, &contracted)?,
        density,
        features,
        network,
        mask,
        scene: source.field.scene.clone(),
        limits: limits.clone(),
        loaded: Lazy::default(),
    });
    let lattices = plan(&world, options, limits)?;
    let scene = &mut source.field.scene;
    if let Some(first) = lattices.first() {
        (scene.bounds, scene.nodes) = (first.bounds, first.nodes);
        source.field.free_space = world.free_space(first, limits)?;
    }
    scene.march.check(scene.nodes)?;
    let field = &mut source.field;
    let densities = SampledDensity::new(Arc::clone(&world), field.lattice(), &field.scene, false);
    field.density = Grid::Values(Arc::new(densities));
    field.color = Vec::new();
    let harmonics = harmonics(options.view);
    let colors = Colors { harmonics, plain: is_plain, cameras: &options.cameras };
    let around = lattices.get(1..).unwrap_or_default();
    field.shells = nested::shells(&world, field, around, inner_box, &colors, limits);
    field.color = vec![nested::fitted_colors(&world, field, &colors, limits)];
    field.color_domain = ColorDomain::Linear;
    field.view = (!is_plain).then_some(ViewDependence::Harmonics(harmonics));
    field.check()?;
    if !is_plain {
        source.assumptions.push(fit_assumption(harmonics.degree, false, &options.cameras));
    }
    source.family = Family::Dvgo;
    source.is_unbounded = true;
    source.model = Some(Arc::new(Unloaded(world)));
    Ok(source)
}

/// The boxes.
fn plan(world: &WorldFile, options: &SourceOptions, limits: &Limits) -> Result<Vec<Lattice>> {
    let place = Place::Key("scene_radius".to_owned());
    let (middle, extent) = (world.contraction.middle(), options.extent.map_or(REACH, f64::from));
    let first = match options.resolution {
        Some(nodes) => nested::even(middle, nodes, extent),
        None => {
            let lowest = [-world.contraction.reach(); 3];
            nested::aligned(middle, lowest, world.spacing(), extent)
        }
    };
    nested::boxes(first, middle, extent, limits, &place)
}

impl WorldFile {
    /// The mask at its own nodes, extended to the first box.
    fn free_space(&self, first: &Lattice, limits: &Limits) -> Result<Option<FreeSpace>> {
        let Some(mask) = &self.mask else { return Ok(None) };
        let middle = self.contraction.middle();
        let (mut scale, mut shift) = (mask.scale, mask.shift);
        let mut counts = [0; 3];
        let middles = middle.center.into_iter().zip(middle.radius);
        let corners = first.bounds.min.into_iter().zip(first.bounds.max).zip(middles);
        let axes = scale.iter_mut().zip(&mut shift).zip(&mut counts).zip(corners);
        for (((scale, shift), count), ((min, max), (center, radius))) in axes {
            *scale /= radius;
            *shift -= center * *scale;
            let ends = [min, max].map(|at| libm::rint(f64::from(at) * *scale + *shift));
            let [low, high] = [ends[0].min(ends[1]), ends[0].max(ends[1])];
            *shift -= low;
            #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
            let nodes = (high - low + 1.0).max(2.0) as u64;
            *count = nodes;
        }
        let place = Place::Tensor("mask_cache.mask".to_owned());
        let nodes = Nodes::checked(counts, limits, &place)?;
        let mut inside: Vec<bool> =
            Budget::new(limits).zeroed(nodes.count(), "bytes of a mask", &place)?;
        let Nodes([_, ny, nz]) = nodes;
        for (number, inside) in inside.iter_mut().enumerate() {
            let mut at = [number / (ny * nz), number / nz % ny, number % nz].map(|at| at as f64);
            let axes = at.iter_mut().zip(scale).zip(shift);
            axes.for_each(|((at, scale), shift)| *at = (*at - shift) / scale);
            *inside = self.is_free(self.contraction.contracted(self.contraction.place(at)));
        }
        Ok(Some(FreeSpace { nodes, scale, shift, lookup: Lookup::Nearest(inside) }))
    }
}
