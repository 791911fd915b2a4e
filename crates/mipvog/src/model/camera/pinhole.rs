//! Pinhole cameras and the rays through their pixels.

use glam::{DMat4, DVec3};
use sha2::{Digest, Sha256};

use crate::base::error::{Error, Place, Result};

/// Maximum pixels along a picture's side: pictures of that size take gigabytes.
pub const LARGEST_SIDE: usize = 1 << 15;
/// Bounds on focal lengths, as shares of a picture's longer side.
const FOCAL_SHARES: std::ops::RangeInclusive<f64> = 1e-6..=1e6;
/// Maximum distance of cameras and optical centres from 0: beyond it, float64 cannot distinguish
/// rays.
const FARTHEST: f64 = 1e12;

/// Tolerance of a rotation's volume, for rounded numbers.
const SKEW: f64 = 0.02;

/// One camera: a frame of a camera file.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// The frame's file name without folder and extension; frames of the same name have as many of
    /// their folders as distinguish them.
    pub name: String,
    /// Camera to world; the columns are the camera's axes and its position.
    pub to_world: DMat4,
    /// The map from pixels to directions.
    pub lens: Lens,
    /// The frame's picture, as the file names it.
    pub picture: Option<String>,
}

/// A pinhole: picture size, focal lengths and centre in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Pixels along a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal lengths along x and y.
    pub focal: [f64; 2],
    /// The point of the picture on the optical axis.
    pub center: [f64; 2],
}

/// SHA-256 of the cameras, without the names of their frames.
pub fn digest(cameras: &[Camera]) -> [u8; 32] {
    let mut sum = Sha256::new();
    for Camera { to_world, lens, .. } in cameras {
        sum.update([lens.width as u64, lens.height as u64].map(u64::to_le_bytes).concat());
        let numbers = to_world.to_cols_array().into_iter().chain(lens.focal).chain(lens.center);
        numbers.for_each(|number| sum.update(number.to_le_bytes()));
    }
    sum.finalize().into()
}

/// A ray from the camera through a point of its picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Its start.
    pub origin: DVec3,
    /// Its direction, not normalised: a unit of `t` is a unit along the optical axis.
    pub direction: DVec3,
}

impl Lens {
    /// The same view on a picture of another size: focal lengths and centre scale with each axis.
    #[must_use]
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let scale = [width as f64 / self.width as f64, height as f64 / self.height as f64];
        Self {
            width,
            height,
            focal: [self.focal[0] * scale[0], self.focal[1] * scale[1]],
            center: [self.center[0] * scale[0], self.center[1] * scale[1]],
        }
    }

    /// The same angle along x in another picture size. Pixels keep their shape, so another aspect
    /// ratio shows more or less along y.
    #[must_use]
    pub fn reframed(&self, width: usize, height: usize) -> Self {
        let scale = width as f64 / self.width as f64;
        let [x, y] = [self.center[0], self.center[1] - 0.5 * self.height as f64];
        Self {
            width,
            height,
            focal: self.focal.map(|focal| focal * scale),
            center: [x * scale, 0.5 * height as f64 + y * scale],
        }
    }

    /// The view whose pixels are blocks of `scale` x `scale` pixels, the first one in the upper
    /// left corner. Incomplete blocks at the right and at the bottom are dropped.
    #[must_use]
    pub fn shrunk(&self, scale: usize) -> Self {
        let divided = |length: f64| length / scale as f64;
        Self {
            width: self.width / scale,
            height: self.height / scale,
            focal: self.focal.map(divided),
            center: self.center.map(divided),
        }
    }

    /// `factor` rays along each side of a pixel.
    #[must_use]
    pub fn supersampled(&self, factor: usize) -> Self {
        self.resized(self.width * factor, self.height * factor)
    }
}

impl Camera {
    /// A camera at `eye` that looks at `target`, with z up. `field_of_view` is the angle along x in
    /// degrees, above 0 and below 180. `size` is the picture's width and height in pixels.
    ///
    /// ```
    /// use mipvog::Camera;
    ///
    /// let camera = Camera::look_at([3.0, 0.0, 1.0], [0.0; 3], 40.0, [64, 48])?;
    /// assert_eq!((camera.lens.width, camera.lens.height), (64, 48));
    /// # Ok::<(), mipvog::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// An eye at its target, an angle or a size out of range.
    pub fn look_at(
        eye: [f64; 3],
        target: [f64; 3],
        field_of_view: f64,
        size: [usize; 2],
    ) -> Result<Self> {
        let (eye, target) = (DVec3::from(eye), DVec3::from(target));
        let back = (eye - target).normalize_or_zero();
        // Straight up or down, y takes the place of z.
        let up = if back.cross(DVec3::Z).length() > 1e-9 { DVec3::Z } else { DVec3::Y };
        let right = up.cross(back).normalize_or_zero();
        let axes = [right, back.cross(right), back].map(|axis| axis.extend(0.0));
        let [width, height] = size;
        let focal = 0.5 * width as f64 / libm::tan(0.5 * field_of_view.to_radians());
        let camera = Self {
            name: "camera".to_owned(),
            to_world: DMat4::from_cols(axes[0], axes[1], axes[2], eye.extend(1.0)),
            lens: Lens {
                width,
                height,
                focal: [focal; 2],
                center: [0.5 * width as f64, 0.5 * height as f64],
            },
            picture: None,
        };
        camera.check()?;
        Ok(camera)
    }

    /// Refuses cameras that cannot be rendered.
    pub fn check(&self) -> Result<()> {
        let place = || Place::Key(format!("frame {}", self.name));
        let bad = |found: String, expected: &str| {
            Err(Error::malformed(place(), found, expected.to_owned()))
        };
        if !self.to_world.is_finite() {
            return bad("a matrix with numbers that are not finite".into(), "finite numbers");
        }
        let determinant = glam::DMat3::from_mat4(self.to_world).determinant();
        if determinant.abs() < 1e-12 {
            return bad(format!("a matrix with determinant {determinant}"), "a rotation");
        }
        if determinant < 0.0 {
            return bad("a matrix that mirrors".into(), "a rotation");
        }
        let axes = glam::DMat3::from_mat4(self.to_world);
        let lengths = [axes.x_axis, axes.y_axis, axes.z_axis].map(glam::DVec3::length);
        let longest = lengths.into_iter().fold(0.0, f64::max);
        // Edges of equal length that are perpendicular have the largest volume.
        let upright = determinant / longest.powi(3);
        if upright < 1.0 - SKEW {
            return bad("a matrix that skews or stretches".into(), "a rotation");
        }
        let is_near = |number: &f64| number.abs() <= FARTHEST;
        if let Some(far) = self.to_world.to_cols_array().into_iter().find(|n| !is_near(n)) {
            return bad(format!("a matrix with {far}"), "numbers up to 1e12");
        }
        let lens = &self.lens;
        let longest = lens.width.max(lens.height) as f64;
        if let Some(focal) = lens.focal.iter().find(|&f| !FOCAL_SHARES.contains(&(f / longest))) {
            let shown = match focal.abs() {
                plain if (1e-4..1e12).contains(&plain) || plain == 0.0 => focal.to_string(),
                _ => format!("{focal:e}"),
            };
            let found = format!("focal length {shown} of a picture of {longest} pixels");
            return bad(found, "a millionth to a million times the picture's longer side");
        }
        if !lens.center.iter().all(is_near) {
            return bad(format!("an optical centre at {:?}", lens.center), "numbers up to 1e12");
        }
        let sides = 1..=LARGEST_SIDE;
        if !sides.contains(&lens.width) || !sides.contains(&lens.height) {
            let found = format!("a picture of {} x {} pixels", lens.width, lens.height);
            return bad(found, "1 to 32768 pixels along each side");
        }
        Ok(())
    }

    /// The ray through a point of the picture, in pixels from its upper left corner.
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        let Lens { focal, center, .. } = self.lens;
        let local = DVec3::new((x - center[0]) / focal[0], -(y - center[1]) / focal[1], -1.0);
        Ray {
            origin: self.to_world.w_axis.truncate(),
            direction: self.to_world.transform_vector3(local),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(width: usize, height: usize) -> Lens {
        Lens { width, height, focal: [120.0, 110.0], center: [33.0, 20.0] }
    }

    fn camera(lens: Lens) -> Camera {
        Camera { name: "c".to_owned(), to_world: DMat4::IDENTITY, lens, picture: None }
    }

    #[test]
    fn a_pixel_of_a_small_picture_is_a_block_of_the_large_one() {
        for (scale, size) in [(1, [63, 41]), (2, [31, 20]), (8, [7, 5]), (41, [1, 1])] {
            let (large, small) = (lens(63, 41), lens(63, 41).shrunk(scale));
            assert_eq!([small.width, small.height], size);
            let [large, small] = [large, small].map(camera);
            for (x, y) in [(0.0, 0.0), (0.5, 0.75), (1.0, 1.0)] {
                let [a, b] = [(&small, 1.0), (&large, scale as f64)]
                    .map(|(camera, times)| camera.ray(x * times, y * times).direction);
                assert!((a - b).length() < 1e-12, "{scale}: {a} for {b}");
            }
        }
    }

    #[test]
    fn another_shape_of_the_picture_keeps_the_angle_along_x_and_the_shape_of_pixels() {
        let square = Lens { width: 40, height: 40, focal: [50.0; 2], center: [20.0; 2] };
        let wide = square.reframed(80, 30);
        assert_eq!(wide, Lens { width: 80, height: 30, focal: [100.0; 2], center: [40.0, 15.0] });
        // The same aspect ratio gives the same view, wherever the centre is.
        let (moved, same) = (lens(60, 40).reframed(90, 60), lens(60, 40).resized(90, 60));
        assert_eq!((moved.focal, moved.center), (same.focal, same.center));
    }

    #[test]
    fn lenses_without_a_picture_are_refused() {
        let good = lens(60, 40);
        camera(good).check().expect("a camera");
        let focal = |focal: f64| Lens { focal: [60.0, focal], ..good };
        for focal_length in [0.0, -1.0, 1e-308, 5e-5, 1e9, f64::INFINITY, f64::NAN] {
            let error = camera(focal(focal_length)).check().expect_err("no focal length");
            assert!(error.to_string().contains("focal length"), "{error}");
        }
        for far in [1e13, f64::NAN] {
            camera(Lens { center: [far, 0.0], ..good }).check().expect_err("no centre");
            let to_world = DMat4::from_translation(DVec3::new(0.0, far, 0.0));
            Camera { to_world, ..camera(good) }.check().expect_err("no place");
        }
    }
}
