//! Tests whether an existing container is the one that a bake would write.
//!
//! Provenance states a container's origin: tool and version, the input's digest, options,
//! assumptions. Settings of the scene, which also decide its bytes, are in its metadata. If all of
//! them are the same and the container is whole, a bake would write the same bytes again.

use serde_json::Value;

use super::{BakeOptions, Origin};
use crate::base::error::Result;
use crate::container::Container;
use crate::model::baked::ViewMetadata;
use crate::model::field::RadianceField;

/// True if `container` is the one that [`super::bake`] would write of `field`. Always false if the
/// input's digest does not cover its values, as in formats without checksums.
///
/// # Errors
///
/// Reading the container may fail. Damage is not an error: a damaged container is not current.
pub fn is_current(
    container: &Container,
    field: &RadianceField,
    options: &BakeOptions,
    origin: &Origin,
) -> Result<bool> {
    if !origin.covers_values || container.verify().is_err() {
        return Ok(false);
    }
    let expected = origin.provenance(&origin.digest, options.to_json());
    // As it reads once it is written.
    let expected: Option<Value> = serde_json::from_str(&expected.to_string()).ok();
    let metadata = container.metadata();
    let scene = &field.scene;
    Ok(expected.is_some()
        && container.provenance()? == expected
        && metadata.bounds == scene.bounds
        && metadata.activation == scene.activation
        && metadata.march == scene.march
        && metadata.background == scene.background
        && metadata.view == field.view.as_ref().map(ViewMetadata::of))
}
