//! The format `vdb`.

use std::path::Path;

use serde_json::{Map, Value, json};

use super::file::{GridPlan, write_file};
use super::metadata::MetaValue;
use super::read_back::{points_of, read_points};
use super::tree::GridContent;
use crate::base::bytes::Output;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::base::progress::{Progress, Step};
use crate::export_files::{ExportFiles, WrittenFiles};
use crate::format::{ExportFormat, ExportOptions, ExportSource, Exported, Shown, UpAxis};
use crate::view::render::Renderer;
use crate::volume::{Leaf, POINTS, SparseVolume, VolumeModel, lattice, lost, volume};

/// Maximum relative difference of a cube's edges, as in OpenVDB's float64 comparison.
const ROUNDING: f64 = 1e-9;
/// Points for each node along an axis.
const FACTOR: usize = 2;
/// Volume of a voxel, in world units, below which OpenVDB's readers refuse a transform as singular
/// (`isApproxEqual` of its determinant and 0).
const SINGULAR: f64 = 1e-15;
/// The largest half float.
const LARGEST_HALF: f32 = 65_504.0;

/// One file of OpenVDB.
#[derive(Debug)]
pub struct Vdb;

impl ExportFormat for Vdb {
    fn name(&self) -> &'static str {
        "vdb"
    }

    fn options(&self) -> &'static [&'static str] {
        &["supersample", "resolution", "crop", "up", "float32", "normalize_density", "features"]
    }

    fn check(&self, source: &ExportSource, options: &ExportOptions, output: &Path) -> Result<()> {
        if output.extension().is_none_or(|extension| extension != "vdb") {
            let output = output.display();
            return Err(Error::usage(format!(
                "-o {output}: the name of an OpenVDB file must end in .vdb"
            )));
        }
        check_volume(source, options)
    }

    fn write(
        &self,
        source: &ExportSource,
        options: &ExportOptions,
        files: &mut ExportFiles,
        progress: &dyn Progress,
    ) -> Result<Exported> {
        let path = files.output().to_owned();
        let output = files.create(path)?;
        write_volume(source, options, output, progress).map(|(exported, _)| exported)
    }

    fn read_back(
        &self,
        source: &ExportSource,
        files: &WrittenFiles,
        limits: &Limits,
    ) -> Result<Box<dyn Shown>> {
        let points = points_of(read_points(files, limits)?, limits)?;
        let model = VolumeModel::new(points, limits)?;
        Ok(Box::new(Renderer::with_view(source.field.view(), Box::new(model))))
    }
}

/// Refuses volumes with too many points.
///
/// # Errors
/// Options out of range, more points than the limits allow, and voxels too small for readers.
pub fn check_volume(source: &ExportSource, options: &ExportOptions) -> Result<()> {
    if options.features && source.field.view().features == 0 {
        let message = "--features: the field has no features, and no harmonics beyond band 0";
        return Err(Error::usage(message));
    }
    let spacing = lattice(source, options, FACTOR)?.spacing;
    if spacing.into_iter().product::<f64>() > SINGULAR {
        return Ok(());
    }
    let found = format!("points {spacing:?} apart");
    let expected = "a larger box: OpenVDB treats voxels this small as zero";
    Err(Error::unsupported(Place::File, found, expected))
}

/// Writes density and colours into a file.
///
/// # Errors
/// As [`SparseVolume::new`], and those of writing.
pub fn write_volume(
    source: &ExportSource,
    options: &ExportOptions,
    output: &mut Output,
    progress: &dyn Progress,
) -> Result<(Exported, SparseVolume)> {
    let volume = volume(source, options, lattice(source, options, FACTOR)?, true, progress)?;
    let half = !options.float32;
    let largest = volume.largest_density();
    let scale = if options.normalize_density && largest > 0.0 { largest } else { 1.0 };
    let density = |leaf: &Leaf, point: usize| [leaf.density[point] / scale, 0.0, 0.0];
    let color = |leaf: &Leaf, point: usize| leaf.color[point];
    let occupied = |leaf: &Leaf| leaf.occupied;
    let colored = |leaf: &Leaf| leaf.colored;
    let features: Vec<_> = (0..volume.features)
        .map(|channel| {
            move |leaf: &Leaf, point: usize| [leaf.features[channel * POINTS + point], 0.0, 0.0]
        })
        .collect();
    let mut density_metadata = Vec::new();
    if options.normalize_density {
        density_metadata.push(("mipvog_density_scale", MetaValue::Float(scale)));
    }
    let mut grids = vec![
        GridPlan {
            name: "density".to_owned(),
            class: "fog volume",
            content: GridContent { width: 1, half, active: &occupied, value: &density },
            metadata: density_metadata,
        },
        GridPlan {
            name: "Cd".to_owned(),
            class: "unknown",
            content: GridContent { width: 3, half, active: &colored, value: &color },
            metadata: vec![("vector_type", MetaValue::Text("invariant".to_owned()))],
        },
    ];
    for (channel, value) in features.iter().enumerate() {
        grids.push(GridPlan {
            name: format!("feature_{channel}"),
            class: "unknown",
            content: GridContent { width: 1, half, active: &occupied, value },
            metadata: Vec::new(),
        });
    }
    progress.begin(Step::Write, 1);
    let texts = provenance(source, options, &volume);
    let counts = write_file(output, &volume, options.up, texts, &grids, progress)?;
    progress.advance(Step::Write, 1);
    let mut lost = lost(source, options);
    if options.supersample.is_none() {
        let fewer = match options.resolution {
            None => "--supersample 4",
            Some(_) => "a higher --resolution",
        };
        lost.push(format!("clean surfaces at grazing angles: specks, fewer with {fewer}"));
    }
    if half {
        lost.push("precision: values are half floats; --float32 keeps it".to_owned());
    }
    if half && largest / scale > LARGEST_HALF {
        lost.push(format!("densities above {LARGEST_HALF}, the largest half float"));
    }
    if !is_cubic(volume.lattice.spacing) {
        lost.push(
            "cubic voxels, which Unreal and some others require; --resolution makes them"
                .to_owned(),
        );
    }
    let mut details = Map::new();
    let mut tell = |name: &str, value: Value| details.insert(name.to_owned(), value);
    tell("dims", json!(volume.lattice.counts()));
    tell("spacing", json!(volume.lattice.spacing));
    tell("voxels", json!(counts.first()));
    tell("leaves", json!(volume.leaves.len()));
    tell("largest_density", json!(largest));
    tell("density_scale", json!(scale));
    drop(grids);
    Ok((Exported { lost, details }, volume))
}

/// True for cubic voxels, by OpenVDB's test (`hasUniformVoxels`).
fn is_cubic(spacing: [f64; 3]) -> bool {
    let [x, y, z] = spacing;
    (x - y).abs() <= ROUNDING * x && (y - z).abs() <= ROUNDING * x
}

/// The provenance in the file.
fn provenance(
    source: &ExportSource,
    options: &ExportOptions,
    volume: &SparseVolume,
) -> Vec<(&'static str, MetaValue)> {
    let text = |text: &str| MetaValue::Text(text.to_owned());
    let has_view = source.field.view().view_dependence.is_some() || source.field.is_model();
    let color = if has_view { "mean over directions" } else { "diffuse" };
    let settings = json!({
        "level": options.level,
        "supersample": options.supersample,
        "resolution": options.resolution,
        "crop": options.crop.map(|crop| [crop.min, crop.max]),
        "points": volume.lattice.counts(),
    });
    let up = if options.up == UpAxis::Y { "y" } else { "z" };
    vec![
        ("creator", text(concat!("mipvog-bake ", env!("CARGO_PKG_VERSION")))),
        ("mipvog_color", text(color)),
        ("mipvog_settings", MetaValue::Text(settings.to_string())),
        ("mipvog_source", text(&source.name)),
        ("mipvog_source_sha256", text(&source.sha256)),
        ("mipvog_up", text(up)),
    ]
}
