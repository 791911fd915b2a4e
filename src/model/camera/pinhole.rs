//! Pinhole cameras and the rays through their pixels.

use glam::{DMat4, DVec3};
use sha2::{Digest, Sha256};

use crate::base::error::{Error, Place, Result};

/// Pixels along a picture's sides, at most: pictures of that size take gigabytes.
pub const LARGEST_SIDE: usize = 1 << 15;

/// One camera: a frame of a camera file.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// The file's name for the frame, without folder and extension.
    pub name: String,
    /// Camera to world, columns are the camera's axes and its place.
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

    /// The view at `1 / scale` of the distance in pixels: sizes rounded down, the focal length
    /// divided, the centre in proportion to the size.
    #[must_use]
    pub fn shrunk(&self, scale: usize) -> Self {
        let (width, height) = ((self.width / scale).max(1), (self.height / scale).max(1));
        let focal = self.focal.map(|focal| focal / scale as f64);
        Self { focal, ..self.resized(width, height) }
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
    /// use mipvog_bake::Camera;
    ///
    /// let camera = Camera::look_at([3.0, 0.0, 1.0], [0.0; 3], 40.0, [64, 48])?;
    /// assert_eq!((camera.lens.width, camera.lens.height), (64, 48));
    /// # Ok::<(), mipvog_bake::Error>(())
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
        let lens = &self.lens;
        let [fx, fy] = lens.focal;
        if !(fx > 0.0 && fy > 0.0 && fx.is_finite() && fy.is_finite()) {
            return bad(format!("focal lengths {fx} and {fy}"), "positive numbers");
        }
        if lens.center.iter().any(|center| !center.is_finite()) {
            return bad(format!("an optical centre at {:?}", lens.center), "finite numbers");
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
