//! Global values of a file.

use crate::base::error::{Error, Place, Result};
use crate::tensor::{FileKind, TensorFile, Value};

/// Numbers that a file states once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Settings {
    /// Middle of all boxes, in world units.
    pub(super) center: [f64; 3],
    /// Edge of the octree's root, in world units.
    pub(super) extent: f64,
    /// Edge of the inner box, if it is stated.
    pub(super) inside: Option<f64>,
    /// Degree of the harmonics that are used, if it is stated.
    pub(super) degree: Option<usize>,
    /// GeoSVR's supersampling factor of pictures.
    pub(super) supersampling: Option<f64>,
}

/// Refuses a number of harmonics that is not that of degree 0 to 3. `columns` counts those of all
/// three colour channels.
pub(super) fn check_harmonics(columns: usize, place: &Place) -> Result<()> {
    if [3, 12, 27, 48].contains(&columns) {
        return Ok(());
    }
    let found = format!("{columns} numbers of colour");
    Err(Error::malformed(place.clone(), found, "3, 12, 27 or 48: harmonics of degree 0 to 3"))
}

impl Settings {
    pub(super) fn read(file: &TensorFile) -> Result<Self> {
        let settings = match file.kind {
            FileKind::Ply => Self::of_comments(file)?,
            _ => Self::of_checkpoint(&file.root)?,
        };
        let Self { center, extent, inside, .. } = settings;
        let bad = |key: &str, found: String, expected: &str| {
            Err(Error::malformed(Place::Key(key.to_owned()), found, expected))
        };
        if !center.iter().all(|at| at.abs() <= 1e10) {
            return bad("scene_center", format!("{center:?}"), "a position within 1e10 of 0");
        }
        if !(1e-9..=1e10).contains(&extent) {
            return bad("scene_extent", extent.to_string(), "an edge from 1e-9 to 1e10");
        }
        if let Some(inside) = inside.filter(|inside| !(*inside > 0.0 && *inside <= extent * 1.001))
        {
            return bad("inside_extent", inside.to_string(), "an edge above 0, up to scene_extent");
        }
        Ok(settings)
    }

    fn of_checkpoint(root: &Value) -> Result<Self> {
        let needed = |key: &str| {
            let missing = || Error::malformed(Place::Key(key.to_owned()), "nothing", "a number");
            root.get(key).ok_or_else(missing)
        };
        let optional = |key: &str| root.get(key).filter(|value| !value.is_none());
        Ok(Self {
            center: needed("scene_center")?.vector3("scene_center")?,
            extent: needed("scene_extent")?.number("scene_extent")?,
            inside: optional("inside_extent")
                .map(|value| value.number("inside_extent"))
                .transpose()?,
            degree: optional("active_sh_degree").map(degree).transpose()?,
            supersampling: optional("ss").map(|value| value.number("ss")).transpose()?,
        })
    }

    fn of_comments(file: &TensorFile) -> Result<Self> {
        let numbers = |key: &str| -> Result<Option<Vec<f64>>> {
            let Some(Value::Text(text)) = file.root.at(&["comments", key]) else { return Ok(None) };
            let found: std::result::Result<Vec<f64>, _> =
                text.split_ascii_whitespace().take(4).map(str::parse).collect();
            let place = || Place::Key(format!("comment {key}"));
            found.map(Some).map_err(|error| Error::malformed(place(), error.to_string(), "numbers"))
        };
        let (center, extent) = (numbers("scene_center")?, numbers("scene_extent")?);
        let missing = |key: &str, expected: &str| {
            Error::malformed(Place::Key(format!("comment {key}")), "another text or none", expected)
        };
        let center = center.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
        let extent = extent.as_deref().and_then(|numbers| numbers.first().copied());
        let degree = numbers("active_sh_degree")?.and_then(|numbers| numbers.first().copied());
        Ok(Self {
            center: center.ok_or_else(|| missing("scene_center", "three numbers"))?,
            extent: extent.ok_or_else(|| missing("scene_extent", "a number"))?,
            inside: None,
            degree: degree.map(|value| self::degree(&Value::Float(value))).transpose()?,
            supersampling: None,
        })
    }
}

fn degree(value: &Value) -> Result<usize> {
    let found = value.integer("active_sh_degree")?;
    usize::try_from(found).ok().filter(|degree| *degree <= 3).ok_or_else(|| {
        let place = Place::Key("active_sh_degree".to_owned());
        Error::malformed(place, found.to_string(), "a degree from 0 to 3")
    })
}
