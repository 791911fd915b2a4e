//! Frames of a camera file: selecting them, and notes for users.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::Camera;
use super::frame_names::{find, picture_path};
use super::moved::WorldTransform;
use crate::base::error::{Error, Result};

/// Picture size if neither the file nor its pictures have one.
pub(super) const DEFAULT_SIDE: usize = 800;
/// Names of frames that a message lists, at most.
const NAMES_SHOWN: usize = 5;

/// The frames of a camera file.
#[derive(Debug)]
pub struct CameraFile {
    pub(super) frames: Vec<Frame>,
    pub(super) folder: PathBuf,
    /// The transform that was applied to all poses before they were written.
    pub(super) applied: WorldTransform,
}

/// A frame; its camera may be unreadable.
#[derive(Debug)]
pub(super) struct Frame {
    pub(super) name: String,
    pub(super) picture: Option<String>,
    pub(super) camera: Result<Camera>,
    pub(super) notes: Notes,
}

/// Notes for users about a frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Notes {
    /// Distortion coefficients that are ignored.
    pub(super) distortion: Vec<&'static str>,
    /// Values in pixels of a picture of unknown size.
    pub(super) unsized_values: Vec<&'static str>,
    /// An existing picture whose size cannot be read.
    pub(super) unread: Option<String>,
}

/// Selected cameras, in the requested order.
#[derive(Debug, Clone, Default)]
pub struct PickedCameras {
    /// The cameras.
    pub cameras: Vec<Camera>,
    /// Sentences about ignored and assumed values.
    pub warnings: Vec<String>,
}

impl CameraFile {
    /// The cameras after a transform of the world.
    #[must_use]
    pub fn moved(mut self, by: &WorldTransform) -> Self {
        for frame in &mut self.frames {
            if let Ok(camera) = &mut frame.camera {
                *camera = by.moved(camera, self.applied);
            }
        }
        self
    }

    /// The cameras of all frames that can be read.
    pub fn sound(&self) -> impl Iterator<Item = &Camera> {
        self.frames.iter().filter_map(|frame| frame.camera.as_ref().ok())
    }

    /// The pictures of all frames, where there are any.
    pub fn pictures(&self) -> impl Iterator<Item = PathBuf> {
        let named = self.frames.iter().filter_map(|frame| frame.picture.as_deref());
        named.filter_map(|name| picture_path(&self.folder, name))
    }

    /// The frames that a list of names, paths or indices selects, in its order; all without a list.
    ///
    /// # Errors
    /// Names of no frame or of several, and selected frames that cannot be read.
    pub fn pick(self, wanted: &[String]) -> Result<PickedCameras> {
        let known: Vec<(&str, Option<&str>)> =
            self.frames.iter().map(|frame| (&*frame.name, frame.picture.as_deref())).collect();
        let numbers = picked(&known, wanted)?;
        let warnings = warnings(numbers.iter().map(|&number| &self.frames[number]));
        if let Some(&broken) = numbers.iter().find(|&&number| self.frames[number].camera.is_err()) {
            let broken = self.frames.into_iter().nth(broken).map(|frame| frame.camera);
            return Err(broken.and_then(Result::err).unwrap_or_else(Error::cancelled));
        }
        let camera = |&number: &usize| self.frames[number].camera.as_ref().ok().cloned();
        Ok(PickedCameras { cameras: numbers.iter().filter_map(camera).collect(), warnings })
    }
}

/// Selects among cameras without a file, by names or indices.
///
/// # Errors
/// Names of no camera.
pub fn pick(cameras: Vec<Camera>, wanted: &[String]) -> Result<Vec<Camera>> {
    let known: Vec<(&str, Option<&str>)> =
        cameras.iter().map(|camera| (&*camera.name, camera.picture.as_deref())).collect();
    let numbers = picked(&known, wanted)?;
    Ok(numbers.into_iter().map(|number| cameras[number].clone()).collect())
}

fn picked(known: &[(&str, Option<&str>)], wanted: &[String]) -> Result<Vec<usize>> {
    if wanted.is_empty() {
        return Ok((0..known.len()).collect());
    }
    let one = |wanted: &String| {
        find(known, wanted).map_err(|alike| match alike.as_slice() {
            [] => Error::invalid_option("frames", wanted, choices(known)),
            alike => {
                let found = format!("{wanted}, which {} frames are called", alike.len());
                Error::invalid_option("frames", found, format!("one of {}", list(alike)))
            }
        })
    };
    wanted.iter().map(one).collect()
}

/// The names and indices that select frames.
fn choices(known: &[(&str, Option<&str>)]) -> String {
    let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
    let last = known.len().saturating_sub(1);
    format!("a name ({}) or an index from 0 to {last}; several with commas", list(&names))
}

/// The first few of some names.
fn list<T: AsRef<str>>(names: &[T]) -> String {
    let shown: Vec<&str> = names.iter().take(NAMES_SHOWN).map(AsRef::as_ref).collect();
    let more = if names.len() > shown.len() { ", ..." } else { "" };
    format!("{}{more}", shown.join(", "))
}

/// Notes about some frames, without duplicates.
fn warnings<'a>(frames: impl Iterator<Item = &'a Frame> + Clone) -> Vec<String> {
    let mut warnings = Vec::new();
    let named = |is_meant: &dyn Fn(&Notes) -> bool| {
        let names: Vec<&str> =
            frames.clone().filter(|f| is_meant(&f.notes)).map(|f| f.name.as_str()).collect();
        let noun = if names.len() == 1 { "frame" } else { "frames" };
        (!names.is_empty()).then(|| format!("{noun} {}", list(&names)))
    };
    let values = |of: fn(&Notes) -> &[&'static str]| {
        let values: BTreeSet<&str> = frames.clone().flat_map(|f| of(&f.notes)).copied().collect();
        values.into_iter().collect::<Vec<_>>().join(", ")
    };
    if let Some(frames) = named(&|notes| !notes.distortion.is_empty()) {
        let left_out = values(|notes| &notes.distortion);
        warnings.push(format!(
            "{frames}: distortion of the lens ({left_out}) is left out, for cameras are pinholes \
             here; photographs must be undistorted first"
        ));
    }
    if let Some(frames) = named(&|notes| !notes.unsized_values.is_empty()) {
        let stated = values(|notes| &notes.unsized_values);
        warnings.push(format!(
            "{frames}: no size of the picture is stated, and no picture is there that has one: \
             {DEFAULT_SIDE}x{DEFAULT_SIDE} is assumed, though {stated} are in pixels of the true \
             size; option size sets it"
        ));
    }
    let unread = frames.clone().find_map(|frame| frame.notes.unread.as_deref());
    if let (Some(names), Some(why)) = (named(&|notes| notes.unread.is_some()), unread) {
        warnings.push(format!("{names}: a picture is there whose size cannot be read: {why}"));
    }
    warnings
}
