//! Splats: pictures and derivatives against plain float64 code.

use glam::{DMat2, DMat3, DVec2, DVec3};
use mipvog::model::camera::{Camera, Lens};
use mipvog::model::harmonics::basis_f64;
use mipvog_outputs::splat::{GaussianSplat, PARAMETERS, Rules, differentiate, rasterize};

const BACKGROUND: [f32; 3] = [0.9, 0.5, 0.2];
const SIZE: [usize; 2] = [37, 21];

/// Numbers from 0 to 1.
fn noise(seed: &mut u32) -> f32 {
    *seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    (*seed >> 8) as f32 / (1 << 24) as f32
}

/// Splats in a box of 2 around the middle, some of them behind others.
fn splats(count: usize, directional: f32) -> Vec<GaussianSplat> {
    let seed = &mut 5;
    let splat = |_| {
        let mut splat = [0.0; PARAMETERS];
        splat[..3].iter_mut().for_each(|at| *at = 2.0 * noise(seed) - 1.0);
        splat[3] = -3.0 + noise(seed);
        splat[4] = 4.0 * noise(seed) - 2.0;
        splat[5..8].iter_mut().for_each(|color| *color = 2.0 * noise(seed) - 1.0);
        splat[8..].iter_mut().for_each(|color| *color = directional * (noise(seed) - 0.5));
        splat
    };
    (0..count).map(splat).collect()
}

fn camera() -> Camera {
    let back = DVec3::new(0.4, -0.7, 0.3).normalize();
    let lens = Lens::centered(SIZE, 0.4);
    Camera::looking_at(DVec3::new(0.1, 0.0, 0.1), back, 4.0, "plain".to_owned(), lens)
}

/// A picture by the rules, pixel by pixel, splat by splat.
fn plain(splats: &[[f64; PARAMETERS]], camera: &Camera, rules: Rules) -> Vec<[f64; 3]> {
    let axes = camera.to_world;
    let [right, up, back] = [axes.x_axis, axes.y_axis, axes.z_axis].map(|axis| axis.truncate());
    let view = DMat3::from_cols(right, -up, -back).transpose();
    let eye = axes.w_axis.truncate();
    let ([fx, fy], [cx, cy]) = (camera.lens.focal, camera.lens.center);
    let mut shown = Vec::new();
    for splat in splats {
        let away = DVec3::new(splat[0], splat[1], splat[2]) - eye;
        let at = view * away;
        let (u, v) = (at.x / at.z, at.y / at.z);
        // Rows of the projection's derivative.
        let jacobian = [DVec3::new(fx, 0.0, -fx * u) / at.z, DVec3::new(0.0, fy, -fy * v) / at.z];
        let covariance = DMat3::from_diagonal(DVec3::splat((2.0 * splat[3]).exp()));
        let seen = view * covariance * view.transpose();
        let entry = |a: usize, b: usize| jacobian[a].dot(seen * jacobian[b]);
        let ellipse = DMat2::from_cols_array(&[
            entry(0, 0) + 0.3,
            entry(0, 1),
            entry(1, 0),
            entry(1, 1) + 0.3,
        ]);
        let mut color = [0.5; 3];
        let basis = basis_f64(away.normalize().to_array());
        for (function, value) in basis.into_iter().enumerate() {
            for (channel, sum) in color.iter_mut().enumerate() {
                *sum += value * splat[5 + 3 * function + channel];
            }
        }
        let middle = DVec2::new(cx + fx * u, cy + fy * v);
        let opacity = 1.0 / (1.0 + (-splat[4]).exp());
        let depth = if rules.by_distance { away.length() } else { at.z };
        shown.push((depth, middle, ellipse.inverse(), opacity, color.map(|value| value.max(0.0))));
    }
    shown.sort_by(|a, b| a.0.total_cmp(&b.0));
    let pixel = |number: usize| {
        let at = DVec2::new((number % SIZE[0]) as f64 + 0.5, (number / SIZE[0]) as f64 + 0.5);
        let (mut sum, mut passes) = ([0.0; 3], 1.0);
        for (_, middle, inverse, opacity, color) in &shown {
            let off = at - *middle;
            let square = off.dot(*inverse * off);
            let alpha = (opacity * (-0.5 * square).exp()).min(0.99);
            if alpha < 1.0 / 255.0 || square.sqrt() > f64::from(rules.reach) {
                continue;
            }
            if passes * (1.0 - alpha) < 1e-4 {
                break;
            }
            sum.iter_mut().zip(color).for_each(|(sum, own)| *sum += passes * alpha * own);
            passes *= 1.0 - alpha;
        }
        sum.iter_mut().zip(BACKGROUND).for_each(|(sum, own)| *sum += passes * f64::from(own));
        sum
    };
    (0..SIZE[0] * SIZE[1]).map(pixel).collect()
}

fn doubles(splats: &[GaussianSplat]) -> Vec<[f64; PARAMETERS]> {
    splats.iter().map(|splat| splat.map(f64::from)).collect()
}

#[test]
fn pictures_are_those_of_the_plain_rules() {
    for (count, directional, rules) in [
        (0, 0.0, Rules::TRAINING),
        (1, 0.0, Rules::TRAINING),
        (60, 0.8, Rules::TRAINING),
        (900, 0.4, Rules::TRAINING),
        (900, 0.4, Rules::GLTF),
    ] {
        let splats = splats(count, directional);
        let camera = camera();
        let picture = rasterize(&splats, &camera, BACKGROUND, rules).expect("a picture");
        let expected = plain(&doubles(&splats), &camera, rules);
        assert_eq!(picture.color.len(), expected.len());
        let off = picture.color.iter().zip(&expected).map(|(own, expected)| {
            let off = own.iter().zip(expected).map(|(a, b)| (f64::from(*a) - b).abs());
            off.fold(0.0, f64::max)
        });
        let mut off: Vec<f64> = off.collect();
        off.sort_by(f64::total_cmp);
        // An opacity next to a threshold may fall on its other side: a step of 1/255 of a colour.
        assert!(off[off.len() * 99 / 100] < 2e-5, "{count}: {:?}", &off[off.len() - 9..]);
        assert!(off[off.len() - 1] < 0.01, "{count}: {:?}", off.last());
    }
}

#[test]
fn derivatives_are_those_of_the_plain_pictures() {
    let splats = splats(40, 0.0);
    let camera = camera();
    let seed = &mut 11;
    let wanted: Vec<[f32; 3]> =
        (0..SIZE[0] * SIZE[1]).map(|_| [(); 3].map(|()| noise(seed))).collect();
    let error_of = |splats: &[[f64; PARAMETERS]]| {
        let picture = plain(splats, &camera, Rules::TRAINING);
        let pairs = picture.as_flattened().iter().zip(wanted.as_flattened());
        let sum: f64 = pairs.map(|(own, wanted)| (own - f64::from(*wanted)).powi(2)).sum();
        sum / (3 * wanted.len()) as f64
    };
    let (error, by) = differentiate(&splats, &camera, &wanted, BACKGROUND).expect("derivatives");
    let splats = doubles(&splats);
    assert!((error - error_of(&splats)).abs() < 1e-5 * error);
    let by: Vec<GaussianSplat> = by.into_iter().map(|by| by.unwrap_or([0.0; PARAMETERS])).collect();
    // Of positions the change of the ellipse is left out, a tenth at this near a distance; the rest
    // is exact to float32.
    for (parameters, most) in [(0..3, 0.1), (3..4, 2e-3), (4..5, 2e-3), (5..11, 2e-3)] {
        let (mut squares, mut off) = (0.0, 0.0);
        for (number, parameter) in
            (0..splats.len()).flat_map(|number| parameters.clone().map(move |at| (number, at)))
        {
            let moved = |by: f64| {
                let mut splats = splats.clone();
                splats[number][parameter] += by;
                error_of(&splats)
            };
            let step = 1e-6;
            let expected = (moved(step) - moved(-step)) / (2.0 * step);
            squares += expected * expected;
            off += (f64::from(by[number][parameter]) - expected).powi(2);
        }
        let off = (off / squares).sqrt();
        assert!(off < most, "parameters {parameters:?}: {off} off");
    }
}
