//! Worlds: boxes around a field's own.

use mipvog::bake::{BakeOptions, Changes, bake};
use mipvog::base::bytes::WriterSink;
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::container::Container;
use mipvog::container::json::to_canonical;
use mipvog::levels::Filter;
use mipvog::model::baked::{Bends, LevelOfDetail, Metadata};
use mipvog::model::camera::{Camera, Ray};
use mipvog::model::field::{Lattice, RadianceField, Shell};
use mipvog::model::grid::{Bounds, Nodes};
use mipvog::view::render::Renderer;
use mipvog_testing::chunks::{chunks, with_chunk};
use mipvog_testing::plain_nested::{PlainSample, PlainWorld};
use mipvog_testing::world::{random_world, world};
use mipvog_testing::{Random, assert_golden, fixture, open_bytes, origin, packed, with_threads};

fn bytes_of(field: &RadianceField, options: &BakeOptions) -> Vec<u8> {
    let mut bytes = Vec::new();
    bake(field, options, &origin(), &mut WriterSink::new(&mut bytes), &Silent).expect("a bake");
    bytes
}

pub fn baked(field: &RadianceField, options: &BakeOptions) -> Container {
    open_bytes(&bytes_of(field, options)).expect("a container")
}

/// Cameras inside, looking around.
fn cameras(pixels: usize) -> Vec<Camera> {
    let looks = [[1.0, 0.2, 0.0], [-0.7, 0.7, 0.2], [0.1, -1.0, -0.2], [0.5, 0.5, 0.8]];
    let places = [[-0.6, -0.4, 0.2], [0.5, -0.5, 0.0], [0.0, 0.8, 0.3], [0.6, 0.6, -0.2]];
    let camera = |(from, to)| Camera::look_at(from, to, 60.0, [pixels; 2]).expect("a camera");
    places.into_iter().zip(looks).map(camera).collect()
}

/// The mean squared difference of two lists of colours, as decibels.
fn decibels(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    let sum: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
    -10.0 * (sum / (3 * a.len()) as f64).log10()
}

#[test]
fn a_world_looks_as_it_did_from_inside() {
    let field = world(65, 3);
    let unbaked = Renderer::trained(&field, None, &Limits::default()).expect("a renderer");
    let renderer = Renderer::of_container(&baked(&field, &BakeOptions::default()));
    let renderer = renderer.expect("levels");
    for (number, camera) in cameras(128).iter().enumerate() {
        let [a, b] = [&unbaked, &renderer].map(|of| of.picture(camera).expect("a picture"));
        let found = decibels(&a.color, &b.color);
        assert!(found > 45.0, "camera {number}: {found:.1} dB");
        assert!(a.transmittance.iter().chain(&b.transmittance).all(|left| *left < 1e-3));
        // Smaller pictures read coarser levels; the reference is supersampled.
        for (factor, least) in [(4, 33.0), (8, 29.0)] {
            let small =
                Camera { lens: camera.lens.resized(128 / factor, 128 / factor), ..camera.clone() };
            let reference = a.clone().box_downsampled(factor);
            let found =
                decibels(&reference.color, &renderer.picture(&small).expect("a picture").color);
            assert!(found > least, "camera {number}, 1/{factor}: {found:.1} dB");
        }
    }
}

#[test]
fn pictures_follow_the_specification() {
    let mut random = Random::new(11);
    for round in 0..12 {
        let shells = 1 + random.below(4);
        let field = random_world(&mut random, shells, [0.05, 0.4, 1.0, 0.0][round % 4]);
        let options = BakeOptions::default().with_filter(Filter::Isotropic);
        let container = baked(&field, &options);
        let plain = PlainWorld::new(&container);
        let mut renderer = Renderer::of_container(&container).expect("levels");
        let last = container.metadata().levels.len() as f64 - 1.0;
        for _ in 0..60 {
            let lambda = [0.0f64, 0.0, 1.3, 2.6][random.below(4)].min(last);
            let view = renderer.view_mut();
            // The same level of detail everywhere.
            view.level_of_detail = Some(LevelOfDetail {
                factor: 1e-9,
                bias: lambda as f32,
                bound: None,
                bends: Bends::default(),
                ..container.metadata().level_of_detail
            });
            let outer = view.bounds;
            let mut point = || -> [f64; 3] {
                std::array::from_fn(|axis| {
                    let (low, high) = (outer.min[axis], outer.max[axis]);
                    f64::from(random.between(1.2 * low - 0.2 * high, 1.2 * high - 0.2 * low))
                })
            };
            let camera = Camera::look_at(point(), point(), 1e-3, [2, 2]).expect("a camera");
            let picture = renderer.picture(&camera).expect("a picture");
            let ray = camera.ray(0.5, 0.5);
            let ray = Ray { direction: ray.direction / ray.direction.length(), ..ray };
            let (color, left) = plain.light(&ray, f64::from(lambda as f32));
            assert!(
                (f64::from(picture.transmittance[0]) - left).abs() < 2e-4,
                "round {round}, {ray:?}, lambda {lambda}: {} for {left}",
                picture.transmittance[0]
            );
            for (got, want) in picture.color[0].into_iter().zip(color) {
                assert!((f64::from(got) - want).abs() < 5e-4, "round {round}: {got} for {want}");
            }
        }
    }
}

/// Two boxes of 5 nodes along each axis, filled with thin fog.
fn two_boxes() -> RadianceField {
    let bounds = |half: f32| Bounds { min: [-half; 3], max: [half; 3] };
    let field = |half: f32| {
        let density = vec![-1.0; 125];
        let builder = RadianceField::builder([5; 3], density, vec![0.0; 375]);
        builder.bounds([-half; 3], [half; 3]).stepsize(1.0).build().expect("a field")
    };
    let mut inner = field(1.0);
    inner.scene.march.voxel_size = 0.5;
    let RadianceField { density, color, .. } = field(2.0);
    let lattice = Lattice::new(bounds(2.0), Nodes([5; 3]));
    inner.shells.push(Shell { lattice, density, color });
    inner
}

#[test]
fn the_worked_example_of_boxes_is_what_the_code_does() {
    let options = BakeOptions { levels: Some(2), ..BakeOptions::default() };
    let options = options.with_filter(Filter::Isotropic);
    let container = baked(&two_boxes(), &options);
    let ray = Ray { origin: [-1.4, 0.0, 0.0].into(), direction: [1.0, 0.0, 0.0].into() };
    let plain = PlainWorld::new(&container);
    let found: Vec<PlainSample> = plain.samples(&ray, 0.0).iter().map(|(own, _)| *own).collect();
    let sample = |k, number, covers| PlainSample { k, number, covers };
    let want = [
        sample(0.0, 1, 1.0),
        sample(1.0, 0, 1.0),
        sample(2.0, 0, 1.0),
        sample(3.0, 0, 1.0),
        sample(4.0, 0, 1.0),
        sample(5.0, 1, 2.0),
    ];
    assert_eq!(found, want);
    let renderer = Renderer::of_container(&container).expect("levels");
    let light = renderer.ray_colors(&[ray], 0, &Silent).expect("light")[0];
    let (_, left) = plain.light(&ray, 0.0);
    assert!((f64::from(light.transmittance) - left).abs() < 1e-6);
}

#[test]
fn worlds_do_not_depend_on_threads_and_come_back() {
    let mut random = Random::new(5);
    for shells in [1, 3] {
        let field = random_world(&mut random, shells, 0.5);
        let options = BakeOptions::default();
        let bytes = bytes_of(&field, &options);
        for threads in [1, 2, 16] {
            assert!(with_threads(threads, || bytes_of(&field, &options)) == bytes, "{threads}");
        }
        let container = open_bytes(&bytes).expect("a container");
        let unpacked = mipvog::unpacked::Unpacked::of_container(&container).expect("levels");
        let again = packed(&unpacked, &Changes::default()).expect("packed");
        assert!(again == bytes);
        let again = unpacked.field(&Limits::default()).expect("in memory").expect("densities");
        assert_eq!(again.shells.len(), shells);
    }
}

#[test]
fn a_world_is_the_golden_container() {
    let bytes = bytes_of(&world(17, 2), &BakeOptions::default());
    assert_golden(&fixture("baked/world.mipvog"), &bytes);
}

#[test]
fn the_far_does_not_change_what_is_near() {
    // Level 0 and level 1 of a world are those of its inner box alone, but for the light that
    // colours of level 1 are weighted by.
    let field = world(33, 2);
    let alone = RadianceField { shells: Vec::new(), ..field.clone() };
    let [whole, alone] = [&field, &alone].map(|field| baked(field, &BakeOptions::default()));
    let [a, b] = [&whole, &alone].map(|container| container.read_level(0).expect("level 0"));
    assert_eq!(a, b);
    assert_eq!(whole.metadata().bounds, alone.metadata().bounds);
    assert_eq!(whole.metadata().outer_bounds().max, [4.0; 3]);
    assert_eq!((whole.header().version, alone.header().version[1]), ([1, 3], 2));
}

/// The metadata of the golden world, changed, and how it is refused.
fn refused(change: impl FnOnce(&mut Metadata)) -> String {
    let world = std::fs::read(fixture("baked/world.mipvog")).expect("the golden world");
    let bytes = with_chunk(&chunks(&world), b"META", None, |bytes| {
        let mut metadata: Metadata = serde_json::from_slice(bytes).expect("metadata");
        change(&mut metadata);
        *bytes = to_canonical(&metadata).expect("JSON").into_bytes();
    });
    let read = open_bytes(&bytes).and_then(|container| container.read());
    read.expect_err("a broken container").to_string()
}

#[test]
fn boxes_that_lie_are_refused() {
    let far = f32::MAX;
    let boxed = |min: [f32; 3], max: [f32; 3]| Some(Bounds { min, max });
    for bounds in [
        // It touches the smaller box all around, lies beside it, is reversed, overflows, or its
        // nodes are as close or four times as far apart.
        boxed([-1.0; 3], [1.0; 3]),
        boxed([2.0; 3], [6.0; 3]),
        boxed([2.0; 3], [-2.0; 3]),
        boxed([-far; 3], [far; 3]),
        boxed([-1.0, -1.0, -1.0], [1.0, 1.0, 1.1]),
        boxed([-4.0; 3], [4.0; 3]),
        boxed([f32::NAN; 3], [2.0; 3]),
        None,
    ] {
        let error = refused(|metadata| metadata.shells[0].bounds = bounds);
        assert!(error.contains("shells[0].bounds") || error.contains("JSON"), "{error}");
    }
    let error = refused(|metadata| metadata.levels[1].bounds = metadata.shells[0].bounds);
    assert!(error.contains("levels[1].bounds"), "{error}");
    let error = refused(|metadata| metadata.shells = vec![metadata.shells[0].clone(); 31]);
    assert!(error.contains("shells"), "{error}");
    let error = refused(|metadata| metadata.shells.clear());
    assert!(error.contains("chunk TABL"), "{error}");
    let error = refused(|metadata| metadata.march.stepsize = 1e-6);
    assert!(error.contains("16777216"), "{error}");
    let error =
        refused(|metadata| metadata.shells[0].blocks_filled = metadata.shells[0].blocks_stored);
    assert!(error.contains("inherited"), "{error}");
    let error = refused(|metadata| metadata.levels[1].blocks_filled = 1);
    assert!(error.contains("blocks_filled"), "{error}");
}

#[test]
fn what_worlds_lack_is_refused_by_name() {
    let field = world(17, 2);
    let refused = |options: BakeOptions, words: &str| {
        let mut sink = WriterSink::new(std::io::sink());
        let error = bake(&field, &options, &origin(), &mut sink, &Silent).expect_err("refused");
        assert!(error.to_string().contains(words), "{error}");
    };
    refused(BakeOptions::default().with_filter(Filter::Code), "filter");
    refused(BakeOptions::default().with_filter(Filter::Fit), "filter");
    refused(BakeOptions { levels: Some(2), ..BakeOptions::default() }, "levels");
    let container = baked(&field, &BakeOptions::default());
    let unpacked = mipvog::unpacked::Unpacked::of_container(&container).expect("levels");
    for changes in [
        Changes { without_finest: 1, ..Changes::default() },
        Changes { drop_islands: Some(3), ..Changes::default() },
        Changes { levels: Some(2), ..Changes::default() },
    ] {
        let error = packed(&unpacked, &changes).expect_err("refused").to_string();
        assert!(error.contains("nested boxes"), "{error}");
    }
    let fewer = Changes { levels: Some(3), ..Changes::default() };
    let fewer = open_bytes(&packed(&unpacked, &fewer).expect("packed")).expect("a container");
    assert_eq!((fewer.metadata().levels.len(), fewer.metadata().shells.len()), (3, 2));
    assert!(fewer.read().is_ok());
}

#[test]
fn a_box_of_a_world_is_a_field_of_its_own() {
    let container = baked(&world(33, 3), &BakeOptions::default());
    let whole = Renderer::of_container(&container).expect("a renderer");
    let boxes = container.metadata().boxes();
    let field = container.read().expect("a field");
    for (number, own) in boxes.iter().enumerate() {
        let one = field.clone().one_box(number);
        one.check().expect("levels that fit");
        assert_eq!(one.metadata.bounds, *own);
        let one = Renderer::baked(&one, &Limits::default()).expect("a field of one box");
        let smaller = number.checked_sub(1).map(|smaller| boxes[smaller]);
        let (mut compared, mut dense) = (0, 0);
        for place in 0..1000 {
            let at = [place / 100, place / 10 % 10, place % 10];
            let at: [f64; 3] = std::array::from_fn(|axis| {
                let [low, high] = [own.min, own.max].map(|corner| f64::from(corner[axis]));
                low + (at[axis] as f64 + 0.37) / 10.0 * (high - low)
            });
            let within = |bounds: &Bounds| {
                (0..3).all(|axis| {
                    (f64::from(bounds.min[axis])..=f64::from(bounds.max[axis])).contains(&at[axis])
                })
            };
            if smaller.as_ref().is_some_and(within) {
                continue;
            }
            let [a, b] = [&whole, &one].map(|of| of.sample(at, 0).expect("a point").density);
            assert!((a - b).abs() <= 1e-5 * a.abs(), "box {number} at {at:?}: {a} {b}");
            compared += 1;
            dense += usize::from(a > 0.5);
        }
        assert!(compared > 500 && dense > 20, "box {number}: {compared}, {dense} dense");
    }
    let last = boxes.len() - 1;
    assert_eq!(field.clone().one_box(last), field.clone().one_box(last + 5));
    let same = field.one_box(0);
    assert_eq!(same.clone().one_box(2), same);
}
