//! The space of an unbounded scene.
//!
//! ```text
//! y = (x - centre) / radius,  n = norm of y
//! c = y                            where n <= 1
//! c = y / n (1 + b - b / n)        beyond, b = the background's length
//! ```
//!
//! So all of space is in the box from `-1 - b` to `1 + b`. There, a step in the world has this
//! length:
//!
//! ```text
//! along y: b / n^2 times as long,  across: (1 + b - b / n) / n times
//! ```

use crate::base::error::{Error, Place, Result};
use crate::checkpoint::Inner;
use crate::model::grid::Bounds;
use crate::nested::Middle;

/// Faces of the contracted box differ by this share, at most.
const ROUNDED: f64 = 1e-4;

/// From the world to contracted space.
#[derive(Debug, Clone)]
pub(super) struct Contraction {
    inner: Inner,
    /// Length of the background.
    background: f64,
}

/// A position relative to the inner box.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    /// In half sizes of the inner box, from its centre.
    pub(super) own: [f64; 3],
    /// Its norm; up to 1 it is not contracted.
    pub(super) norm: f64,
}

impl Contraction {
    /// For a scene whose contracted space is this box, in half sizes of the inner one.
    ///
    /// # Errors
    /// `Malformed` for a box that is not a cube around the inner one.
    pub(super) fn new(inner: Inner, contracted: &Bounds) -> Result<Self> {
        let [high, ..] = contracted.max;
        let corners = contracted.max.into_iter().chain(contracted.min.map(|at| -at));
        let is_cube = corners
            .map(f64::from)
            .all(|at| (at - f64::from(high)).abs() <= ROUNDED * f64::from(high));
        let background = f64::from(high) - 1.0;
        if is_cube && background > ROUNDED {
            return Ok(Self { inner, background });
        }
        let place = Place::Key("xyz_max".to_owned());
        let found = format!("{:?} to {:?}", contracted.min, contracted.max);
        Err(Error::malformed(place, found, "a cube around 0 that holds the box from -1 to 1"))
    }

    /// The inner box.
    pub(super) fn middle(&self) -> Middle {
        Middle { center: self.inner.center, radius: [self.inner.radius; 3] }
    }

    /// Half the edge of the inner box.
    pub(super) fn radius(&self) -> f64 {
        self.inner.radius
    }

    /// Half the edge of contracted space.
    pub(super) fn reach(&self) -> f64 {
        1.0 + self.background
    }

    /// A position of the world.
    pub(super) fn place(&self, world: [f64; 3]) -> Spot {
        let mut own = world;
        let axes = own.iter_mut().zip(self.inner.center);
        axes.for_each(|(at, center)| *at = (*at - center) / self.inner.radius);
        self.place_of(own)
    }

    /// A position in half sizes of the inner box.
    pub(super) fn place_of(&self, own: [f64; 3]) -> Spot {
        let norm = match self.inner.ball {
            true => own.iter().map(|at| at * at).sum::<f64>().sqrt(),
            false => own.iter().fold(0.0, |most: f64, at| most.max(at.abs())),
        };
        Spot { own, norm }
    }

    /// The position in contracted space.
    pub(super) fn contracted(&self, place: Spot) -> [f64; 3] {
        let Spot { own, norm } = place;
        if norm <= 1.0 {
            return own;
        }
        let length = self.reach() - self.background / norm;
        own.map(|at| at / norm * length)
    }

    /// Contracted lengths of a short step of the world: along the position, and across.
    pub(super) fn stretches(&self, place: Spot) -> [f64; 2] {
        let norm = place.norm;
        let own = match norm <= 1.0 {
            true => [1.0; 2],
            false => {
                let along = self.background / (norm * norm);
                [along, (self.reach() - self.background / norm) / norm]
            }
        };
        own.map(|length| length / self.inner.radius)
    }
}
