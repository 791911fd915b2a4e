//! The place of a fault in a file.

use std::fmt;

/// Place of an error.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// The file as a whole.
    File,
    /// Bytes from the start of the file.
    Offset(u64),
    /// A tensor, by its name in the file.
    Tensor(String),
    /// An entry of a zip archive.
    Entry(String),
    /// A line of a text, counted from 1.
    Line(u64),
    /// A value of a configuration, by its key.
    Key(String),
    /// A chunk of a container: its type, and its level if it has one.
    Chunk {
        /// Four letters.
        kind: [u8; 4],
        /// Level, 0 is the finest.
        level: Option<u32>,
    },
    /// A block of a level.
    Block {
        /// Level, 0 is the finest.
        level: u32,
        /// Number of the block in the level, z fastest.
        block: u64,
    },
    /// A value of a JSON document, by its pointer (RFC 6901); the whole document's is empty.
    Pointer(String),
    /// A place in a container that a value of a JSON document embeds or names.
    Within {
        /// Pointer to the value.
        pointer: String,
        /// Place in the container; byte offsets count from the container's own start.
        place: Box<Place>,
        /// Offset of the container's first byte in the file that holds it.
        offset: u64,
    },
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => write!(f, "file"),
            Self::Offset(at) => write!(f, "byte {at}"),
            Self::Tensor(name) => write!(f, "tensor {name}"),
            Self::Entry(name) => write!(f, "zip entry {name}"),
            Self::Line(number) => write!(f, "line {number}"),
            Self::Key(name) => write!(f, "key {name}"),
            Self::Chunk { kind, level } => {
                write!(f, "chunk {}", kind.escape_ascii())?;
                level.map_or(Ok(()), |level| write!(f, " of level {level}"))
            }
            Self::Block { level, block } => write!(f, "level {level}, block {block}"),
            Self::Pointer(pointer) if pointer.is_empty() => write!(f, "JSON"),
            Self::Pointer(pointer) => write!(f, "JSON {pointer}"),
            Self::Within { pointer, place, offset } => {
                write!(f, "JSON {pointer}, container at byte {offset}")?;
                match **place {
                    Self::File => Ok(()),
                    Self::Offset(at) => write!(f, ", byte {}", offset.saturating_add(at)),
                    ref place => write!(f, ", {place}"),
                }
            }
        }
    }
}
