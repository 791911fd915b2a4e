//! The renderer against its reference implementation, which visits every sample: random scenes,
//! dense and baked.

use crate::ONE_IN;
use crate::common;
use crate::common::plain_render::PlainField;
use crate::common::rendered::{Differences, baked_levels, finest_level, trained_levels};
use crate::common::{Random, baked_bytes, grid_values, open_bytes, random_field};
use glam::{DMat4, DVec3};
use mipvog::bake::{BakeOptions, Filter};
use mipvog::base::error::Place;
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::levels::{FilterDomain, Kernel, LevelFilter};
use mipvog::model::baked::{
    BakedField, Bends, Blend, Codes, Decode, DensityDomain, Encoding, FootprintNeighbour, Group,
    LevelOfDetail, NumberType,
};
use mipvog::model::camera::{Camera, Lens};
use mipvog::model::field::{
    Activation, ActivationOrder, ColorDomain, FreeSpace, Grid, Lookup, RadianceField,
};
use mipvog::model::grid::{Bounds, Nodes};
use mipvog::model::harmonics::{Clamp, Evaluation, Harmonics};
use mipvog::model::view_dependence::ViewDependence;
use mipvog::model::view_mlp::{Layer, ViewMlp};
use mipvog::quantize::Bits;
use mipvog::view::compare::{Reference, compare};
use mipvog::view::render::{
    FrameOptions, LevelChoice, Renderer, TrainedLevels, camera_coverage, render,
};

/// Rays end at an optical depth of 11.6, with a transmittance of 9.2e-6; the rest is for float32,
/// in which raw values around 100 are 4e-6 off.
const BOUND: f64 = 1.2e-5;
/// The same where levels average alpha while a field is opened: amounts are f32, and near 1 the
/// light that they leave is known to 3e-8 only (formats/numerics.md, weighted averages). A trial
/// found 4e-5.
const ALPHA_BOUND: f64 = 1e-4;

fn random_network(random: &mut Random, features: usize) -> ViewMlp {
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
fn random_scene(random: &mut Random) -> RadianceField {
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

fn random_rule(random: &mut Random) -> LevelOfDetail {
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
fn random_camera(random: &mut Random, bounds: &Bounds) -> Camera {
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

fn cameras(random: &mut Random, bounds: &Bounds) -> [Camera; 3] {
    [random_camera(random, bounds), random_camera(random, bounds), straight_camera(random, bounds)]
}

/// Renders and holds every pixel to the reference's.
fn assert_same(
    field: &Renderer,
    plain: &PlainField,
    camera: &Camera,
    levels: LevelChoice,
    bound: f64,
    case: &str,
) {
    let options = FrameOptions { levels, supersample: 1 };
    let frame = render(field, camera, &options, &Silent).expect("a frame");
    let pixels: Vec<usize> = (0..frame.transmittance.len()).collect();
    let d = Differences::of(plain, camera, levels, &frame, &pixels);
    // Both accumulated and view-dependent colour may be off; distances and levels are sums of
    // numbers around 10 and 4.
    let ok = d.color <= 2.0 * bound
        && d.transmittance <= bound
        && d.accumulated <= bound
        && d.distance <= 10.0 * bound
        && d.level <= 4.0 * bound;
    assert!(ok, "{case}, {levels:?}: {d:?}");
    assert!(d.doubt < 0.1, "{case}: thresholds leave {} open", d.doubt);
}

/// Any kernel with the domain and the rules of a filter.
#[derive(Debug)]
struct RandomFilter {
    kernel: Kernel,
    density: bool,
    rules: Filter,
}

impl LevelFilter for RandomFilter {
    fn name(&self) -> &str {
        "random"
    }

    fn weights(&self) -> Vec<f64> {
        self.kernel.weights()
    }

    fn domain(&self) -> FilterDomain {
        match self.rules.domain() {
            FilterDomain::Logits { .. } => FilterDomain::Logits { density: self.density },
            alpha => alpha,
        }
    }
}

#[test]
fn trained_scenes_look_as_their_twins() {
    for seed in (0..150).step_by(ONE_IN) {
        let mut random = Random::new(seed);
        let field = random_scene(&mut random);
        let filter = RandomFilter {
            kernel: Kernel::ALL[random.below(7)],
            density: random.below(2) == 0,
            // Logits as in training, or alpha.
            rules: [Filter::Code, Filter::RateTent, Filter::Coverage][random.below(3)],
        };
        let count = 1 + random.below(5);
        let averages_alpha = matches!(filter.domain(), FilterDomain::Alpha { .. });
        let bound = if averages_alpha { ALPHA_BOUND } else { BOUND };
        let level_of_detail = random_rule(&mut random);
        let made = TrainedLevels { filter: &filter, count, level_of_detail };
        let limits = Limits::default();
        let alone = Renderer::trained(&field, None, &limits).expect("a field");
        let fast = Renderer::trained(&field, Some(made), &limits).expect("a field");
        let finest = PlainField::new(alone.view(), finest_level(&field));
        let plain = PlainField::new(fast.view(), trained_levels(&field, Some((&filter, count))));
        for camera in cameras(&mut random, &field.scene.bounds) {
            let case = format!("seed {seed}");
            assert_same(&alone, &finest, &camera, LevelChoice::Auto, BOUND, &case);
            assert_same(&fast, &plain, &camera, LevelChoice::Auto, bound, &case);
            let fixed = LevelChoice::Fixed(random.below(6));
            assert_same(&fast, &plain, &camera, fixed, bound, &case);
        }
    }
}

fn random_bake(random: &mut Random, field: &RadianceField) -> BakedField {
    let options = BakeOptions {
        filter: Filter::all()[random.below(5)].into(),
        fit_steps: 1,
        levels: Some(1 + random.below(5)),
        bits: [Bits::Integer(8), Bits::Integer(12), Bits::F16, Bits::F32][random.below(4)],
        block_size: 1 + random.below(9),
        alpha_threshold: [1e-3, 0.1, 0.5][random.below(3)],
        ..BakeOptions::default()
    };
    let container = open_bytes(&baked_bytes(field, &options).expect("a bake")).expect("valid");
    container.read().expect("decodes")
}

/// Gives the levels from a random one on directional brightness, where that may be.
fn brighten(random: &mut Random, baked: &mut BakedField) {
    let metadata = &mut baked.metadata;
    if metadata.blend != Blend::AfterActivation || metadata.color_domain() != ColorDomain::Logit {
        return;
    }
    let finest = random.below(3);
    for (level, own) in metadata.levels.iter_mut().zip(&mut baked.levels).skip(finest) {
        let empty = [0.0, random.between(-3.0, 3.0)][random.below(2)];
        level.directional = Some(steps_of(0.03, Decode::Directional, empty));
        let count = own.table.frames() * 3 * level.grid().block_nodes();
        own.atlases[Group::Directional.index()] = Some(random_codes(random, count));
    }
}

/// Gives some of the levels that store roots of optical depth anisotropy.
fn shape(random: &mut Random, baked: &mut BakedField) {
    for (level, own) in baked.metadata.levels.iter_mut().zip(&mut baked.levels) {
        if level.density_domain() != DensityDomain::SqrtOpticalDepth || random.below(4) == 0 {
            continue;
        }
        level.anisotropy = Some(steps_of(0.01, Decode::Anisotropy, 0.0));
        let count = own.table.frames() * 5 * level.grid().block_nodes();
        own.atlases[Group::Anisotropy.index()] = Some(random_codes(random, count));
    }
}

fn steps_of(step: f32, decode: Decode, empty: f32) -> Encoding {
    Encoding {
        number: NumberType::U8,
        bits: 8,
        center: 0.0,
        step,
        curve: 0.0,
        empty,
        empty_code: false,
        decode,
        max_error: 0.01,
    }
}

fn random_codes(random: &mut Random, count: usize) -> Codes {
    Codes::U8((0..count).map(|_| random.below(256) as u8).collect())
}

#[test]
fn baked_scenes_look_as_their_twins() {
    let (mut brightened, mut shaped) = (0, 0);
    for seed in (0..150).step_by(ONE_IN) {
        let mut random = Random::new(1000 + seed);
        let field = random_scene(&mut random);
        let mut baked = random_bake(&mut random, &field);
        baked.metadata.level_of_detail = random_rule(&mut random);
        brighten(&mut random, &mut baked);
        shape(&mut random, &mut baked);
        let fast = Renderer::baked(&baked, &Limits::default()).expect("a field");
        brightened += usize::from(fast.view().directional);
        shaped += usize::from(fast.view().anisotropic);
        let plain = PlainField::new(fast.view(), baked_levels(&baked));
        for camera in cameras(&mut random, &field.scene.bounds) {
            let case = format!("seed {seed}");
            assert_same(&fast, &plain, &camera, LevelChoice::Auto, BOUND, &case);
            let fixed = LevelChoice::Fixed(random.below(6));
            assert_same(&fast, &plain, &camera, fixed, BOUND, &case);
        }
    }
    assert!(brightened * ONE_IN > 15, "{brightened} scenes with directional brightness");
    assert!(shaped * ONE_IN > 15, "{shaped} scenes with anisotropy");
}

/// The format lets any level but the finest go without density, and emptiness have any colour; our
/// writer makes neither.
#[test]
fn levels_of_any_kind_look_as_their_twins() {
    for seed in (0..60).step_by(ONE_IN) {
        let mut random = Random::new(2000 + seed);
        let field = random_scene(&mut random);
        let mut baked = random_bake(&mut random, &field);
        baked.metadata.level_of_detail = random_rule(&mut random);
        for (number, level) in baked.metadata.levels.iter_mut().enumerate() {
            let mixed_raw = baked.metadata.blend == Blend::BeforeActivation;
            if number > 0 && mixed_raw && random.below(2) == 0 {
                level.density = None;
                baked.levels[number].atlases[0] = None;
            }
            for encoding in [&mut level.diffuse, &mut level.features].into_iter().flatten() {
                encoding.empty = random.between(-3.0, 3.0);
            }
        }
        let fast = Renderer::baked(&baked, &Limits::default()).expect("a field");
        let plain = PlainField::new(fast.view(), baked_levels(&baked));
        for camera in cameras(&mut random, &field.scene.bounds) {
            assert_same(&fast, &plain, &camera, LevelChoice::Auto, BOUND, &format!("seed {seed}"));
        }
    }
}

#[test]
fn empty_and_full_scenes_look_as_their_twins() {
    for (seed, nodes) in [[2, 2, 2], [2, 9, 17], [16, 16, 16]].into_iter().enumerate() {
        let count: usize = nodes.iter().product();
        for raw in [-100.0, -1e30, 0.0, 30.0, 1e30] {
            let mut random = Random::new(3000 + seed as u64);
            let field = common::field(nodes, &vec![raw; count], &vec![0.25; 5 * count]);
            let dense = Renderer::trained(&field, None, &Limits::default()).expect("a field");
            let plain = PlainField::new(dense.view(), finest_level(&field));
            let baked = random_bake(&mut random, &field);
            let sparse = Renderer::baked(&baked, &Limits::default()).expect("a field");
            let plain_baked = PlainField::new(sparse.view(), baked_levels(&baked));
            for camera in cameras(&mut random, &field.scene.bounds) {
                let case = format!("{nodes:?}, raw {raw}");
                assert_same(&dense, &plain, &camera, LevelChoice::Auto, BOUND, &case);
                assert_same(&sparse, &plain_baked, &camera, LevelChoice::Auto, BOUND, &case);
            }
        }
    }
}

#[test]
fn thread_count_never_shows_in_a_picture() {
    let mut random = Random::new(4);
    let field = random_field(&mut random, [17, 30, 9], 7);
    let dense = Renderer::trained(&field, None, &Limits::default()).expect("a field");
    let options = BakeOptions { filter: Filter::Paper.into(), ..BakeOptions::default() };
    let container = open_bytes(&baked_bytes(&field, &options).expect("a bake")).expect("valid");
    let baked = container.read().expect("decodes");
    let rule = random_rule(&mut random);
    let camera = Camera {
        lens: Lens { width: 70, height: 45, focal: [60.0; 2], center: [35.0, 22.5] },
        ..random_camera(&mut random, &field.scene.bounds)
    };
    let frames = |threads| {
        common::with_threads(threads, || {
            let limits = Limits::default();
            let mut sparse = Renderer::baked(&baked, &limits).expect("a field");
            sparse.view_mut().level_of_detail = Some(rule);
            [&dense, &sparse].map(|field| {
                render(field, &camera, &FrameOptions::default(), &Silent).expect("a frame")
            })
        })
    };
    let one = frames(1);
    assert!(one[0].statistics.samples > 0 && one[1].statistics.samples > 0);
    for threads in [2, 3, 8] {
        assert!(one == frames(threads), "{threads} threads gave another picture");
    }
}

#[test]
fn as_many_features_as_the_format_allows_look_as_their_twins() {
    for features in [13, 14, 29, 30, 61] {
        let mut random = Random::new(5000 + features as u64);
        let mut field = random_field(&mut random, [7, 6, 8], 3 + features);
        field.view = Some(ViewDependence::Network(random_network(&mut random, features)));
        let dense = Renderer::trained(&field, None, &Limits::default()).expect("a field");
        let plain = PlainField::new(dense.view(), finest_level(&field));
        // Fitted levels too: a fit differentiates by every feature.
        let mut options = BakeOptions::default();
        (options.filter, options.fit_steps) = (Filter::Fit.into(), 1);
        (options.levels, options.block_size) = (Some(2), 4);
        let container = open_bytes(&baked_bytes(&field, &options).expect("a bake")).expect("valid");
        let baked = container.read().expect("decodes");
        let sparse = Renderer::baked(&baked, &Limits::default()).expect("a field");
        let plain_baked = PlainField::new(sparse.view(), baked_levels(&baked));
        let cameras = cameras(&mut random, &field.scene.bounds);
        for camera in &cameras {
            let case = format!("{features} features");
            assert_same(&dense, &plain, camera, LevelChoice::Auto, BOUND, &case);
            assert_same(&sparse, &plain_baked, camera, LevelChoice::Auto, BOUND, &case);
        }
        let seen = camera_coverage(&dense, &cameras, 1e-3, &Silent).expect("coverage");
        assert!(seen.importance.iter().any(|&importance| importance > 0.0));
        let reference = Reference::Field(Box::new(dense));
        compare(&reference, &sparse, &cameras, &[1], 1, &Silent, |_| Ok(())).expect("errors");
    }
    let more = random_field(&mut Random::new(1), [3, 3, 3], 65);
    assert!(Renderer::trained(&more, None, &Limits::default()).is_err());
}
