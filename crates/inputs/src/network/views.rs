//! Viewing directions of a scene: those for a fit, and those held out.
//!
//! Given cameras see each position along a different direction. If there are too few, the scene is
//! seen from all around, along the directions of a spiral. One in [`HELD_OUT_EVERY`] cameras is
//! kept from every fit, and so is a second spiral.

use sha2::{Digest, Sha256};

use crate::base::bytes::hex;
use crate::model::grid::Bounds;

/// Number of cameras up to which fits ignore them.
const LEAST_CAMERAS: usize = 16;
/// One in this many cameras is held out of fits.
const HELD_OUT_EVERY: usize = 8;
/// Directions of a scene without cameras.
const AROUND: u32 = 64;
/// Directions all around that are held out of its fits.
const HELD_OUT_AROUND: u32 = 16;
/// The angle from one spiral to the other, in radians.
const TURN: f64 = 1.0;
/// Distance of places within a box from its middle, in half its edges.
const WITHIN: f64 = 0.7;
/// Distance of held-out eyes from the middle of the box, in half diagonals.
const EYE: f64 = 3.0;

/// Directions that a fit uses.
#[derive(Debug, Clone)]
pub enum Views {
    /// Unit directions into the scene.
    Around(Vec<[f64; 3]>),
    /// Places of cameras.
    Cameras(Vec<[f64; 3]>),
}

impl Views {
    /// From the cameras at these places that fits use; from all around if there are few.
    pub fn new(cameras: &[[f64; 3]]) -> Self {
        if cameras.len() < LEAST_CAMERAS {
            return Self::around();
        }
        let fits = (0..).zip(cameras).filter(|(number, _)| !is_held_out(*number));
        Self::Cameras(fits.map(|(_, place)| *place).collect())
    }

    /// The given cameras; else places around the middle of a box, for views of its surroundings.
    #[must_use]
    pub fn within(&self, inner: &Bounds) -> Self {
        let Self::Around(directions) = self else { return self.clone() };
        let places = directions.iter().map(|direction| {
            let mut place = *direction;
            let corners =
                inner.min.into_iter().zip(inner.max).map(|(a, b)| (f64::from(a), f64::from(b)));
            for (at, (min, max)) in place.iter_mut().zip(corners) {
                *at = 0.5 * (min + max) + WITHIN * 0.5 * (max - min) * *at;
            }
            place
        });
        Self::Cameras(places.collect())
    }

    /// From all around.
    pub fn around() -> Self {
        Self::Around(all_around())
    }

    /// The description for provenance: none for views from all around, else a digest of cameras.
    pub fn label(&self) -> String {
        let Self::Cameras(places) = self else { return String::new() };
        let mut sum = Sha256::new();
        places.iter().flatten().for_each(|value| sum.update(value.to_le_bytes()));
        format!(" for {} cameras, {:.16}", places.len(), hex(&sum.finalize().into()))
    }

    /// Their number.
    pub fn count(&self) -> usize {
        match self {
            Self::Around(views) | Self::Cameras(views) => views.len(),
        }
    }

    /// The unit direction of a view at a position, and the distance to the camera.
    pub fn at(&self, number: usize, position: [f64; 3]) -> ([f64; 3], f64) {
        match self {
            Self::Around(directions) => {
                (directions.get(number).copied().unwrap_or([0.0, 0.0, 1.0]), f64::INFINITY)
            }
            Self::Cameras(places) => {
                let mut way = position;
                let place = places.get(number).copied().unwrap_or_default();
                way.iter_mut().zip(place).for_each(|(at, from)| *at -= from);
                let distance = way.iter().map(|value| value * value).sum::<f64>().sqrt();
                (way.map(|value| value / distance.max(f64::MIN_POSITIVE)), distance)
            }
        }
    }
}

/// Unit directions all around, those that fits use without cameras.
pub fn all_around() -> Vec<[f64; 3]> {
    spiral(AROUND, 0.0)
}

/// Camera positions held out of a fit to these cameras, or positions all around if there are few.
pub fn held_out_eyes(cameras: &[[f64; 3]], bounds: &Bounds) -> Vec<[f64; 3]> {
    if cameras.len() >= LEAST_CAMERAS {
        let held_out = (0..).zip(cameras).filter(|(number, _)| is_held_out(*number));
        return held_out.map(|(_, place)| *place).collect();
    }
    let extent = bounds.extent();
    let radius = EYE * 0.5 * extent.iter().map(|edge| edge * edge).sum::<f64>().sqrt();
    let eye = |direction: [f64; 3]| {
        let mut eye = direction;
        let corners = bounds.min.into_iter().zip(bounds.max);
        for (at, (min, max)) in eye.iter_mut().zip(corners) {
            *at = 0.5 * (f64::from(min) + f64::from(max)) - radius * *at;
        }
        eye
    };
    spiral(HELD_OUT_AROUND, TURN).into_iter().map(eye).collect()
}

/// The same for the surroundings of a box: places in it if there are few cameras.
pub(super) fn held_out_within(cameras: &[[f64; 3]], inner: &Bounds) -> Views {
    match cameras.len() >= LEAST_CAMERAS {
        true => Views::Cameras(held_out_eyes(cameras, inner)),
        false => Views::Around(spiral(HELD_OUT_AROUND, TURN)).within(inner),
    }
}

/// True for cameras that no fit uses.
fn is_held_out(number: usize) -> bool {
    number % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
}

/// Points of a spiral on the sphere, at equal steps of height.
fn spiral(count: u32, turned: f64) -> Vec<[f64; 3]> {
    let turn = std::f64::consts::PI * (3.0 - 5.0f64.sqrt());
    let at = |number: u32| {
        let z = 1.0 - (2.0 * f64::from(number) + 1.0) / f64::from(count);
        let (radius, angle) = ((1.0 - z * z).sqrt(), turn * f64::from(number) + turned);
        [radius * libm::cos(angle), radius * libm::sin(angle), z]
    };
    (0..count).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_camera_both_fits_and_is_held_out() {
        let bounds = Bounds { min: [-1.0; 3], max: [1.0; 3] };
        for count in [0, 15, 16, 100] {
            let cameras: Vec<[f64; 3]> = (0..count).map(|at| [f64::from(at), 3.0, 4.0]).collect();
            let (views, eyes) = (Views::new(&cameras), held_out_eyes(&cameras, &bounds));
            assert!(!eyes.is_empty());
            match views {
                Views::Cameras(places) => {
                    assert_eq!(places.len() + eyes.len(), cameras.len());
                    assert!(eyes.iter().all(|eye| !places.contains(eye)));
                }
                Views::Around(directions) => {
                    let near = |eye: &[f64; 3]| {
                        let along = |direction: &[f64; 3]| -> f64 {
                            let products = direction.iter().zip(eye).map(|(a, b)| -a * b);
                            products.sum::<f64>() / (EYE * 3.0f64.sqrt())
                        };
                        directions.iter().map(along).fold(-1.0, f64::max)
                    };
                    assert!(eyes.iter().map(near).all(|cosine| cosine < 0.9999));
                }
            }
        }
    }

    #[test]
    fn cameras_are_seen_from_where_they_are() {
        let cameras: Vec<[f64; 3]> = (0..16).map(|at| [0.0, 0.0, f64::from(at) + 2.0]).collect();
        let (direction, distance) = Views::new(&cameras).at(1, [0.0; 3]);
        assert_eq!((direction, distance), ([0.0, 0.0, -1.0], 3.0));
    }
}
