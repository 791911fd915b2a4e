//! Opens a tree as a field, and as a model with its own rules.

use std::fmt::Debug;
use std::sync::{Arc, Mutex};

use super::basis::Basis;
use super::keys::Arrays;
use super::model::TreeFile;
use super::tree::Tree;
use crate::base::error::{Place, Result};
use crate::base::limits::Limits;
use crate::base::lock::lock;
use crate::model::field::{Activation, ColorDomain, Grid, March, RadianceField, Scene};
use crate::model::grid::Nodes;
use crate::model::harmonics::{Clamp, Evaluation, Harmonics};
use crate::model::view_dependence::ViewDependence;
use crate::options::{SourceOptions, ViewChoice};
use crate::source::{Assumption, Family, Source};
use crate::sparse::{CellBox, Channel, Index, PlaneRows, RowArray, RowGrid};
use crate::tensor::TensorFile;

/// Step length in voxels of the resampled field.
const STEPSIZE: f32 = 0.5;

/// Opens a tree. Leaves stay in the file.
///
/// # Errors
/// `Unsupported` for other functions and nodes of more than eight cells, `Malformed` for
/// inconsistent arrays and invalid children.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    let arrays = Arc::new(Arrays::find(file, limits)?);
    let mut assumptions = Vec::new();
    if let Basis::Colors { logits } = arrays.basis {
        let (value, other) = match logits {
            true => (
                "logits",
                "volrend shows the numbers unchanged, svox applies the logistic function",
            ),
            false => ("colours", "svox would apply the logistic function"),
        };
        assumptions.push(Assumption {
            key: "data_format",
            value: value.to_owned(),
            message: format!("RGBA leaves of this kind of file are taken as {value}: {other}"),
        });
    }
    let place = Place::Tensor("child".to_owned());
    let cells = Nodes([arrays.tree.side(); 3]);
    let cells = CellBox { radius: arrays.radius, center: arrays.center, cells };
    let leaves = Leaves {
        tree: Arc::clone(&arrays.tree),
        rows: Arc::clone(&arrays.rows),
        full: Mutex::default(),
    };
    Nodes::checked(cells.cells.0.map(|side| side as u64), limits, &place)?;
    let index = Arc::new(Index::other(cells.cells, arrays.rows.rows(), Box::new(leaves), &place)?);
    let (stored, density) = (arrays.basis.functions(), arrays.rows.width() - 1);
    let (channels, color_domain, view) = colors(&arrays.basis, options.view);
    let unchecked = match file.has_checksums {
        true => Vec::new(),
        false => vec![Arc::clone(&arrays.rows)],
    };
    let grid = |channels| RowGrid::new(&index, &arrays.rows, channels, 1, unchecked.clone());
    let (stepsize, voxel_size) = (options.stepsize.unwrap_or(STEPSIZE), cells.voxel_size());
    let march = March {
        color_threshold: options.color_threshold.unwrap_or(0.0),
        sampled: Some(cells.faces()),
        ..March::new(stepsize, voxel_size)
    };
    #[expect(clippy::cast_possible_truncation, reason = "a field's settings are float32")]
    let interval = (f64::from(stepsize * voxel_size) / arrays.unit) as f32;
    let key = |name: &str| Place::Key(name.to_owned());
    let field = RadianceField {
        scene: Scene {
            bounds: cells.bounds(["invradius3", "offset"].map(key).each_ref())?,
            nodes: cells.nodes(),
            activation: Activation::relu(interval),
            march,
            background: options.background.unwrap_or([1.0; 3]),
        },
        density: Grid::Values(Arc::new(grid(vec![Channel::column(density)]))),
        color: vec![Grid::Values(Arc::new(grid(channels).dilated()))],
        color_domain,
        view,
        free_space: None,
        shells: Vec::new(),
    };
    field.check()?;
    let degree = field.harmonics().map_or(0, |rules| rules.degree);
    let functions = match (&arrays.basis, options.view) {
        (Basis::Harmonics(_), ViewChoice::Harmonics(_) | ViewChoice::None) => (degree + 1).pow(2),
        _ => stored,
    };
    Ok(Source {
        field,
        model: Some(Arc::new(TreeFile { arrays, functions })),
        family: Family::PlenOctree,
        kind: file.kind,
        has_checksums: file.has_checksums,
        is_unbounded: false,
        scene_scale: 1.0,
        assumptions,
        recorded: Vec::new(),
        digest: file.digest,
        file: Arc::clone(&file.file),
        side_files: Vec::new(),
    })
}

/// The field's channels of colour, their meaning, and view dependence.
fn colors(
    basis: &Basis,
    choice: ViewChoice,
) -> (Vec<Channel>, ColorDomain, Option<ViewDependence>) {
    let Some(weights) = basis.harmonics() else {
        let domain = match basis {
            Basis::Colors { logits: true } => ColorDomain::Logit,
            _ => ColorDomain::Linear,
        };
        return ((0..3).map(Channel::column).collect(), domain, None);
    };
    let most = weights.len().isqrt() - 1;
    let degree = match choice {
        ViewChoice::Keep => most,
        ViewChoice::Harmonics(wanted) => most.min(wanted),
        ViewChoice::None => 0,
    };
    let (evaluation, clamp) = (Evaluation::Sample, Clamp::Sigmoid);
    let rules = Harmonics { degree, evaluation, offset: 0.0, clamp };
    let kept = weights.get(..rules.functions()).unwrap_or_default();
    let channels = Channel::of_weights(0, basis.functions(), kept);
    match choice {
        ViewChoice::None => (Channel::of_band_0(channels, rules), ColorDomain::Linear, None),
        _ => (channels, ColorDomain::Linear, Some(ViewDependence::Harmonics(rules))),
    }
}

/// The leaves of the deepest level's cells; those of density 0 have no row.
struct Leaves {
    tree: Arc<Tree>,
    rows: Arc<RowArray>,
    /// For each cell, true if it is a leaf with density; computed on first use.
    full: Mutex<Option<Arc<[bool]>>>,
}

impl Debug for Leaves {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "Leaves of {} cells", self.tree.cells())
    }
}

impl Leaves {
    fn full(&self) -> Result<Arc<[bool]>> {
        let mut kept = lock(&self.full);
        if let Some(full) = &*kept {
            return Ok(Arc::clone(full));
        }
        let mut full = Vec::with_capacity(self.tree.cells());
        self.rows.column(self.rows.width() - 1, |densities| {
            // NaN densities are reported when they are read.
            full.extend(densities.iter().map(|&density| density > 0.0 || density.is_nan()));
        })?;
        let full: Arc<[bool]> = full.into();
        *kept = Some(Arc::clone(&full));
        Ok(full)
    }
}

impl PlaneRows for Leaves {
    fn fill(&self, x: usize, rows: &mut [u32]) -> Result<()> {
        let full = self.full()?;
        let side = self.tree.side();
        self.tree.plane(x, |cell, [y, z], size| {
            if !full.get(cell).copied().unwrap_or(false) {
                return;
            }
            let row = u32::try_from(cell).unwrap_or(u32::MAX);
            for y in y..y + size {
                if let Some(nodes) = rows.get_mut(y * side + z..y * side + z + size) {
                    nodes.fill(row);
                }
            }
        });
        Ok(())
    }

    fn memory_bytes(&self) -> u64 {
        self.tree.memory_bytes() + self.tree.cells() as u64
    }
}
