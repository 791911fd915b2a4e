//! Where a container's content comes from.

use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::base::bytes::hex;
use crate::input::checkpoint::Source;

/// What is known about the input of a bake. No paths, no times: the same input gives the same
/// bytes wherever it lies.
#[derive(Debug, Clone, PartialEq)]
pub struct Origin {
    /// Kind of the input file.
    pub kind: String,
    /// SHA-256 of what identifies the input without reading it all.
    pub digest: [u8; 32],
    /// Whether the digest covers the grids' values (by their checksums). Where it does not, what
    /// the bake reads is added.
    pub covers_values: bool,
    /// Role and SHA-256 of other files that were used.
    pub companions: Vec<(&'static str, [u8; 32])>,
    /// What was missing in the input, and what was assumed.
    pub assumptions: Vec<Value>,
}

impl Origin {
    /// Of a trained input.
    pub fn of_source(source: &Source) -> Self {
        let assumptions = source.assumptions.iter();
        Self {
            kind: format!("{} {}", source.family.name(), source.kind.name()),
            digest: source.digest,
            covers_values: source.field.density.storage.crc32().is_some(),
            companions: source.companions.iter().map(|c| (c.role, c.digest)).collect(),
            assumptions: assumptions.map(|a| json!({ "key": a.key, "value": a.value })).collect(),
        }
    }

    /// The input's digest, with the checksums of what was read where it needs them.
    pub(super) fn digest(&self, density: &[u32], color: &[u32]) -> [u8; 32] {
        if self.covers_values {
            return self.digest;
        }
        let mut sum = Sha256::new();
        sum.update(self.digest);
        density.iter().chain(color).for_each(|checksum| sum.update(checksum.to_le_bytes()));
        sum.finalize().into()
    }

    /// The container's provenance.
    pub(super) fn provenance(&self, digest: &[u8; 32], options: Value) -> Value {
        let companions = self.companions.iter();
        let companions =
            companions.map(|(role, digest)| json!({ "role": role, "sha256": hex(digest) }));
        json!({
            "tool": env!("CARGO_PKG_NAME"),
            "version": env!("CARGO_PKG_VERSION"),
            "input": { "kind": self.kind, "sha256": hex(digest) },
            "companions": companions.collect::<Vec<_>>(),
            "options": options,
            "assumptions": self.assumptions,
        })
    }
}
