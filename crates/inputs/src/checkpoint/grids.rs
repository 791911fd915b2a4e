//! The two grids, the box they span, and refused models.

use super::names::NamedValues;
use super::stored::StoredGrid;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::model::grid::Bounds;
use crate::source::{Assumption, Family};

/// Checkpoints of other models that cannot be baked: names of weights (a trailing dot matches a
/// prefix), names of settings, the reason.
const OTHERS: [(&[&str], &[&str], &str); 3] = [
    (&[], &["fourier_freq_num"], "an unbounded scene whose grid holds Fourier coefficients"),
    (&["act_shift.grid"], &["mpi_depth"], "a multiplane scene, whose opacity depends on the plane"),
    (&["density_plane.", "app_plane."], &[], "TensoRF's factors without its settings, kwargs"),
];

/// Refuses models that are not dense grids in a box, interpolated linearly.
pub(super) fn refuse_others(names: &NamedValues<'_>) -> Result<()> {
    let expected = "a dense grid in a box (Mip-VoG or DirectVoxGO)";
    for (weights, settings, reason) in OTHERS {
        let weight = weights.iter().find(|name| match name.strip_suffix('.') {
            Some(_) => names.has_prefix(name),
            None => names.weight(name).is_some(),
        });
        let setting = settings.iter().find(|name| names.setting(name).is_some());
        if let Some(name) = weight.or(setting) {
            let place = Place::Key((*name).to_owned());
            return Err(Error::unsupported(place, reason, expected));
        }
    }
    let key = |name: &str| Place::Key(format!("{}.{name}", super::names::SETTINGS));
    if names.flag("nearest")? {
        let found = "a grid with nearest-neighbour lookup";
        return Err(Error::unsupported(key("nearest"), found, "trilinear interpolation"));
    }
    if names.flag("rgbnet_full_implicit")? {
        let found = "colour from a network that runs at every sample";
        let expected = "colour stored at the nodes";
        return Err(Error::unsupported(key("rgbnet_full_implicit"), found, expected));
    }
    Ok(())
}

/// Finds density and colour, of one size, the colour of at least three channels.
pub(super) fn find(names: &NamedValues<'_>, limits: &Limits) -> Result<(StoredGrid, StoredGrid)> {
    let density = StoredGrid::find(names, "density", limits)?;
    let color = StoredGrid::find(names, "k0", limits)?;
    if density.channels != 1 {
        let found = format!("{} channels of density", density.channels);
        return Err(Error::malformed(Place::Tensor(density.name), found, "one"));
    }
    if color.channels < 3 {
        let found = format!("{} channels of colour", color.channels);
        let expected = "three of diffuse colour, then the features";
        return Err(Error::malformed(Place::Tensor(color.name), found, expected));
    }
    if color.nodes() != density.nodes() {
        let found = format!("{:?} nodes", color.nodes().0);
        let expected = format!("{:?}, as density has", density.nodes().0);
        return Err(Error::malformed(Place::Tensor(color.name), found, expected));
    }
    Ok((density, color))
}

/// The family that wrote a checkpoint. Mip-VoG keeps its low-pass filter and its surface cache
/// with the weights; files that were stripped of both are Mip-VoG's if their colour has its
/// seven channels under the old names.
pub(super) fn family(names: &NamedValues<'_>, channels: usize) -> Family {
    let own = names.has_prefix("lowpass_filter.") || names.has_prefix("surf_cache.");
    let newer = ["density.grid", "density.xy_plane", "mask_cache.mask"];
    let newer = newer.iter().any(|name| names.weight(name).is_some());
    if own || (!newer && channels == 7) { Family::MipVog } else { Family::Dvgo }
}

/// The box that the nodes span.
pub(super) fn bounds(names: &NamedValues<'_>) -> Result<Bounds> {
    let corner = |name: &str| {
        let stored = match names.vector3(name)? {
            Some(corner) => Some(corner),
            None => names.vector3(&format!("density.{name}"))?,
        };
        #[expect(clippy::cast_possible_truncation, reason = "stored as float32")]
        let corner = stored.map(|corner| corner.map(|value| value as f32));
        corner.ok_or_else(|| {
            let expected = "the box of the scene, xyz_min and xyz_max";
            Error::malformed(Place::Key(name.into()), "no such tensor or setting", expected)
        })
    };
    let bounds = Bounds { min: corner("xyz_min")?, max: corner("xyz_max")? };
    bounds.check_model(&Place::Key("xyz_min".into()))?;
    Ok(bounds)
}

/// Keeps only the diffuse channels, if requested or if nothing uses the others.
pub(super) fn drop_features(
    color: &mut StoredGrid,
    asked: bool,
    assumptions: &mut Vec<Assumption>,
) {
    let features = color.channels - 3;
    if features == 0 {
        return;
    }
    color.channels = 3;
    let message = if asked {
        format!(
            "option mlp is none: {features} feature channels and the view-dependent colour are left out"
        )
    } else {
        format!(
            "the checkpoint has {features} feature channels but no network rgbnet to use them: \
             they are left out, and the scene is diffuse; option mlp names another file's network"
        )
    };
    assumptions.push(Assumption { key: "mlp", value: "none".into(), message });
}
