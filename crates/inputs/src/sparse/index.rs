//! The mapping from nodes to rows.

use std::fmt::Debug;
use std::sync::Mutex;

use crate::base::bytes::Storage;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, Budget, LimitName, Limits};
use crate::base::lock::lock;
use crate::model::grid::{Element, Nodes};
use crate::tensor::Tensor;

/// Stands for no row.
pub(super) const NO_ROW: u32 = u32::MAX;

/// The rows of a grid's nodes, not all in memory.
#[derive(Debug)]
pub struct Index {
    nodes: Nodes,
    /// Rows that there are.
    rows: u64,
    rule: Rule,
}

#[derive(Debug)]
enum Rule {
    /// Row numbers are node numbers, z fastest.
    Dense,
    /// A table of row numbers; negative numbers mean none.
    Links { tensor: Tensor, limits: Limits, storage: Mutex<Option<Storage>> },
    /// Cubes of rows, `edge` nodes per side, z fastest within; and the number of each cube's block,
    /// z fastest. [`NO_ROW`] means none.
    Blocks { edge: usize, counts: [usize; 3], table: Vec<u32> },
    /// Another structure.
    Other(Box<dyn PlaneRows>),
}

/// Rows of nodes from another structure.
pub trait PlaneRows: Debug + Send + Sync {
    /// Fills in the rows of plane `x`, z fastest; entries of nodes without one do not change.
    ///
    /// # Errors
    /// Errors of reading.
    fn fill(&self, x: usize, rows: &mut [u32]) -> Result<()>;

    /// Bytes that it takes in memory.
    fn memory_bytes(&self) -> u64;
}

impl Index {
    /// For a grid with a row for each node.
    ///
    /// # Errors
    /// `Malformed` for another number of rows, or more than 2^32 - 2.
    pub fn dense(nodes: Nodes, rows: u64, place: &Place) -> Result<Self> {
        if rows != nodes.count() as u64 {
            let found = format!("{rows} rows for {:?} nodes", nodes.0);
            return Err(Error::malformed(place.clone(), found, "one for each"));
        }
        Self::new(nodes, rows, Rule::Dense, place)
    }

    /// From links, int32 `[x, y, z]`.
    ///
    /// # Errors
    /// `Malformed` for another shape or type.
    pub fn links(tensor: &Tensor, rows: u64, limits: &Limits) -> Result<Self> {
        let place = tensor.place();
        let &[x, y, z] = tensor.shape() else {
            let found = format!("shape {:?}", tensor.shape());
            return Err(Error::malformed(place, found, "[x, y, z]"));
        };
        if tensor.element() != Element::I32 {
            let found = format!("{} numbers", tensor.element().name());
            return Err(Error::malformed(place, found, "int32"));
        }
        let nodes = Nodes::checked([x, y, z], limits, &place)?;
        let storage = Mutex::new(None);
        let rule = Rule::Links { tensor: tensor.clone(), limits: limits.clone(), storage };
        Self::new(nodes, rows, rule, &place)
    }

    /// From blocks of `edge` nodes per side: `places` are their numbers along each axis, in the
    /// order of their rows. Rows beyond the grid's end are ignored.
    ///
    /// # Errors
    /// `Malformed` for blocks outside the grid, duplicate blocks, or another number of rows;
    /// `OverLimit` for too many blocks.
    pub fn blocks(
        nodes: Nodes,
        edge: usize,
        (places, place): (&[[i64; 3]], &Place),
        rows: u64,
        limits: &Limits,
    ) -> Result<Self> {
        let counts = nodes.0.map(|size| size.div_ceil(edge));
        let total: u64 = counts.iter().map(|&count| count as u64).product();
        limits::check(LimitName::Blocks, "blocks", total, limits.blocks, place)?;
        let wanted = (edge as u64).checked_pow(3).and_then(|n| n.checked_mul(places.len() as u64));
        if wanted != Some(rows) {
            let found = format!("{rows} rows for {} blocks of {edge} nodes per side", places.len());
            return Err(Error::malformed(place.clone(), found, "one for each node"));
        }
        let slots = crate::base::limits::product(&counts.map(|n| n as u64), "blocks", place)?;
        let mut table: Vec<u32> = Budget::new(limits).zeroed(slots, "bytes of blocks", place)?;
        table.fill(NO_ROW);
        for (number, block) in places.iter().enumerate() {
            let slot = (0..3).try_fold(0usize, |slot, axis| {
                let (&at, &count) = (block.get(axis)?, counts.get(axis)?);
                let at = usize::try_from(at).ok().filter(|&at| at < count)?;
                Some(slot * count + at)
            });
            let slot = slot.and_then(|slot| table.get_mut(slot)).filter(|slot| **slot == NO_ROW);
            let number = u32::try_from(number).ok();
            let (Some(slot), Some(number)) = (slot, number) else {
                let found = format!("block {block:?} in a grid of {counts:?} blocks");
                let expected = "distinct blocks inside the grid";
                return Err(Error::malformed(place.clone(), found, expected));
            };
            *slot = number;
        }
        Self::new(nodes, rows, Rule::Blocks { edge, counts, table }, place)
    }

    /// From another structure.
    ///
    /// # Errors
    /// `OverLimit` for more than 2^32 - 2 rows.
    pub fn other(nodes: Nodes, rows: u64, own: Box<dyn PlaneRows>, place: &Place) -> Result<Self> {
        Self::new(nodes, rows, Rule::Other(own), place)
    }

    fn new(nodes: Nodes, rows: u64, rule: Rule, place: &Place) -> Result<Self> {
        limits::check_fixed("rows", rows, u64::from(NO_ROW) - 1, place)?;
        Ok(Self { nodes, rows, rule })
    }

    /// Nodes along each axis.
    pub fn nodes(&self) -> Nodes {
        self.nodes
    }

    /// True if each node has the row of its own number.
    pub(super) fn is_dense(&self) -> bool {
        matches!(self.rule, Rule::Dense)
    }

    /// The rows of plane `x`, z fastest; [`NO_ROW`] for none.
    ///
    /// # Errors
    /// Errors of reading, and `Malformed` for a link to no row.
    pub(super) fn plane(&self, x: usize, out: &mut Vec<u32>) -> Result<()> {
        let [_, ny, nz] = self.nodes.0;
        out.clear();
        match &self.rule {
            Rule::Dense => out.extend((x * ny * nz..(x + 1) * ny * nz).map(narrow)),
            Rule::Links { tensor, limits, storage } => {
                let storage = stored(tensor, limits, storage)?;
                let mut bytes = vec![0; ny * nz * 4];
                storage.read_into((x * ny * nz * 4) as u64, &mut bytes)?;
                let links = bytes.as_chunks::<4>().0.iter().map(|bytes| i32::from_le_bytes(*bytes));
                out.extend(links.map(|link| u32::try_from(link).unwrap_or(NO_ROW)));
                let beyond = |row: &u32| *row != NO_ROW && u64::from(*row) >= self.rows;
                if let Some(at) = out.iter().position(beyond) {
                    let link = out.get(at).copied().unwrap_or_default();
                    let found = format!(
                        "link {link} of node {x}, {}, {} in {} rows",
                        at / nz,
                        at % nz,
                        self.rows
                    );
                    let expected = "links below the number of rows";
                    return Err(Error::malformed(tensor.place(), found, expected));
                }
            }
            Rule::Other(own) => {
                out.resize(ny * nz, NO_ROW);
                own.fill(x, out)?;
            }
            Rule::Blocks { edge, counts, table } => {
                let [_, by, bz] = *counts;
                for y in 0..ny {
                    for block in 0..bz {
                        let slot = (x / edge * by + y / edge) * bz + block;
                        let number = table.get(slot).copied().unwrap_or(NO_ROW);
                        let row = (x % edge * edge + y % edge) * edge;
                        let first = (number as usize).wrapping_mul(edge.pow(3)).wrapping_add(row);
                        let inside = (*edge).min(nz - block * edge);
                        let row = |z| if number == NO_ROW { NO_ROW } else { narrow(first + z) };
                        out.extend((0..inside).map(row));
                    }
                }
            }
        }
        Ok(())
    }

    /// Visits a table in memory, for a digest.
    ///
    /// # Errors
    /// None of its own.
    pub(super) fn digest(&self, hash: &mut dyn FnMut(&[u8])) -> Result<()> {
        if let Rule::Blocks { table, .. } = &self.rule {
            table.iter().for_each(|number| hash(&number.to_le_bytes()));
        }
        Ok(())
    }

    /// Bytes that it takes in memory, at most.
    pub fn memory_bytes(&self) -> u64 {
        match &self.rule {
            Rule::Dense => 0,
            Rule::Links { tensor, .. } if tensor.is_compressed() => tensor.bytes(),
            Rule::Links { .. } => 0,
            Rule::Blocks { table, .. } => 4 * table.len() as u64,
            Rule::Other(own) => own.memory_bytes(),
        }
    }

    /// All of it in memory.
    ///
    /// # Errors
    /// Errors of reading, and more memory than the budget has.
    pub fn load(&self, budget: &mut Budget) -> Result<LoadedIndex> {
        let mut rows = budget.zeroed(self.nodes.count(), "bytes of an index", &Place::File)?;
        let [nx, ny, nz] = self.nodes.0;
        let mut plane = Vec::new();
        for (x, out) in (0..nx).zip(rows.chunks_exact_mut(ny * nz)) {
            self.plane(x, &mut plane)?;
            out.copy_from_slice(&plane);
        }
        Ok(LoadedIndex { nodes: self.nodes, rows })
    }
}

/// The rows of all nodes.
#[derive(Debug)]
pub struct LoadedIndex {
    nodes: Nodes,
    rows: Vec<u32>,
}

impl LoadedIndex {
    /// Nodes along each axis.
    pub fn nodes(&self) -> Nodes {
        self.nodes
    }

    /// The row of a node inside the grid, if any.
    #[inline]
    pub fn row(&self, [x, y, z]: [usize; 3]) -> Option<usize> {
        let [_, ny, nz] = self.nodes.0;
        let row = self.rows.get((x * ny + y) * nz + z).copied();
        row.filter(|&row| row != NO_ROW).map(|row| row as usize)
    }
}

/// The bytes of links, verified at the first call.
fn stored(tensor: &Tensor, limits: &Limits, kept: &Mutex<Option<Storage>>) -> Result<Storage> {
    let mut kept = lock(kept);
    if let Some(storage) = &*kept {
        return Ok(storage.clone());
    }
    let storage = tensor.storage(&mut Budget::new(limits))?;
    *kept = Some(storage.clone());
    Ok(storage)
}

/// A row's number; there are fewer than 2^32.
fn narrow(row: usize) -> u32 {
    u32::try_from(row).unwrap_or(NO_ROW)
}
