//! Worlds that are cut, without their checkpoint.

use mipvog::bake::{BakeOptions, Changes};
use mipvog::base::limits::Limits;
use mipvog::container::Container;
use mipvog::model::baked::BakedField;
use mipvog::model::camera::Camera;
use mipvog::model::grid::Bounds;
use mipvog::unpacked::Unpacked;
use mipvog::view::render::Renderer;
use mipvog_testing::world::world;
use mipvog_testing::{open_bytes, packed};

use super::nested::baked;

fn changed(container: &Container, changes: &Changes) -> Container {
    let unpacked = Unpacked::of_container(container).expect("levels");
    let bytes = packed(&unpacked, changes).expect("packed");
    let container = open_bytes(&bytes).expect("a container");
    container.read().expect("a field").check().expect("levels that fit");
    container
}

fn refused(container: &Container, changes: &Changes, words: &str) {
    let unpacked = Unpacked::of_container(container).expect("levels");
    let error = packed(&unpacked, changes).expect_err("refused").to_string();
    assert!(error.contains(words), "{error}");
}

/// Pictures from inside and from beyond the second box.
fn pictures(field: &BakedField) -> Vec<Vec<[f32; 3]>> {
    let renderer = Renderer::baked(field, &Limits::default()).expect("a renderer");
    let ways = [([-0.6, -0.4, 0.2], [1.0, 0.2, 0.0]), ([0.3, 0.2, 2.7], [0.1, 0.0, -1.0])];
    let picture = |(from, to)| {
        let camera = Camera::look_at(from, to, 70.0, [48; 2]).expect("a camera");
        renderer.picture(&camera).expect("a picture").color
    };
    ways.into_iter().map(picture).collect()
}

#[test]
fn outermost_boxes_go_and_the_rest_stays() {
    let container = baked(&world(33, 3), &BakeOptions::default());
    let whole = container.read().expect("a field");
    let boxes = container.metadata().boxes();
    for count in 1..=3 {
        let changes = Changes { without_outermost: count, ..Changes::default() };
        let fewer = changed(&container, &changes);
        let metadata = fewer.metadata();
        assert_eq!(metadata.boxes(), boxes[..boxes.len() - count]);
        assert_eq!(metadata.levels.len(), 5 - count);
        let fewer = fewer.read().expect("a field");
        let [whole, fewer] = [&whole, &fewer]
            .map(|field| Renderer::baked(field, &Limits::default()).expect("a renderer"));
        let mut dense = 0;
        let last = boxes[boxes.len() - 1 - count];
        for place in 0..1000 {
            let at: [f64; 3] = [place / 100, place / 10 % 10, place % 10].map(|at| {
                let share = (f64::from(at) + 0.43) / 10.0;
                f64::from(boxes[0].min[0]) * 8.0 * (1.0 - 2.0 * share)
            });
            let inside = (0..3).all(|axis| {
                (f64::from(last.min[axis])..=f64::from(last.max[axis])).contains(&at[axis])
            });
            let [before, found] =
                [&whole, &fewer].map(|renderer| renderer.sample(at, 0).expect("a place").density);
            assert_eq!(found, if inside { before } else { 0.0 }, "{at:?}");
            dense += usize::from(found > 0.0);
        }
        assert!(dense > 3, "{dense}");
    }
    let more = Changes { without_outermost: 4, ..Changes::default() };
    refused(&container, &more, "at most 3: the boxes around the inner one");
    let one = changed(&container, &Changes { without_outermost: 3, ..Changes::default() });
    assert!(one.metadata().shells.is_empty());
    let more = Changes { without_outermost: 1, ..Changes::default() };
    refused(&one, &more, "a container of nested boxes");
}

#[test]
fn a_cut_world_shows_what_is_left_of_it() {
    let container = baked(&world(33, 3), &BakeOptions::default());
    for crop in [
        // Off the middle, and beside the innermost box.
        Bounds { min: [-1.9, -0.3, -2.5], max: [2.2, 0.9, 1.1] },
        Bounds { min: [1.3, -1.6, -1.7], max: [1.9, 1.8, 1.5] },
    ] {
        let cut = changed(&container, &Changes { crop: Some(crop), ..Changes::default() });
        let metadata = cut.metadata();
        assert!(metadata.shells.len() < 3 && !metadata.shells.is_empty());
        let kept = metadata.march.sampled.expect("a part that is sampled");
        for axis in 0..3 {
            assert!(kept.min[axis] <= crop.min[axis] && kept.max[axis] >= crop.max[axis]);
            let [wider, width] = [&kept, &crop].map(|own| own.max[axis] - own.min[axis]);
            assert!(wider < width + 0.2, "{kept:?}");
        }
        assert!(blocks(&cut) < blocks(&container) * 3 / 4);
        // The same part of the file without the boxes that went, whose blocks are all there.
        let dropped = 3 - metadata.shells.len();
        let whole = Changes { without_outermost: dropped, ..Changes::default() };
        let mut whole = changed(&container, &whole).read().expect("a field");
        whole.metadata.march.sampled = Some(kept);
        assert_eq!(pictures(&whole), pictures(&cut.read().expect("a field")));
    }
    // Within the innermost box no other is left.
    let inner = Bounds { min: [-0.5; 3], max: [0.5, 0.4, 0.3] };
    let cut = changed(&container, &Changes { crop: Some(inner), ..Changes::default() });
    assert!(cut.metadata().shells.is_empty() && cut.metadata().free_space);
    let beyond = Bounds { min: [100.0; 3], max: [101.0; 3] };
    refused(&container, &Changes { crop: Some(beyond), ..Changes::default() }, "crop");
    // All of it is what it was.
    let all = Bounds { min: [-1e3; 3], max: [1e3; 3] };
    let same = changed(&container, &Changes { crop: Some(all), ..Changes::default() });
    assert_eq!(same.metadata(), container.metadata());
}

#[test]
fn a_world_fits_into_a_size_with_all_its_levels() {
    let container = baked(&world(33, 2), &BakeOptions::default());
    let most = container.file().length() * 17 / 20;
    let small = changed(&container, &Changes { max_bytes: Some(most), ..Changes::default() });
    assert!(small.file().length() <= most);
    assert_eq!(small.metadata().boxes(), container.metadata().boxes());
    refused(&container, &Changes { max_bytes: Some(3000), ..Changes::default() }, "max_bytes");
}

fn blocks(container: &Container) -> usize {
    container.metadata().parts().map(|part| part.blocks_stored).sum()
}
