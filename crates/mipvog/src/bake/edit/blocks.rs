//! Blocks that become empty.

use crate::base::error::Result;
use crate::model::baked::{Occupancy, Table};
use crate::unpacked::Unpacked;

/// Keeps the stored blocks of a part for whose place `keep` returns true. The others become empty.
///
/// # Errors
///
/// None of its own.
pub fn keep_blocks(
    unpacked: &mut Unpacked,
    part: usize,
    keep: impl Fn([usize; 3]) -> bool,
) -> Result<()> {
    let table = &unpacked.levels[part].table;
    let [_, rows, length] = table.grid().counts();
    let mut occupancy = table.occupancy().to_vec();
    for (block, state) in occupancy.iter_mut().enumerate() {
        if !keep([block / length / rows, block / length % rows, block % length]) {
            *state = Occupancy::Empty;
        }
    }
    let table = Table::new(table.grid(), occupancy)?;
    if let Some(metadata) = unpacked.metadata.parts_mut().nth(part) {
        (metadata.blocks_stored, metadata.blocks_filled) = (table.frames(), table.inherited());
    }
    unpacked.levels[part].table = table;
    Ok(())
}
