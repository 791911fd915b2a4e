//! The names of limits.

/// A limit, by the name under which users set it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LimitName {
    /// [`super::limits::Limits::axis_nodes`]
    AxisNodes,
    /// [`super::limits::Limits::nodes`]
    Nodes,
    /// [`super::limits::Limits::channels`]
    Channels,
    /// [`super::limits::Limits::header_bytes`]
    HeaderBytes,
    /// [`super::limits::Limits::entries`]
    Entries,
    /// [`super::limits::Limits::chunks`]
    Chunks,
    /// [`super::limits::Limits::blocks`]
    Blocks,
    /// [`super::limits::Limits::pickle_objects`]
    PickleObjects,
    /// [`super::limits::Limits::memory`]
    Memory,
}

impl LimitName {
    /// Every limit.
    pub const ALL: [Self; 9] = [
        Self::AxisNodes,
        Self::Nodes,
        Self::Channels,
        Self::HeaderBytes,
        Self::Entries,
        Self::Chunks,
        Self::Blocks,
        Self::PickleObjects,
        Self::Memory,
    ];

    /// The name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::AxisNodes => "axis-nodes",
            Self::Nodes => "nodes",
            Self::Channels => "channels",
            Self::HeaderBytes => "header-bytes",
            Self::Entries => "entries",
            Self::Chunks => "chunks",
            Self::Blocks => "blocks",
            Self::PickleObjects => "pickle-objects",
            Self::Memory => "memory",
        }
    }

    /// The thing that it bounds.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::AxisNodes => "nodes along one axis of a grid",
            Self::Nodes => "nodes of one grid",
            Self::Channels => "channels of the colour grid",
            Self::HeaderBytes => "bytes of one pickle, header, JSON document or metadata text",
            Self::Entries => "entries of an archive, tensors of a file",
            Self::Chunks => "chunks of a container",
            Self::Blocks => "blocks of a level of a container",
            Self::PickleObjects => "objects that a pickle makes",
            Self::Memory => {
                "bytes of tensors, chunks, tables and codes held at once because a file says so"
            }
        }
    }
}
