//! A field to render: its rules, and either values in as many lanes as its channels need, or a
//! model that evaluates itself.

use super::trained::{TrainedLevels, view_of};
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::container::{Container, check_metadata};
use crate::model::baked::BakedField;
use crate::model::directional::DIRECTIONAL;
use crate::model::field::RadianceField;
use crate::model::grid::Bounds;
use crate::model::trained_model::{LoadModel, TrainedModel};
use crate::model::view_dependence::ViewDependence;
use crate::view::sample::{Dense, SampleLevels as _, Sparse, Stored, View};

/// Renders a field.
#[derive(Debug)]
pub struct Renderer {
    view: View,
    content: Content,
}

/// The source of a field's colours.
#[derive(Debug)]
pub(crate) enum Content {
    /// Values at nodes, rendered by the rules of a [`View`].
    Values(Lanes),
    /// A model with its own rules; it takes only box, background, near and far from the view.
    Model(Box<dyn TrainedModel>),
}

/// Values, by the number of lanes for colours and features. Lanes without a channel are zero.
#[derive(Debug)]
pub(crate) enum Lanes {
    Four(Stored<4>),
    Eight(Stored<8>),
    Twelve(Stored<12>),
    Sixteen(Stored<16>),
    ThirtyTwo(Stored<32>),
    FortyEight(Stored<48>),
    SixtyFour(Stored<64>),
}

/// The same with values in lanes of each width.
macro_rules! with_lanes {
    ($lanes:expr, $stored:ident => $result:expr) => {
        match $lanes {
            $crate::view::render::Lanes::Four($stored) => $result,
            $crate::view::render::Lanes::Eight($stored) => $result,
            $crate::view::render::Lanes::Twelve($stored) => $result,
            $crate::view::render::Lanes::Sixteen($stored) => $result,
            $crate::view::render::Lanes::ThirtyTwo($stored) => $result,
            $crate::view::render::Lanes::FortyEight($stored) => $result,
            $crate::view::render::Lanes::SixtyFour($stored) => $result,
        }
    };
}
pub(crate) use with_lanes;

/// The same with values of each kind. The kind is dispatched once per picture, not per sample.
macro_rules! with_values {
    ($lanes:expr, $values:ident => $result:expr) => {
        $crate::view::render::with_lanes!($lanes, stored => match stored {
            $crate::view::sample::Stored::Dense($values) => $result,
            $crate::view::sample::Stored::Sparse($values) => $result,
        })
    };
}
pub(crate) use with_values;

/// Values for this many channels of colour and features, in the fewest lanes that hold them.
macro_rules! in_lanes {
    ($channels:expr, $values:expr) => {
        match $channels {
            0..=4 => Ok(Lanes::Four($values)),
            5..=8 => Ok(Lanes::Eight($values)),
            9..=12 => Ok(Lanes::Twelve($values)),
            13..=16 => Ok(Lanes::Sixteen($values)),
            17..=32 => Ok(Lanes::ThirtyTwo($values)),
            33..=48 => Ok(Lanes::FortyEight($values)),
            49..=64 => Ok(Lanes::SixtyFour($values)),
            channels => {
                let found = format!("{channels} channels of colour and features");
                Err(Error::unsupported(Place::File, found, "at most 64"))
            }
        }
    };
}

impl Renderer {
    /// A trained field, with coarser levels if `levels` has a filter. All of its values are read.
    ///
    /// # Errors `Malformed` if the field's parts are inconsistent, `Unsupported` for more than 64
    /// channels of colour and features, and errors of reading the values.
    pub fn trained(
        field: &RadianceField,
        levels: Option<TrainedLevels>,
        limits: &Limits,
    ) -> Result<Self> {
        field.check()?;
        let view = view_of(field, levels);
        let filter = levels.map(|levels| (levels.filter, levels.count));
        let channels = field.color_channels() + if view.directional { DIRECTIONAL } else { 0 };
        let values: Result<Lanes> =
            in_lanes!(channels, Stored::Dense(Dense::new(field, filter, limits)?));
        Ok(Self { view, content: Content::Values(values?) })
    }

    /// A model with its own rules, which takes box, background, near and far from `field`.
    ///
    /// # Errors
    /// `Malformed` if the field's parts are inconsistent, and errors of loading.
    pub fn of_model(field: &RadianceField, model: &dyn LoadModel, limits: &Limits) -> Result<Self> {
        field.check()?;
        Ok(Self { view: view_of(field, None), content: Content::Model(model.load(limits)?) })
    }

    /// A baked field.
    ///
    /// # Errors
    /// `Malformed` if metadata or codes break the rules of a container.
    pub fn baked(field: &BakedField, limits: &Limits) -> Result<Self> {
        check_metadata(&field.metadata, limits, &Place::File)?;
        field.check()?;
        let channels = field.metadata.layout().color_channels();
        let values: Result<Lanes> =
            in_lanes!(channels, Stored::Sparse(Sparse::new(field, limits)?));
        Ok(Self { view: View::of_baked(field), content: Content::Values(values?) })
    }

    /// All levels of a container, within its limits at opening.
    ///
    /// # Errors
    /// `Malformed` if its levels are damaged, and more memory than the limits allow.
    pub fn of_container(container: &Container) -> Result<Self> {
        Self::baked(&container.read()?, container.limits())
    }

    /// True if a ray gathers diffuse colour apart from what depends on the view: a network adds to
    /// it, or nothing does. Harmonics and models by their own rules have no such part.
    pub fn separates_diffuse(&self) -> bool {
        let has_harmonics = matches!(self.view.view_dependence, Some(ViewDependence::Harmonics(_)));
        matches!(self.content, Content::Values(_)) && !has_harmonics
    }

    /// A model in memory with its own rules. Box, background, near and far come from the view of
    /// another field.
    pub fn with_view(view: &View, model: Box<dyn TrainedModel>) -> Self {
        Self { view: view.clone(), content: Content::Model(model) }
    }

    /// True if colours come from a model with its own rules.
    pub fn is_model(&self) -> bool {
        matches!(self.content, Content::Model(_))
    }

    /// Skips all samples outside a box.
    ///
    /// # Errors `InvalidOption` for an empty box or one outside the field's, `Usage` for a model
    /// with its own rules.
    pub fn crop(&mut self, crop: &Bounds) -> Result<()> {
        if self.is_model() {
            let message = "--crop works on values at nodes, and this model is evaluated by its own \
                           rules: bake it first";
            return Err(Error::usage(message));
        }
        let bounds = self.view.march.sampled.unwrap_or(self.view.bounds);
        let sampled = Bounds {
            min: std::array::from_fn(|axis| crop.min[axis].max(bounds.min[axis])),
            max: std::array::from_fn(|axis| crop.max[axis].min(bounds.max[axis])),
        };
        let found = format!("{:?} to {:?}", crop.min, crop.max);
        let expected = format!("a box that meets {:?} to {:?}", bounds.min, bounds.max);
        sampled.check(&Place::File).map_err(|_| Error::invalid_option("crop", found, expected))?;
        self.view.march.sampled = Some(sampled);
        Ok(())
    }

    /// A trained field without coarser levels. All of its values are read.
    ///
    /// # Errors
    /// As [`Self::trained`].
    pub fn of_field(field: &RadianceField) -> Result<Self> {
        Self::trained(field, None, &Limits::default())
    }

    /// The rules.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// Number of levels, including those missing from a prefix of a container.
    pub fn level_count(&self) -> usize {
        match &self.content {
            Content::Values(lanes) => with_values!(lanes, values => values.levels()),
            Content::Model(_) => 1,
        }
    }

    /// The rules, to override them.
    pub fn view_mut(&mut self) -> &mut View {
        &mut self.view
    }

    /// The source of colours.
    pub(super) fn content(&self) -> &Content {
        &self.content
    }

    /// The values at nodes.
    pub(super) fn lanes(&self) -> Result<&Lanes> {
        match &self.content {
            Content::Values(lanes) => Ok(lanes),
            Content::Model(_) => Err(without_nodes()),
        }
    }

    /// Rules and values at nodes.
    pub(crate) fn into_parts(self) -> Result<(View, Lanes)> {
        match self.content {
            Content::Values(lanes) => Ok((self.view, lanes)),
            Content::Model(_) => Err(without_nodes()),
        }
    }
}

fn without_nodes() -> Error {
    Error::usage("this works on values at nodes, and the model is evaluated by its own rules")
}
