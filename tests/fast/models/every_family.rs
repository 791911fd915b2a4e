//! What holds for models of every family alike: the same bytes from any number of threads, rays from
//! anywhere that come to an end, and a place in the documentation, the fuzz targets and the schema.

use std::collections::BTreeSet;
use std::path::Path;

use crate::common::families::{self, models, open};
use crate::common::models::renderer;
use crate::common::pages::{anchors, text};
use crate::common::{folder, root};
use glam::DVec3;
use mipvog::base::progress::Silent;
use mipvog::model::camera::Ray;
use mipvog_inputs::Family;

/// Distances from which rays come.
const DISTANCES: [f64; 5] = [0.0, 1e6, 1e12, 1e16, 1e25];

/// `tests/slow/every_family.rs` bakes them many times.
#[test]
fn bytes_do_not_depend_on_threads() {
    families::bytes_do_not_depend_on_threads(&[1, 16], 1);
}

#[test]
fn rays_from_anywhere_come_to_an_end() {
    let here = folder();
    for (family, path) in models(here.path()) {
        let model = renderer(&open(family, &path));
        let bounds = model.view().bounds;
        let middle = DVec3::from(
            [0, 1, 2].map(|axis| 0.5 * (f64::from(bounds.min[axis]) + f64::from(bounds.max[axis]))),
        );
        let ways = [
            DVec3::new(1.0, 1.0, 1.0),
            DVec3::new(1.0, 0.0, 0.0),
            DVec3::new(0.0, -1.0, 1e-9),
            DVec3::new(-0.3, 0.8, 0.5),
        ];
        let rays = DISTANCES.iter().flat_map(|&distance| {
            ways.iter().map(move |way| {
                let direction = way.normalize();
                Ray { origin: middle - distance * direction, direction }
            })
        });
        let rays: Vec<Ray> = rays.collect();
        let light = model.ray_colors(&rays, 0, &Silent).expect("rays");
        for (ray, light) in rays.iter().zip(light) {
            assert!(
                light.color.iter().all(|value| value.is_finite())
                    && (0.0..=1.0).contains(&light.transmittance),
                "{}: {light:?} along {ray:?}",
                path.display()
            );
        }
    }
}

#[test]
fn a_row_names_the_section_the_fuzz_target_and_the_schema_s_entry() {
    let pages = ["docs/models.md", "docs/inputs.md"].map(|page| text(Path::new(page)));
    let sections: BTreeSet<String> = pages.iter().flat_map(|page| anchors(page)).collect();
    let schema = std::fs::read_to_string(root().join("formats/inspect.schema.json"));
    let schema: serde_json::Value = serde_json::from_str(&schema.expect("a schema")).expect("JSON");
    let entries = schema["$defs"]["Family"]["oneOf"].as_array().expect("families");
    let mut entries: BTreeSet<&str> =
        entries.iter().map(|entry| entry["const"].as_str().expect("a name")).collect();
    let here = folder();
    let tried = models(here.path());
    for row in mipvog_inputs::registered() {
        let name = serde_json::to_value(row.family).expect("a name");
        let name = name.as_str().expect("text");
        assert!(entries.remove(name), "{name} is not in formats/inspect.schema.json");
        assert!(sections.contains(row.docs), "no section {} for {name}", row.docs);
        assert!(pages[0].contains(&format!("`{name}`")), "docs/models.md has no {name}");
        let target = root().join(format!("fuzz/fuzz_targets/{}.rs", row.fuzz));
        assert!(target.exists(), "no fuzz target {} for {name}", row.fuzz);
        // torch-ngp's networks are Instant-NGP's; `ngp.rs` reads its files.
        let is_tried =
            row.family == Family::TorchNgp || tried.iter().any(|(family, _)| *family == row.family);
        assert!(is_tried, "tests/support/src/families.rs has no model of {name}");
    }
    assert!(entries.is_empty(), "no rows for {entries:?}");
}
