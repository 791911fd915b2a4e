//! The stages along a ray: interpolation, transmittance, sums, levels, against the slow renderer.

use glam::{DMat4, DVec3};
use mipvog::bake::Filter;
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::model::activate;
use mipvog::model::anisotropy::ANISOTROPY;
use mipvog::model::camera::{Camera, Lens};
use mipvog::model::field::RadianceField;
use mipvog::model::grid::Bounds;
use mipvog::view::render::{Frame, FrameOptions, LevelChoice, Renderer, TrainedLevels, render};
use mipvog::view::sample::{Dense, SampleLevels};

use std::sync::OnceLock;

use super::plain::{all_nodes, index, trilinear};
use super::plain_render::{Pixel, PlainField};
use super::rendered::{finest_level, trained_levels};
use super::stress::Worst;
use super::stress_scalar::INTERVALS;
use super::{Random, field};

pub fn interpolation() -> Worst {
    let mut worst = Worst::default();
    for (seed, nodes) in [[2, 2, 2], [5, 4, 3], [2, 2, 1000]].into_iter().enumerate() {
        let mut random = Random::new(seed as u64);
        let count: usize = nodes.iter().product();
        let checkerboard = all_nodes(nodes).map(|[x, y, z]| [1e30, -1e30][(x + y + z) % 2]);
        let chance = (0..count).map(|_| random.between(-100.0, 80.0)).collect();
        let mixed = (0..count).map(|i| [1e30, -7.0, 1e-40, -1e30, 0.5][i * 7 % 5]).collect();
        for values in [checkerboard.collect(), chance, mixed] {
            let values: Vec<f32> = values;
            let scene = field(nodes, &values, &[&values[..]; 3].concat());
            let dense = Dense::<4>::new(&scene, None, &Limits::default());
            let dense = dense.expect("a field");
            let wide: Vec<f64> = values.iter().map(|&value| value.into()).collect();
            let shares = |axis: usize, random: &mut Random| {
                let node = random.below(nodes[axis]) as f64 / (nodes[axis] - 1) as f64;
                let nudge = [0.0, 1e-12, -1e-12, 1e-6, f64::from(random.between(0.0, 1.0))];
                (node + nudge[random.below(5)]).clamp(0.0, 1.0)
            };
            for _ in 0..2000 {
                let position = [0, 1, 2].map(|axis| shares(axis, &mut random));
                let u = [0, 1, 2].map(|axis| position[axis] * (nodes[axis] - 1) as f64);
                let low = [0, 1, 2].map(|axis| (u[axis] as usize).min(nodes[axis] - 2));
                let corners = all_nodes([2; 3]).map(|up| [0, 1, 2].map(|a| low[a] + up[a]));
                let scale = corners.map(|at| wide[index(nodes, at)].abs()).fold(0.0, f64::max);
                let want = trilinear(nodes, &wide, u);
                let cell = dense.locate(0, position).expect("a cell");
                let at = || format!("{nodes:?} at {position:?}");
                worst.take(dense.density(0, &cell, &[0.0; ANISOTROPY]).into(), want, scale, &at);
                worst.take(dense.color(0, &cell)[2].into(), want, scale, &at);
            }
        }
    }
    worst
}

/// Looks along `axis` from `eye`; its middle ray stays straight.
fn straight(axis: usize, eye: [f64; 3], side: usize, focal: f64) -> Camera {
    let mut axes = [DVec3::X, DVec3::Y, DVec3::Z];
    axes.rotate_left(axis);
    // Along -z of its own: against its third column.
    let columns = [-axes[1], axes[2], -axes[0]].map(|column| column.extend(0.0));
    let eye = DVec3::from_array(eye).extend(1.0);
    let to_world = DMat4::from_cols(columns[0], columns[1], columns[2], eye);
    let center = [side as f64 / 2.0; 2];
    let lens = Lens { width: side, height: side, focal: [focal; 2], center };
    Camera { name: String::new(), to_world, lens, picture: None }
}

/// A field of one raw density and colours by chance, without thresholds.
fn scene(nodes: [usize; 3], density: impl Fn([usize; 3]) -> f32) -> RadianceField {
    let density: Vec<f32> = all_nodes(nodes).map(density).collect();
    let mut random = Random::new(1);
    let color: Vec<f32> = (0..3 * density.len()).map(|_| random.between(-4.0, 9.0)).collect();
    let mut field = field(nodes, &density, &color);
    field.scene.march.color_threshold = 0.0;
    field.scene.march.stepsize = 0.1;
    field.scene.march.voxel_size = 0.5;
    field.scene.background = [0.0; 3];
    field
}

/// A place in the box by shares of it; faces are those of the box to the last bit.
fn place(bounds: &Bounds, share: [f64; 3]) -> [f64; 3] {
    let extent = bounds.extent();
    [0, 1, 2].map(|a| match share[a] {
        1.0 => bounds.max[a].into(),
        share => f64::from(bounds.min[a]) + share * extent[a],
    })
}

/// Every hard ray: its name, and the results of the renderer and its reference.
fn rays(mut take: impl FnMut(&str, &Frame, usize, &Pixel)) {
    let mut look = |name: &str, scene: &RadianceField, cameras: &[Camera]| {
        let fast = Renderer::trained(scene, None, &Limits::default()).expect("a field");
        let plain = PlainField::new(fast.view(), finest_level(scene));
        for camera in cameras {
            see(&fast, &plain, camera, |frame, i, pixel| take(name, frame, i, pixel));
        }
    };
    let shift = -4.595_12f32;
    let one = activate::inverse_softplus(1.0) as f32 - shift;
    // 10^5 samples.
    for depth in [1e-3f32, 0.1, 1.0, 5.0, 11.0] {
        for slope in [0.0, 0.25] {
            let mut scene = scene([2; 3], |at| one + slope * at[2] as f32);
            scene.scene.march.stepsize = 3e-5;
            scene.scene.march.voxel_size = 1.0;
            scene.scene.activation.interval = depth * 1e-5;
            let eye = place(&scene.scene.bounds, [0.5, 0.5, -0.5]);
            let name = format!("10^5 samples, optical depth {depth}");
            look(&name, &scene, &[straight(2, eye, 1, 100.0)]);
        }
    }
    // Along faces and edges, and beside them.
    let body = scene([5, 6, 7], |[x, y, z]| ((x * 7 + y * 5 + z * 3) % 11) as f32 - 2.0);
    let mut cameras = Vec::new();
    for axis in 0..3 {
        for (a, b) in SHARES.into_iter().flat_map(|a| SHARES.map(|b| (a, b))) {
            let mut share = [a; 3];
            share[(axis + 1) % 3] = b;
            share[axis] = -0.25;
            cameras.push(straight(axis, place(&body.scene.bounds, share), 3, 1e4));
        }
    }
    look("along a face", &body, &cameras);
    // Intervals and opacities.
    for interval in INTERVALS {
        for raw in [-1e30, -100.0, -27.63, -8.0, 0.0, 9.0, 27.63, 80.0, 1e30f32] {
            let mut scene = scene([3, 2, 5], |_| raw - shift);
            scene.scene.activation.interval = interval;
            let eye = place(&scene.scene.bounds, [0.3, 0.6, -0.5]);
            look(&format!("interval {interval}, {raw}"), &scene, &[straight(2, eye, 3, 20.0)]);
        }
    }
    // Boxes 1:1000.
    for flat in 0..3 {
        let mut nodes = [33; 3];
        nodes[flat] = 2;
        let mut thin = scene(nodes, |[x, y, z]| ((x * 7 + y * 5 + z * 3) % 11) as f32 - 4.0);
        let mut bounds = Bounds { min: [10.0, -5.0, 300.0], max: [11.0, -4.0, 301.0] };
        bounds.max[flat] = bounds.min[flat] + 1e-3;
        thin.scene.bounds = bounds;
        thin.scene.march.stepsize = 0.01;
        thin.scene.march.voxel_size = 0.05;
        let cameras = [0, 1, 2].map(|axis| {
            let mut share = [0.25, 0.5, 0.75];
            share[axis] = -2.0;
            straight(axis, place(&bounds, share), 3, 3e4)
        });
        look("a box 1:1000", &thin, &cameras);
    }
}

/// Fields of the largest numbers that f32 has, all levels, both orders.
pub fn look_at_the_largest(mut take: impl FnMut(&Frame)) {
    for filter in [Filter::RateTent, Filter::Coverage, Filter::Paper] {
        let mut scene = scene([5, 2, 9], |[x, y, z]| [f32::MAX, f32::MIN][(x + y + z / 2) % 2]);
        for interval in [1e-7, 1e5] {
            scene.scene.activation.interval = interval;
            let made = TrainedLevels::of_training(&filter, &scene.scene);
            let fast = Renderer::trained(&scene, Some(made), &Limits::default()).expect("a field");
            for focal in [0.5, 4.0, 100.0] {
                let eye = place(&scene.scene.bounds, [0.3, 0.6, -0.5]);
                let camera = straight(2, eye, 5, focal);
                let frame = render(&fast, &camera, &FrameOptions::default(), &Silent);
                take(&frame.expect("a frame"));
            }
        }
    }
}

/// Positions in the box of rays along an axis: on faces, beside them, between.
const SHARES: [f64; 7] = [0.0, -5e-10, 5e-10, 0.5, 1.0, 1.0 - 5e-10, 1.0 + 5e-10];

/// Renders both ways.
fn see(
    fast: &Renderer,
    plain: &PlainField,
    camera: &Camera,
    mut take: impl FnMut(&Frame, usize, &Pixel),
) {
    let frame = render(fast, camera, &FrameOptions::default(), &Silent).expect("a frame");
    for i in 0..frame.transmittance.len() {
        let at = [i % frame.width, i / frame.width];
        take(&frame, i, &plain.pixel(camera, at, LevelChoice::Auto));
    }
}

/// Relative where rays do not end early.
const LEAST_TRANSMITTANCE: f64 = 2e-5;
/// Relative errors count only above the opacities of 1e-10 that rays may skip.
const LEAST_SUM: f64 = 1e-4;

fn at_least(least: f64, want: f64) -> f64 {
    if want.abs() >= least { want.abs() } else { 0.0 }
}

pub fn transmittance() -> Worst {
    of_rays().0.clone()
}

pub fn accumulated() -> Worst {
    of_rays().1.clone()
}

/// Of light and of sums, which the same rays measure.
fn of_rays() -> &'static (Worst, Worst) {
    static MEASURED: OnceLock<(Worst, Worst)> = OnceLock::new();
    MEASURED.get_or_init(measure_rays)
}

fn measure_rays() -> (Worst, Worst) {
    let (mut light, mut worst) = (Worst::default(), Worst::default());
    rays(|name, frame, i, pixel| {
        let want = pixel.transmittance;
        let at = || format!("{name}, {} for {want}", frame.transmittance[i]);
        let scale = at_least(LEAST_TRANSMITTANCE, want);
        light.take(frame.transmittance[i].into(), want, scale, &at);
        let colors = &frame.accumulated[i * frame.channels..][..frame.channels];
        let sums = colors.iter().zip(&pixel.accumulated);
        for (&got, &want) in sums {
            let at = || format!("{name}, {got} for {want}");
            worst.take(got.into(), want, at_least(LEAST_SUM, want), &at);
        }
        let (got, want) = (frame.distance[i], pixel.distance);
        let far = want.max(1.0);
        let at = || format!("{name}, distance {got} for {want}");
        worst.take(f64::from(got) / far, want / far, at_least(LEAST_SUM, want / far), &at);
    });
    (light, worst)
}

pub fn level_blend() -> Worst {
    let mut worst = Worst::default();
    let nodes = [2, 2, 4096];
    for filter in [Filter::Isotropic, Filter::Coverage, Filter::Paper, Filter::Code] {
        let mut scene = scene(nodes, |at| ((at[2] * 37 + at[0] * 5) % 101) as f32 * 0.2 - 8.0);
        scene.scene.march.stepsize = 0.5;
        scene.scene.march.voxel_size = 0.01;
        let mut made = TrainedLevels::of_training(&filter, &scene.scene);
        made.count = 20;
        made.level_of_detail.bound = None;
        let fast = Renderer::trained(&scene, Some(made), &Limits::default()).expect("a field");
        let plain =
            PlainField::new(fast.view(), trained_levels(&scene, Some((made.filter, made.count))));
        for octave in 0..14 {
            for axis in 0..3 {
                let mut share = [0.4; 3];
                share[axis] = -0.5;
                let eye = place(&scene.scene.bounds, share);
                let camera = straight(axis, eye, 3, 0.7 * 2f64.powi(octave));
                see(&fast, &plain, &camera, |frame, i, pixel| {
                    let name = |what: &str| format!("{filter:?}, octave {octave}, {what}");
                    let got = frame.transmittance[i].into();
                    worst.take(got, pixel.transmittance, 0.0, &|| name("transmittance"));
                    let colors = &frame.accumulated[i * frame.channels..][..frame.channels];
                    for (&got, &want) in colors.iter().zip(&pixel.accumulated) {
                        worst.take(got.into(), want, 0.0, &|| name("colour"));
                    }
                });
            }
        }
    }
    worst
}
