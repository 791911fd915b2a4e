//! Random scenes and cameras for renderers and their reference implementation.

use crate::common;
use crate::common::{Random, grid_values, random_field};
use glam::{DMat4, DVec3};
use mipvog::base::error::Place;
use mipvog::model::baked::{Bends, FootprintNeighbour, LevelOfDetail};
use mipvog::model::camera::{Camera, Lens};
use mipvog::model::field::{
    Activation, ActivationOrder, ColorDomain, FreeSpace, Grid, Lookup, RadianceField,
};
use mipvog::model::grid::{Bounds, Nodes};
use mipvog::model::harmonics::{Clamp, Evaluation, Harmonics};
use mipvog::model::view_dependence::ViewDependence;
use mipvog::model::view_mlp::{Layer, ViewMlp};

pub(super) fn random_network(random: &mut Random, features: usize) -> ViewMlp {
    let frequencies = random.below(5);
    let diffuse = if random.below(2) == 0 || features == 0 { 3 } else { 0 };
    let widths = [3 + 6 * frequencies + diffuse + features, 16, 5, 3];
    let layer = |pair: &[usize]| Layer {
        inputs: pair[0],
        outputs: pair[1],
        weights: (0..pair[0] * pair[1]).map(|_| random.between(-0.5, 0.5)).collect(),
        bias: (0..pair[1]).map(|_| random.between(-1.0, 1.0)).collect(),
    };
    let layers = widths.windows(2).map(layer).collect();
    ViewMlp::new(layers, frequencies, features, &Place::File).expect("widths that join")
}

/// A mask that covers a part of the box, in a box of its own that is a little larger.
fn random_mask(random: &mut Random, bounds: &Bounds) -> FreeSpace {
    let nodes = [0; 3].map(|_: usize| 2 + random.below(6));
    let count: usize = nodes.iter().product();
    let lookup = match random.below(2) {
        0 => Lookup::Nearest((0..count).map(|_| random.below(3) > 0).collect()),
        _ => Lookup::Trilinear {
            values: (0..count).map(|_| random.between(-9.0, 9.0)).collect(),
            threshold: random.between(-4.0, 1.0),
        },
    };
    let (extent, margin) = (bounds.extent(), f64::from(random.between(0.01, 0.3)));
    let scale = [0, 1, 2].map(|a| (nodes[a] - 1) as f64 / ((1.0 + 2.0 * margin) * extent[a]));
    let shift = [0, 1, 2].map(|a| (margin * extent[a] - f64::from(bounds.min[a])) * scale[a]);
    FreeSpace { nodes: Nodes(nodes), scale, shift, lookup }
}

/// A scene with all that a scene can have, chosen by chance.
pub(super) fn random_scene(random: &mut Random) -> RadianceField {
    let nodes = [0; 3].map(|_: usize| [2, 3, 5, 8, 13, 17, 30][random.below(7)]);
    let features = [0, 1, 2, 4, 5, 6][random.below(6)];
    let mut field = random_field(random, nodes, 3 + features);
    let scene = &mut field.scene;
    let low = [0; 3].map(|_: usize| random.between(-2.0, 1.0));
    let size = [0; 3].map(|_: usize| random.between(0.3, 3.0));
    scene.bounds = Bounds { min: low, max: std::array::from_fn(|axis| low[axis] + size[axis]) };
    scene.activation.order =
        [ActivationOrder::Raw, ActivationOrder::Density, ActivationOrder::Opacity][random.below(3)];
    scene.march.stepsize = random.between(0.2, 1.1);
    scene.march.voxel_size = random.between(0.05, 0.3);
    scene.activation.interval = scene.march.stepsize * random.between(0.5, 2.0);
    scene.march.near = [0.0, 0.3][random.below(2)];
    scene.march.far = [None, Some(4.0)][random.below(2)];
    scene.march.color_threshold = [0.0, 1e-4, 1e-2][random.below(3)];
    scene.march.alpha_threshold = [0.0, 0.0, 1e-4, 1e-2][random.below(4)];
    scene.background = [0; 3].map(|_: usize| random.between(0.0, 1.0));
    if random.below(3) == 0 {
        return linear(random, field);
    }
    if random.below(3) > 0 {
        field.view = Some(ViewDependence::Network(random_network(random, features)));
    }
    if random.below(2) == 0 {
        let mask = random_mask(random, &field.scene.bounds);
        field.free_space = Some(mask);
    }
    field
}

/// The same scene with linear colours, harmonics most of the time, and often densities that are no
/// logits.
fn linear(random: &mut Random, scene: RadianceField) -> RadianceField {
    let degree = random.below(4);
    let channels = 3 * (degree + 1) * (degree + 1);
    let mut field = random_field(random, scene.scene.nodes.0, channels);
    // Sums of coefficients are colours.
    let scaled = |grid: &Grid, scale: f32| -> Vec<f32> {
        grid_values(grid).iter().map(|value| value * scale).collect()
    };
    let color = scaled(&field.color[0], 0.04);
    let mut density = grid_values(&field.density);
    let mut activation = scene.scene.activation;
    if random.below(3) > 0 {
        let order = [ActivationOrder::Raw, ActivationOrder::Density][random.below(2)];
        activation = Activation { order, ..Activation::relu(activation.interval) };
        // Levels that average alpha know the light that a nearly opaque node leaves to 3e-8. Where
        // that is 1e-6 of the light, depths are off by percents: such nodes become opaque.
        let depth = |raw: f32| raw * activation.interval;
        for raw in &mut density {
            let nearly_opaque = (2.4..4.0).contains(&depth(*raw));
            *raw = if nearly_opaque { 8.0 / activation.interval } else { raw.max(-3.0) };
        }
    }
    field = common::field(scene.scene.nodes.0, &density, &color);
    field.scene = scene.scene;
    field.scene.activation = activation;
    field.color_domain = ColorDomain::Linear;
    if random.below(2) == 0 {
        let edge = field.scene.march.voxel_size;
        field.scene.march.voxel = Some([0; 3].map(|_: usize| edge * random.between(0.5, 2.0)));
    }
    let clamp = [Clamp::Zero, Clamp::None, Clamp::Sigmoid][random.below(3)];
    let evaluation = match (clamp, random.below(2)) {
        (Clamp::Sigmoid, _) | (_, 0) => Evaluation::Sample,
        _ => Evaluation::Ray,
    };
    if degree > 0 || random.below(2) == 0 {
        let offset = random.between(0.0, 0.6);
        let harmonics = Harmonics { degree, evaluation, offset, clamp };
        field.view = Some(ViewDependence::Harmonics(harmonics));
    }
    field
}

/// Changes of slope, of which rules have some.
const BENDS: [[f32; 2]; 4] = [[-0.6, 0.2], [0.4, 0.3], [1.1, -0.6], [1.9, 0.5]];

pub(super) fn random_rule(random: &mut Random) -> LevelOfDetail {
    LevelOfDetail {
        factor: [0.333, 0.5, 1.0][random.below(3)],
        bias: random.between(-1.0, 1.5),
        neighbour: [FootprintNeighbour::SameIndex, FootprintNeighbour::SameDistance]
            [random.below(2)],
        bound: [None, Some(0.7), Some(4.0)][random.below(3)],
        bends: Bends::new(&BENDS[..random.below(BENDS.len() + 1)]).expect("few"),
    }
}

fn point(bounds: &Bounds, share: [f64; 3]) -> DVec3 {
    let extent = bounds.extent();
    DVec3::from_array([0, 1, 2].map(|a| f64::from(bounds.min[a]) + share[a] * extent[a]))
}

fn lens(random: &mut Random) -> Lens {
    let [width, height] = [[9, 7], [19, 5], [3, 18]][random.below(3)];
    let focal = f64::from(random.between(0.4, 3.0)) * 9.0;
    Lens {
        width,
        height,
        focal: [focal, focal * f64::from(random.between(0.8, 1.25))],
        center: [width as f64 / 2.0, height as f64 / 2.0],
    }
}

/// A camera that looks at a point in the box from around it, or from within.
pub(super) fn random_camera(random: &mut Random, bounds: &Bounds) -> Camera {
    let mut share = |low, high| [0; 3].map(|_: usize| f64::from(random.between(low, high)));
    let (inside, around, at) = (share(0.1, 0.9), share(-2.0, 3.0), share(0.2, 0.8));
    let eye = point(bounds, if random.below(3) == 0 { inside } else { around });
    let back = (eye - point(bounds, at)).normalize();
    let right = DVec3::new(0.3, 0.2, 1.0).cross(back).normalize();
    let to_world = DMat4::from_cols(
        right.extend(0.0),
        back.cross(right).extend(0.0),
        back.extend(0.0),
        eye.extend(1.0),
    );
    Camera { name: String::new(), to_world, lens: lens(random), picture: None }
}

/// A camera that looks straight along an axis from a place on a face, on an edge or on a node
/// plane's height, from outside or from within: its middle ray, row and column stay there.
fn straight_camera(random: &mut Random, bounds: &Bounds) -> Camera {
    let axis = random.below(3);
    let mut share = [0; 3].map(|_: usize| [0.0, 1.0, 0.5, 0.0][random.below(4)]);
    let forward = [1.0, -1.0][random.below(2)];
    share[axis] = [-0.75, 0.0, 0.25, 1.0, 1.5][random.below(5)];
    let mut axes = [DVec3::X, DVec3::Y, DVec3::Z];
    axes.rotate_left(axis);
    // Looks along -z of its own: against its third column.
    let back = -forward * axes[0];
    let faces = [bounds.min, bounds.max];
    let mut eye = point(bounds, share);
    for axis in 0..3 {
        // On the face to the last bit.
        if share[axis] == 0.0 || share[axis] == 1.0 {
            eye[axis] = faces[share[axis] as usize][axis].into();
        }
    }
    let columns = [-forward * axes[1], axes[2], back].map(|column| column.extend(0.0));
    let to_world = DMat4::from_cols(columns[0], columns[1], columns[2], eye.extend(1.0));
    Camera { name: String::new(), to_world, lens: lens(random), picture: None }
}

pub(super) fn cameras(random: &mut Random, bounds: &Bounds) -> [Camera; 3] {
    [random_camera(random, bounds), random_camera(random, bounds), straight_camera(random, bounds)]
}
