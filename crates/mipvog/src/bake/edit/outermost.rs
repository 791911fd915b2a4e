//! A world without its outermost boxes.
//!
//! If `K` boxes around the inner one stay, levels 0 to `K + 1` stay: coarser levels span a dropped
//! box. With `K` of 0, the result is a container of one box. The background shows behind the
//! remaining boxes.

use crate::base::error::{Error, Result};
use crate::container::OtherChunk;
use crate::unpacked::Unpacked;

/// Drops the `count` outermost boxes.
///
/// # Errors
///
/// [`crate::base::error::ErrorKind::InvalidOption`] for more boxes than there are around the inner
/// one.
pub fn drop_outermost(unpacked: &mut Unpacked, count: usize) -> Result<()> {
    if count == 0 {
        return Ok(());
    }
    let metadata = &mut unpacked.metadata;
    let (levels, shells) = (metadata.levels.len(), metadata.shells.len());
    let Some(boxes) = shells.checked_sub(count) else {
        let expected = match shells {
            0 => "a container of nested boxes: this one has a single box".to_owned(),
            _ => format!("at most {shells}: the boxes around the inner one"),
        };
        return Err(Error::invalid_option("without_outermost", count.to_string(), expected));
    };
    let kept = levels.min(boxes + 2);
    let stays = |part: usize| part < kept || (levels..levels + boxes).contains(&part);
    metadata.levels.truncate(kept);
    metadata.shells.truncate(boxes);
    let outermost = metadata.outer_bounds();
    if let Some(sampled) = metadata.march.sampled {
        let Some(common) = sampled.common(&outermost) else {
            let expected = "boxes that meet the part of the world that is sampled";
            return Err(Error::invalid_option("without_outermost", count.to_string(), expected));
        };
        metadata.march.sampled = (common != outermost).then_some(common);
    }
    let mut part = 0..;
    unpacked.levels.retain(|_| part.next().is_some_and(stays));
    renumber(&mut unpacked.others, |part| match stays(part) {
        true => Some(if part < kept { part } else { part - levels + kept }),
        false => None,
    });
    Ok(())
}

/// Renumbers unknown chunks, and drops those of dropped parts.
fn renumber(chunks: &mut Vec<OtherChunk>, new: impl Fn(usize) -> Option<usize>) {
    chunks.retain_mut(|chunk| {
        let Some(old) = chunk.level else { return true };
        let number = new(old as usize).and_then(|number| u32::try_from(number).ok());
        chunk.level = number;
        number.is_some()
    });
}
