//! The right pictures of all cameras at all scales.

use super::metrics::Picture;
use super::reference::Reference;
use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::progress::Progress;
use crate::model::camera::Camera;

/// The right pictures that fields are compared with. Pictures are made when they are first wanted.
pub struct References<'a> {
    reference: &'a Reference,
    cameras: &'a [Camera],
    scales: &'a [usize],
    supersample: usize,
    /// Each camera's pictures, one a scale, where they are kept.
    kept: Vec<Option<Vec<Picture>>>,
    /// For each camera, true if its pictures were paid for.
    paid: Vec<bool>,
    /// Memory for kept pictures; none keeps none.
    budget: Option<Budget>,
}

impl<'a> References<'a> {
    /// Pictures that are forgotten once compared with.
    pub fn new(
        reference: &'a Reference,
        cameras: &'a [Camera],
        scales: &'a [usize],
        supersample: usize,
    ) -> Self {
        let kept = cameras.iter().map(|_| None).collect();
        let paid = vec![false; cameras.len()];
        Self { reference, cameras, scales, supersample, kept, paid, budget: None }
    }

    /// Keeps pictures for the next field, as long as the memory of `limits` lasts; pictures beyond
    /// it are made again each time.
    #[must_use]
    pub fn keep(self, limits: &Limits) -> Self {
        Self { budget: Some(Budget::new(limits)), ..self }
    }

    pub(super) fn cameras(&self) -> &'a [Camera] {
        self.cameras
    }

    pub(super) fn scales(&self) -> &'a [usize] {
        self.scales
    }

    /// The pictures of a camera, one a scale.
    pub(super) fn take(&mut self, number: usize, progress: &dyn Progress) -> Result<Vec<Picture>> {
        if let Some(pictures) = self.kept[number].take() {
            return Ok(pictures);
        }
        let full = self.reference.picture(&self.cameras[number], self.supersample, progress)?;
        let pictures: Vec<Picture> =
            self.scales.iter().map(|&scale| full.downsampled(scale)).collect();
        let bytes = pictures.iter().map(Picture::bytes).sum();
        if let Some(budget) = self.budget.as_mut() {
            self.paid[number] = budget.spend(bytes, "bytes of pictures", &Place::File).is_ok();
        }
        Ok(pictures)
    }

    /// Hands back the pictures of [`Self::take`].
    pub(super) fn put_back(&mut self, number: usize, pictures: Vec<Picture>) {
        if self.paid[number] {
            self.kept[number] = Some(pictures);
        }
    }
}
