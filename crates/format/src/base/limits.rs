//! Limits on the sizes that a file may request.
//!
//! Every count, length and product from a file is checked against [`Limits`] before it sizes an
//! allocation, indexes or loops. Memory that a file's numbers request is taken from a [`Budget`],
//! so that many small false sizes cannot add up to a large one.

use crate::base::error::{Error, ErrorKind, Place, Result};

pub use super::limit_table::{LimitName, Limits};

impl Limits {
    /// The same limits with another bound on memory, in bytes.
    #[must_use]
    pub fn with_memory(self, memory: u64) -> Self {
        Self { memory, ..self }
    }

    /// The limits for one of this many things that are held at the same time.
    #[must_use]
    pub fn shared_by(&self, things: u64) -> Self {
        Self { memory: self.memory / things.max(1), ..self.clone() }
    }
}

/// Refuses `asked` things of a kind if a limit allows fewer.
pub fn check(
    limit: LimitName,
    what: &'static str,
    asked: u64,
    allowed: u64,
    place: &Place,
) -> Result<()> {
    over(Some(limit), what, asked, allowed, place)
}

/// Refuses `asked` things of a kind if the format or this reader allows fewer.
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

/// The remaining memory for sizes that files state.
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
        // Including memory taken before, so that the error shows the user's limit.
        let spent = self.all.saturating_sub(self.left);
        check(LimitName::Memory, what, spent.saturating_add(bytes), self.all, place)?;
        self.left -= bytes;
        Ok(())
    }

    /// Returns bytes of freed memory.
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
