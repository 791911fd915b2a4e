//! Several fields as one.
//!
//! The grid of the first field is extended to the boxes of the others ([`part`]). Each of its nodes
//! reads every field whose box contains it ([`values`]):
//!
//! * **Density**: optical depths per world unit add up, as those of mixed fogs do. If only one
//!   field is visible and its densities have the meaning of the first one's, its value does not
//!   change.
//! * **Colour**: the average, weighted by optical depth.
//! * **Where a field ends**, at a face of its box, a crop or its free-space mask, its values count
//!   only if no other field continues there; of several such fields, the densest one counts. So the
//!   parts of a cut scene merge to the original scene.
//!
//! Fields whose nodes coincide with the grid are copied; others are interpolated there, so those
//! with finer voxels lose detail. Nodes that a crop or a mask cuts off are empty, and the merged
//! field has neither.

mod part;
#[cfg(test)]
mod tests;
mod values;

use std::sync::Arc;

use self::part::Part;
use self::values::{Merged, MergedColor, MergedDensity};
use super::{ActivationOrder, ColorDomain, Grid, Lattice, RadianceField, Scene};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::model::grid::Nodes;
use crate::model::harmonics::Harmonics;
use crate::model::view_dependence::ViewDependence;

/// Nodes that are closer than this share of a voxel coincide.
pub(super) const COINCIDENT: f64 = 1e-2;

impl RadianceField {
    /// Merges several fields in their common world. Voxels, steps, background and the meaning of
    /// density are those of the first one.
    ///
    /// # Errors
    ///
    /// `Unsupported` for fields that one container cannot show: different networks, colours that
    /// mean different things, nested boxes, densities that are interpolated after their activation,
    /// steps whose length depends on the direction. `OverLimit` for more nodes than `limits` allow.
    pub fn merge(fields: &[Self], limits: &Limits) -> Result<Self> {
        let Some((first, others)) = fields.split_first() else {
            return Err(Error::malformed(Place::File, "no field", "one or more"));
        };
        fields.iter().try_for_each(refuse_unlike_fog)?;
        let view = others.iter().try_fold(first.view.clone(), |view, other| {
            merged_view(&(first.color_domain, view), &(other.color_domain, other.view.clone()))
        })?;
        let lattice = extended(&first.lattice(), others, limits)?;
        let parts = fields.iter().map(|field| Part::new(field, &lattice, &first.scene));
        let channels = fields.iter().map(Self::color_channels).max().unwrap_or_default();
        let merged = Arc::new(Merged {
            parts: parts.collect::<Result<_>>()?,
            nodes: lattice.nodes,
            activation: first.scene.activation,
            depth_of_density: depth_of_density(&first.scene),
        });
        let mut scene = first.scene.clone();
        (scene.bounds, scene.nodes) = (lattice.bounds, lattice.nodes);
        // A crop empties nodes of its own field.
        scene.march.sampled = None;
        let field = Self {
            scene,
            density: Grid::Values(Arc::new(MergedDensity(Arc::clone(&merged)))),
            color: vec![Grid::Values(Arc::new(MergedColor { merged, channels }))],
            color_domain: first.color_domain,
            view,
            free_space: None,
            shells: Vec::new(),
        };
        field.check()?;
        Ok(field)
    }
}

/// Optical depth per world unit of a density of 1.
pub(super) fn depth_of_density(scene: &Scene) -> f64 {
    f64::from(scene.activation.interval) / scene.march.interval_length()
}

/// The remedy for scenes that no single container can show.
const ATTACH: &str = "attach both to one glTF asset, where each keeps its own grid and colours; \
                      colours without view dependence (view none) always fit each other";

/// Refuses fields whose optical depths at nodes do not determine those between nodes.
fn refuse_unlike_fog(field: &RadianceField) -> Result<()> {
    let refuse = |found: &str, expected: &str| {
        Err(Error::unsupported(Place::File, found, expected).advise(ATTACH))
    };
    if !field.shells.is_empty() {
        return refuse("a field with nested boxes", "fields of one box to merge");
    }
    if field.scene.activation.order != ActivationOrder::Raw {
        return refuse("densities that are interpolated after their activation", "raw densities");
    }
    if field.scene.march.voxel.is_some() {
        return refuse("steps whose length depends on the direction", "steps of one length");
    }
    Ok(())
}

/// The meaning of a field's colour channels.
type Color = (ColorDomain, Option<ViewDependence>);

/// The common meaning of both fields' colours, with the higher degree of harmonics.
fn merged_view(own: &Color, other: &Color) -> Result<Option<ViewDependence>> {
    if own == other {
        return Ok(own.1.clone());
    }
    let found = match (&own.1, &other.1) {
        (Some(ViewDependence::Harmonics(a)), Some(ViewDependence::Harmonics(b))) => {
            let degree = a.degree.max(b.degree);
            let [a, b] = [a, b].map(|rule| Harmonics { degree, ..*rule });
            if a == b {
                return Ok(Some(ViewDependence::Harmonics(a)));
            }
            "harmonics by another rule"
        }
        (_, Some(ViewDependence::Harmonics(_))) => "harmonics",
        (_, Some(ViewDependence::Network(_))) => "another network, or the same after a rotation",
        (_, None) if own.0 != other.0 => "colours in another domain",
        (_, None) => "no view dependence",
    };
    let place = Place::Key("view dependence".to_owned());
    Err(Error::unsupported(place, found, "that of the first scene").advise(ATTACH))
}

/// The grid, extended by nodes of the same distance until it contains the other boxes.
fn extended(own: &Lattice, others: &[RadianceField], limits: &Limits) -> Result<Lattice> {
    let mut lattice = *own;
    let (extent, mut sizes) = (own.bounds.extent(), [0; 3]);
    for axis in 0..3 {
        let voxel = extent[axis] / (own.nodes.0[axis] - 1) as f64;
        let [min, max] = [own.bounds.min[axis], own.bounds.max[axis]].map(f64::from);
        let low = others.iter().map(|field| f64::from(field.scene.bounds.min[axis]));
        let high = others.iter().map(|field| f64::from(field.scene.bounds.max[axis]));
        let voxels = |length: f64| (length / voxel - COINCIDENT).ceil().max(0.0);
        let below = voxels(min - low.fold(min, f64::min));
        let above = voxels(high.fold(max, f64::max) - max);
        lattice.bounds.min[axis] = (min - below * voxel) as f32;
        lattice.bounds.max[axis] = (max + above * voxel) as f32;
        sizes[axis] = ((below + above) as u64).saturating_add(own.nodes.0[axis] as u64);
    }
    let place = Place::Key("nodes of the merged field".to_owned());
    lattice.nodes = Nodes::checked(sizes, limits, &place)?;
    lattice.bounds.check(&place)?;
    Ok(lattice)
}
