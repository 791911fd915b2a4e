use super::super::transforms;
use super::*;

const CAMERAS: &str = "# Camera list\n1 PINHOLE 40 30 50 52 20 15\n\
                       7 OPENCV 20 10 25 26 10 5 0.1 0 0 0\n2 OPENCV_FISHEYE 8 8 4 4 4 4 0 0 0 0\n";

/// The file of images, of rotations about axes of the world, with and without points.
fn images() -> String {
    let root = 0.5f64.sqrt();
    format!(
        "# Image list\n3 1 0 0 0 1 2 3 1 a/first.png\n1.5 2.5 -1 4 4 7\n\
         4 {root} {root} 0 0 0 0 5 7 second one.png\n\n5 1 0 0 0 0 0 0 2 third.png\n\n"
    )
}

/// The same, as binary files.
fn binary(folder: &Path) {
    let mut cameras = 2u64.to_le_bytes().to_vec();
    for (number, model, size, parameters) in [
        (1u32, 1i32, [40u64, 30], &[50.0f64, 52.0, 20.0, 15.0][..]),
        (7, 4, [20, 10], &[25.0, 26.0, 10.0, 5.0, 0.1, 0.0, 0.0, 0.0]),
    ] {
        cameras.extend(number.to_le_bytes());
        cameras.extend(model.to_le_bytes());
        cameras.extend(size.map(u64::to_le_bytes).concat());
        parameters.iter().for_each(|value| cameras.extend(value.to_le_bytes()));
    }
    std::fs::write(folder.join("cameras.bin"), cameras).expect("a file");
    let root = 0.5f64.sqrt();
    let mut images = 2u64.to_le_bytes().to_vec();
    for (pose, camera, name, points) in [
        ([1.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0], 1u32, "a/first.png", 2u64),
        ([root, root, 0.0, 0.0, 0.0, 0.0, 5.0], 7, "second one.png", 0),
    ] {
        images.extend(9u32.to_le_bytes());
        pose.iter().for_each(|value: &f64| images.extend(value.to_le_bytes()));
        images.extend(camera.to_le_bytes());
        images.extend(name.bytes().chain([0]));
        images.extend(points.to_le_bytes());
        images.extend(vec![7; 24 * points as usize]);
    }
    std::fs::write(folder.join("images.bin"), images).expect("a file");
}

#[test]
fn text_and_binary_models_have_the_same_cameras() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("cameras.txt"), CAMERAS).expect("a file");
    std::fs::write(folder.path().join("images.txt"), images()).expect("a file");
    binary(folder.path());
    let read = |name: &str| {
        let path = folder.path().join(name);
        transforms::read(&path, None, &Limits::default()).expect("cameras")
    };
    let names = ["first".to_owned(), "second one".to_owned()];
    let of_text = read("images.txt").pick(&names).expect("cameras");
    let of_bytes = read("cameras.bin").pick(&names).expect("cameras");
    assert_eq!(of_text.cameras, of_bytes.cameras);
    assert_eq!(of_text.warnings, of_bytes.warnings);
    assert!(of_text.warnings[0].contains("frame second one: distortion of the lens (k1)"));
    let [first, second] = of_text.cameras.as_slice() else { panic!("two cameras") };
    // The world is not rotated, so the camera looks along its z axis, upside down.
    assert_eq!(first.to_world.w_axis.truncate(), DVec3::new(-1.0, -2.0, -3.0));
    let ray = first.ray(20.0, 15.0);
    assert_eq!(ray.direction, DVec3::Z);
    assert_eq!(first.ray(20.0, 67.0).direction, DVec3::new(0.0, 1.0, 1.0), "downwards is y");
    // A quarter turn about x moves y to z: the camera looks along y, from 5 before 0.
    assert!((second.to_world.w_axis.truncate() - DVec3::new(0.0, -5.0, 0.0)).length() < 1e-12);
    assert!((second.ray(10.0, 5.0).direction - DVec3::Y).length() < 1e-12);
    assert_eq!(second.lens.focal, [25.0, 26.0]);
    // Lenses that are not pinholes are refused when they are selected.
    let error = read("images.txt").pick(&["third".to_owned()]).expect_err("a fish's eye");
    assert!(error.to_string().contains("OPENCV_FISHEYE"), "{error}");
}

#[test]
fn damaged_models_are_refused_with_their_place() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, bytes: &[u8]| {
        std::fs::write(folder.path().join(name), bytes).expect("a file");
    };
    let refused = |name: &str, expected: &str| {
        let path = folder.path().join(name);
        let error = transforms::read(&path, None, &Limits::default()).expect_err("damage");
        assert!(error.to_string().contains(expected), "{error} for {expected}");
    };
    for (cameras, images, expected) in [
        ("1 PINHOLE 40 30 50 52 20", "", "3 parameters of a PINHOLE"),
        ("1 PINHOLE 40", "", "line 1"),
        ("1 PINHOLE 40 30 50 NaN 20 15", "", "NaN"),
        (CAMERAS, "", "no frames"),
        (CAMERAS, "1 1 0 0 0 0 0 0 8 a.png\n", "camera 8"),
        (CAMERAS, "1 0 0 0 0 0 0 0 1 a.png\n", "length 0"),
        (CAMERAS, "1 1 0 0 0 0 0 0 1\n", "the name of a picture"),
        (CAMERAS, "x", "the number of an image"),
    ] {
        write("cameras.txt", cameras.as_bytes());
        write("images.txt", images.as_bytes());
        refused("images.txt", expected);
    }
    binary(folder.path());
    let whole = std::fs::read(folder.path().join("images.bin")).expect("a file");
    for length in 0..whole.len() {
        write("images.bin", &whole[..length]);
        refused("images.bin", "images.bin");
    }
    let mut many = whole.clone();
    many[..8].fill(255);
    write("images.bin", &many);
    refused("images.bin", "the end of the file");
    write("images.bin", &whole);
    let cameras = std::fs::read(folder.path().join("cameras.bin")).expect("a file");
    for length in 0..cameras.len() {
        write("cameras.bin", &cameras[..length]);
        refused("images.bin", "cameras.bin");
    }
    let mut other = cameras.clone();
    other[12] = 99;
    write("cameras.bin", &other);
    refused("images.bin", "model 99");
}
