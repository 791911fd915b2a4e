//! The arrays and settings of a file.

use std::sync::Arc;

use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, Budget, LimitName, Limits};
use crate::model::grid::{Bounds, Nodes};
use crate::model::harmonics::{Clamp, Evaluation, Harmonics};
use crate::sparse::{Index, RowArray};
use crate::tensor::{Tensor, TensorFile, Value};

/// Nodes along a block's edge, at most.
const MAX_BLOCK: u64 = 1024;

/// The arrays of a file.
#[derive(Debug, Clone)]
pub(super) struct Arrays {
    pub(super) index: Arc<Index>,
    pub(super) density: Arc<RowArray>,
    pub(super) color: Arc<RowArray>,
    /// The rules of harmonics, clamped at each sample; none for plain colours.
    pub(super) harmonics: Option<Harmonics>,
    pub(super) bounds: Bounds,
}

/// True for a file of sampled arrays. A missing box is reported when the file is opened.
pub fn knows(file: &TensorFile) -> bool {
    let is_tensor = |key: &str| file.root.get(key).is_some_and(|value| value.tensor().is_some());
    is_tensor("density") && (is_tensor("sh") || is_tensor("color"))
}

/// The numbers of a setting; in text, separated by commas.
pub(super) fn numbers(file: &TensorFile, key: &str) -> Result<Option<Vec<f64>>> {
    let Some(value) = file.setting(key) else { return Ok(None) };
    let Value::Text(text) = value else { return value.numbers(key).map(Some) };
    let plain = text.trim_matches(['[', ']', ' ']);
    let numbers: Option<Vec<f64>> = plain.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers.map(Some).ok_or_else(|| {
        Error::malformed(
            Place::Key(key.to_owned()),
            format!("{text:?}"),
            "numbers separated by commas, such as 1,1,1",
        )
    })
}

/// One finite number.
#[expect(clippy::cast_possible_truncation, reason = "settings are float32")]
pub(super) fn number(file: &TensorFile, key: &str) -> Result<Option<f32>> {
    match numbers(file, key)?.as_deref() {
        None => Ok(None),
        Some(&[number]) if (number as f32).is_finite() => Ok(Some(number as f32)),
        Some(found) => {
            let place = Place::Key(key.to_owned());
            Err(Error::malformed(place, format!("{found:?}"), "one finite number"))
        }
    }
}

impl Arrays {
    /// Finds the arrays of the first box, and those of the boxes around it.
    pub(super) fn find_all(file: &TensorFile, limits: &Limits) -> Result<(Self, Vec<Self>)> {
        let first = Self::find(file, 0, limits)?;
        let mut around = Vec::new();
        while file.root.get(&key_of(around.len() + 1, "density")).is_some() {
            let level = around.len() + 1;
            let found = Self::find(file, level, limits)?;
            if found.harmonics != first.harmonics {
                let place = Place::Key(key_of(level, "density"));
                let expected = "colours of the same kind in all boxes";
                return Err(Error::malformed(
                    place,
                    "colours of another kind than the first box's",
                    expected,
                ));
            }
            around.push(found);
        }
        Ok((first, around))
    }

    /// Finds the arrays of a box; reads the places of blocks.
    fn find(file: &TensorFile, level: usize, limits: &Limits) -> Result<Self> {
        let key = |name: &str| key_of(level, name);
        let get = |name: &str| file.root.get(&key(name));
        let tensor = |name: &str| -> Result<&Tensor> {
            get(name).and_then(Value::tensor).ok_or_else(|| {
                let place = Place::Tensor(key(name));
                Error::malformed(place, "no such array", "an array of sampled density and colour")
            })
        };
        let density = tensor("density")?;
        let (color, plain) = match get("sh") {
            Some(_) => (tensor("sh")?, false),
            None => (tensor("color")?, true),
        };
        if !plain && get("color").is_some() {
            let place = Place::Tensor(key("color"));
            return Err(Error::malformed(place, "color beside sh", "one of them"));
        }
        // Outer boxes are dense, or have blocks like the first one.
        let block = block_size(file)?.filter(|_| level == 0 || get("blocks").is_some());
        let (places, own): (_, &[u64]) = match (get("blocks"), block) {
            (Some(_), Some(_)) => (Some(places(tensor("blocks")?, limits)?), density.shape()),
            (None, None) => (None, density.shape()),
            _ => {
                let found = "one of blocks and block_size";
                return Err(Error::malformed(Place::Key(key("blocks")), found, "both or neither"));
            }
        };
        let functions = match (color.shape().strip_prefix(own), plain) {
            (Some(&[3]), true) => 1,
            (Some(&[3, functions @ (1 | 4 | 9 | 16)]), false) => {
                usize::try_from(functions).unwrap_or(0)
            }
            _ => {
                let found = format!("shape {:?} for density of shape {own:?}", color.shape());
                let last = if plain { "3" } else { "3, B with B of 1, 4, 9 or 16" };
                let expected = format!("the shape of density, then {last}");
                return Err(Error::malformed(color.place(), found, expected));
            }
        };
        let density = RowArray::new(density, 1, limits)?;
        let color = RowArray::new(color, 3 * functions, limits)?;
        let place = Place::Tensor(key("density"));
        let index = match (own, places, block) {
            (&[x, y, z], None, _) => {
                let nodes = Nodes::checked([x, y, z], limits, &place)?;
                Index::dense(nodes, density.rows(), &place)?
            }
            (&[_, a, b, c], Some(places), Some(edge)) if [a, b, c] == [edge; 3] => {
                let nodes = dimensions(file, &key("dimensions"), &places, edge, limits)?;
                let edge = usize::try_from(edge).unwrap_or(0);
                let blocks = Place::Tensor(key("blocks"));
                Index::blocks(nodes, edge, (&places, &blocks), density.rows(), limits)?
            }
            _ => {
                let found = format!("shape {own:?}");
                let expected = "[X, Y, Z], or [n, b, b, b] with blocks";
                return Err(Error::malformed(place, found, expected));
            }
        };
        // Plain colours ignore these settings, but they must be valid.
        let harmonics = harmonics(file, functions)?;
        let harmonics = (!plain).then_some(harmonics);
        let bounds = bounds(file, &key("aabb"))?;
        let (index, density, color) = (Arc::new(index), Arc::new(density), Arc::new(color));
        Ok(Self { index, density, color, harmonics, bounds })
    }
}

/// The key of an array or setting of a box; the first one's has no number.
fn key_of(level: usize, name: &str) -> String {
    match level {
        0 => name.to_owned(),
        level => format!("level{level}.{name}"),
    }
}

fn block_size(file: &TensorFile) -> Result<Option<u64>> {
    let Some(found) = number(file, "block_size")? else { return Ok(None) };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in range")]
    let size = found as u64;
    if found >= 1.0 && found.fract() == 0.0 && size <= MAX_BLOCK {
        return Ok(Some(size));
    }
    let place = Place::Key("block_size".to_owned());
    let expected = format!("an integer from 1 to {MAX_BLOCK}");
    Err(Error::malformed(place, found.to_string(), expected))
}

/// The numbers of blocks along each axis.
fn places(tensor: &Tensor, limits: &Limits) -> Result<Vec<[i64; 3]>> {
    let &[count, 3] = tensor.shape() else {
        let found = format!("shape {:?}", tensor.shape());
        return Err(Error::malformed(tensor.place(), found, "[n, 3]"));
    };
    limits::check(LimitName::Blocks, "blocks", count, limits.blocks, &tensor.place())?;
    let numbers = tensor.read_f64(&mut Budget::new(limits))?;
    if let Some(odd) = numbers.iter().find(|number| number.fract() != 0.0) {
        return Err(Error::malformed(tensor.place(), odd.to_string(), "whole numbers of blocks"));
    }
    #[expect(clippy::cast_possible_truncation, reason = "casts of floats saturate")]
    let places = numbers.as_chunks::<3>().0.iter().map(|place| place.map(|at| at as i64));
    Ok(places.collect())
}

/// Nodes of a file of blocks.
fn dimensions(
    file: &TensorFile,
    key: &str,
    places: &[[i64; 3]],
    edge: u64,
    limits: &Limits,
) -> Result<Nodes> {
    let place = Place::Key(key.to_owned());
    let sizes = match numbers(file, key)? {
        Some(numbers) => numbers,
        None => {
            let reach = places.iter().fold([0; 3], |mut reach: [i64; 3], place| {
                reach.iter_mut().zip(place).for_each(|(reach, at)| *reach = (*reach).max(*at));
                reach
            });
            reach.iter().map(|&last| (last as f64 + 1.0) * edge as f64).collect()
        }
    };
    let &[x, y, z] = sizes.as_slice() else {
        return Err(Error::malformed(place, format!("{sizes:?}"), "three sizes"));
    };
    if sizes.iter().any(|size| !(*size >= 1.0 && size.fract() == 0.0)) {
        return Err(Error::malformed(
            place,
            format!("{sizes:?}"),
            "three integer numbers of nodes",
        ));
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts saturate")]
    let sizes = [x, y, z].map(|size| size as u64);
    Nodes::checked(sizes, limits, &place)
}

fn harmonics(file: &TensorFile, functions: usize) -> Result<Harmonics> {
    let clamp = match file.setting("clamp") {
        None => Clamp::Zero,
        Some(Value::Text(text)) if text == "zero" => Clamp::Zero,
        Some(Value::Text(text)) if text == "none" => Clamp::None,
        Some(Value::Text(text)) if text == "sigmoid" => Clamp::Sigmoid,
        Some(other) => {
            let place = Place::Key("clamp".to_owned());
            return Err(Error::malformed(place, other.describe(), "zero, none or sigmoid"));
        }
    };
    let offset = number(file, "offset")?.unwrap_or(0.5);
    let degree = functions.isqrt() - 1;
    Ok(Harmonics { degree, evaluation: Evaluation::Sample, offset, clamp })
}

#[expect(clippy::cast_possible_truncation, reason = "a field's box is float32")]
fn bounds(file: &TensorFile, key: &str) -> Result<Bounds> {
    let place = Place::Tensor(key.to_owned());
    let expected = "two corners of three numbers";
    let Some(corners) = numbers(file, key)? else {
        return Err(Error::malformed(place, "no such tensor", expected));
    };
    let &[a, b, c, d, e, f] = corners.as_slice() else {
        return Err(Error::malformed(place, format!("{corners:?}"), expected));
    };
    let corner = |corner: [f64; 3]| corner.map(|value| value as f32);
    let bounds = Bounds { min: corner([a, b, c]), max: corner([d, e, f]) };
    bounds.check_model(&place)?;
    Ok(bounds)
}
