//! The renderer's settings beside the bulk: the JSON of a container's `META` chunk.

use super::generated::{Encoding, LevelMetadata, Metadata, NetworkMetadata, ViewMetadata};
use super::harmonics::HarmonicsMetadata;
use super::{ColorLayout, Decode, DensityDomain, Group};
use crate::model::activate;
use crate::model::grid::{BlockGrid, Bounds, Nodes};
use crate::model::harmonics::{BAND_0, FUNCTIONS, Harmonics};
use crate::model::scene::ColorDomain;
use crate::model::view_dependence::ViewDependence;
use crate::model::view_mlp::ViewMlp;

impl Metadata {
    /// The meaning of colours.
    pub fn color_domain(&self) -> ColorDomain {
        let diffuse = self.levels.first().and_then(|level| level.diffuse.as_ref());
        match diffuse.map(|encoding| encoding.decode) {
            Some(Decode::Linear | Decode::Coefficient(_)) => ColorDomain::Linear,
            _ => ColorDomain::Logit,
        }
    }

    /// The stated view dependence, with its `network` if it has one.
    pub fn view_dependence(&self, network: Option<&ViewMlp>) -> Option<ViewDependence> {
        match self.view.as_ref()? {
            ViewMetadata::Harmonics(harmonics) => Some(ViewDependence::Harmonics(harmonics.rules)),
            ViewMetadata::Network(_) => network.cloned().map(ViewDependence::Network),
        }
    }

    /// A colour channel, 0 to 1, of a diffuse value; for harmonics, the mean over all directions.
    pub fn mean_color(&self, value: f32) -> f64 {
        let view = self.view.as_ref().and_then(ViewMetadata::harmonics);
        match (view, self.color_domain()) {
            (Some(rules), _) => {
                let band_0 = Harmonics { degree: 0, ..*rules };
                let [color, ..] = band_0.color(&[BAND_0; FUNCTIONS], &[value; 3]);
                f64::from(color).clamp(0.0, 1.0)
            }
            (None, ColorDomain::Linear) => f64::from(value).clamp(0.0, 1.0),
            (None, ColorDomain::Logit) => activate::sigmoid(value.into()),
        }
    }

    /// The parts of a node's values beside density.
    pub fn layout(&self) -> ColorLayout {
        let harmonics = self.view.as_ref().and_then(ViewMetadata::harmonics);
        ColorLayout {
            features: if harmonics.is_some() { 0 } else { self.features },
            degree: harmonics.map_or(0, |harmonics| harmonics.degree),
            directional: self.has_directional(),
            anisotropy: self.has_anisotropy(),
        }
    }

    /// Levels and shells, the parts with a table and atlases. Part `k` is level `k`; the shells of
    /// levels 1, 2 and so on follow the levels.
    pub fn parts(&self) -> impl Iterator<Item = &LevelMetadata> {
        self.levels.iter().chain(&self.shells)
    }

    /// The same, mutable.
    pub fn parts_mut(&mut self) -> impl Iterator<Item = &mut LevelMetadata> {
        self.levels.iter_mut().chain(&mut self.shells)
    }

    /// A part by its number.
    pub fn part(&self, number: usize) -> Option<&LevelMetadata> {
        self.parts().nth(number)
    }

    /// The number of the level that a part belongs to.
    pub fn level_of_part(&self, part: usize) -> usize {
        if part < self.levels.len() { part } else { part - self.levels.len() + 1 }
    }

    /// The name of a part in files and messages: `level2`, `shell1`.
    pub fn part_name(&self, part: usize) -> String {
        let kind = if part < self.levels.len() { "level" } else { "shell" };
        format!("{kind}{}", self.level_of_part(part))
    }

    /// True if a part and the next coarser level span the same box, as inherited blocks require.
    pub fn shares_box_with_coarser(&self, part: usize) -> bool {
        let coarser = self.level_of_part(part) + 1;
        coarser < self.levels.len() && self.box_of_part(part) == self.box_of_part(coarser)
    }

    /// The number of a level's shell among the parts, if it has one.
    pub fn shell_of(&self, level: usize) -> Option<usize> {
        (1..=self.shells.len()).contains(&level).then(|| self.levels.len() + level - 1)
    }

    /// Bytes of all values that are stored, as floats in memory.
    pub fn value_bytes(&self) -> u64 {
        let part = |part: &LevelMetadata| {
            let layout = self.layout();
            let groups = Group::ALL.into_iter().filter(|group| part.encoding(*group).is_some());
            let channels: usize = groups.map(|group| group.channels(layout)).sum();
            let nodes = (part.block_size as u64).pow(3);
            part.blocks_stored as u64 * nodes * channels as u64 * size_of::<f32>() as u64
        };
        self.parts().map(part).sum()
    }

    /// The next coarser level of a part.
    pub fn coarser(&self, part: usize) -> Option<&LevelMetadata> {
        self.levels.get(self.level_of_part(part) + 1)
    }

    /// Numbers of the parts in the order of a file: coarse to fine, a shell before its level.
    pub fn parts_in_file(&self) -> impl Iterator<Item = usize> {
        (0..self.levels.len())
            .rev()
            .flat_map(|level| self.shell_of(level).into_iter().chain([level]))
    }

    /// The boxes, smallest first: that of level 0, then those of shells.
    pub fn boxes(&self) -> Vec<Bounds> {
        let shells = self.shells.iter().map(|shell| shell.bounds.unwrap_or(self.bounds));
        std::iter::once(self.bounds).chain(shells).collect()
    }

    /// The number of the box that a part spans: a shell's own box, or the box of the next finer
    /// level.
    pub fn box_of_part(&self, part: usize) -> usize {
        match part < self.levels.len() {
            true => part.saturating_sub(1).min(self.shells.len()),
            false => self.level_of_part(part),
        }
    }

    /// The outermost box.
    pub fn outer_bounds(&self) -> Bounds {
        self.level_bounds(self.shells.len())
    }

    /// The box that a level spans with its shell.
    pub fn level_bounds(&self, level: usize) -> Bounds {
        let shell = level.min(self.shells.len()).checked_sub(1);
        let shell = shell.and_then(|shell| self.shells.get(shell));
        shell.and_then(|shell| shell.bounds).unwrap_or(self.bounds)
    }

    /// True if a level has directional brightness.
    pub fn has_directional(&self) -> bool {
        self.levels.iter().any(|level| level.directional.is_some())
    }

    /// True if a level has anisotropy.
    pub fn has_anisotropy(&self) -> bool {
        self.levels.iter().any(|level| level.anisotropy.is_some())
    }
}

impl LevelMetadata {
    /// The cut into blocks.
    pub fn grid(&self) -> BlockGrid {
        BlockGrid { nodes: Nodes(self.dimensions), edge: self.block_size }
    }

    /// The domain of the level's density; raw where it has none, as every file's level 0 may be.
    pub fn density_domain(&self) -> DensityDomain {
        let stated = self.density.as_ref().and_then(|density| density.decode.density());
        stated.unwrap_or(DensityDomain::Raw)
    }

    /// True if colours are stored in integer codes, as inherited blocks require.
    pub fn has_integer_colors(&self) -> bool {
        let mut colors = Group::COLORS.into_iter().filter_map(|group| self.encoding(group));
        colors.all(|encoding| !encoding.number.is_float())
    }

    /// All encodings with their groups, mutable, in the order of [`Group::ALL`].
    pub fn encodings_mut(&mut self) -> impl Iterator<Item = (Group, &mut Encoding)> {
        let bands = self.bands.iter_mut().enumerate();
        let groups = [
            (Group::Density, self.density.as_mut()),
            (Group::Diffuse, self.diffuse.as_mut()),
            (Group::Features, self.features.as_mut()),
        ];
        let groups = groups.into_iter().filter_map(|(group, encoding)| Some((group, encoding?)));
        let directional = self.directional.as_mut().map(|encoding| (Group::Directional, encoding));
        let anisotropy = self.anisotropy.as_mut().map(|encoding| (Group::Anisotropy, encoding));
        let bands = bands.map(|(i, encoding)| (Group::Band(i + 1), encoding));
        groups.chain(bands).chain(directional).chain(anisotropy)
    }

    /// The encoding of a group, mutable.
    pub fn encoding_mut(&mut self, group: Group) -> Option<&mut Encoding> {
        match group {
            Group::Density => self.density.as_mut(),
            Group::Diffuse => self.diffuse.as_mut(),
            Group::Features => self.features.as_mut(),
            Group::Band(band) => self.bands.get_mut(band - 1),
            Group::Directional => self.directional.as_mut(),
            Group::Anisotropy => self.anisotropy.as_mut(),
        }
    }

    /// The encoding of a group.
    pub fn encoding(&self, group: Group) -> Option<&Encoding> {
        match group {
            Group::Density => self.density.as_ref(),
            Group::Diffuse => self.diffuse.as_ref(),
            Group::Features => self.features.as_ref(),
            Group::Band(band) => self.bands.get(band - 1),
            Group::Directional => self.directional.as_ref(),
            Group::Anisotropy => self.anisotropy.as_ref(),
        }
    }
}

impl ViewMetadata {
    /// The network, if it is one.
    pub fn network(&self) -> Option<&NetworkMetadata> {
        match self {
            Self::Network(network) => Some(network),
            Self::Harmonics(_) => None,
        }
    }

    /// The harmonics, if it is them.
    pub fn harmonics(&self) -> Option<&Harmonics> {
        match self {
            Self::Network(_) => None,
            Self::Harmonics(harmonics) => Some(&harmonics.rules),
        }
    }

    /// The facts of a field's view dependence.
    pub fn of(view: &ViewDependence) -> Self {
        match view {
            ViewDependence::Network(network) => Self::Network(NetworkMetadata {
                widths: network.widths(),
                frequencies: network.frequencies,
                input: network.input,
            }),
            ViewDependence::Harmonics(rules) => Self::Harmonics(HarmonicsMetadata::new(*rules)),
        }
    }
}
