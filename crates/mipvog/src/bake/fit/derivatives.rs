//! Tests of the derivatives of all levels against finite differences of pictures.

use super::adam::Adam;
use super::curve::Curve;
use super::finest::Finest;
use super::gradient::{Gradient, NOT_FITTED};
use super::options::FitOptions;
use super::target::{Targets, Windows};
use super::trace::Rays;
use crate::base::limits::Limits;
use crate::base::progress::Silent;
use crate::levels::sizes::level_sizes;
use crate::levels::{Filter, SharedFilter};
use crate::model::anisotropy::ANISOTROPY;
use crate::model::baked::{LevelOfDetail, StepRule};
use crate::model::directional::DIRECTIONAL;
use crate::model::field::RadianceField;
use crate::model::grid::{NodeMask, Nodes};
use crate::view::render::{Renderer, TrainedLevels, View, with_lanes};
use crate::view::sample::{Dense, Stored};

const NODES: [usize; 3] = [12, 9, 14];
const LEVELS: usize = 3;
/// Rays of each scale.
const RAYS: usize = 300;
/// Added to a value, and taken from it.
const STEP: f32 = 0.01;
/// Difference of a derivative and a difference, as a share of the group's largest derivative. The
/// differences have errors of the order of the step's square, and of thresholds that rays cross.
const TOLERANCE: f64 = 0.01;
/// Number of nodes tested on each level.
const LOOKED_AT: usize = 12;

/// A half-transparent volume with waves of colour, so that every node has derivatives.
fn field(is_linear: bool) -> RadianceField {
    let count = NODES.iter().product();
    let wave = |at: usize, by: f32| libm::sinf(at as f32 * by);
    let density = (0..count).map(|at| 0.5 + 3.0 * wave(at, 0.37)).collect();
    let height = if is_linear { 0.4 } else { 2.0 };
    let color = (0..3 * count).map(|at| 0.5 + height * wave(at, 0.11)).collect();
    let builder = RadianceField::builder(NODES, density, color).shift(-2.0);
    let builder = builder.bounds([-1.2, -0.9, -1.4], [1.2, 0.9, 1.4]);
    let builder = if is_linear { builder.linear_colors() } else { builder };
    builder.build().expect("a field")
}

#[test]
fn derivatives_are_differences_of_pictures_at_every_level() {
    // Steps of fits take every second sample of their rays at first.
    for (is_linear, every) in [(false, 1), (true, 1), (false, 2)] {
        let filter = SharedFilter::from(Filter::Fit);
        let line = filter.rule();
        let curve = Curve::above(LevelOfDetail { factor: 0.6, bias: 0.3, ..line }, LEVELS - 1);
        let level_of_detail = curve.rule();
        let levels = TrainedLevels { filter: &*filter, count: LEVELS, level_of_detail };
        let limits = Limits::default();
        let rendered = Renderer::trained(&field(is_linear), Some(levels), &limits);
        let rendered = rendered.expect("a field");
        let options = FitOptions { steps: 0, seconds: None, cameras: &[], photographs: None };
        let targets = Targets::new(&rendered, LEVELS - 1, &options, &limits, &Silent);
        let (view, values) = rendered.into_parts().expect("values");
        let targets = targets.expect("pictures");
        with_lanes!(values, stored => check(&view, &curve, stored, &targets, every));
    }
}

fn check<const C: usize>(
    view: &View,
    curve: &Curve,
    stored: Stored<C>,
    targets: &Targets,
    every: u32,
) {
    let Stored::Dense(mut field) = stored else { panic!("a trained field is dense") };
    let sizes = level_sizes(Nodes(NODES), LEVELS);
    let adam = |(level, &nodes): (usize, &Nodes)| {
        Adam::new(&mut field, level, &NodeMask::full(nodes), view)
    };
    let adams: Vec<_> = sizes.iter().enumerate().skip(1).map(adam).collect();
    let finest = Finest::taken_from(&mut field);
    for level in 1..LEVELS {
        for (node, values) in field.values_mut(level).anisotropy.iter_mut().enumerate() {
            let values = values.iter_mut().enumerate();
            values.for_each(|(i, value)| *value = 0.1 * libm::sinf((7 * node + i) as f32 * 0.3));
        }
    }
    for level in (1..LEVELS).filter(|_| view.directional) {
        for (node, color) in field.values_mut(level).color.iter_mut().enumerate() {
            let brightness = color.iter_mut().skip(C - DIRECTIONAL).enumerate();
            brightness.for_each(|(i, value)| *value = libm::sinf((5 * node + i) as f32 * 0.21));
        }
    }
    let numbers: Vec<&[u32]> = adams.iter().map(Adam::numbers).collect();
    let counts: Vec<usize> = adams.iter().map(Adam::nodes).collect();
    let of_scale = |scale: usize| (0..RAYS).map(move |number| (scale, number));
    let all: Vec<_> = (0..targets.scales).flat_map(of_scale).collect();
    let mut gradient = Gradient::new(&counts);
    let rays =
        Rays { view, field: &field, finest: &finest, targets, numbers: &numbers, curve, every };
    for &(scale, number) in &all {
        rays.differentiate(scale, number, Windows::Part(0, 1), 1.0, &mut gradient);
    }
    let mut unused = Gradient::new(&[]);
    let mut loss = |field: &Dense<C>| -> f64 {
        let rays = Rays { view, field, finest: &finest, targets, numbers: &numbers, curve, every };
        let square = |&(scale, number): &(usize, usize)| {
            let square = rays.square(scale, number, Windows::Part(0, 1), &mut unused);
            square.map_or(0.0, |(_, square)| 0.5 * f64::from(square))
        };
        all.iter().map(square).sum()
    };
    for level in 1..LEVELS {
        let (sums, count) = (&gradient.levels[level - 1], counts[level - 1]);
        let directional = if view.directional { C - DIRECTIONAL..C } else { C..C };
        let colors = (0..3).chain(directional).map(Lane::Color);
        let anisotropy = (0..ANISOTROPY).map(Lane::Anisotropy);
        for lane in [Lane::Density].into_iter().chain(colors).chain(anisotropy) {
            let by = |node: usize| match lane {
                Lane::Density => f64::from(sums[node].density),
                Lane::Anisotropy(lane) => f64::from(sums[node].anisotropy[lane]),
                Lane::Color(lane) => f64::from(sums[node].color[lane]),
            };
            let largest = (0..count).map(|node| by(node).abs()).fold(0.0, f64::max);
            assert!(largest > 0.01, "level {level}, lane {lane:?}: {largest}");
            for node in (0..count).step_by(count / LOOKED_AT) {
                let mut moved = |to: f32| {
                    let before = *value(&mut field, level, lane, node);
                    *value(&mut field, level, lane, node) += to;
                    let loss = loss(&field);
                    *value(&mut field, level, lane, node) = before;
                    loss
                };
                let slope = (moved(STEP) - moved(-STEP)) / f64::from(2.0 * STEP);
                let off = (slope - by(node)).abs();
                let place = format!("level {level}, lane {lane:?}, node {node}");
                assert!(off < TOLERANCE * largest, "{place}: {} for {slope}", by(node));
            }
        }
    }
}

/// The derivatives by the rule's knots. The places of samples must not depend on the rule here: the
/// derivatives leave out how those move.
#[test]
fn derivatives_by_knots_are_differences_of_pictures() {
    let filter = SharedFilter::from(Filter::Fit);
    let line = filter.rule();
    let curve = Curve::above(LevelOfDetail { factor: 0.6, bias: 0.3, ..line }, LEVELS - 1);
    let level_of_detail = curve.rule();
    let levels = TrainedLevels { filter: &*filter, count: LEVELS, level_of_detail };
    let limits = Limits::default();
    let rendered = Renderer::trained(&field(false), Some(levels), &limits).expect("a field");
    let options = FitOptions { steps: 0, seconds: None, cameras: &[], photographs: None };
    let targets = Targets::new(&rendered, LEVELS - 1, &options, &limits, &Silent);
    let (mut view, values) = rendered.into_parts().expect("values");
    view.step_rule = StepRule::Constant;
    with_lanes!(values, stored => check_knots(view, &curve, stored, &targets.expect("pictures")));
}

fn check_knots<const C: usize>(
    mut view: View,
    curve: &Curve,
    stored: Stored<C>,
    targets: &Targets,
) {
    let Stored::Dense(mut field) = stored else { panic!("a trained field is dense") };
    let finest = Finest::taken_from(&mut field);
    let none: Vec<u32> = vec![NOT_FITTED; Nodes(NODES).count()];
    let numbers = [&none[..]; LEVELS - 1];
    let mut of = |curve: &Curve| {
        view.level_of_detail = Some(curve.rule());
        let (view, field, finest) = (&view, &field, &finest);
        let rays = Rays { view, field, finest, targets, numbers: &numbers, curve, every: 1 };
        let (mut gradient, mut sum) = (Gradient::new(&[0; LEVELS - 1]), 0.0);
        for (scale, ray) in (0..targets.scales * RAYS).map(|i| (i / RAYS, i % RAYS)) {
            let windows = Windows::Part(0, 1);
            rays.differentiate(scale, ray, windows, 1.0, &mut gradient);
            let square = rays.square(scale, ray, windows, &mut gradient);
            sum += square.map_or(0.0, |(_, square)| 0.5 * f64::from(square));
        }
        (sum, gradient.knots)
    };
    let by = &of(curve).1[..LEVELS];
    let largest = by.iter().map(|by| f64::from(by.abs())).fold(0.0, f64::max);
    for (knot, &by) in by.iter().enumerate() {
        let (by, [up, down]) =
            (f64::from(by), [STEP, -STEP].map(|by| of(&curve.moved(knot, by)).0));
        let slope = (up - down) / f64::from(2.0 * STEP);
        assert!(by.abs() > 0.02 * largest, "knot {knot}: {by} of {largest}");
        assert!((slope - by).abs() < TOLERANCE * largest, "knot {knot}: {by} for {slope}");
    }
}

/// One of a node's values.
#[derive(Debug, Clone, Copy)]
enum Lane {
    Density,
    Anisotropy(usize),
    Color(usize),
}

fn value<const C: usize>(field: &mut Dense<C>, level: usize, lane: Lane, node: usize) -> &mut f32 {
    match lane {
        Lane::Density => &mut field.values_mut(level).density[node],
        Lane::Anisotropy(lane) => &mut field.values_mut(level).anisotropy[node][lane],
        Lane::Color(lane) => &mut field.values_mut(level).color[node][lane],
    }
}
