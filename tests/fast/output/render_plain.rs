//! The renderer against its reference implementation, which visits every sample: random scenes,
//! dense and baked.

use super::random_scenes::{cameras, random_camera, random_network, random_rule, random_scene};
use crate::ONE_IN;
use crate::common;
use crate::common::plain_render::PlainField;
use crate::common::rendered::{Differences, baked_levels, finest_level, trained_levels};
use crate::common::{Random, baked_bytes, open_bytes, random_field};
use mipvog::bake::{BakeOptions, Filter};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::levels::{FilterDomain, Kernel, LevelFilter};
use mipvog::model::baked::{
    BakedField, Blend, Codes, Decode, DensityDomain, Encoding, Group, NumberType,
};
use mipvog::model::camera::{Camera, Lens};
use mipvog::model::field::{ColorDomain, RadianceField};
use mipvog::model::view_dependence::ViewDependence;
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
