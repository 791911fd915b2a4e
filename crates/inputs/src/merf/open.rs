//! Opens a folder's core.

use std::sync::Arc;

use super::parameters::{KEYS, LOW, Parameters};
use super::sums::Assets;
use super::whole::WholeModel;
use super::world::{MerfWorld, sampled};
use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::folder::{self, Folder, Found, InputOrder};
use crate::model::field::Shell;
use crate::model::view_mlp::ViewMlp;
use crate::nested::{self, Middle};
use crate::options::SourceOptions;
use crate::source::{Family, Source};
use crate::tensor::{FileKind, TensorFile};

/// True for the parameters of MERF's folders.
pub fn knows(file: &TensorFile) -> bool {
    let stated = |key: &str| file.root.get(key).is_some_and(|value| !value.is_none());
    file.kind == FileKind::Folder && KEYS.iter().any(|key| stated(key))
}

/// Opens a folder: reads its parameters, checks its pictures, and reads the index picture.
///
/// # Errors
/// `Unsupported` for SMERF; `Malformed` if
/// numbers and pictures do not fit each other; `Io` if a picture is missing.
pub fn open_tensors(file: &TensorFile, options: &SourceOptions, limits: &Limits) -> Result<Source> {
    let family = Family::Merf;
    folder::refuse_other_views(family.name(), options)?;
    let parameters = Parameters::read(file, limits)?;
    let stored = folder::read_network(file, InputOrder::ValuesFirst, &mut Budget::new(limits))?;
    let network = stored.filter(|_| !folder::drops_network(options));
    let place = Place::Key("resolution".to_owned());
    let scene = folder::scene(&parameters.cells(), options, &place)?;
    let (assets, side_files) = Assets::find(Folder::of(file.file.path()), parameters, limits)?;
    let assets = Arc::new(assets);
    let own = (Arc::clone(&assets), network.clone());
    let core = folder::source(file, Found { family, scene, assets, network, side_files })?;
    match (options.drop_background, own) {
        (true, _) => Ok(core),
        (false, (assets, network)) => whole(core, assets, network, options, limits),
    }
}

/// Nodes along an edge of the first box up to which it gets a third more than the model has. Around
/// the core, a model interpolates before it activates, and boxes afterwards: at the model's own nodes,
/// pictures are 3 dB farther away.
const SMALL: usize = 257;

/// All of space, in nested boxes.
fn whole(
    mut source: Source,
    assets: Arc<Assets>,
    network: Option<ViewMlp>,
    options: &SourceOptions,
    limits: &Limits,
) -> Result<Source> {
    let voxel = assets.parameters.voxel_size();
    let middle = Middle { center: [0.0; 3], radius: [1.0; 3] };
    // The last voxel of contracted space begins there.
    let extent = options.extent.map_or(1.0 / voxel, f64::from);
    let first = match options.resolution {
        Some(nodes) => nested::even(middle, nodes, extent),
        None => {
            let own = nested::aligned(middle, [LOW + 0.5 * voxel; 3], [voxel; 3], extent);
            let [nodes, ..] = own.nodes.0;
            if nodes > SMALL { own } else { nested::even(middle, nodes * 4 / 3, extent) }
        }
    };
    let place = Place::Key("resolution".to_owned());
    let lattices = nested::boxes(first, middle, extent, limits, &place)?;
    let channels = source.field.color_channels();
    let field = &mut source.field;
    let scene = &mut field.scene;
    (scene.bounds, scene.nodes) = (first.bounds, first.nodes);
    scene.march.sampled = None;
    scene.march.check(scene.nodes)?;
    let world = Arc::new(MerfWorld(Arc::clone(&assets)));
    let mut boxes = lattices.into_iter().map(|lattice| sampled(&world, lattice, scene, channels));
    if let Some(Shell { density, color, .. }) = boxes.next() {
        (field.density, field.color) = (density, color);
    }
    let shells = boxes.collect();
    field.shells = shells;
    field.check()?;
    source.is_unbounded = true;
    source.model = Some(Arc::new(WholeModel { assets, network }));
    Ok(source)
}
