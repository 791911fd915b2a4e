//! The origin of a container's content.

use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::base::bytes::hex;
use crate::base::error::Result;
use crate::model::field::{Grid, RadianceField};
use crate::unpacked::Unpacked;

/// The program, as provenance names it.
const TOOL: &str = "mipvog-bake";
/// Samples of each colour tensor in a digest, evenly spaced from its first byte to its last.
const SAMPLES: u64 = 64;
/// Bytes of a sample.
const SAMPLE_BYTES: u64 = 4096;

/// The input of a bake. It contains no paths and no times, so the same input gives the same bytes
/// everywhere.
#[derive(Debug, Clone, PartialEq)]
pub struct Origin {
    /// Kind of the input file.
    pub kind: String,
    /// SHA-256 that identifies the input without reading all of it.
    pub digest: [u8; 32],
    /// True if the digest covers the grids' values, by their checksums. If not, a bake adds
    /// checksums of values.
    pub covers_values: bool,
    /// Role and SHA-256 of other files that were used.
    pub side_files: Vec<(&'static str, [u8; 32])>,
    /// Settings that the input lacks, and the values that were assumed.
    pub assumptions: Vec<Value>,
}

impl Origin {
    /// The origin of arrays in memory.
    pub fn of_arrays() -> Self {
        Self {
            kind: "arrays".to_owned(),
            digest: [0; 32],
            covers_values: false,
            side_files: Vec::new(),
            assumptions: Vec::new(),
        }
    }

    /// Of a container's levels, baked anew.
    #[doc(hidden)]
    pub fn of_unpacked(unpacked: &Unpacked) -> Self {
        let kind = CONTAINER.to_owned();
        Self { kind, digest: unpacked.digest, ..Self::of_arrays() }
    }

    /// The input's digest. If the format has no checksums, it also covers all of density, by the
    /// CRC-32 of each plane, and samples of colour. It does not depend on options.
    pub(super) fn digest(&self, field: &RadianceField, density: &[u32]) -> Result<[u8; 32]> {
        if self.covers_values {
            return Ok(self.digest);
        }
        let mut sum = Sha256::new();
        sum.update(self.digest);
        density.iter().for_each(|checksum| sum.update(checksum.to_le_bytes()));
        let mut piece = Vec::new();
        for shell in &field.shells {
            add_density(&shell.density, &mut sum)?;
        }
        let shells = field.shells.iter().flat_map(|shell| &shell.color);
        for grid in field.color.iter().chain(shells) {
            let volume = match grid {
                Grid::Array(volume) => volume,
                Grid::Values(values) => {
                    values.digest(&mut |bytes| sum.update(bytes))?;
                    continue;
                }
            };
            let length = volume.storage.length();
            let size = length.min(SAMPLE_BYTES);
            for sample in 0..SAMPLES {
                piece.resize(size as usize, 0);
                let start = (length - size) * sample / (SAMPLES - 1);
                volume.storage.read_into(start, &mut piece)?;
                sum.update(&piece);
            }
        }
        Ok(sum.finalize().into())
    }

    /// The container's provenance.
    pub(super) fn provenance(&self, digest: &[u8; 32], options: Value) -> Value {
        let side_files = self.side_files.iter();
        let side_files =
            side_files.map(|(role, digest)| json!({ "role": role, "sha256": hex(digest) }));
        json!({
            "tool": TOOL,
            "version": env!("CARGO_PKG_VERSION"),
            "input": { "kind": self.kind, "sha256": hex(digest) },
            "companions": side_files.collect::<Vec<_>>(),
            "options": options,
            "assumptions": self.assumptions,
        })
    }
}

/// Adds the checksum of all densities of a shell to a digest.
fn add_density(density: &Grid, sum: &mut Sha256) -> Result<()> {
    let volume = match density {
        Grid::Values(values) => return values.digest(&mut |bytes| sum.update(bytes)),
        Grid::Array(volume) => volume,
    };
    let mut checksum = crc32fast::Hasher::new();
    let mut plane = vec![0.0; volume.nodes.0[1] * volume.nodes.0[2]];
    for x in 0..volume.nodes.0[0] {
        density.read_plane(0, x, &mut plane, |bytes| checksum.update(bytes))?;
    }
    sum.update(checksum.finalize().to_le_bytes());
    Ok(())
}

/// Kind of the input that a container is packed again from.
const CONTAINER: &str = "unpacked container";

/// The provenance of a container with `changes` to one whose provenance is `before`. It names the
/// first input, and lists all later changes in one flat list, the latest last, because JSON readers
/// limit nesting.
pub(super) fn provenance_of_changes(before: &Value, changes: &Value) -> Value {
    let mut earlier = Vec::new();
    let mut first = before;
    while first["input"]["kind"] == CONTAINER
        && let Some(inner) = first["input"].get("provenance")
    {
        earlier.push(json!({
            "tool": first["tool"],
            "version": first["version"],
            "options": first["options"],
        }));
        let listed = first["earlier_changes"].as_array();
        earlier.extend(listed.into_iter().flatten().rev().cloned());
        first = inner;
    }
    earlier.reverse();
    let mut provenance = json!({
        "tool": TOOL,
        "version": env!("CARGO_PKG_VERSION"),
        "input": { "kind": CONTAINER, "provenance": first },
        "options": changes,
    });
    if !earlier.is_empty() {
        provenance["earlier_changes"] = earlier.into();
    }
    provenance
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_stand_in_a_flat_list() {
        let baked = json!({ "tool": "a", "input": { "kind": "checkpoint" }, "options": {} });
        let mut provenance = baked.clone();
        for number in 0..200 {
            provenance = provenance_of_changes(&provenance, &json!({ "levels": number }));
            assert_eq!(provenance["input"]["provenance"], baked);
            assert_eq!(provenance["options"]["levels"], number);
        }
        let earlier = provenance["earlier_changes"].as_array().expect("a list");
        let levels: Vec<&Value> =
            earlier.iter().map(|change| &change["options"]["levels"]).collect();
        assert_eq!(levels, (0..199).collect::<Vec<_>>());
        // As 0.1 wrote them.
        let nested = |inner: &Value, levels: i32| {
            let input = json!({ "kind": CONTAINER, "provenance": inner });
            json!({ "tool": "a", "version": "0", "input": input, "options": { "levels": levels } })
        };
        let nested = nested(&nested(&baked, 1), 2);
        let flat = provenance_of_changes(&nested, &json!({ "levels": 3 }));
        assert_eq!(flat["input"]["provenance"], baked);
        let earlier = flat["earlier_changes"].as_array().expect("a list");
        assert_eq!(
            [&earlier[0], &earlier[1]].map(|e| e["options"]["levels"].as_i64()),
            [Some(1), Some(2)]
        );
    }
}
