//! Camera files: NeRF-synthetic's `transforms*.json` (one `camera_angle_x`) and nerfstudio's
//! (`fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`, for all frames or for each).
//!
//! Cameras of COLMAP's sparse models are read as such a file, too ([`colmap`]).
//!
//! An unreadable frame does not affect the others: it is refused only when it is selected.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};

use glam::{DMat4, DVec4};
use serde_json::Value;

use super::colmap;
use super::document::{Document, Fields, kind, number};
use super::frame_lens::FrameLens;
use super::frame_names::{names, picture_path};
use super::frames::{CameraFile, DEFAULT_SIDE, Frame, Notes};
use super::moved::applied;
use super::{Camera, Lens};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::base::text::{is_quoted_number, without_mark};
use crate::picture;

/// Tolerance of a matrix's last row, for rounded numbers.
const LAST_ROW_ERROR: f64 = 1e-4;

/// Reads a camera file. The pictures' size is `size`, else the file's, else that of the frame's
/// picture, else that of the first existing picture, else 800 x 800.
///
/// # Errors
/// A file that cannot be read, or is not a camera file.
pub fn read(path: &Path, size: Option<[usize; 2]>, limits: &Limits) -> Result<CameraFile> {
    let (document, folder) = match colmap::is_model(path) {
        true => colmap::read(path, limits)?,
        false => {
            let text = read_text(path, limits)?;
            let document = Document::read(&text).map_err(|error| error.in_file(path))?;
            (document, path.parent().map(Path::to_owned).unwrap_or_default())
        }
    };
    let mut read = frames(document, folder, size).map_err(|error| error.in_file(path))?;
    for frame in &mut read.frames {
        let camera = std::mem::replace(&mut frame.camera, Err(Error::cancelled()));
        frame.camera = camera.map_err(|error| error.in_file(path));
    }
    Ok(read)
}

/// The cameras of a file's text, whose pictures are relative to `folder`.
///
/// # Errors
/// Text that is not a camera file.
pub fn parse(text: &str, folder: PathBuf, size: Option<[usize; 2]>) -> Result<CameraFile> {
    frames(Document::read(text)?, folder, size)
}

fn frames(document: Document, folder: PathBuf, size: Option<[usize; 2]>) -> Result<CameraFile> {
    let fields = document.frames.unwrap_or_default();
    let paths: Vec<Option<&str>> =
        fields.iter().map(|frame| frame.get("file_path").and_then(Value::as_str)).collect();
    let names = names(&folder, &paths);
    let sizes = PictureSizes { folder: &folder, paths: &paths, first: OnceCell::new() };
    let mut frames = Vec::with_capacity(fields.len());
    for ((number, (own, path)), name) in fields.iter().zip(&paths).enumerate().zip(names) {
        let mut notes = Notes::default();
        let place = Place::Key(format!("frame {name}"));
        let lens = FrameLens { frame: own, all: &document.all, place: &place };
        let camera = check_path(own, &place)
            .and_then(|()| camera(own, &lens, &name, || sizes.of(number), size, &mut notes))
            .map_err(|error| match document.is_list && error.advice().is_none() {
                true => error.advise(
                    "a list of frames alone, as ns-export cameras writes it, names no lens: put it \
                     into {\"camera_angle_x\": ANGLE, \"frames\": LIST}, or use transforms.json",
                ),
                false => error,
            });
        frames.push(Frame { name, picture: path.map(str::to_owned), camera, notes });
    }
    let applied =
        applied(document.all.get("applied_transform"), document.all.get("applied_scale"))?;
    Ok(CameraFile { frames, folder, applied })
}

fn read_text(path: &Path, limits: &Limits) -> Result<String> {
    let file = crate::base::bytes::SourceFile::open(path)?;
    let bytes = file.read(0, file.length(), limits.header_bytes)?;
    String::from_utf8(without_mark(&bytes).to_vec()).map_err(|_| {
        let expected = "a camera file: JSON with frames, in UTF-8";
        Error::wrong_kind("bytes that are no text", expected).in_file(path)
    })
}

/// Refuses a frame's path that is not a string.
fn check_path(frame: &Fields, place: &Place) -> Result<()> {
    match frame.get("file_path") {
        None | Some(Value::String(_)) => Ok(()),
        Some(other) => {
            let found = format!("file_path that is {}", kind(other));
            Err(Error::malformed(place.clone(), found, "a text"))
        }
    }
}

fn camera(
    frame: &Fields,
    stated: &FrameLens<'_>,
    name: &str,
    of_pictures: impl FnOnce() -> (Option<[usize; 2]>, Option<String>),
    wanted: Option<[usize; 2]>,
    notes: &mut Notes,
) -> Result<Camera> {
    stated.check_model()?;
    let to_world = matrix(frame, stated.place)?;
    let mut size = stated.size()?;
    if size.is_none() {
        (size, notes.unread) = of_pictures();
    }
    if size.or(wanted).is_none() {
        notes.unsized_values = stated.in_pixels()?;
    }
    let [width, height] = size.or(wanted).unwrap_or([DEFAULT_SIDE; 2]);
    let sides = [width as f64, height as f64];
    let lens = Lens { width, height, focal: stated.focal(sides)?, center: stated.center(sides)? };
    let lens = match wanted {
        Some([width, height]) => lens.reframed(width, height),
        None => lens,
    };
    notes.distortion = stated.distortion();
    let picture = frame.get("file_path").and_then(Value::as_str).map(str::to_owned);
    let camera = Camera { name: name.to_owned(), to_world, lens, picture };
    camera.check()?;
    Ok(camera)
}

/// The camera-to-world matrix: three rows, and optionally 0, 0, 0, 1.
fn matrix(frame: &Fields, place: &Place) -> Result<DMat4> {
    let expected = "transform_matrix with 3 or 4 rows of 4 numbers";
    let named = ["transform_matrix", "transform"].into_iter();
    let (name, value) = named
        .filter_map(|name| Some((name, frame.get(name)?)))
        .next()
        .ok_or_else(|| Error::malformed(place.clone(), "no matrix", expected))?;
    let malformed =
        || Error::malformed(place.clone(), format!("{name} of another shape"), expected);
    let rows =
        value.as_array().filter(|rows| (3..=4).contains(&rows.len())).ok_or_else(malformed)?;
    let mut columns = [DVec4::ZERO, DVec4::ZERO, DVec4::ZERO, DVec4::W];
    for (column, row) in columns.iter_mut().zip(rows) {
        let row = row.as_array().filter(|row| row.len() == 4).ok_or_else(malformed)?;
        for (axis, value) in row.iter().enumerate() {
            column[axis] = match value {
                Value::String(text) if is_quoted_number(text) => f64::NAN,
                value => number(value, name, place)?,
            };
        }
    }
    let [x, y, z, last] = columns;
    if !last.abs_diff_eq(DVec4::W, LAST_ROW_ERROR) {
        let found = format!("{name} with the last row {:?}", last.to_array());
        let expected = "0, 0, 0, 1 there: rows of numbers, not columns";
        return Err(Error::malformed(place.clone(), found, expected));
    }
    Ok(DMat4::from_cols(x, y, z, last).transpose())
}

/// Sizes of the frames' pictures.
struct PictureSizes<'a> {
    folder: &'a Path,
    paths: &'a [Option<&'a str>],
    /// The size of the first existing picture.
    first: OnceCell<Option<[usize; 2]>>,
}

impl PictureSizes<'_> {
    /// The size of a frame's picture, else of the first existing one, and why its own is missing.
    fn of(&self, number: usize) -> (Option<[usize; 2]>, Option<String>) {
        match self.own(number) {
            Some(Ok(size)) => (Some(size), None),
            Some(Err(error)) => (self.first(), Some(error.to_string())),
            None => (self.first(), None),
        }
    }

    fn own(&self, number: usize) -> Option<Result<[usize; 2]>> {
        let path = picture_path(self.folder, self.paths.get(number).copied().flatten()?)?;
        Some(picture::size(&path))
    }

    fn first(&self) -> Option<[usize; 2]> {
        let mut sizes = (0..self.paths.len()).filter_map(|number| self.own(number)?.ok());
        *self.first.get_or_init(|| sizes.next())
    }
}

#[cfg(test)]
mod tests {
    use super::super::PickedCameras;
    use super::*;
    use crate::base::error::ErrorKind;

    const FRAME: &str = r#""transform_matrix":[[1,0,0,0],[0,0,-1,-4],[0,1,0,0.5],[0,0,0,1]]"#;

    /// The cameras of a file with these values, and of frames with those.
    fn cameras(all: &str, frames: &[&str]) -> Result<PickedCameras> {
        let frames: Vec<String> = frames
            .iter()
            .map(|own| match own.contains("transform") {
                true => format!("{{{own}}}"),
                false => format!("{{{own}{}{FRAME}}}", if own.is_empty() { "" } else { "," }),
            })
            .collect();
        let text = format!("{{{all},\"frames\":[{}]}}", frames.join(","));
        parse(&text, PathBuf::from("/nowhere"), None)?.pick(&[])
    }

    fn lens(all: &str, frame: &str) -> Lens {
        let found = cameras(all, &[frame]).expect("a camera");
        assert_eq!(found.warnings, Vec::<String>::new(), "{all} {frame}");
        found.cameras[0].lens
    }

    #[test]
    fn focal_lengths_are_found_field_by_field() {
        let size = r#""w":200,"h":150,"#;
        let angle = |focal: f64, side: f64| 2.0 * (0.5 * side / focal).atan();
        let (x, y) = (angle(220.0, 200.0), angle(300.0, 150.0));
        for (all, frame, focal) in [
            (format!(r#"{size}"fl_x":220"#), String::new(), [220.0, 220.0]),
            (format!(r#"{size}"fl_x":220,"fl_y":300"#), String::new(), [220.0, 300.0]),
            (format!(r#"{size}"fl_x":220,"fl_y":null"#), String::new(), [220.0, 220.0]),
            (format!(r#"{size}"camera_angle_x":{x}"#), String::new(), [220.0, 220.0]),
            (
                format!(r#"{size}"camera_angle_x":{x},"camera_angle_y":{y}"#),
                String::new(),
                [220.0, 300.0],
            ),
            (format!(r#"{size}"camera_angle_y":{y}"#), String::new(), [300.0, 300.0]),
            (format!(r#"{size}"fl_x":220,"camera_angle_y":{y}"#), String::new(), [220.0, 300.0]),
            (
                format!(r#"{size}"x_fov":{},"y_fov":{}"#, x.to_degrees(), y.to_degrees()),
                String::new(),
                [220.0, 300.0],
            ),
            // A frame's own value overrides only that value of the file.
            (format!(r#"{size}"fl_x":220,"fl_y":230"#), r#""fl_y":300"#.into(), [220.0, 300.0]),
            (format!(r#"{size}"fl_x":220,"fl_y":300"#), r#""fl_x":210"#.into(), [210.0, 300.0]),
            (format!(r#"{size}"camera_angle_x":{x}"#), r#""fl_y":300"#.into(), [220.0, 300.0]),
            // Another way to state the focal length overrides both.
            (
                format!(r#"{size}"fl_x":500,"fl_y":400"#),
                format!(r#""camera_angle_x":{x}"#),
                [220.0, 220.0],
            ),
            (
                format!(r#"{size}"camera_angle_x":1,"camera_angle_y":1"#),
                r#""fl_x":220"#.into(),
                [220.0, 220.0],
            ),
            // 0 in the file means that each frame has its own.
            (
                r#""w":0,"h":0,"fl_x":0,"fl_y":0"#.into(),
                format!(r#"{size}"fl_x":220"#),
                [220.0, 220.0],
            ),
            (r#""width":200,"height":150,"fl_x":220"#.into(), String::new(), [220.0, 220.0]),
        ] {
            let found = lens(&all, &frame);
            assert_eq!((found.width, found.height), (200, 150), "{all} {frame}");
            let far = [0, 1].map(|axis: usize| (found.focal[axis] - focal[axis]).abs());
            assert!(far.iter().all(|far| *far < 1e-9), "{all} {frame}: {:?}", found.focal);
        }
    }

    #[test]
    fn only_pinholes_are_taken() {
        let plain = r#""w":20,"h":10,"fl_x":9"#;
        for model in ["PINHOLE", "OPENCV", "SIMPLE_RADIAL", "opencv", ""] {
            let model = format!(r#""camera_model":"{model}""#);
            lens(&format!("{plain},{model}"), "");
            lens(plain, &model);
        }
        lens(&format!(r#"{plain},"is_fisheye":false,"k1":0,"k2":0.0,"camera_model":null"#), "");
        lens(&format!(r#"{plain},"is_fisheye":true"#), r#""camera_model":"PINHOLE""#);
        for (stated, told) in [
            (r#""camera_model":"EQUIRECTANGULAR""#, "EQUIRECTANGULAR"),
            (r#""camera_model":"OPENCV_FISHEYE""#, "OPENCV_FISHEYE"),
            (r#""camera_model":"ORTHOPHOTO""#, "ORTHOPHOTO"),
            (r#""camera_model":5"#, "camera_model 5"),
            (r#""is_fisheye":true"#, "is_fisheye"),
            (r#""ftheta_p0":0.5"#, "ftheta_p0"),
            (r#""latlong":true"#, "latlong"),
        ] {
            for error in [
                cameras(&format!("{plain},{stated}"), &[""]).expect_err(stated),
                cameras(plain, &["", stated]).expect_err(stated),
            ] {
                assert!(matches!(error.kind(), ErrorKind::Unsupported { .. }), "{error}");
                assert!(
                    error.to_string().contains(told) && error.to_string().contains("frame_"),
                    "{error}"
                );
            }
        }
    }

    #[test]
    fn what_is_left_out_or_assumed_is_told_once() {
        let told = |all: &str, frames: &[&str], parts: &[&str]| {
            let found = cameras(all, frames).expect("cameras").warnings;
            let [warning] = found.as_slice() else { panic!("{found:?}") };
            assert!(parts.iter().all(|part| warning.contains(part)), "{warning}");
        };
        let plain = r#""w":20,"h":10,"fl_x":9"#;
        told(
            &format!(r#"{plain},"k1":-0.2,"p2":0.1,"k3":0"#),
            &["", ""],
            &["k1, p2", "frame_0, frame_1"],
        );
        told(
            plain,
            &["", r#""file_path":"b.png","distortion_params":[0,1e-3]"#],
            &["frame b", "undistorted"],
        );
        told(r#""fl_x":220"#, &["", ""], &["800x800", "fl_x", "option size"]);
        told(r#""camera_angle_x":0.7,"w":20"#, &[""], &["800x800", "w are"]);
        told(r#""camera_angle_x":0.7,"cx":100,"cy":75"#, &[""], &["cx, cy"]);
        // NeRF-synthetic scenes state no sizes, and their pictures may be missing.
        let found = lens(r#""camera_angle_x":0.7"#, "");
        assert_eq!((found.width, found.height), (800, 800));
    }

    #[test]
    fn matrices_have_three_rows_or_four() {
        let plain = r#""w":20,"h":10,"fl_x":9"#;
        let four = cameras(plain, &[""]).expect("cameras").cameras[0].to_world;
        for rows in [
            r#""transform_matrix":[[1,0,0,0],[0,0,-1,-4],[0,1,0,0.5]]"#,
            r#""transform":[[1,0,0,0],[0,0,-1,-4],[0,1,0,0.5]]"#,
        ] {
            assert_eq!(cameras(plain, &[rows]).expect("cameras").cameras[0].to_world, four);
        }
        for (matrix, told) in [
            ("[1,0,0,0,0,0,-1,-4,0,1,0,0.5,0,0,0,1]", "shape"),
            (r#"[["1",0,0,0],[0,0,-1,-4],[0,1,0,0.5]]"#, "text"),
            ("null", "no matrix"),
            ("[[1,0,0,0],[0,0,-1,-4],[0,1,0,NaN]]", "not finite"),
            ("[[1,0,0,0],[0,0,-1,-4],[0,1,0,-Infinity]]", "not finite"),
            ("[[-1,0,0,0],[0,0,-1,-4],[0,1,0,0.5]]", "mirrors"),
            // Columns in place of rows, all of it doubled, one axis doubled, a last row of its own.
            ("[[1,0,0,0],[0,0,1,0],[0,-1,0,0],[0,-4,0.5,1]]", "last row"),
            ("[[2,0,0,0],[0,0,-2,-8],[0,2,0,1],[0,0,0,2]]", "last row"),
            ("[[1,0,0,0],[0,0,-1,-4],[0,1,0,0.5],[0,0,1,1]]", "last row"),
            ("[[2,0,0,0],[0,0,-1,-4],[0,1,0,0.5]]", "stretches"),
            ("[[1,0.5,0,0],[0,0,-1,-4],[0,1,0,0.5]]", "stretches"),
        ] {
            let frame = format!(r#""file_path":"b.png","transform_matrix":{matrix}"#);
            let error = cameras(plain, &["", &frame]).expect_err(matrix).to_string();
            assert!(error.contains(told) && error.contains("frame b"), "{error}");
            // What another frame has does not matter.
            let text = format!(r#"{{{plain},"frames":[{{{FRAME},"sharpness":NaN}},{{{frame}}}]}}"#);
            let file = parse(&text, PathBuf::new(), None).expect("a file");
            assert_eq!(file.pick(&["0".to_owned()]).expect("a frame").cameras[0].to_world, four);
        }
    }

    #[test]
    fn other_files_are_told_for_what_they_are() {
        for (text, told, remedy) in [
            (
                r#"[{"file_path":"a.png","transform":[[1,0,0,0],[0,1,0,0],[0,0,1,0]]}]"#,
                "no focal length",
                "ns-export",
            ),
            (r#"{"camera_type":"perspective","camera_path":[]}"#, "camera path", "transforms.json"),
            (r#"{"asset":{}}"#, "without frames", "transforms.json"),
            (r#"{"frames":[]}"#, "no frames", "make the file again"),
            ("[1, 2]", "another file", "transforms.json"),
            ("ply\n", "another file", "transforms.json"),
            ("{\n// comment\n}", "line 2", ""),
            (r#"{"fl_x":1,"fl_x":2,"frames":[]}"#, "fl_x twice", ""),
            (r#"{"frames":{"a":1}}"#, "line 1", ""),
        ] {
            let error = parse(text, PathBuf::new(), None).and_then(|file| file.pick(&[]));
            let error = error.expect_err(text);
            assert!(error.to_string().contains(told), "{text}: {error}");
            assert!(error.remedy().contains(remedy), "{text}: {}", error.remedy());
        }
    }
}
