//! Viewpoints of `render`: given cameras, paths around the scene, paths through cameras, and the
//! whole scene.

use clap::Args;

use super::cameras::CameraArguments;
use super::common::Common;
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::model::camera::{Camera, Orbit, flight};
use crate::view::overview;
use crate::view::render::Renderer;

/// Options of viewpoints beside those that all verbs have.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Cameras")]
pub struct ViewpointArguments {
    /// Instead of a camera file: N cameras on a spiral over the upper half of a sphere
    #[arg(long, value_name = "N", conflicts_with_all = ["cameras", "turntable"],
          value_parser = clap::value_parser!(u16).range(1..))]
    spiral: Option<u16>,
    /// N frames along a smooth path through the cameras of --cameras, in order
    #[arg(long, value_name = "N", requires = "cameras",
          value_parser = clap::value_parser!(u16).range(2..))]
    path: Option<u16>,
    /// Angle of a turntable above the centre of the box, above -90 and below 90 [default: 30]
    #[arg(long, value_name = "DEG", requires = "turntable", allow_negative_numbers = true)]
    elevation: Option<f64>,
    /// Distance of a turntable or spiral from the centre of the box, in radii of the sphere around
    /// it [default: the sphere just fits the picture]
    #[arg(long, value_name = "R", conflicts_with = "cameras")]
    radius: Option<f64>,
    /// Field of view of a turntable or spiral along the shorter side, 1 to 170 [default: 40.1]
    #[arg(long, value_name = "DEG", conflicts_with = "cameras")]
    fov: Option<f64>,
    /// Angle of the first camera of a turntable or spiral, from x towards y [default: 0]
    #[arg(long, value_name = "DEG", conflicts_with = "cameras", allow_negative_numbers = true)]
    start: Option<f64>,
}

impl ViewpointArguments {
    /// The cameras of a picture or a film of the field.
    pub fn cameras(
        &self,
        cameras: &CameraArguments,
        field: &mut Renderer,
        common: &Common,
        progress: &dyn Progress,
    ) -> Result<Vec<Camera>> {
        let bounds = field.view().bounds;
        let orbit = self.orbit()?;
        let size = cameras.made_size();
        if let Some(count) = self.spiral {
            return cameras.pick(orbit.spiral(&bounds, count.into(), size));
        }
        if let Some(count) = cameras.turntable() {
            return cameras.pick(orbit.circle(&bounds, count, size));
        }
        if !cameras.given() {
            if self.radius.or(self.fov).or(self.start).is_some() {
                return Err(Error::usage(
                    "--radius, --fov and --start belong to --turntable or --spiral",
                ));
            }
            return cameras.pick(vec![overview(field, size, progress)?]);
        }
        let given = cameras.cameras(&bounds, common)?;
        match self.path {
            Some(count) => flight(&given, count.into()),
            None => Ok(given),
        }
    }

    /// True if the cameras are made, and not from a file.
    pub fn makes(&self, cameras: &CameraArguments) -> bool {
        cameras.file().is_none()
    }

    fn orbit(&self) -> Result<Orbit> {
        let default = Orbit::default();
        let within = |name, value: Option<f64>, holds: fn(f64) -> bool, expected: &str| {
            let value = value.unwrap_or(f64::NAN);
            Error::require_option(value.is_nan() || holds(value), name, value, expected)
        };
        // NaN means that an option is not given; a typed NaN is refused here.
        let typed = [self.elevation, self.radius, self.fov, self.start].into_iter().flatten();
        if typed.into_iter().any(|number| !number.is_finite()) {
            return Err(Error::usage(
                "--elevation, --radius, --fov and --start are finite numbers",
            ));
        }
        within(
            "elevation",
            self.elevation,
            |deg| deg.abs() < 90.0,
            "above -90 and below 90 degrees",
        )?;
        within("radius", self.radius, |radii| radii > 0.0 && radii <= 1e6, "above 0, at most 1e6")?;
        within("fov", self.fov, |deg| (1.0..=170.0).contains(&deg), "1 to 170 degrees")?;
        Ok(Orbit {
            elevation: self.elevation.map_or(default.elevation, f64::to_radians),
            radius: self.radius,
            field_of_view: self.fov.map_or(default.field_of_view, f64::to_radians),
            start: self.start.map_or(default.start, f64::to_radians),
        })
    }
}
