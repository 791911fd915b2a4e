//! The trained scene: its grids, its network and its mask.

use super::{Activation, FreeSpace, Scene, Volume};
use crate::base::error::{Error, Place, Result};
use crate::model::view_mlp::ViewMlp;

/// A trained scene, grids not yet read.
#[derive(Debug, Clone)]
pub struct RadianceField {
    /// The renderer's settings beside the grids.
    pub scene: Scene,
    /// Raw logits, one channel.
    pub density: Volume,
    /// Raw logits: 3 diffuse colour channels, then the specular features, in one volume or more.
    pub color: Vec<Volume>,
    /// View-dependent colour, added once a ray; without it the scene is diffuse.
    pub view_mlp: Option<ViewMlp>,
    /// The space in which training kept samples; none means everywhere.
    pub free_space: Option<FreeSpace>,
}

impl RadianceField {
    /// Refuses a field whose parts do not fit each other.
    ///
    /// # Errors
    /// `Malformed` or `Unsupported`, with the part as its place.
    pub fn check(&self) -> Result<()> {
        let Scene { bounds, nodes, activation, march, .. } = &self.scene;
        let place = |key: &str| Place::Key(key.to_owned());
        let require = |holds: bool, key: &str, found: String, expected: &str| match holds {
            true => Ok(()),
            false => Err(Error::malformed(place(key), found, expected)),
        };
        bounds.check(&place("bounds"))?;
        let large = nodes.0.iter().all(|&size| size >= 2);
        require(large, "nodes", format!("{:?}", nodes.0), "at least 2 nodes along each axis")?;
        let Activation { shift, interval, .. } = *activation;
        let opaque = shift.is_finite() && interval > 0.0 && interval.is_finite();
        let found = format!("shift {shift}, interval {interval}");
        require(opaque, "activation", found, "a finite shift and a positive interval")?;
        march.check(*nodes)?;
        let found = format!("{} channels", self.density.channels);
        require(self.density.channels == 1, "density", found, "one channel")?;
        let found = format!("{} channels", self.color_channels());
        require(self.color_channels() >= 3, "colour", found, "at least 3 channels")?;
        for volume in std::iter::once(&self.density).chain(&self.color) {
            let found = format!("a volume of {:?} nodes", volume.nodes.0);
            let expected = format!("{:?} nodes", nodes.0);
            require(volume.nodes == *nodes, "volumes", found, &expected)?;
        }
        if let Some(network) = &self.view_mlp {
            network.check(self.color_channels() - 3, &place("view network"))?;
        }
        self.free_space.as_ref().map_or(Ok(()), FreeSpace::check)
    }

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
