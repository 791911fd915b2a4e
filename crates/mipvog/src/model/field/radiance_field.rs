//! The trained scene: its grids, its network and its mask.

use super::{Activation, ColorDomain, DensityFunction, FreeSpace, Grid, Lattice, Scene, Shell};
use crate::base::error::{Error, Place, Result};
use crate::base::progress::Progress;
use crate::model::grid::{Bounds, BoxFrame};
use crate::model::harmonics::Harmonics;
use crate::model::view_dependence::ViewDependence;
use crate::model::view_mlp::ViewMlp;

/// A trained scene, grids not yet read.
#[derive(Debug, Clone)]
pub struct RadianceField {
    /// The renderer's settings beside the grids.
    pub scene: Scene,
    /// Raw density, one channel.
    pub density: Grid,
    /// Raw colour in one grid or more: 3 diffuse channels, then the specular features; or the
    /// coefficients of harmonics, function by function, each red, green and blue.
    pub color: Vec<Grid>,
    /// The meaning of raw colour; linear beside harmonics.
    pub color_domain: ColorDomain,
    /// View-dependent colour; without it the scene is diffuse.
    pub view: Option<ViewDependence>,
    /// The space in which training kept samples; none for everywhere.
    pub free_space: Option<FreeSpace>,
    /// The world around the box, from level 1 on; none for an object.
    pub shells: Vec<Shell>,
}

impl RadianceField {
    /// Prepares data that all planes of its grids need; see
    /// [`NodeValues::prepare`](super::NodeValues::prepare).
    ///
    /// # Errors
    /// Errors of reading, and a request to stop.
    pub fn prepare(&self, progress: &dyn Progress) -> Result<()> {
        let shells = self.shells.iter().flat_map(Shell::grids);
        self.grids().chain(shells).try_for_each(|grid| grid.prepare(progress))
    }

    /// Refuses a field with inconsistent parts.
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
        let Activation { shift, interval, function, .. } = *activation;
        let opaque = shift.is_finite() && interval > 0.0 && interval.is_finite();
        let found = format!("shift {shift}, interval {interval}");
        require(opaque, "activation", found, "a finite shift and a positive interval")?;
        let shifted = function == DensityFunction::Relu && shift != 0.0;
        require(!shifted, "activation", format!("relu with shift {shift}"), "no shift")?;
        let outer = self.outer_bounds();
        march.check_nested(*nodes, bounds, &outer)?;
        let found = format!("{:?}", march.sampled);
        require(march.samples_within(&outer), "march.sampled", found, "a box within the field's")?;
        let found = format!("{} channels", self.density.channels());
        require(self.density.channels() == 1, "density", found, "one channel")?;
        let found = format!("{} channels", self.color_channels());
        require(self.color_channels() >= 3, "colour", found, "at least 3 channels")?;
        for grid in self.grids() {
            let found = format!("a grid of {:?} nodes", grid.nodes().0);
            let expected = format!("{:?} nodes", nodes.0);
            require(grid.nodes() == *nodes, "grids", found, &expected)?;
        }
        if let Some(view) = &self.view {
            view.check(self.color_channels() - 3, &place("view dependence"))?;
            let harmonics = view.harmonics().is_some();
            let expected = "linear colours with harmonics, logits with a network";
            let found = format!("{:?}", self.color_domain);
            let fits = harmonics == (self.color_domain == ColorDomain::Linear);
            require(fits, "colour", found, expected)?;
        }
        self.check_shells()?;
        self.free_space.as_ref().map_or(Ok(()), FreeSpace::check)
    }

    fn check_shells(&self) -> Result<()> {
        let mut smaller = self.lattice();
        for (number, shell) in (1..).zip(&self.shells) {
            let place = Place::Key(format!("shells[{number}]"));
            shell.lattice.check_around(&smaller, &place)?;
            smaller = shell.lattice;
            let channels: Vec<usize> = shell.grids().map(Grid::channels).collect();
            let own: Vec<usize> = self.grids().map(Grid::channels).collect();
            let grids = shell.grids().all(|grid| grid.nodes() == smaller.nodes);
            if channels != own || !grids {
                let found = format!("grids of {channels:?} channels");
                let expected = format!("{own:?} channels at {:?} nodes", smaller.nodes.0);
                return Err(Error::malformed(place, found, expected));
            }
        }
        Ok(())
    }

    /// The boxes of level 0 and of shells.
    fn boxes(&self) -> Vec<Bounds> {
        self.lattices().iter().map(|lattice| lattice.bounds).collect()
    }

    /// The box of everything.
    pub fn outer_bounds(&self) -> Bounds {
        self.shells.last().map_or(self.scene.bounds, |shell| shell.lattice.bounds)
    }

    /// Places of the boxes within the outermost one; empty if there is one box.
    pub fn frames(&self) -> Vec<BoxFrame> {
        BoxFrame::of_boxes(&self.boxes())
    }

    /// A shell as a separate field in one box; none if there is no such shell. Numbers start at 1.
    pub fn of_shell(&self, number: usize) -> Option<Self> {
        let Shell { lattice, density, color } = self.shells.get(number.checked_sub(1)?)?;
        let mut scene = self.scene.clone();
        (scene.bounds, scene.nodes, scene.march.sampled) = (lattice.bounds, lattice.nodes, None);
        Some(Self {
            scene,
            density: density.clone(),
            color: color.clone(),
            free_space: None,
            shells: Vec::new(),
            ..self.clone()
        })
    }

    /// The box of level 0 with its nodes.
    pub const fn lattice(&self) -> Lattice {
        Lattice::new(self.scene.bounds, self.scene.nodes)
    }

    /// The boxes of all levels that have their own, level 0's first.
    pub fn lattices(&self) -> Vec<Lattice> {
        std::iter::once(self.lattice())
            .chain(self.shells.iter().map(|shell| shell.lattice))
            .collect()
    }

    /// Channels of colour and features together.
    pub fn color_channels(&self) -> usize {
        self.color.iter().map(Grid::channels).sum()
    }

    /// The network that makes view-dependent colour, if there is one.
    pub fn network(&self) -> Option<&ViewMlp> {
        self.view.as_ref().and_then(ViewDependence::network)
    }

    /// The harmonics, if any.
    pub fn harmonics(&self) -> Option<&Harmonics> {
        self.view.as_ref().and_then(ViewDependence::harmonics)
    }

    /// All grids, density first.
    pub fn grids(&self) -> impl Iterator<Item = &Grid> {
        std::iter::once(&self.density).chain(&self.color)
    }

    /// The grid that holds a channel (0 is density, the others colour), and the channel's index in
    /// it.
    pub fn grid_of(&self, channel: usize) -> Option<(&Grid, usize)> {
        let mut left = channel;
        for grid in self.grids() {
            if left < grid.channels() {
                return Some((grid, left));
            }
            left -= grid.channels();
        }
        None
    }
}
