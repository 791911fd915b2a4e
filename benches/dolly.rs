//! Shows popping levels: a camera moves away from the box, from the distance at which the box fills
//! the picture to 16 times that, 30 frames for each doubling.
//!
//! ```text
//! cargo bench --bench dolly -- [SCENE] [--made-up NAME] [--side PIXELS] [--filters NAME,...]
//!                              [--shifts N] [--svg FILE] [--stepsize S] [--near T] [--far T]
//! ```
//!
//! Each frame, one ray a pixel, is compared with the unbaked scene at 4x4 rays a pixel. Pixels that
//! show nothing do not count. Every frame has pictures from the same 8 directions around the box. Far
//! away few pixels count, and their positions are noise of a decibel or two. So each direction has
//! `--shifts` pictures, whose pixels lie at different places, and a frame at n times the distance has
//! at least `--shifts` times n^2 in all. Prints the curve of errors in dB, one column a filter, and
//! the largest second difference of each: a level that pops is a kink. `--svg` draws the curves.
//! Without arguments the scene is `fixtures/trained/lego64`.

mod arguments;
use mipvog_testing as common;
mod made_up;

use std::fmt::Write;

use arguments::{Arguments, number};
use common::{baked_bytes, open_bytes};
use glam::DVec3;
use mipvog::bake::{BakeOptions, Filter};
use mipvog::base::limits::Limits;
use mipvog::base::progress::Silent;
use mipvog::model::camera::{Camera, Lens, turntable};
use mipvog::model::field::RadianceField;
use mipvog::model::grid::Bounds;
use mipvog::view::render::{Frame, FrameOptions, LevelChoice, Renderer, render};

const FRAMES: usize = 121;
const FARTHEST: f64 = 16.0;
const SUPERSAMPLE: usize = 4;
/// Directions that each frame is taken from.
const DIRECTIONS: usize = 8;
/// Pictures from each direction, at least, unless `--shifts` says another number.
const SHIFTS: usize = 4;
/// Steps from one shift of pixels to the next, in pixels along x and y: the R2 sequence, which is
/// even in two dimensions for any count (Roberts 2018).
const SHIFT: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053_3];
/// A pixel shows something from this opacity on.
const LEAST_OPACITY: f32 = 1e-3;

fn main() {
    let arguments = Arguments::read(&["--made-up", "--side", "--filters", "--shifts", "--svg"]);
    let field = arguments.own("--made-up").map_or_else(|| arguments.field(), made_up::scene);
    let names = arguments.own("--filters").unwrap_or("rate-tent,fit,coverage,paper,code");
    let filters: Vec<Filter> = names
        .split(',')
        .map(|name| name.parse().unwrap_or_else(|error| panic!("{name}: {error}")))
        .collect();
    let side = arguments.own("--side").map_or(400, number);
    let shifts = arguments.own("--shifts").map_or(SHIFTS, number);
    let cameras = dolly(&field.scene.bounds, side, shifts);
    let unbaked = unbounded(Renderer::trained(&field, None, &Limits::default()).expect("a field"));
    let options = FrameOptions { levels: LevelChoice::Fixed(0), supersample: SUPERSAMPLE };
    let frame = |camera: &Camera| render(&unbaked, camera, &options, &Silent).expect("a frame");
    let references: Vec<Vec<Frame>> =
        cameras.iter().map(|cameras| cameras.iter().map(frame).collect()).collect();
    let curves: Vec<Vec<f64>> =
        filters.iter().map(|&filter| curve(&field, filter, &cameras, &references)).collect();
    print(&filters, &curves);
    if let Some(path) = arguments.own("--svg") {
        std::fs::write(path, svg(&filters, &curves)).expect("a file that can be written");
    }
}

/// Distance of frame `i`.
fn distance(i: usize) -> f64 {
    FARTHEST.powf(i as f64 / (FRAMES - 1) as f64)
}

/// The cameras, frame by frame. Pictures are cut to the box's rectangle.
fn dolly(bounds: &Bounds, side: usize, least: usize) -> Vec<Vec<Camera>> {
    let corner = |corner: [f32; 3]| DVec3::from_array(corner.map(f64::from));
    let middle = 0.5 * (corner(bounds.min) + corner(bounds.max));
    let moved = |mut camera: Camera, distance: f64, shift: usize| {
        let place = camera.to_world.w_axis.truncate();
        camera.to_world.w_axis = (middle + (place - middle) * distance).extend(1.0);
        // Even, so that pixels do not jump by half of their width.
        let pixels = 2 * (0.5 * side as f64 / distance * 1.1).ceil() as usize;
        let shifted = |step: f64| (0.5 + step * shift as f64).fract() - 0.5;
        let center = SHIFT.map(|step| 0.5 * pixels as f64 + shifted(step));
        camera.lens = Lens { width: pixels, height: pixels, center, ..camera.lens };
        camera
    };
    let directions = turntable(bounds, DIRECTIONS, [side; 2]);
    let frame = |i: usize| {
        let distance = distance(i);
        let shifts = (least as f64 * distance.powi(2) / DIRECTIONS as f64).ceil() as usize;
        let shifts = shifts.max(least);
        let pictures = directions.iter().flat_map(|camera| (0..shifts).map(move |i| (camera, i)));
        pictures.map(|(camera, shift)| moved(camera.clone(), distance, shift)).collect()
    };
    (0..FRAMES).map(frame).collect()
}

/// Removes training's near and far planes: they would cut off a distant box.
fn unbounded(mut field: Renderer) -> Renderer {
    (field.view_mut().march.near, field.view_mut().march.far) = (0.0, None);
    field
}

/// PSNR of each frame over the pixels that show something.
fn curve(
    field: &RadianceField,
    filter: Filter,
    cameras: &[Vec<Camera>],
    references: &[Vec<Frame>],
) -> Vec<f64> {
    let options = BakeOptions { filter: filter.into(), ..BakeOptions::default() };
    let bytes = baked_bytes(field, &options).expect("a bake");
    let baked = open_bytes(&bytes).expect("a container").read().expect("levels");
    let baked = unbounded(Renderer::baked(&baked, &Limits::default()).expect("a field"));
    let psnr = |(cameras, references): (&Vec<Camera>, &Vec<Frame>)| {
        let (mut sum, mut count) = (0.0, 0);
        for (camera, reference) in cameras.iter().zip(references) {
            let frame = render(&baked, camera, &FrameOptions::default(), &Silent);
            let frame = frame.expect("a frame");
            for (i, (got, want)) in frame.color.iter().zip(&reference.color).enumerate() {
                if reference.transmittance[i] > 1.0 - LEAST_OPACITY {
                    continue;
                }
                let error = |c: usize| f64::from(got[c].clamp(0.0, 1.0) - want[c].clamp(0.0, 1.0));
                sum += (0..3).map(|c| error(c).powi(2)).sum::<f64>();
                count += 3;
            }
        }
        -10.0 * (sum / f64::from(count.max(1))).log10()
    };
    cameras.iter().zip(references).map(psnr).collect()
}

/// The largest second difference of a curve.
fn kink(curve: &[f64]) -> f64 {
    let second = |three: &[f64]| (three[0] - 2.0 * three[1] + three[2]).abs();
    curve.windows(3).map(second).fold(0.0, f64::max)
}

fn print(filters: &[Filter], curves: &[Vec<f64>]) {
    let names: Vec<&str> = filters.iter().map(|filter| filter.label()).collect();
    println!("distance,{}", names.join(","));
    for i in 0..FRAMES {
        let errors: Vec<String> = curves.iter().map(|curve| format!("{:.2}", curve[i])).collect();
        println!("{:.2},{}", distance(i), errors.join(","));
    }
    for (name, curve) in names.iter().zip(curves) {
        println!("{name}: largest second difference {:.2} dB", kink(curve));
    }
}

/// Curves over the logarithm of distance.
fn svg(filters: &[Filter], curves: &[Vec<f64>]) -> String {
    const COLORS: [&str; 6] = ["#0b6e99", "#c2410c", "#4d7c0f", "#7c3aed", "#6b7280", "#be185d"];
    let [left, right, top, bottom] = [48.0, 640.0, 16.0, 300.0];
    let all = || curves.iter().flatten().copied();
    let low = all().fold(f64::MAX, f64::min).floor();
    let high = all().fold(f64::MIN, f64::max).ceil();
    let x = |i: usize| left + (right - left) * i as f64 / (FRAMES - 1) as f64;
    let y = |psnr: f64| bottom - (bottom - top) * (psnr - low) / (high - low);
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 760 340\" \
         font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"760\" height=\"340\" \
         fill=\"#fff\"/>\n",
    );
    for octave in 0..=4 {
        let x = left + (right - left) * f64::from(octave) / 4.0;
        writeln!(svg, "<path d=\"M{x:.1} {top}V{bottom}\" stroke=\"#ddd\"/>").ok();
        let label = format!("{}x", 1 << octave);
        writeln!(svg, "<text x=\"{x:.1}\" y=\"318\" text-anchor=\"middle\">{label}</text>").ok();
    }
    let mut tick = (low / 5.0).ceil() * 5.0;
    while tick <= high {
        let y = y(tick);
        writeln!(svg, "<path d=\"M{left} {y:.1}H{right}\" stroke=\"#ddd\"/>").ok();
        let at = y + 4.0;
        writeln!(svg, "<text x=\"42\" y=\"{at:.1}\" text-anchor=\"end\">{tick}</text>").ok();
        tick += 5.0;
    }
    writeln!(svg, "<text x=\"344\" y=\"335\" text-anchor=\"middle\">distance</text>").ok();
    writeln!(svg, "<text x=\"8\" y=\"12\">dB</text>").ok();
    for (i, (filter, curve)) in filters.iter().zip(curves).enumerate() {
        let color = COLORS[i % COLORS.len()];
        let points: Vec<String> =
            curve.iter().enumerate().map(|(i, &p)| format!("{:.1},{:.1}", x(i), y(p))).collect();
        let points = points.join(" ");
        writeln!(
            svg,
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>"
        )
        .ok();
        let (name, at) = (filter.label(), top + 14.0 + 18.0 * i as f64);
        writeln!(svg, "<text x=\"650\" y=\"{at}\" fill=\"{color}\">{name}</text>").ok();
    }
    svg + "</svg>\n"
}
