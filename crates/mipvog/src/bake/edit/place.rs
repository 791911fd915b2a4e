//! A container at another place: rotated, scaled and moved, in this order.
//!
//! * **Rotation** by multiples of 90 degrees maps nodes to nodes. The mask, the network's first
//!   layer and everything else that depends on the view direction turn with the field. Coefficients
//!   of such functions are no longer codes of their encodings, so they get new encodings of as many
//!   bits.
//! * **Scale and translation** change lengths and positions. No value of a node changes: opacity is
//!   over an interval, which is counted in voxels.

use serde_json::{Value, json};

use crate::bake::ranges::{EncodingChoice, RangeSink};
use crate::bake::unpacked_levels::UnpackedLevels;
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::model::baked::Metadata;
use crate::model::field::{FreeSpace, Lookup};
use crate::model::grid::{Bounds, NodeMask, Nodes};
use crate::model::view_mlp::ViewMlp;
use crate::unpacked::{Rotation, Unpacked};

/// Tolerance of a face's position, as a share of a voxel.
const LARGEST_ROUNDING: f64 = 1e-2;

/// Roundings to f32 of sums of coefficients may move a colour or an opacity by this much.
const SUM_ROUNDING: f64 = 1e-6;

/// A placement: moves a point `p` to `scale * R p + translate`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Quarter turns about the x axis, then y, then z, counterclockwise for a viewer whom the axis
    /// points at. The axes do not turn.
    pub quarter_turns: [i32; 3],
    /// Scale about the origin, above 0.
    pub scale: f32,
    /// Translation in world units.
    pub translate: [f32; 3],
}

impl Default for Placement {
    /// No change.
    fn default() -> Self {
        Self { quarter_turns: [0; 3], scale: 1.0, translate: [0.0; 3] }
    }
}

impl Placement {
    /// The rotation.
    pub fn rotation(&self) -> Rotation {
        Rotation::of_quarter_turns(self.quarter_turns)
    }

    /// True if it rotates anything.
    pub fn rotates(&self) -> bool {
        self.rotation() != Rotation::NONE
    }

    /// True if it scales or translates anything.
    fn moves(&self) -> bool {
        self.scale != 1.0 || self.translate != [0.0; 3]
    }

    /// True if nothing changes its place.
    pub fn is_identity(&self) -> bool {
        !self.rotates() && !self.moves()
    }

    /// The numbers that have an effect, as named in provenance and reports.
    pub(in crate::bake) fn add_to_json(&self, changes: &mut Value) {
        if self.rotates() {
            changes["rotate"] = json!(self.quarter_turns.map(|turns| 90 * turns.rem_euclid(4)));
        }
        if self.scale != 1.0 {
            changes["scale"] = json!(self.scale);
        }
        if self.translate != [0.0; 3] {
            changes["translate"] = json!(self.translate);
        }
    }

    /// Checks that the numbers are in their ranges.
    ///
    /// # Errors
    ///
    /// [`crate::base::error::ErrorKind::InvalidOption`].
    pub(in crate::bake) fn check(&self) -> Result<()> {
        let fits = self.scale.is_finite() && self.scale > 0.0;
        Error::require_option(fits, "scale", self.scale, "a number above 0")?;
        let fits = self.translate.iter().all(|number| number.is_finite());
        let found = format!("{:?}", self.translate);
        Error::require_option(fits, "translate", found, "three numbers, in world units")
    }
}

/// Puts a container at another place.
///
/// # Errors
///
/// [`crate::base::error::ErrorKind::InvalidOption`] if f32 coordinates cannot represent the place;
/// errors of reading values.
pub fn place(
    unpacked: &mut Unpacked,
    placement: &Placement,
    progress: &dyn Progress,
) -> Result<()> {
    if placement.rotates() {
        rotate(unpacked, placement.rotation(), progress)?;
    }
    if placement.moves() {
        move_metadata(&mut unpacked.metadata, placement)?;
        unpacked.free_space.as_mut().map_or(Ok(()), |mask| move_mask(mask, placement))?;
    }
    Ok(())
}

/// Scales and moves everything that metadata states.
fn move_metadata(metadata: &mut Metadata, placement: &Placement) -> Result<()> {
    let (scale, translate) = (placement.scale, placement.translate);
    for (own, nodes) in boxes(metadata) {
        *own = moved(own, nodes, placement)?;
    }
    let march = &mut metadata.march;
    if let Some(sampled) = &mut march.sampled {
        // Rounded as the corners of the box that it lies in are.
        let corner =
            |at: [f32; 3]| [0, 1, 2].map(|axis| at_place(at[axis], scale, translate[axis]));
        *sampled = Bounds { min: corner(sampled.min), max: corner(sampled.max) };
    }
    march.near *= scale;
    march.far = march.far.map(|far| far * scale);
    march.voxel_size *= scale;
    march.voxel.iter_mut().flatten().for_each(|edge| *edge *= scale);
    let far = march.far.unwrap_or(march.voxel_size);
    let lengths = march.voxel.into_iter().flatten().chain([march.voxel_size, far]);
    let fits = lengths.into_iter().all(f32::is_normal) && march.near.is_finite();
    Error::require_option(fits, "scale", scale, "one that leaves lengths which f32 can hold")
}

/// The box of level 0 and those of shells, with the nodes along their axes.
fn boxes(metadata: &mut Metadata) -> impl Iterator<Item = (&mut Bounds, [usize; 3])> {
    let finest = metadata.levels.first().map_or([2; 3], |level| level.dimensions);
    let shells = metadata.shells.iter_mut();
    let shells = shells.filter_map(|shell| Some((shell.bounds.as_mut()?, shell.dimensions)));
    std::iter::once((&mut metadata.bounds, finest)).chain(shells)
}

fn at_place(at: f32, scale: f32, translate: f32) -> f32 {
    (f64::from(at) * f64::from(scale) + f64::from(translate)) as f32
}

/// A box of this many nodes, scaled and moved.
fn moved(bounds: &Bounds, nodes: [usize; 3], placement: &Placement) -> Result<Bounds> {
    let mut moved = *bounds;
    for axis in 0..3 {
        let (scale, translate) = (placement.scale, placement.translate[axis]);
        let voxel = bounds.extent()[axis] * f64::from(scale) / (nodes[axis] - 1) as f64;
        for corner in [&mut moved.min, &mut moved.max] {
            let exact = f64::from(corner[axis]) * f64::from(scale) + f64::from(translate);
            corner[axis] = at_place(corner[axis], scale, translate);
            let error = (f64::from(corner[axis]) - exact).abs();
            // A NaN is no place either.
            if !(error <= LARGEST_ROUNDING * voxel && exact.abs() <= Bounds::FARTHEST) {
                let found = format!("{translate} along axis {}", ["x", "y", "z"][axis]);
                let expected = format!(
                    "a place where f32 coordinates, as containers state them, resolve voxels of \
                     {voxel:e} units, within {:e} of the origin",
                    Bounds::FARTHEST
                );
                let option = if translate == 0.0 { "scale" } else { "translate" };
                return Err(Error::invalid_option(option, found, expected));
            }
        }
    }
    Ok(moved)
}

/// Moves a mask: a position `p` before is `scale * p + translate` now.
fn move_mask(mask: &mut FreeSpace, placement: &Placement) -> Result<()> {
    for axis in 0..3 {
        mask.scale[axis] /= f64::from(placement.scale);
        mask.shift[axis] -= f64::from(placement.translate[axis]) * mask.scale[axis];
    }
    let fits = mask.scale.iter().chain(&mask.shift).all(|number| number.is_finite());
    Error::require_option(fits, "scale", placement.scale, "one that the free-space mask can state")
}

/// Rotates levels, boxes, mask and network about the origin.
fn rotate(unpacked: &mut Unpacked, rotation: Rotation, progress: &dyn Progress) -> Result<()> {
    let levels = std::mem::take(&mut unpacked.levels).into_iter();
    unpacked.levels = levels.map(|level| level.rotated(rotation)).collect::<Result<_>>()?;
    let metadata = &mut unpacked.metadata;
    for (part, level) in metadata.parts_mut().zip(&unpacked.levels) {
        part.dimensions = rotation.lengths(part.dimensions);
        part.bounds = part.bounds.map(|bounds| rotation.bounds(&bounds));
        (part.blocks_stored, part.blocks_filled) = (level.table.frames(), level.table.inherited());
    }
    metadata.bounds = rotation.bounds(&metadata.bounds);
    metadata.march.sampled = metadata.march.sampled.map(|sampled| rotation.bounds(&sampled));
    metadata.march.voxel = metadata.march.voxel.map(|edges| rotation.lengths(edges));
    unpacked.free_space.iter_mut().for_each(|mask| *mask = rotated_mask(mask, rotation));
    unpacked.view_mlp.iter_mut().for_each(|network| rotate_network(network, rotation));
    lay_directional(unpacked, progress)
}

/// Gives new encodings to coefficients of functions of the direction, which are no longer codes.
fn lay_directional(unpacked: &mut Unpacked, progress: &dyn Progress) -> Result<()> {
    let metadata = &mut unpacked.metadata;
    let mut laid = metadata.clone();
    // Other groups are neither read nor encoded anew.
    for part in laid.parts_mut() {
        (part.diffuse, part.features) = (None, None);
    }
    let has_any =
        laid.parts_mut().any(|part| part.encodings_mut().any(|(group, _)| group.is_directional()));
    if !has_any {
        return Ok(());
    }
    let counted: Vec<NodeMask> =
        unpacked.levels.iter().map(|level| level.counted_nodes()).collect::<Result<_>>()?;
    let source = UnpackedLevels { levels: &unpacked.levels, metadata: &laid.clone() };
    let choice = EncodingChoice::Directional;
    let counted: Vec<&NodeMask> = counted.iter().collect();
    let (sink, _) = RangeSink::read(&laid, &counted, choice, &source, progress)?;
    sink.choose_encodings(choice, &mut laid)?;
    for (part, laid) in metadata.parts_mut().zip(laid.parts_mut()) {
        for (group, encoding) in laid.encodings_mut().filter(|(group, _)| group.is_directional()) {
            if let Some(own) = part.encoding_mut(group) {
                encoding.max_error = encoding.error_after(f64::from(own.max_error) + SUM_ROUNDING);
                *own = encoding.clone();
            }
        }
    }
    Ok(())
}

/// A mask after a rotation.
fn rotated_mask(mask: &FreeSpace, rotation: Rotation) -> FreeSpace {
    let sizes = rotation.lengths(mask.nodes.0);
    let source = |node: usize| {
        let place = [node / (sizes[1] * sizes[2]), node / sizes[2] % sizes[1], node % sizes[2]];
        let [x, y, z] = rotation.source(sizes, place);
        (x * mask.nodes.0[1] + y) * mask.nodes.0[2] + z
    };
    let all = 0..mask.nodes.count();
    let lookup = match &mask.lookup {
        Lookup::Nearest(inside) => Lookup::Nearest(all.map(|node| inside[source(node)]).collect()),
        Lookup::Trilinear { values, threshold } => Lookup::Trilinear {
            values: all.map(|node| values[source(node)]).collect(),
            threshold: *threshold,
        },
    };
    // Along a flipped axis, position and number of the node both run the other way.
    let shift = [0, 1, 2].map(|axis| {
        let shift = mask.shift[rotation.axes[axis]];
        if rotation.flips[axis] { (sizes[axis] - 1) as f64 - shift } else { shift }
    });
    FreeSpace { nodes: Nodes(sizes), scale: rotation.lengths(mask.scale), shift, lookup }
}

/// Converts a network's input to the direction before the rotation: `d[axes[a]] = ±d'[a]`. Sines of
/// a direction's octaves change their sign with it, cosines do not.
fn rotate_network(network: &mut ViewMlp, rotation: Rotation) {
    let octaves = network.frequencies;
    let Some(layer) = network.layers.first_mut() else { return };
    for weights in layer.weights.chunks_exact_mut(layer.inputs) {
        let before = weights.to_vec();
        for axis in 0..3 {
            let (source, sign) = (rotation.axes[axis], rotation.sign(axis) as f32);
            weights[axis] = sign * before[source];
            for octave in 0..octaves {
                let sine = |axis: usize| 3 + axis * octaves + octave;
                let cosine = |axis: usize| 3 + (3 + axis) * octaves + octave;
                weights[sine(axis)] = sign * before[sine(source)];
                weights[cosine(axis)] = before[cosine(source)];
            }
        }
    }
}
