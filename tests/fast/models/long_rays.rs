//! Step lengths so short that a ray would never end: refused wherever a field comes in, and where
//! the shortest are allowed, every long loop ends soon after it is told to.

use crate::common;
use std::time::{Duration, Instant};

use crate::common::{Random, baked_bytes, open_bytes, random_field};
use mipvog::bake::fit::{FitOptions, fit};
use mipvog::bake::{BakeOptions, Filter};
use mipvog::base::error::{Error, ErrorKind};
use mipvog::base::limits::Limits;
use mipvog::base::progress::{Progress, Silent};
use mipvog::model::camera::{Camera, turntable};
use mipvog::model::field::{ActivationOrder, March, RadianceField};
use mipvog::model::grid::{NodeMask, Nodes};
use mipvog::view::compare::{Reference, compare};
use mipvog::view::render::{FrameOptions, Renderer, TrainedLevels, camera_coverage, render};
use mipvog_inputs::SourceOptions;

/// Steps of which a ray through a small box takes far more than a million.
const TOO_SHORT: [f32; 3] = [1e-7, 1e-30, f32::MIN_POSITIVE];

/// Fog, which no ray leaves before the box ends.
fn fog(stepsize: f32) -> RadianceField {
    let mut field = random_field(&mut Random::new(3), [6, 6, 6], 3);
    field.scene.activation.shift = -20.0;
    field.scene.march.stepsize = stepsize;
    // The last sample lies behind the box, whatever the step.
    field.scene.march.voxel_size = 0.5;
    field
}

fn cameras(field: &RadianceField) -> Vec<Camera> {
    turntable(&field.scene.bounds, 2, [600, 600])
}

fn is_about_steps(error: &Error) -> bool {
    error.to_string().contains("march.stepsize")
}

#[test]
fn steps_that_are_too_short_are_refused_everywhere() {
    let sound = fog(0.5);
    let container = open_bytes(&baked_bytes(&sound, &BakeOptions::default()).expect("a bake"));
    let baked = container.expect("valid").read().expect("decodes");
    for stepsize in TOO_SHORT {
        let error =
            Renderer::trained(&fog(stepsize), None, &Limits::default()).expect_err("too short");
        assert!(is_about_steps(&error), "{error}");
        let error = baked_bytes(&fog(stepsize), &BakeOptions::default()).expect_err("too short");
        assert!(is_about_steps(&error), "{error}");
        let mut other = baked.clone();
        other.metadata.march.stepsize = stepsize;
        let error = Renderer::baked(&other, &Limits::default()).expect_err("too short");
        assert!(is_about_steps(&error), "{error}");
        let mut field = Renderer::trained(&sound, None, &Limits::default()).expect("a field");
        field.view_mut().set_stepsize(stepsize);
        let camera = &cameras(&sound)[0];
        let error =
            render(&field, camera, &FrameOptions::default(), &Silent).expect_err("too short");
        assert!(is_about_steps(&error), "{error}");
        let options = SourceOptions { stepsize: Some(stepsize), ..SourceOptions::default() };
        let path = common::fixture("trained/dvgo/flat.safetensors");
        let error =
            mipvog_inputs::open_with(&path, &options, &Limits::default()).expect_err("too short");
        // The user's own setting is at fault here, and not the file.
        let ErrorKind::InvalidOption { option, .. } = error.kind() else { panic!("{error}") };
        assert_eq!(*option, "stepsize");
    }
}

#[test]
fn another_step_length_leaves_the_optical_depth() {
    let orders = [ActivationOrder::Raw, ActivationOrder::Density, ActivationOrder::Opacity];
    for order in orders {
        let mut scene = common::field([6; 3], &[1.0; 216], &[0.0; 648]);
        scene.scene.activation.order = order;
        let stepsize = scene.scene.march.stepsize;
        let bytes = baked_bytes(&scene, &BakeOptions::default()).expect("a bake");
        let baked = open_bytes(&bytes).expect("valid").read().expect("decodes");
        let mut field = Renderer::baked(&baked, &Limits::default()).expect("a field");
        let middle = [0, 1, 2].map(|axis| {
            0.5 * f64::from(scene.scene.bounds.min[axis] + scene.scene.bounds.max[axis])
        });
        let before = field.sample(middle, 0).expect("a sample").density;
        assert!(before > 0.0, "{order:?}");
        field.view_mut().set_stepsize(0.5 * stepsize);
        let after = field.sample(middle, 0).expect("a sample").density;
        assert!((after / before - 1.0).abs() < 1e-5, "{order:?}: {before} {after}");
    }
}

/// Wants everything to end after a quarter of a second.
struct Impatient(Instant);

impl Progress for Impatient {
    fn cancelled(&self) -> bool {
        self.0.elapsed() > Duration::from_millis(250)
    }
}

/// Runs something that would take minutes, and holds it to end within a second of being told to.
fn assert_ends<T>(name: &str, work: impl FnOnce(&dyn Progress) -> Result<T, Error>) {
    let start = Instant::now();
    let Err(error) = work(&Impatient(start)) else { panic!("{name} is done already") };
    assert!(matches!(error.kind(), ErrorKind::Cancelled), "{name}: {error}");
    let took = start.elapsed();
    assert!(took < Duration::from_millis(1250), "{name} went on for {took:?}");
}

#[test]
fn long_loops_end_within_a_second_of_being_told_to() {
    // The shortest step that is allowed: a million samples a ray.
    let diagonal = f64::from(3 * 7 * 7).sqrt();
    let field = fog((diagonal / f64::from(March::MAX_SAMPLES - 1)) as f32);
    let cameras = cameras(&field);
    let limits = Limits::default();
    let open = || Renderer::trained(&field, None, &limits).expect("a field");
    assert_ends("render", |progress| {
        render(&open(), &cameras[0], &FrameOptions::default(), progress)
    });
    assert_ends("coverage", |progress| camera_coverage(&open(), &cameras, 1e-3, progress));
    assert_ends("compare", |progress| {
        let reference = Reference::Field(Box::new(open()));
        compare(&reference, &open(), &cameras, &[1, 4], 1, progress, |_| Ok(()))
    });
    let made = TrainedLevels { count: 2, ..TrainedLevels::of_training(&Filter::Fit, &field.scene) };
    let retained = [[6; 3], [3; 3]].map(|nodes| NodeMask::full(Nodes(nodes)));
    let retained = [&retained[0], &retained[1]];
    let options = FitOptions { steps: 1000, seconds: None, cameras: &cameras, photographs: None };
    assert_ends("fit", |progress| fit(&field, made, &retained, false, &options, &limits, progress));
}
