//! The reference pictures of all cameras at all scales.

use super::metrics::Picture;
use super::reference::Reference;
use crate::base::error::{Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::base::progress::Progress;
use crate::model::camera::Camera;
use crate::view::render::{FrameOptions, LevelChoice, Renderer, tiles};

/// The reference pictures of a comparison. Pictures are made on first use.
pub struct References<'a> {
    reference: &'a Reference,
    cameras: &'a [Camera],
    scales: &'a [usize],
    supersample: usize,
    /// True if the reference is rendered at each scale, like the field.
    alike: bool,
    /// The level that samples read.
    levels: LevelChoice,
    /// Each camera's pictures, one per scale, if they are cached.
    kept: Vec<Option<Vec<Picture>>>,
    /// For each camera, true if the budget already counts its pictures.
    paid: Vec<bool>,
    /// Memory for cached pictures; none disables the cache.
    budget: Option<Budget>,
}

impl<'a> References<'a> {
    /// Makes references without a cache: pictures are dropped after each comparison.
    pub fn new(
        reference: &'a Reference,
        cameras: &'a [Camera],
        scales: &'a [usize],
        supersample: usize,
    ) -> Self {
        let kept = cameras.iter().map(|_| None).collect();
        let paid = vec![false; cameras.len()];
        let levels = LevelChoice::Auto;
        let (alike, budget) = (false, None);
        Self { reference, cameras, scales, supersample, alike, levels, kept, paid, budget }
    }

    /// Sets the level that samples read, on both sides if the reference is a field.
    #[must_use]
    pub fn with_levels(self, levels: LevelChoice) -> Self {
        Self { levels, ..self }
    }

    /// Renders both sides at each scale, instead of averaging the reference's full-size pictures.
    /// Errors then measure only the difference between the fields. The reference must be a field.
    #[must_use]
    pub fn alike(self) -> Self {
        Self { alike: true, ..self }
    }

    /// Caches pictures for the next field within the memory of `limits`. Pictures beyond this
    /// memory are made again each time.
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

    /// The pictures of a camera, one per scale.
    pub(super) fn take(&mut self, number: usize, progress: &dyn Progress) -> Result<Vec<Picture>> {
        if let Some(pictures) = self.kept[number].take() {
            return Ok(pictures);
        }
        let pictures = self.make(&self.cameras[number], progress)?;
        let bytes = pictures.iter().map(Picture::bytes).sum();
        if let Some(budget) = self.budget.as_mut() {
            self.paid[number] = budget.spend(bytes, "bytes of pictures", &Place::File).is_ok();
        }
        Ok(pictures)
    }

    fn make(&self, camera: &Camera, progress: &dyn Progress) -> Result<Vec<Picture>> {
        if self.alike {
            let small = |&scale| Camera { lens: camera.lens.shrunk(scale), ..camera.clone() };
            let small = self.scales.iter().map(small);
            let options = self.options(self.supersample);
            let picture = |small| self.reference.picture(&small, &options, progress);
            return small.map(picture).collect();
        }
        let full = self.reference.picture(camera, &self.options(self.supersample), progress)?;
        Ok(self.scales.iter().map(|&scale| full.downsampled(scale)).collect())
    }

    fn options(&self, supersample: usize) -> FrameOptions {
        FrameOptions { levels: self.levels, supersample }
    }

    /// The field's picture.
    pub(super) fn of_field(
        &self,
        field: &Renderer,
        camera: &Camera,
        progress: &dyn Progress,
    ) -> Result<Picture> {
        Picture::of_field(field, camera, &self.options(self.field_supersample()), progress)
    }

    /// Rays along each side of a pixel of the field.
    fn field_supersample(&self) -> usize {
        if self.alike { self.supersample } else { 1 }
    }

    /// Units of `Step::Render` for the next comparison.
    pub fn work(&self) -> u64 {
        let reference = |camera: &Camera| match self.reference {
            Reference::Pictures { .. } => 0,
            Reference::Field(_) if self.alike => self.at_scales(camera),
            Reference::Field(_) => tiles(&camera.lens, self.supersample),
        };
        let made = self.cameras.iter().zip(&self.kept).filter(|(_, kept)| kept.is_none());
        made.map(|(camera, _)| reference(camera)).sum::<u64>() + self.field_work()
    }

    /// The units of [`Self::work`] for rendering the field.
    pub fn field_work(&self) -> u64 {
        self.cameras.iter().map(|camera| self.at_scales(camera)).sum()
    }

    fn at_scales(&self, camera: &Camera) -> u64 {
        let supersample = self.field_supersample();
        self.scales.iter().map(|&scale| tiles(&camera.lens.shrunk(scale), supersample)).sum()
    }

    /// Returns the pictures of [`Self::take`] to the cache.
    pub(super) fn put_back(&mut self, number: usize, pictures: Vec<Picture>) {
        if self.paid[number] {
            self.kept[number] = Some(pictures);
        }
    }
}
