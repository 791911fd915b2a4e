//! Limits on the sizes that a file may ask for.
//!
//! Every count, length and product that comes from a file is held against [`Limits`] before it
//! sizes an allocation, indexes or loops. Memory that a file's numbers ask for is spent from a
//! [`Budget`], so that many small lies cannot add up to a large one.

use crate::base::error::{Error, ErrorKind, Place, Result};

pub use super::limit_name::LimitName;

/// Upper bounds on the contents of an input. The defaults admit scenes of 2048 nodes a side.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    /// Nodes along one axis of a grid. Default: 65,536
    pub axis_nodes: u64,
    /// Nodes in one grid. Default: 2^33 (2048 a side)
    pub nodes: u64,
    /// Channels of the colour grid. Default: 64
    pub channels: u64,
    /// Bytes of one pickle, header or metadata text. Default: 64 MiB
    pub header_bytes: u64,
    /// Entries of an archive, tensors of a file. Default: 65,536
    pub entries: u64,
    /// Chunks of a container. Default: 4096
    pub chunks: u64,
    /// Blocks of a level. Default: 2^26 (3250 nodes a side in blocks of 8)
    pub blocks: u64,
    /// Objects that a pickle makes. Default: 2,097,152
    pub pickle_objects: u64,
    /// Bytes of tensors, chunks, tables and codes held at once because a file says so. Default: 16
    /// GiB
    pub memory: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            axis_nodes: 1 << 16,
            nodes: 1 << 33,
            channels: 64,
            header_bytes: 64 << 20,
            entries: 1 << 16,
            chunks: 1 << 12,
            blocks: 1 << 26,
            pickle_objects: 1 << 21,
            memory: 16 << 30,
        }
    }
}

impl Limits {
    /// For files of strangers, such as uploads to a service: scenes of 512 nodes a side, a GiB of
    /// memory, headers of 4 MiB.
    pub fn untrusted() -> Self {
        Self {
            axis_nodes: 1 << 12,
            nodes: 1 << 27,
            header_bytes: 4 << 20,
            entries: 1 << 12,
            blocks: 1 << 20,
            pickle_objects: 1 << 16,
            memory: 1 << 30,
            ..Self::default()
        }
    }

    /// For files of one's own: as much as the format can state. Memory alone is bounded, by half of
    /// the address space.
    pub fn trusted() -> Self {
        Self {
            axis_nodes: u64::from(u32::MAX),
            nodes: 1 << 48,
            channels: 64,
            header_bytes: 1 << 32,
            entries: 1 << 32,
            chunks: 1 << 24,
            blocks: 1 << 40,
            pickle_objects: 1 << 32,
            memory: isize::MAX as u64,
        }
    }

    /// The same limits with another bound on memory, in bytes.
    #[must_use]
    pub fn with_memory(self, memory: u64) -> Self {
        Self { memory, ..self }
    }

    /// The limits of one of so many things that are held at the same time.
    #[must_use]
    pub fn shared_by(&self, things: u64) -> Self {
        Self { memory: self.memory / things.max(1), ..self.clone() }
    }

    /// The limit of a name.
    pub fn get_mut(&mut self, name: LimitName) -> &mut u64 {
        match name {
            LimitName::AxisNodes => &mut self.axis_nodes,
            LimitName::Nodes => &mut self.nodes,
            LimitName::Channels => &mut self.channels,
            LimitName::HeaderBytes => &mut self.header_bytes,
            LimitName::Entries => &mut self.entries,
            LimitName::Chunks => &mut self.chunks,
            LimitName::Blocks => &mut self.blocks,
            LimitName::PickleObjects => &mut self.pickle_objects,
            LimitName::Memory => &mut self.memory,
        }
    }
}

/// Refuses `asked` things of a kind where a limit allows only so many.
pub fn check(
    limit: LimitName,
    what: &'static str,
    asked: u64,
    allowed: u64,
    place: &Place,
) -> Result<()> {
    over(Some(limit), what, asked, allowed, place)
}

/// Refuses `asked` things of a kind where the format, or this reader, allows only so many.
pub fn check_fixed(what: &'static str, asked: u64, allowed: u64, place: &Place) -> Result<()> {
    over(None, what, asked, allowed, place)
}

fn over(
    limit: Option<LimitName>,
    what: &'static str,
    asked: u64,
    allowed: u64,
    place: &Place,
) -> Result<()> {
    if asked <= allowed {
        return Ok(());
    }
    Err(Error::new(ErrorKind::OverLimit { limit, what, asked, allowed }, place.clone()))
}

/// The product of sizes that a file states, as a count that fits in memory.
pub fn product(sizes: &[u64], what: &'static str, place: &Place) -> Result<usize> {
    sizes
        .iter()
        .try_fold(1u64, |n, &size| n.checked_mul(size))
        .and_then(|n| usize::try_from(n).ok())
        .filter(|&n| n < isize::MAX as usize)
        .ok_or_else(|| Error::new(ErrorKind::Overflow { what }, place.clone()))
}

/// Memory that is left to spend on a file's word.
#[derive(Debug)]
pub struct Budget {
    all: u64,
    left: u64,
}

impl Budget {
    /// All of [`Limits::memory`].
    pub fn new(limits: &Limits) -> Self {
        Self { all: limits.memory, left: limits.memory }
    }

    /// Takes `bytes` from the budget.
    pub fn spend(&mut self, bytes: u64, what: &'static str, place: &Place) -> Result<()> {
        // With what was spent before, so that the error shows the limit that users know.
        let spent = self.all.saturating_sub(self.left);
        check(LimitName::Memory, what, spent.saturating_add(bytes), self.all, place)?;
        self.left -= bytes;
        Ok(())
    }

    /// Returns bytes that were spent on memory that is now free.
    pub fn give_back(&mut self, bytes: u64) {
        self.left += bytes;
    }

    /// The only way to allocate by a number that came from a file.
    pub fn zeroed<T>(&mut self, count: usize, what: &'static str, place: &Place) -> Result<Vec<T>>
    where
        T: Clone + Default,
    {
        let asked = (count as u64).saturating_mul(size_of::<T>() as u64);
        self.spend(asked, what, place)?;
        Ok(vec![T::default(); count])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_is_spent() {
        let limits = Limits { memory: 10, ..Limits::default() };
        let mut budget = Budget::new(&limits);
        assert_eq!(budget.zeroed::<u16>(4, "bytes", &Place::File).expect("8 of 10").len(), 4);
        let error = budget.zeroed::<u8>(3, "bytes", &Place::File).expect_err("11 of 10");
        assert!(matches!(error.kind(), ErrorKind::OverLimit { asked: 11, allowed: 10, .. }));
        assert!(budget.zeroed::<u64>(usize::MAX, "bytes", &Place::File).is_err());
    }

    #[test]
    fn products_do_not_wrap() {
        let huge = product(&[1 << 32, 1 << 32], "node count", &Place::File);
        assert!(matches!(huge.expect_err("wraps").kind(), ErrorKind::Overflow { .. }));
        assert_eq!(product(&[7, 0, 3], "node count", &Place::File).expect("zero"), 0);
    }
}
