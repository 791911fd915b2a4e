//! `probe`: given rays see what pictures show, given points what samples hold.

use std::collections::BTreeMap;
use std::path::Path;

use crate::common::{assert_schema, fixture, folder, program};
use mipvog::base::limits::{Budget, Limits};
use mipvog::container::Container;
use mipvog::model::camera::turntable;
use mipvog::model::directional::color_from;
use mipvog::model::view_dependence::ViewDependence;
use mipvog::view::render::{FrameOptions, LevelChoice, Renderer, render};
use mipvog_inputs::tensor::{self, Row, Value, safetensors_header};

/// Names and rows.
type Tensors = Vec<(&'static str, Vec<[f32; 3]>)>;

/// Writes float32 tensors of rows of three.
fn write(path: &Path, tensors: &[(&str, Vec<[f32; 3]>)]) {
    let rows: Vec<Row> = tensors
        .iter()
        .map(|(name, rows)| Row::new((*name).to_owned(), "F32", &[rows.len(), 3]).expect("small"))
        .collect();
    let header = safetensors_header(&BTreeMap::new(), &rows);
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.into_bytes());
    let values = tensors.iter().flat_map(|(_, rows)| rows.as_flattened());
    bytes.extend(values.flat_map(|value| value.to_le_bytes()));
    std::fs::write(path, bytes).expect("writable");
}

fn read(path: &Path) -> impl Fn(&str) -> (Vec<u64>, Vec<f32>) + use<> {
    let file = tensor::open(path, &Limits::default()).expect("tensors");
    move |name: &str| {
        let found = file.root.get(name).and_then(Value::tensor).expect("a tensor");
        let values = found.read_f32(&mut Budget::new(&Limits::default())).expect("values");
        (found.shape().to_vec(), values)
    }
}

#[test]
fn rays_see_what_pictures_show_and_points_hold_what_samples_do() {
    let folder = folder();
    let here = folder.path();
    let path = fixture("baked/tiny.rate.f16.mipvog");
    let container = Container::open_path(&path, &Limits::default()).expect("a container");
    let renderer = Renderer::of_container(&container).expect("a field");
    for level in [0, 2] {
        let camera = &turntable(&renderer.view().bounds, 3, [23, 17])[1];
        let rays: Vec<_> = (0..17 * 23)
            .map(|pixel| camera.ray((pixel % 23) as f64 + 0.5, (pixel / 23) as f64 + 0.5))
            .collect();
        let single = |vector: [f64; 3]| vector.map(|value| value as f32);
        let bounds = renderer.view().bounds;
        let share = |axis: usize, share: f32| {
            bounds.min[axis] + share * (bounds.max[axis] - bounds.min[axis])
        };
        let positions: Vec<[f32; 3]> = (0..90)
            .map(|i| [0, 1, 2].map(|axis| share(axis, (i * 7 % 23) as f32 / 20.0)))
            .collect();
        let directions = vec![[0.0, 0.6, -0.8], [1.0, 0.0, 0.0]];
        let tensors = [
            ("origins", rays.iter().map(|ray| single(ray.origin.to_array())).collect()),
            (
                "directions",
                rays.iter().map(|ray| single(ray.direction.normalize().to_array())).collect(),
            ),
            ("positions", positions.clone()),
            ("view_directions", directions.clone()),
        ];
        write(&here.join("rays.safetensors"), &tensors);
        let output = program()
            .current_dir(here)
            .arg("probe")
            .arg(&path)
            .args(["--rays", "rays.safetensors", "-o", "out.safetensors", "--positions"])
            .args(["--force", "--format", "json", "--level-of-detail", &level.to_string()])
            .output()
            .expect("starts");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let report = serde_json::from_slice(&output.stdout).expect("JSON");
        assert_schema("probe", &report);
        assert_eq!((&report["rays"], &report["positions"]), (&391.into(), &90.into()));

        let found = read(&here.join("out.safetensors"));
        let options = FrameOptions { levels: LevelChoice::Fixed(level), supersample: 1 };
        let silent = mipvog::base::progress::Silent;
        let frame = render(&renderer, camera, &options, &silent).expect("a picture");
        let near = |found: &[f32], want: &[f32]| {
            assert_eq!(found.len(), want.len());
            for (found, want) in found.iter().zip(want) {
                // Directions were rounded to float32.
                assert!((found - want).abs() < 2e-4, "{found} for {want}");
            }
        };
        let (shape, colors) = found("rgb");
        assert_eq!(shape, [391, 3]);
        near(&colors, frame.color.as_flattened());
        near(&found("transmittance").1, &frame.transmittance);
        near(&found("depth").1, &frame.distance);
        assert!(frame.transmittance.iter().any(|&left| left < 0.5), "the camera misses the scene");

        let (shape, colors) = found("color");
        assert_eq!(shape, [90, 2, 3]);
        for (i, position) in positions.iter().enumerate() {
            let position = position.map(f64::from);
            let sample = renderer.sample(position, level).expect("a sample");
            assert_eq!(found("density").1[i], sample.density);
            let network = renderer
                .view()
                .view_dependence
                .as_ref()
                .and_then(ViewDependence::network)
                .expect("a network");
            for (j, direction) in directions.iter().enumerate() {
                let direction = direction.map(f64::from);
                let diffuse = color_from(sample.color, sample.directional, direction);
                let inside = [&diffuse[..], &sample.features].concat();
                let added = network.colors(&[direction], &[&inside])[0];
                for channel in 0..3 {
                    let want = diffuse[channel] + added[channel];
                    assert!((colors[(i * 2 + j) * 3 + channel] - want).abs() < 1e-6);
                }
            }
        }
    }
}

#[test]
fn rays_that_cannot_be_are_refused() {
    let folder = folder();
    let here = folder.path();
    let field = fixture("baked/tiny.rate.f16.mipvog").display().to_string();
    let up = vec![[0.0, 0.0, 1.0]; 2];
    let cases: [(&str, Tensors, &[&str], i32, &str); 8] = [
        ("no origins", vec![("directions", up.clone())], &[], 3, "origins"),
        (
            "counts",
            vec![("origins", up[..1].to_vec()), ("directions", up.clone())],
            &[],
            3,
            "1 orig",
        ),
        (
            "length",
            vec![("origins", up.clone()), ("directions", vec![[0.5; 3]; 2])],
            &[],
            3,
            "row 0",
        ),
        (
            "nan",
            vec![("origins", vec![[f32::NAN; 3]; 2]), ("directions", up.clone())],
            &[],
            3,
            "NaN",
        ),
        (
            "no positions",
            vec![("origins", up.clone()), ("directions", up.clone())],
            &["--positions"],
            3,
            "positions",
        ),
        (
            "level",
            vec![("origins", up.clone()), ("directions", up.clone())],
            &["--level-of-detail", "9"],
            2,
            "0 to 3",
        ),
        (
            "memory",
            vec![("origins", up.clone()), ("directions", up.clone())],
            &["--limit", "memory=20"],
            6,
            "raise --limit",
        ),
        ("name", vec![("origins", up.clone())], &["-o", "x.png"], 2, "safetensors"),
    ];
    for (name, tensors, more, code, says) in cases {
        write(&here.join("rays.safetensors"), &tensors);
        let mut probe = program();
        probe.current_dir(here).args(["probe", &field, "--rays", "rays.safetensors"]).args(more);
        if !more.contains(&"-o") {
            probe.args(["-o", "out.safetensors"]);
        }
        let output = probe.output().expect("starts");
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{name}: {message}");
        assert!(message.contains(says), "{name}: {message}");
        assert!(!here.join("out.safetensors").exists(), "{name}");
    }
}
