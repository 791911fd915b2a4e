//! The trained scene: its grids, its network and its mask.

use super::{FreeSpace, Scene, Volume};
use crate::model::view_mlp::ViewMlp;

/// A trained scene, grids not yet read.
#[derive(Debug, Clone)]
pub struct RadianceField {
    /// What a renderer needs beside the grids.
    pub scene: Scene,
    /// Raw logits, one channel.
    pub density: Volume,
    /// Raw logits: 3 diffuse colour channels, then the specular features, in one volume or more.
    pub color: Vec<Volume>,
    /// View-dependent colour, added once a ray; without it the scene is diffuse.
    pub view_mlp: Option<ViewMlp>,
    /// Where training kept samples; without it everywhere.
    pub free_space: Option<FreeSpace>,
}

impl RadianceField {
    /// Channels of colour and features together.
    pub fn color_channels(&self) -> usize {
        self.color.iter().map(|volume| volume.channels).sum()
    }

    /// The volume that holds a channel, 0 being density and the others colour, and the channel's
    /// number in it.
    pub(super) fn volume_of(&self, channel: usize) -> Option<(&Volume, usize)> {
        let mut left = channel;
        for volume in std::iter::once(&self.density).chain(&self.color) {
            if left < volume.channels {
                return Some((volume, left));
            }
            left -= volume.channels;
        }
        None
    }
}
