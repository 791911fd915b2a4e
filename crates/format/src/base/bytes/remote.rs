//! Files at addresses, read by ranges.
//!
//! Nothing is fetched without a [`NetworkPermit`]: a name on a command line or in a file never
//! causes a request by itself. Only `https` is supported, and `http` on this machine.
//!
//! Requests are for blocks of [`BLOCK`] bytes. Sequential reads request more at once, up to
//! [`LARGEST_AHEAD`] blocks. So the directory of a checkpoint takes two requests, and a large
//! tensor few. Recent blocks stay in memory. Failed requests are retried; a file that changes
//! during reading is an error.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use super::address::shown;
use super::fetch::{Answer, fetch};
use crate::base::error::{Error, Result};
use crate::base::lock::lock;

/// Bytes of a block.
const BLOCK: u64 = 128 << 10;
/// Maximum read-ahead of a request in blocks.
const LARGEST_AHEAD: u64 = 32;
/// Blocks that stay in memory.
const KEPT: usize = 512;
/// Number of concurrent sequential reads, such as one per channel of a grid.
const STREAMS: usize = 32;

static PERMITS: AtomicUsize = AtomicUsize::new(0);

/// While it lives, this process may open inputs at addresses.
#[derive(Debug)]
pub struct NetworkPermit(());

impl NetworkPermit {
    /// A new permit, in addition to existing ones.
    #[expect(clippy::new_without_default, reason = "a permit is given on purpose")]
    pub fn new() -> Self {
        PERMITS.fetch_add(1, Ordering::Relaxed);
        Self(())
    }
}

impl Drop for NetworkPermit {
    fn drop(&mut self) {
        PERMITS.fetch_sub(1, Ordering::Relaxed);
    }
}

/// A file on a server.
#[derive(Debug)]
pub struct RemoteFile {
    address: String,
    length: u64,
    /// The server's name of this version of the file.
    version: Option<String>,
    blocks: Mutex<Blocks>,
}

#[derive(Debug, Default)]
struct Blocks {
    /// By number, with the time of the last use.
    kept: BTreeMap<u64, (u64, Arc<[u8]>)>,
    clock: u64,
    /// The next block of each sequential read, and its read-ahead in blocks.
    streams: Vec<(u64, u64)>,
    /// Pending blocks, each with a lock that its thread holds until they arrive.
    on_their_way: Vec<(Range<u64>, Arc<Mutex<()>>)>,
}

impl Blocks {
    fn get(&mut self, number: u64) -> Option<Arc<[u8]>> {
        self.clock += 1;
        let (used, block) = self.kept.get_mut(&number)?;
        *used = self.clock;
        Some(Arc::clone(block))
    }

    fn keep(&mut self, number: u64, block: &[u8]) {
        self.clock += 1;
        self.kept.insert(number, (self.clock, block.into()));
        if self.kept.len() > KEPT {
            let oldest = self.kept.iter().min_by_key(|(_, (used, _))| *used);
            if let Some(oldest) = oldest.map(|(number, _)| *number) {
                self.kept.remove(&oldest);
            }
        }
    }

    /// True for a cached or pending block.
    fn comes(&self, number: u64) -> bool {
        self.kept.contains_key(&number)
            || self.on_their_way.iter().any(|(blocks, _)| blocks.contains(&number))
    }

    /// Blocks to read ahead.
    fn ahead(&mut self, missing: &Range<u64>) -> u64 {
        let known = self.streams.iter().position(|(next, _)| *next == missing.start);
        let ahead = match known.map(|at| self.streams.remove(at)) {
            Some((_, ahead)) => (2 * ahead).clamp(1, LARGEST_AHEAD),
            None => 0,
        };
        if self.streams.len() == STREAMS {
            self.streams.remove(0);
        }
        self.streams.push((missing.end + ahead, ahead));
        ahead
    }
}

impl RemoteFile {
    /// Requests the start of the file.
    ///
    /// # Errors
    /// `Usage` unless fetching is allowed, `Io` if the server does not return the file.
    pub fn open(address: &str) -> Result<Self> {
        if PERMITS.load(Ordering::Relaxed) == 0 {
            let message = "the input is an address, but network access is off: pass \
                           --allow-network";
            return Err(Error::usage(message).in_file(&shown(address)));
        }
        let Answer { start, bytes, length, version } = fetch(address, 0..BLOCK)?;
        let mut blocks = Blocks::default();
        if start == 0 {
            bytes.chunks(BLOCK as usize).zip(0..).for_each(|(block, at)| blocks.keep(at, block));
        }
        let address = address.to_owned();
        Ok(Self { address, length, version, blocks: Mutex::new(blocks) })
    }

    /// Its length in bytes.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Fills `out` from `offset`, which must lie within the file.
    ///
    /// # Errors
    /// `Io` if the server fails permanently, or the file changed.
    pub fn read_into(&self, offset: u64, out: &mut [u8]) -> Result<()> {
        let end = offset + out.len() as u64;
        let (mut at, mut out) = (offset, out);
        while at < end {
            let block = self.block(at / BLOCK, end)?;
            let from = (at % BLOCK) as usize;
            let part = block.get(from..).unwrap_or_default();
            let count = part.len().min(out.len());
            if count == 0 {
                return Err(self.changed());
            }
            let (now, later) = out.split_at_mut(count);
            now.copy_from_slice(part.get(..count).unwrap_or_default());
            (at, out) = (at + count as u64, later);
        }
        Ok(())
    }

    /// A block; missing blocks up to byte `end` are fetched with it.
    fn block(&self, number: u64, end: u64) -> Result<Arc<[u8]>> {
        loop {
            let mut blocks = lock(&self.blocks);
            if let Some(block) = blocks.get(number) {
                return Ok(block);
            }
            let way = blocks.on_their_way.iter().find(|(blocks, _)| blocks.contains(&number));
            if let Some(way) = way.map(|(_, way)| Arc::clone(way)) {
                drop(blocks);
                // If they do not arrive, this thread requests them itself.
                drop(lock(&way));
                continue;
            }
            let last = end.div_ceil(BLOCK).min(number + LARGEST_AHEAD).max(number + 1);
            let next = (number + 1..last).find(|next| blocks.comes(*next));
            let missing = number..next.unwrap_or(last);
            let ahead = blocks.ahead(&missing);
            let to = (missing.end..missing.end + ahead).find(|next| blocks.comes(*next));
            let asked = number..to.unwrap_or(missing.end + ahead);
            let way = Arc::new(Mutex::new(()));
            let here = lock(&way);
            blocks.on_their_way.push((asked.clone(), Arc::clone(&way)));
            drop(blocks);
            let fetched = self.fetch(&asked);
            let mut blocks = lock(&self.blocks);
            blocks.on_their_way.retain(|(_, other)| !Arc::ptr_eq(other, &way));
            drop(here);
            let bytes = fetched?;
            let pieces = bytes.chunks(BLOCK as usize).zip(number..);
            pieces.for_each(|(block, at)| blocks.keep(at, block));
            return blocks.get(number).ok_or_else(|| self.changed());
        }
    }

    /// The byte range of blocks, clamped to the file.
    fn fetch(&self, blocks: &Range<u64>) -> Result<Vec<u8>> {
        let bytes = blocks.start * BLOCK..self.length.min(blocks.end * BLOCK);
        let answer = fetch(&self.address, bytes.clone())?;
        let whole = answer.start == bytes.start
            && answer.bytes.len() as u64 == bytes.end - bytes.start
            && answer.length == self.length
            && answer.version == self.version;
        if whole { Ok(answer.bytes) } else { Err(self.changed()) }
    }

    fn changed(&self) -> Error {
        let message = "the file changed while it was read: begin again";
        let error = std::io::Error::new(std::io::ErrorKind::InvalidData, message);
        Error::io(error, &shown(&self.address))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_that_go_on_get_more_at_once() {
        let mut blocks = Blocks::default();
        assert_eq!((blocks.ahead(&(0..1)), blocks.ahead(&(7..8))), (0, 0));
        assert_eq!((blocks.ahead(&(1..2)), blocks.ahead(&(8..9))), (1, 1));
        assert_eq!((blocks.ahead(&(3..4)), blocks.ahead(&(5..6))), (2, 0));
    }
}
