//! A file of dense arrays as an input: levels, encodings and occupancy as they are.

use serde_json::Value as Json;

use mipvog::unpacked::{CONTENT, LevelValues, Unpacked, UnpackedLevel, tensor_name};

use crate::base::error::{Error, Place, Result};
use crate::base::limits::{Budget, Limits};
use crate::container::{check_metadata, json::from_canonical};
use crate::model::baked::{GROUPS, Group, Metadata, Occupancy, Table, ViewMetadata};
use crate::model::field::{FreeSpace, Lookup};
use crate::model::grid::{Element, Nodes};
use crate::model::view_mlp::{Layer, ViewMlp};
use crate::tensor::{Tensor, TensorFile, Value};

/// Reads metadata, tables, network and mask of an unpacked container; not the levels' values.
pub fn open(file: &TensorFile, limits: &Limits) -> Result<Unpacked> {
    read(file, limits).map_err(|error| error.in_file(file.file.path()))
}

fn read(file: &TensorFile, limits: &Limits) -> Result<Unpacked> {
    let place = Place::Key("__metadata__.mipvog".to_owned());
    let text = file.unpacked_metadata().unwrap_or_default();
    let metadata: Metadata = from_canonical(text.as_bytes(), &place)?;
    check_metadata(&metadata, limits, &place)?;
    let provenance = match file.metadata("mipvog_provenance") {
        Some(text) => {
            let place = Place::Key("__metadata__.mipvog_provenance".to_owned());
            from_canonical(text.as_bytes(), &place)?
        }
        _ => Json::Null,
    };
    let content = file.metadata(CONTENT).and_then(|text| u32::from_str_radix(text, 16).ok());
    let mut budget = Budget::new(limits);
    let count = metadata.parts().count();
    let occupied = |part: usize| format!("{}.occupied", metadata.part_name(part));
    let is_there = |part: &usize| file.root.get(&occupied(*part)).is_some();
    let there = (0..count).filter(is_there).count();
    if there > 0 && there < count {
        let found = format!("{there} of {count} levels");
        return Err(Error::wrong_kind(found, "all levels: unpack it without --levels"));
    }
    let mut levels = Vec::new();
    for (part, level) in metadata.parts().enumerate() {
        let own = metadata.part_name(part);
        let name = |of: &str| format!("{own}.{of}");
        let occupied = tensor(file, &name("occupied"))?;
        let occupied = with_element(occupied, Element::U8)?;
        let bytes = shaped(occupied, &level.grid().counts())?.read_f32(&mut budget)?;
        let blocks = bytes.iter().map(|&id| Occupancy::from_id(id as u8));
        let blocks: Option<Vec<_>> = blocks.collect();
        let blocks = blocks.ok_or_else(|| {
            Error::malformed(place_of(occupied), "an unknown occupancy", "0, 1 or 2")
        })?;
        let mut volumes = [const { None }; GROUPS];
        let layout = metadata.layout();
        let mut band_channel = 0;
        for (group, volume) in Group::ALL.into_iter().zip(&mut volumes) {
            if level.encoding(group).is_none() {
                continue;
            }
            let tensor = tensor(file, &name(tensor_name(group)))?;
            let mut found = tensor.volume(limits)?;
            let own = group.channels(layout);
            let channels = if let Group::Band(_) = group { metadata.features } else { own };
            if found.nodes != Nodes(level.dimensions) || found.channels != channels {
                let shape = format!("shape {:?}", tensor.shape());
                let expected = format!("{channels} channels of {:?} nodes", level.dimensions);
                return Err(Error::malformed(place_of(tensor), shape, expected));
            }
            if let Group::Band(_) = group {
                found = found.with_channels(band_channel..band_channel + own);
                band_channel += own;
            }
            *volume = Some(found);
        }
        let table = Table::new(level.grid(), blocks)?;
        let counts =
            |stored, inherited| format!("{stored} occupied blocks, {inherited} of them inherited");
        if [table.frames(), table.inherited()] != [level.blocks_stored, level.blocks_filled] {
            let found = counts(table.frames(), table.inherited());
            let expected = counts(level.blocks_stored, level.blocks_filled);
            return Err(Error::malformed(place_of(occupied), found, expected));
        }
        levels.push(UnpackedLevel::new(table, LevelValues::Volumes(Box::new(volumes))));
    }
    let view_mlp = network(file, &metadata, &mut budget)?;
    let free_space = match metadata.free_space {
        true => Some(free_space(file, limits, &mut budget)?),
        false => None,
    };
    Ok(Unpacked {
        metadata,
        provenance,
        content,
        levels,
        view_mlp,
        free_space,
        others: Vec::new(),
        digest: file.digest,
    })
}

fn tensor<'a>(file: &'a TensorFile, name: &str) -> Result<&'a Tensor> {
    file.root.get(name).and_then(Value::tensor).ok_or_else(|| {
        let place = Place::Tensor(name.to_owned());
        Error::malformed(place, "no such tensor", "the tensor that the metadata states")
    })
}

fn place_of(tensor: &Tensor) -> Place {
    Place::Tensor(tensor.name().to_owned())
}

fn with_element(tensor: &Tensor, element: Element) -> Result<&Tensor> {
    if tensor.element() == element {
        return Ok(tensor);
    }
    let found = format!("{} values", tensor.element().name());
    Err(Error::malformed(place_of(tensor), found, element.name()))
}

fn shaped<'a>(tensor: &'a Tensor, shape: &[usize]) -> Result<&'a Tensor> {
    if tensor.shape().iter().eq(shape.iter().map(|&size| size as u64).collect::<Vec<_>>().iter()) {
        return Ok(tensor);
    }
    let found = format!("shape {:?}", tensor.shape());
    Err(Error::malformed(place_of(tensor), found, format!("{shape:?}")))
}

fn network(file: &TensorFile, metadata: &Metadata, budget: &mut Budget) -> Result<Option<ViewMlp>> {
    let network = metadata.view.as_ref().and_then(ViewMetadata::network);
    let Some(view) = network else { return Ok(None) };
    let mut layers = Vec::new();
    for (i, pair) in view.widths.windows(2).enumerate() {
        let (inputs, outputs) = (pair[0], pair[1]);
        let weights = tensor(file, &format!("mlp.{i}.weight"))?;
        let bias = tensor(file, &format!("mlp.{i}.bias"))?;
        layers.push(Layer {
            inputs,
            outputs,
            weights: shaped(with_element(weights, Element::F32)?, &[outputs, inputs])?
                .read_f32(budget)?,
            bias: shaped(with_element(bias, Element::F32)?, &[outputs])?.read_f32(budget)?,
        });
    }
    let place = Place::Key("mlp".to_owned());
    ViewMlp::new(layers, view.frequencies, metadata.features, &place).map(Some)
}

fn free_space(file: &TensorFile, limits: &Limits, budget: &mut Budget) -> Result<FreeSpace> {
    let map = shaped(tensor(file, "free_space.map")?, &[3, 3])?.read_f64(budget)?;
    let &[a, b, c, d, e, f, threshold, ..] = map.as_slice() else {
        return Err(Error::malformed(Place::Tensor("free_space.map".to_owned()), "less", "[3, 3]"));
    };
    let inside = file.root.get("free_space.inside").and_then(Value::tensor);
    let values = match inside {
        Some(inside) => inside,
        None => tensor(file, "free_space.values")?,
    };
    let &[x, y, z] = values.shape() else {
        let found = format!("shape {:?}", values.shape());
        return Err(Error::malformed(place_of(values), found, "three axes"));
    };
    let nodes = Nodes::checked([x, y, z], limits, &place_of(values))?;
    let element = if inside.is_some() { Element::U8 } else { Element::F32 };
    let read = with_element(values, element)?.read_f32(budget)?;
    let lookup = match inside {
        Some(_) if read.iter().any(|&byte| byte > 1.0) => {
            return Err(Error::malformed(place_of(values), "a byte above 1", "0 or 1"));
        }
        Some(_) => Lookup::Nearest(read.into_iter().map(|value| value != 0.0).collect()),
        None => Lookup::Trilinear { values: read, threshold: threshold as f32 },
    };
    Ok(FreeSpace { nodes, scale: [a, b, c], shift: [d, e, f], lookup })
}
