//! Other scenes that are merged into the input of a bake.

use std::path::PathBuf;

use super::super::common::Common;
use super::super::outcome::{assumed, warn};
use super::arguments::{Arguments, Content};
use crate::bake::BakeOptions;
use crate::base::error::{Error, Place, Result};
use crate::model::field::RadianceField;
use mipvog_inputs::SideFile;

/// Voxels of another scene that are smaller than this share of the first one's cause a warning.
const FINER: f64 = 0.9;

/// A field with the scenes of `--merge`, and their files.
pub struct WithOthers {
    pub field: RadianceField,
    pub files: Vec<SideFile>,
    /// Other files that settings of those scenes came from.
    pub settings: Vec<PathBuf>,
    /// True if the digests of all files cover their values.
    pub have_checksums: bool,
}

/// Merges the scenes of `--merge` into a field; none without that option.
///
/// # Errors
///
/// Errors of opening them, and incompatible scenes, with the file of the first such scene.
pub fn with_others(
    field: &RadianceField,
    arguments: &Arguments,
    options: &BakeOptions,
    common: &Common,
) -> Result<Option<WithOthers>> {
    if arguments.merge.is_empty() {
        return Ok(None);
    }
    let mut fields = vec![field.clone()];
    let (mut files, mut settings, mut have_checksums) = (Vec::new(), Vec::new(), true);
    for path in &arguments.merge {
        let (other, digest) = match arguments.open_file(path, &options.limits)?.content {
            Content::Stored(unpacked) => {
                // A container's digest covers its values; dense arrays may have been edited since.
                have_checksums &= unpacked.content.is_none();
                let field = unpacked.field(&options.limits).map_err(|error| error.in_file(path))?;
                let field = field.ok_or_else(|| {
                    let (found, expected) = ("no densities of level 0", "some, to merge");
                    Error::malformed(Place::File, found, expected).in_file(path)
                })?;
                (field, unpacked.digest)
            }
            Content::Trained(file) => {
                let found = arguments.scene.settings(path, None, &options.limits)?;
                let source = mipvog_inputs::open_tensors(&file, &found.options, &options.limits)?;
                for assumption in &source.assumptions {
                    warn(&assumed(&assumption.message), common);
                }
                have_checksums &= source.origin().covers_values;
                settings.extend(found.files);
                settings.extend(source.side_files.iter().map(|file| file.path.clone()));
                (source.field, source.digest)
            }
        };
        fields.push(other);
        // Each scene is tried separately, so that an error names its file.
        let tried = [&fields[..1], &fields[fields.len() - 1..]].concat();
        RadianceField::merge(&tried, &options.limits).map_err(|error| error.in_file(path))?;
        warn_of_finer(&fields, path, common);
        let path = mipvog_inputs::file_of(path);
        files.push(SideFile { role: "merged", path, digest });
    }
    let field = RadianceField::merge(&fields, &options.limits)?;
    Ok(Some(WithOthers { field, files, settings, have_checksums }))
}

/// Warns where the voxels of the last field are smaller than those of the first.
fn warn_of_finer(fields: &[RadianceField], path: &std::path::Path, common: &Common) {
    let voxel = |field: &RadianceField| field.scene.march.voxel_size;
    let [Some(first), Some(last)] = [fields.first(), fields.last()].map(|field| field.map(voxel))
    else {
        return;
    };
    if f64::from(last) < FINER * f64::from(first) {
        let path = path.display();
        warn(
            &format!(
                "{path} has smaller voxels ({last} units) than the first input ({first}), \
                 whose grid the merged scene gets: name the finest input first to keep its detail"
            ),
            common,
        );
    }
}
