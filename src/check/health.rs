//! The health of a trained scene: one pass over its values, plane by plane.
//!
//! Memory use is two planes per thread plus a few numbers per plane of the scene. Findings name
//! silent faults of training: NaN or extreme values, scenes that are fully empty or fully opaque,
//! and channels and network inputs without effect.

use serde::Serialize;

use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::finding::{Code, Finding, Report, checked};
use crate::base::parallel;
use crate::base::progress::Silent;
use crate::model::field::{Grid, Nonfinite, NonfiniteCount, Planes, RadianceField, verify_crc32};
use crate::model::view_mlp::ViewMlp;

/// A node of at most this opacity over one interval is empty. The default threshold of a bake.
const EMPTY_OPACITY: f64 = 1e-3;
/// Raw values beyond this indicate failed training: logits of trained scenes reach about 100.
const LARGEST_RAW: f32 = 1e4;
/// Pruning pays if at least this share of the nodes is empty.
const LEAST_EMPTY: f64 = 0.01;

/// Statistics of a scene's values.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct Health {
    /// Number of nodes of the grid.
    pub nodes: u64,
    /// Share of nodes whose opacity over one interval is at most 0.001; 0 to 1.
    pub empty_share: f64,
    /// Number of values that are not finite, over all channels.
    pub nonfinite: u64,
    /// Statistics of raw density, then of each colour channel.
    pub channels: Vec<ChannelHealth>,
    /// Inputs of the view network's first layer whose weights are all 0, by index from 0.
    pub unused_network_inputs: Vec<usize>,
}

/// Statistics of one channel.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub struct ChannelHealth {
    /// `density`, or `k0` and the number of the channel.
    pub name: String,
    /// Lowest and highest finite raw value; null if no value is finite.
    pub range: Option<[f32; 2]>,
    /// Lowest and highest finite raw value of the nodes that are not empty; null if there is none.
    pub seen_range: Option<[f32; 2]>,
}

/// Sums over one channel of some planes.
#[derive(Clone, Default)]
struct Tally {
    found: NonfiniteCount,
    range: Option<[f32; 2]>,
    seen_range: Option<[f32; 2]>,
    checksum: crc32fast::Hasher,
}

/// Reports faults in the values and the network of a scene. Returns the statistics, or `None` if
/// the values are unreadable.
pub fn check(field: &RadianceField, report: &mut Report) -> Result<Option<Health>> {
    let Some(planes) = checked(tallies(field), Code::Input, report)? else { return Ok(None) };
    checksums(field, &planes, report)?;
    let channels = 1 + field.color_channels();
    let whole: Vec<Tally> = (0..channels).map(|channel| merged(channel, &planes)).collect();
    let nodes = field.scene.nodes.count() as u64;
    let visible: u64 = planes.iter().map(|plane| plane.visible).sum();
    let health = Health {
        nodes,
        empty_share: (nodes - visible) as f64 / nodes as f64,
        nonfinite: whole.iter().map(|tally| tally.found.count).sum(),
        channels: whole.iter().enumerate().map(|(channel, tally)| tally.health(channel)).collect(),
        unused_network_inputs: field.network().map_or(Vec::new(), unused_inputs),
    };
    whole.iter().enumerate().try_for_each(|(channel, tally)| values(channel, tally, report))?;
    space(&health, report)?;
    if visible > 1 {
        whole.iter().enumerate().skip(1).try_for_each(|(channel, t)| dead(channel, t, report))?;
    }
    for &input in &health.unused_network_inputs {
        let place = Place::Key(format!("view network, input {input}"));
        let error = Error::malformed(place, "no weight but 0", "an input that is used");
        report(Finding { code: Code::NetworkUnused, error })?;
    }
    Ok(Some(health))
}

/// Sums over one x plane.
struct Plane {
    channels: Vec<Tally>,
    visible: u64,
}

fn tallies(field: &RadianceField) -> Result<Vec<Plane>> {
    let [nx, ny, nz] = field.scene.nodes.0;
    field.prepare(&Silent)?;
    let activation = &field.scene.activation;
    let threshold = activation.raw_at_opacity(EMPTY_OPACITY) as f32;
    parallel::map(nx, |x| {
        let (mut density, mut values) = (vec![0.0; ny * nz], vec![0.0; ny * nz]);
        let mut channels = vec![read(&field.density, 0, x, &mut density)?];
        let is_visible = |value: &f32| *value > threshold;
        channels[0].take(0, x, nz, &density, |at| density.get(at).is_some_and(is_visible));
        for grid in &field.color {
            for channel in 0..grid.channels() {
                let mut tally = read(grid, channel, x, &mut values)?;
                let number = channels.len();
                tally.take(number, x, nz, &values, |at| density.get(at).is_some_and(is_visible));
                channels.push(tally);
            }
        }
        let visible = density.iter().filter(|value| is_visible(value)).count() as u64;
        Ok(Plane { channels, visible })
    })
}

/// Reads a plane into `values`, and tallies it with its checksum.
fn read(grid: &Grid, channel: usize, x: usize, values: &mut [f32]) -> Result<Tally> {
    let mut tally = Tally::default();
    grid.read_plane(channel, x, values, |stored| tally.checksum.update(stored))?;
    Ok(tally)
}

impl Tally {
    fn take(
        &mut self,
        channel: usize,
        x: usize,
        nz: usize,
        values: &[f32],
        is_visible: impl Fn(usize) -> bool,
    ) {
        for (at, &value) in values.iter().enumerate() {
            if !value.is_finite() {
                self.found.count += 1;
                self.found.first.get_or_insert([channel, x, at / nz, at % nz]);
                continue;
            }
            self.range = widened(self.range, [value; 2]);
            if is_visible(at) {
                self.seen_range = widened(self.seen_range, [value; 2]);
            }
        }
    }

    fn health(&self, channel: usize) -> ChannelHealth {
        ChannelHealth {
            name: match channel {
                0 => "density".to_owned(),
                channel => format!("k0 channel {}", channel - 1),
            },
            range: self.range,
            seen_range: self.seen_range,
        }
    }

    fn place(&self, channel: usize) -> Place {
        Place::Tensor(self.health(channel).name)
    }
}

fn widened(range: Option<[f32; 2]>, [low, high]: [f32; 2]) -> Option<[f32; 2]> {
    Some(range.map_or([low, high], |[lowest, highest]| [lowest.min(low), highest.max(high)]))
}

fn merged(channel: usize, planes: &[Plane]) -> Tally {
    let mut whole = Tally::default();
    for tally in planes.iter().filter_map(|plane| plane.channels.get(channel)) {
        whole.found.count += tally.found.count;
        whole.found.first = whole.found.first.or(tally.found.first);
        for (whole, part) in
            [(&mut whole.range, tally.range), (&mut whole.seen_range, tally.seen_range)]
        {
            *whole = part.map_or(*whole, |part| widened(*whole, part));
        }
    }
    whole
}

/// Compares the stated checksums with those of the values.
fn checksums(field: &RadianceField, planes: &[Plane], report: &mut Report) -> Result<()> {
    let stated = Planes::new(field, None, Nonfinite::Empty);
    let channels = 1 + field.color_channels();
    let parts =
        [("density", 0..1, stated.density_crc32()), ("k0", 1..channels, stated.color_crc32())];
    for (name, channels, expected) in parts {
        let Some(expected) = expected else { continue };
        let sums = channels.flat_map(|channel| {
            planes.iter().filter_map(move |plane| plane.channels.get(channel)).map(|t| &t.checksum)
        });
        checked(verify_crc32(name, sums, expected), Code::ValuesChecksum, report)?;
    }
    Ok(())
}

/// Reports values that are not finite or far out of range.
fn values(channel: usize, tally: &Tally, report: &mut Report) -> Result<()> {
    if let NonfiniteCount { count, first: Some([_, x, y, z]) } = tally.found {
        let first = [channel.saturating_sub(1), x, y, z];
        let error = Error::new(ErrorKind::NonFinite { count, first }, tally.place(channel));
        report(Finding { code: Code::ValuesNonfinite, error })?;
    }
    if let Some([low, high]) = tally.range.filter(|r| r.iter().any(|v| v.abs() > LARGEST_RAW)) {
        let found = format!("values from {low} to {high}");
        let expected = format!("values within {LARGEST_RAW} of 0");
        let error = Error::malformed(tally.place(channel), found, expected);
        report(Finding { code: Code::ValuesRange, error })?;
    }
    Ok(())
}

/// Reports scenes that are fully empty or fully opaque.
fn space(health: &Health, report: &mut Report) -> Result<()> {
    let (code, found, expected) = match health.empty_share {
        1.0 => (Code::SpaceEmpty, "no visible node".to_owned(), "some"),
        share if share < LEAST_EMPTY => {
            let found = format!("{:.2} % of nodes that are empty", 100.0 * share);
            (Code::SpaceFull, found, "at least 1 %")
        }
        _ => return Ok(()),
    };
    let place = Place::Tensor("density".to_owned());
    report(Finding { code, error: Error::malformed(place, found, expected) })
}

/// Reports a constant channel.
fn dead(channel: usize, tally: &Tally, report: &mut Report) -> Result<()> {
    let Some([value, _]) = tally.seen_range.filter(|[low, high]| low == high) else {
        return Ok(());
    };
    let found = format!("the value {value} at every visible node");
    let error = Error::malformed(tally.place(channel), found, "values that differ");
    report(Finding { code: Code::ChannelDead, error })
}

/// Inputs of the first layer whose weights are all 0.
fn unused_inputs(network: &ViewMlp) -> Vec<usize> {
    let Some(first) = network.layers.first() else { return Vec::new() };
    let unused = |input: &usize| {
        first.weights.iter().skip(*input).step_by(first.inputs).all(|&weight| weight == 0.0)
    };
    (0..first.inputs).filter(unused).collect()
}
