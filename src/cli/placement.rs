//! Options that rotate, scale and move a container.

use clap::{Args, ValueEnum};

use super::values::parse_vector;
use crate::bake::Placement;

/// Another place in the world: rotation, scale and translation, in this order.
#[derive(Debug, Clone, Args)]
pub struct PlacementArguments {
    /// The axis that points up now; it is rotated to z, which is up in containers
    #[arg(
        long,
        value_name = "AXIS",
        allow_hyphen_values = true,
        conflicts_with = "rotate",
        help_heading = "Place"
    )]
    up: Option<UpAxis>,
    /// Rotate about the x axis, then y, then z, by multiples of 90 degrees: counterclockwise when
    /// the axis points towards you
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_turns,
          help_heading = "Place")]
    rotate: Option<QuarterTurns>,
    /// Scale about the origin, after the rotation [default: 1]
    #[arg(long, value_name = "FACTOR", allow_hyphen_values = true, help_heading = "Place")]
    scale: Option<f32>,
    /// Move by this, in world units, after rotation and scale
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_vector,
          help_heading = "Place")]
    translate: Option<[f32; 3]>,
}

/// Quarter turns about x, y and z.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct QuarterTurns([i32; 3]);

/// An axis that points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum UpAxis {
    X,
    Y,
    Z,
    #[value(name = "-x")]
    NegativeX,
    #[value(name = "-y")]
    NegativeY,
    #[value(name = "-z")]
    NegativeZ,
}

impl UpAxis {
    /// The quarter turns about x, y and z that rotate it to z.
    fn quarter_turns(self) -> [i32; 3] {
        match self {
            Self::X => [0, -1, 0],
            Self::Y => [1, 0, 0],
            Self::Z => [0; 3],
            Self::NegativeX => [0, 1, 0],
            Self::NegativeY => [-1, 0, 0],
            Self::NegativeZ => [2, 0, 0],
        }
    }
}

impl PlacementArguments {
    /// The placement from the options.
    pub fn placement(&self) -> Placement {
        let turns = self.rotate.map(|QuarterTurns(turns)| turns);
        let unmoved = Placement::default();
        Placement {
            quarter_turns: turns.or(self.up.map(UpAxis::quarter_turns)).unwrap_or_default(),
            scale: self.scale.unwrap_or(unmoved.scale),
            translate: self.translate.unwrap_or(unmoved.translate),
        }
    }
}

/// Three multiples of 90.
fn parse_turns(text: &str) -> std::result::Result<QuarterTurns, String> {
    let degrees = parse_vector(text)?;
    if degrees.iter().any(|degrees| degrees % 90.0 != 0.0) {
        let message = "a container's grid can be rotated by multiples of 90 degrees; for other \
                       angles rotate the node of a glTF asset (attach), or move the cameras";
        return Err(message.to_owned());
    }
    // Below 360 it is a small whole number.
    Ok(QuarterTurns(degrees.map(|degrees| (degrees % 360.0 / 90.0) as i32)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::unpacked::Rotation;

    #[test]
    fn the_axis_that_points_up_becomes_z() {
        for axis in UpAxis::value_variants() {
            let up = match axis {
                UpAxis::X => [1.0, 0.0, 0.0],
                UpAxis::Y => [0.0, 1.0, 0.0],
                UpAxis::Z => [0.0, 0.0, 1.0],
                UpAxis::NegativeX => [-1.0, 0.0, 0.0],
                UpAxis::NegativeY => [0.0, -1.0, 0.0],
                UpAxis::NegativeZ => [0.0, 0.0, -1.0],
            };
            let rotation = Rotation::of_quarter_turns(axis.quarter_turns());
            assert_eq!(rotation.vector(up), [0.0, 0.0, 1.0], "{axis:?}");
        }
    }

    #[test]
    fn rotations_are_multiples_of_90_degrees() {
        assert_eq!(parse_turns("90,-180,720"), Ok(QuarterTurns([1, -2, 0])));
        assert_eq!(parse_turns(" 0, 270,-450 "), Ok(QuarterTurns([0, 3, -1])));
        for wrong in ["45,0,0", "0,0,1e-3", "90,0", "90", "", "nan,0,0", "inf,0,0", "a,b,c"] {
            assert!(parse_turns(wrong).is_err(), "{wrong}");
        }
    }
}
