//! The lens of a frame: its own values over those of the file.

use serde_json::Value;

use super::document::{Fields, kind};
use crate::base::error::{Error, Place, Result};
use crate::base::limits;

/// Camera models that are pinholes apart from distortion.
const PINHOLES: [&str; 7] = [
    "PINHOLE",
    "SIMPLE_PINHOLE",
    "PERSPECTIVE",
    "OPENCV",
    "FULL_OPENCV",
    "SIMPLE_RADIAL",
    "RADIAL",
];
/// Keys that determine the kind of a camera by their presence.
const MARKS: [&str; 10] = [
    "is_fisheye",
    "fisheye",
    "latlong",
    "equirectangular",
    "orthographic",
    "ftheta_p0",
    "ftheta_p1",
    "ftheta_p2",
    "ftheta_p3",
    "ftheta_p4",
];
/// Coefficients of distortion.
const DISTORTION: [&str; 18] = [
    "k1",
    "k2",
    "k3",
    "k4",
    "k5",
    "k6",
    "p1",
    "p2",
    "p3",
    "p4",
    "b1",
    "b2",
    "s1",
    "s2",
    "s3",
    "s4",
    "distortion",
    "distortion_params",
];
/// Ways to state a focal length along x and along y.
const FOCALS: [Focal; 3] = [
    Focal { names: ["fl_x", "fl_y"], unit: Unit::Pixels },
    Focal { names: ["camera_angle_x", "camera_angle_y"], unit: Unit::Radians },
    Focal { names: ["x_fov", "y_fov"], unit: Unit::Degrees },
];

#[derive(Clone, Copy)]
struct Focal {
    names: [&'static str; 2],
    unit: Unit,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Unit {
    Pixels,
    Radians,
    Degrees,
}

/// A frame's values before those of its file.
pub(super) struct FrameLens<'a> {
    pub(super) frame: &'a Fields,
    pub(super) all: &'a Fields,
    pub(super) place: &'a Place,
}

/// A stated focal length.
#[derive(Clone, Copy)]
struct Stated {
    name: &'static str,
    unit: Unit,
    value: f64,
}

impl<'a> FrameLens<'a> {
    fn value(&self, name: &str) -> Option<&'a Value> {
        self.frame.get(name).or_else(|| self.all.get(name))
    }

    /// A number of the frame, or else of the file. In the file, 0 means that each frame has its
    /// own.
    fn number(&self, name: &str) -> Result<Option<f64>> {
        let own = self.frame.number(name, self.place)?;
        own.map_or_else(|| self.of_file(name), |own| Ok(Some(own)))
    }

    fn of_file(&self, name: &str) -> Result<Option<f64>> {
        Ok(self.all.number(name, self.place)?.filter(|&number| number != 0.0))
    }

    /// Refuses cameras whose pixels are not those of a pinhole. This is the only such check.
    ///
    /// # Errors
    /// `Unsupported`.
    pub(super) fn check_model(&self) -> Result<()> {
        let refuse = |found: String| {
            let expected = format!("a pinhole: {}", PINHOLES.join(", "));
            let error = Error::unsupported(self.place.clone(), found, expected);
            Err(error.advise(
                "undistort the pictures to pinholes and name their cameras, or choose other frames \
                 with --frames",
            ))
        };
        let model = self.value("camera_model").filter(|model| model.as_str() != Some(""));
        if let Some(model) = model {
            let is_pinhole =
                |text: &str| PINHOLES.iter().any(|known| text.trim().eq_ignore_ascii_case(known));
            if !model.as_str().is_some_and(is_pinhole) {
                let shown = model.as_str().map_or_else(|| kind(model), str::to_owned);
                return refuse(format!("camera_model {shown}"));
            }
        }
        // The model of a frame overrides that of the file.
        let own_model = self.frame.get("camera_model").is_some();
        let is_set = |value: &Value| match value {
            Value::Bool(is_set) => *is_set,
            Value::Number(number) => number.as_f64() != Some(0.0),
            _ => true,
        };
        let mark = MARKS.iter().find(|name| {
            let value = if own_model { self.frame.get(name) } else { self.value(name) };
            value.is_some_and(is_set)
        });
        match mark {
            Some(name) => refuse((*name).to_owned()),
            None => Ok(()),
        }
    }

    /// The coefficients of distortion that are not 0.
    pub(super) fn distortion(&self) -> Vec<&'static str> {
        fn is_set(value: &Value) -> bool {
            match value {
                Value::Number(number) => number.as_f64() != Some(0.0),
                Value::Array(items) => items.iter().any(is_set),
                _ => false,
            }
        }
        let names = DISTORTION.into_iter();
        names.filter(|name| self.value(name).is_some_and(is_set)).collect()
    }

    /// The picture's size, where both sides are stated.
    pub(super) fn size(&self) -> Result<Option<[usize; 2]>> {
        let [width, height] = self.sides()?;
        let (Some(width), Some(height)) = (width, height) else { return Ok(None) };
        Ok(Some([side(width, self.place)?, side(height, self.place)?]))
    }

    fn sides(&self) -> Result<[Option<f64>; 2]> {
        let side =
            |name, long| self.number(name)?.map_or_else(|| self.number(long), |n| Ok(Some(n)));
        Ok([side("w", "width")?, side("h", "height")?])
    }

    /// The values that need a picture size, if none is stated.
    pub(super) fn in_pixels(&self) -> Result<Vec<&'static str>> {
        let focal = self.focal_lengths()?;
        let focal = focal.into_iter().flatten().filter(|stated| stated.unit == Unit::Pixels);
        let mut names: Vec<&str> = focal.map(|stated| stated.name).collect();
        for name in ["cx", "cy", "w", "width", "h", "height"] {
            if self.number(name)?.is_some() {
                names.push(name);
            }
        }
        Ok(names)
    }

    /// Focal lengths in pixels of a picture of this size.
    ///
    /// # Errors
    /// `Malformed` if none is stated, and for angles out of range.
    pub(super) fn focal(&self, [width, height]: [f64; 2]) -> Result<[f64; 2]> {
        let [x, y] = self.focal_lengths()?;
        let pixels = |stated: Option<Stated>, side: f64| {
            stated.map(|stated| self.pixels(stated, side)).transpose()
        };
        match (pixels(x, width)?, pixels(y, height)?) {
            (Some(x), Some(y)) => Ok([x, y]),
            // Pixels are square unless stated otherwise.
            (Some(focal), None) | (None, Some(focal)) => Ok([focal; 2]),
            (None, None) => {
                let expected = "fl_x or camera_angle_x, of the frame or of the file";
                Err(Error::malformed(self.place.clone(), "no focal length", expected))
            }
        }
    }

    /// The focal lengths along x and y, as they are stated. A frame's own values override the
    /// file's, even if one states an angle and the other pixels.
    fn focal_lengths(&self) -> Result<[Option<Stated>; 2]> {
        let mut found = [None; 2];
        let mut of_file = [None; 2];
        let mut is_own = false;
        for Focal { names, unit } in FOCALS {
            let stated = |value: Option<f64>, name| value.map(|value| Stated { name, unit, value });
            let mut own = [None; 2];
            let mut other = [None; 2];
            for (axis, name) in names.into_iter().enumerate() {
                own[axis] = stated(self.frame.number(name, self.place)?, name);
                other[axis] = stated(self.of_file(name)?, name);
            }
            let is_this_way = own.iter().any(Option::is_some);
            for axis in 0..2 {
                if is_this_way {
                    found[axis] = found[axis].or(own[axis]).or(other[axis]);
                }
                of_file[axis] = of_file[axis].or(other[axis]);
            }
            is_own |= is_this_way;
        }
        if !is_own {
            return Ok(of_file);
        }
        // If a frame states only y, x comes from the file.
        found[0] = found[0].or(of_file[0]);
        Ok(found)
    }

    fn pixels(&self, Stated { name, unit, value }: Stated, side: f64) -> Result<f64> {
        let angle = match unit {
            Unit::Pixels => return Ok(value),
            Unit::Radians => value,
            Unit::Degrees => value.to_radians(),
        };
        if angle > 0.0 && angle < std::f64::consts::PI {
            return Ok(0.5 * side / libm::tan(0.5 * angle));
        }
        let expected = match unit {
            Unit::Degrees => "degrees above 0 and below 180",
            _ => "an angle above 0 and below pi",
        };
        Err(Error::malformed(self.place.clone(), format!("{name} {value}"), expected))
    }

    /// The point of a picture of this size on the optical axis.
    pub(super) fn center(&self, [width, height]: [f64; 2]) -> Result<[f64; 2]> {
        // 0 is a valid position.
        let stated = |name, half| -> Result<f64> {
            let own = self.frame.number(name, self.place)?;
            let number = own.map_or_else(|| self.all.number(name, self.place), |n| Ok(Some(n)));
            Ok(number?.unwrap_or(half))
        };
        Ok([stated("cx", 0.5 * width)?, stated("cy", 0.5 * height)?])
    }
}

fn side(pixels: f64, place: &Place) -> Result<usize> {
    if pixels.fract() != 0.0 || !(1.0..=1e9).contains(&pixels) {
        let found = format!("a picture side of {pixels} pixels");
        return Err(Error::malformed(place.clone(), found, "a whole number from 1"));
    }
    limits::check_fixed("pixels along a side", pixels as u64, super::LARGEST_SIDE as u64, place)?;
    Ok(pixels as usize)
}
