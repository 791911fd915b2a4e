//! Plenoxels with background spheres: what they show by their own rules, and their boxes.

use crate::common::boxes::{Boxes, psnr};
use crate::common::models::{Reference, farthest, open, renderer};
use mipvog::base::progress::Silent;
use mipvog::model::camera::Ray;
use mipvog_inputs::{SourceOptions, ViewChoice};

const NAMES: [&str; 2] = ["plenoxels_spheres", "plenoxels_background"];

#[test]
fn spheres_are_seen_as_svox2_shows_them() {
    for name in NAMES {
        let source = open(&format!("{name}.npz"), &SourceOptions::default()).expect(name);
        assert!(source.is_unbounded);
        let (model, reference) = (renderer(&source), Reference::of(name));
        let light = model.ray_colors(&reference.rays(), 0, &Silent).expect("rays");
        let rgb = farthest(light.iter().flat_map(|ray| ray.color), &reference.values("rgb"));
        let left =
            farthest(light.iter().map(|r| r.transmittance), &reference.values("transmittance"));
        assert!(rgb < 2e-6 && left < 2e-6, "{name}: colours {rgb}, transmittance {left}");
    }
}

#[test]
fn the_own_box_keeps_the_values_of_the_model() {
    let plain = SourceOptions::default();
    let alone = SourceOptions { drop_background: true, ..plain.clone() };
    let [whole, alone] = [&plain, &alone].map(|options| open("plenoxels_spheres.npz", options));
    let (whole, alone) = (whole.expect("a world"), alone.expect("a box"));
    assert!(alone.assumptions.iter().any(|assumption| assumption.key == "background_data"));
    let (cells, nodes) = (16, whole.field.scene.nodes.0);
    let (beyond, side) = (cells / 2 + 1, 2 * cells + 2);
    assert_eq!((nodes, alone.field.scene.nodes.0), ([side; 3], [cells + 2; 3]));
    let plane = |field: &mipvog::model::field::RadianceField, channel: usize, x: usize| {
        let ny = field.scene.nodes.0[1];
        let mut values = vec![0.0; ny * ny];
        let grid = if channel == 0 { &field.density } else { &field.color[0] };
        grid.read_plane(channel.saturating_sub(1), x, &mut values, |_| {}).expect("a plane");
        values
    };
    let mut compared = 0;
    for channel in [0, 1, 5, 12] {
        for x in 0..cells {
            let own = plane(&alone.field, channel, x + 1);
            let all = plane(&whole.field, channel, x + beyond);
            for y in 0..cells {
                for z in 0..cells {
                    let at = [x, y, z].map(|at| (2.0 * at as f64 + 1.0) / cells as f64 - 1.0);
                    if at.iter().map(|at| at * at).sum::<f64>().sqrt() > 0.78 {
                        continue;
                    }
                    let found = all[(y + beyond) * side + z + beyond];
                    let expected = own[(y + 1) * (cells + 2) + z + 1];
                    assert!(found == expected, "{channel} at {x} {y} {z}: {found} {expected}");
                    compared += usize::from(found != 0.0);
                }
            }
        }
    }
    assert!(compared > 1000, "{compared}");
}

#[test]
fn boxes_hold_what_is_behind() {
    let source = open("plenoxels_spheres.npz", &SourceOptions::default()).expect("a world");
    // 18 spheres, the last one at 36 half edges; the first box reaches 2 of them.
    let lattices = source.field.lattices();
    assert_eq!(lattices.len(), 5, "{lattices:?}");
    let rays: Vec<Ray> = Reference::of("plenoxels_spheres").rays();
    let own = renderer(&source).ray_colors(&rays, 0, &Silent).expect("rays");
    let own: Vec<[f64; 3]> = own.iter().map(|ray| ray.color.map(f64::from)).collect();
    for (options, least) in [
        (SourceOptions::default(), 40.0),
        (SourceOptions { resolution: Some(41), ..SourceOptions::default() }, 33.0),
        (SourceOptions { extent: Some(4.0), ..SourceOptions::default() }, 14.0),
    ] {
        let source = open("plenoxels_spheres.npz", &options).expect("a world");
        let boxes = Boxes::read(&source.field, true);
        let seen: Vec<_> = rays.iter().map(|ray| boxes.follow(ray).0).collect();
        let [all, most] = psnr(&seen, &own);
        eprintln!("{:?}: {all:.1} dB, {most:.1} without the worst", options.resolution);
        assert!(all > least, "{all}");
        if options.extent.is_some() {
            assert_eq!(source.field.lattices().len(), 2);
        }
    }
}

#[test]
fn densities_fall_with_the_square_of_the_radius() {
    let source = open("plenoxels_spheres.npz", &SourceOptions::default()).expect("a world");
    let model = renderer(&source);
    // Straight up, the last layers are the sky alone.
    let density = |y: f64| f64::from(model.sample([0.0, y, 0.0], 0).expect("a point").density);
    assert_eq!(density(2.0), 0.0);
    for (radius, layer) in [(12.0, 6.833_333), (20.0, 7.0), (30.0, 7.0)] {
        let share: f64 = layer - 6.0;
        let expected = 90.0 * share / (radius * radius);
        let off = (density(radius) / expected - 1.0).abs();
        assert!(off < 1e-5, "{radius}: {} {expected}", density(radius));
    }
    assert_eq!(density(37.0), 0.0, "behind the last sphere");
}

#[test]
fn colours_without_a_view_are_those_of_the_lowest_band() {
    let options = SourceOptions { view: ViewChoice::None, ..SourceOptions::default() };
    let source = open("plenoxels_spheres.npz", &options).expect("a world");
    assert_eq!((source.field.color_channels(), source.field.view), (3, None));
    assert!(source.field.shells.iter().all(|shell| shell.color[0].channels() == 3));
}
