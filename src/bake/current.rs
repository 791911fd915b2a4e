//! Whether a container that is there already is what a bake would write.
//!
//! Provenance says what a container was made from: tool and version, the input's digest, options,
//! what was assumed. The rest of what decides its bytes, settings of the scene, is in its metadata.
//! Where all that is as it would be, and the container is whole, a bake would write the same bytes
//! again.

use serde_json::Value;

use super::{BakeOptions, Origin};
use crate::base::error::Result;
use crate::codec::container::Container;
use crate::model::field::RadianceField;
use crate::model::view_mlp::ViewMlp;

/// Whether `container` is what [`super::bake`] would write of `field`. Never so where the input's
/// digest says nothing of its values, as in formats without checksums.
///
/// # Errors
///
/// Reading what is there may fail; damage is no error, but a container that is not current.
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
    let widths = metadata.view.as_ref().map(|view| view.widths.clone());
    Ok(expected.is_some()
        && container.provenance()? == expected
        && metadata.bounds == scene.bounds
        && metadata.activation == scene.activation
        && metadata.march == scene.march
        && metadata.background == scene.background
        && widths == field.view_mlp.as_ref().map(ViewMlp::widths))
}
