//! Digests of files, and of parts of them.

use sha2::{Digest as _, Sha256};

use super::SourceFile;
use crate::base::error::Result;

/// The SHA-256 of all bytes of a file.
pub fn sha256(file: &SourceFile) -> Result<[u8; 32]> {
    let mut sum = Sha256::new();
    file.for_each_piece(|piece| {
        sum.update(piece);
        Ok(())
    })?;
    Ok(sum.finalize().into())
}

/// Digests in text form.
pub fn hex(digest: &[u8; 32]) -> String {
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A digest of parts of a file.
pub struct Digest(Sha256);

impl Digest {
    /// A digest of a file of this kind.
    pub fn new(kind: &str) -> Self {
        let mut digest = Self(Sha256::new());
        digest.bytes(kind.as_bytes());
        digest
    }

    /// Adds bytes, prefixed by their count, so that parts cannot be confused.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.raw(&(bytes.len() as u64).to_le_bytes());
        self.raw(bytes);
    }

    /// Adds bytes of a known count.
    pub fn raw(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// The digest of everything added.
    pub fn finish(self) -> [u8; 32] {
        self.0.finalize().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_file_and_of_memory_have_the_same_digest() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("bytes");
        let bytes: Vec<u8> = (0..3_000_000u32).map(|i| (i / 7) as u8).collect();
        std::fs::write(&path, &bytes).expect("writable");
        let file = SourceFile::open(&path).expect("a file");
        let memory = SourceFile::decoded(bytes, &path);
        for range in [0..3_000_000, 5..2_500_001, 7..8] {
            let digests = [&file, &memory]
                .map(|whole| sha256(&whole.part(range.clone()).expect("inside")).expect("read"));
            assert_eq!(digests[0], digests[1]);
        }
        // FIPS 180-4's example of an empty message.
        let none = sha256(&file.part(9..9).expect("inside")).expect("read");
        assert!(hex(&none).starts_with("e3b0c44298fc1c149afbf4c8996fb924"));
        assert!(file.part(1..3_000_001).is_err() && memory.part(1..3_000_001).is_err());
        let inner = file.part(100..200).and_then(|part| part.part(10..20)).expect("inside");
        let mut byte = [0];
        inner.read_into(9, &mut byte).expect("inside");
        assert_eq!(byte[0], (119 / 7) as u8);
        assert!(inner.read_into(10, &mut byte).is_err());
    }
}
