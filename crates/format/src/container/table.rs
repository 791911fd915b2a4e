//! Tables of blocks: one byte per block, or run-length coded in files with nested boxes, where most
//! of a large box is empty. See `formats/mipvog.md`, section 5.

use super::runs;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Budget;
use crate::model::baked::{LevelMetadata, Occupancy, Table};

/// Bits of a run's number that hold the occupancy.
const ID_BITS: u32 = 2;

/// Writes a table as a chunk.
pub(super) fn to_bytes(table: &Table, in_runs: bool, zstd_level: i32) -> Result<Vec<u8>> {
    if !in_runs {
        let ids: Vec<u8> = table.occupancy().iter().map(|block| block.id()).collect();
        return runs::compress(&ids, zstd_level);
    }
    let mut bytes = Vec::new();
    for run in table.occupancy().chunk_by(|one, next| one == next) {
        let id = run.first().map_or(0, |block| block.id());
        put_number(&mut bytes, (run.len() as u64) << ID_BITS | u64::from(id));
    }
    runs::compress(&bytes, zstd_level)
}

/// Reads the table of a chunk.
///
/// # Errors
/// `Malformed`, and `OverLimit` if the table exceeds `budget`.
pub(super) fn read(
    level: &LevelMetadata,
    in_runs: bool,
    bytes: &[u8],
    place: &Place,
    budget: &mut Budget,
) -> Result<Table> {
    let grid = level.grid();
    budget.spend(2 * grid.total() as u64, "bytes of tables", place)?;
    let occupancy = match in_runs {
        true => from_runs(&runs::decompress_run(bytes, grid.total(), place)?, grid.total(), place)?,
        false => from_ids(runs::decompress(bytes, grid.total(), place)?, place)?,
    };
    let table = Table::new(grid, occupancy)?;
    if table.frames() == level.blocks_stored && table.inherited() == level.blocks_filled {
        return Ok(table);
    }
    let found =
        format!("{} stored blocks, {} of them inherited", table.frames(), table.inherited());
    let expected = format!("{}, {} of them inherited", level.blocks_stored, level.blocks_filled);
    Err(Error::malformed(place.clone(), found, expected))
}

fn from_ids(ids: Vec<u8>, place: &Place) -> Result<Vec<Occupancy>> {
    let known = |(block, id): (usize, u8)| {
        Occupancy::from_id(id).ok_or_else(|| {
            let found = format!("occupancy {id} of block {block}");
            Error::malformed(place.clone(), found, "0 (empty), 1 (stored) or 2 (inherited)")
        })
    };
    ids.into_iter().enumerate().map(known).collect()
}

fn from_runs(mut bytes: &[u8], total: usize, place: &Place) -> Result<Vec<Occupancy>> {
    let mut occupancy = Vec::with_capacity(total);
    let mut before = None;
    while !bytes.is_empty() {
        let number = take_number(&mut bytes);
        let length = number.map_or(0, |number| number >> ID_BITS);
        let block = number.and_then(|number| Occupancy::from_id(low_bits(number & 3)));
        let left = (total - occupancy.len()) as u64;
        let Some(block) = block
            .filter(|&block| (1..=left).contains(&length) && before.replace(block) != Some(block))
        else {
            let found = format!("a run after block {}: {number:?}", occupancy.len());
            let expected = format!("runs of occupancies 0, 1 and 2 in turn, of {total} blocks");
            return Err(Error::malformed(place.clone(), found, expected));
        };
        // At most the remaining blocks.
        let length = usize::try_from(length).unwrap_or(0);
        occupancy.resize(occupancy.len() + length, block);
    }
    if occupancy.len() == total {
        return Ok(occupancy);
    }
    let found = format!("runs of {} blocks", occupancy.len());
    Err(Error::malformed(place.clone(), found, format!("all {total} blocks")))
}

/// Appends a number, 7 bits per byte, lowest first. A set top bit means that more bytes follow.
fn put_number(bytes: &mut Vec<u8>, mut number: u64) {
    while number >= 0x80 {
        bytes.push(low_bits(number) | 0x80);
        number >>= 7;
    }
    bytes.push(low_bits(number));
}

fn low_bits(number: u64) -> u8 {
    (number & 0x7f) as u8
}

/// Takes a number from the start; none for more than 63 bits, redundant bytes, or truncation.
fn take_number(bytes: &mut &[u8]) -> Option<u64> {
    let mut number = 0u64;
    for place in 0..9 {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        number |= u64::from(byte & 0x7f) << (7 * place);
        if byte < 0x80 {
            return (byte > 0 || place == 0).then_some(number);
        }
    }
    *bytes = &[];
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::limits::Limits;
    use crate::model::grid::{BlockGrid, Nodes};

    fn level(nodes: [usize; 3], table: &Table) -> LevelMetadata {
        LevelMetadata {
            dimensions: nodes,
            block_size: 1,
            bounds: None,
            blocks_stored: table.frames(),
            blocks_filled: table.inherited(),
            density: None,
            diffuse: None,
            features: None,
            bands: Vec::new(),
            directional: None,
            anisotropy: None,
        }
    }

    #[test]
    fn tables_come_back() {
        let grid = BlockGrid { nodes: Nodes([40, 5, 11]), edge: 1 };
        for pattern in [vec![0], vec![1], vec![0, 0, 0, 0, 1, 2], vec![2, 1, 0]] {
            let occupancy = (0..grid.total()).map(|i| {
                Occupancy::from_id(pattern[(i / 37) % pattern.len()]).expect("an occupancy")
            });
            let table = Table::new(grid, occupancy.collect()).expect("as many as blocks");
            for in_runs in [false, true] {
                let bytes = to_bytes(&table, in_runs, 3).expect("no error");
                let mut budget = Budget::new(&Limits::default());
                let level = level([40, 5, 11], &table);
                let read = read(&level, in_runs, &bytes, &Place::File, &mut budget);
                assert_eq!(read.expect("sound"), table);
            }
        }
    }

    #[test]
    fn runs_that_lie_are_refused() {
        let runs = |runs: &[(u64, u64)]| {
            let mut bytes = Vec::new();
            runs.iter().for_each(|(length, id)| put_number(&mut bytes, length << ID_BITS | id));
            from_runs(&bytes, 100, &Place::File)
        };
        assert_eq!(runs(&[(60, 0), (40, 1)]).expect("sound").len(), 100);
        for lie in [
            vec![(60, 0)],
            vec![(60, 0), (41, 1)],
            vec![(60, 0), (40, 0)],
            vec![(60, 0), (40, 3)],
            vec![(60, 0), (0, 1), (40, 0)],
            vec![(u64::MAX >> 2, 1)],
        ] {
            assert!(runs(&lie).is_err(), "{lie:?}");
        }
        for bytes in [&[0xff; 12][..], &[0x90, 0x80, 0x00], &[0x91]] {
            assert!(from_runs(bytes, 100, &Place::File).is_err(), "{bytes:?}");
        }
    }
}
