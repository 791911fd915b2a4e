//! The limits, one row each: the field with its documentation, the name under which users set it, the
//! thing that it bounds, and its values by default, for files of strangers and for one's own.

/// Makes [`Limits`] and [`LimitName`] of the rows.
macro_rules! limits {
    ($($(#[$doc:meta])* $field:ident $variant:ident $name:literal $meaning:literal,
       $default:expr, $untrusted:expr, $trusted:expr;)*) => {
        /// Upper bounds on the contents of an input. The defaults admit scenes of 2048 nodes a side.
        #[derive(Debug, Clone, PartialEq, Eq)]
        pub struct Limits {
            $($(#[$doc])* pub $field: u64,)*
        }

        /// A limit, by the name under which users set it.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum LimitName {
            $(#[doc = concat!("[`Limits::", stringify!($field), "`]")] $variant,)*
        }

        impl Default for Limits {
            fn default() -> Self {
                Self { $($field: $default,)* }
            }
        }

        impl Limits {
            /// For files of strangers, such as uploads to a service: scenes of 512 nodes a side, a
            /// GiB of memory, headers of 4 MiB.
            pub fn untrusted() -> Self {
                Self { $($field: $untrusted,)* }
            }

            /// For files of one's own: as much as the format can state. Memory alone is bounded, by
            /// half of the address space.
            pub fn trusted() -> Self {
                Self { $($field: $trusted,)* }
            }

            /// The limit of a name.
            pub fn get_mut(&mut self, name: LimitName) -> &mut u64 {
                match name {
                    $(LimitName::$variant => &mut self.$field,)*
                }
            }
        }

        impl LimitName {
            /// Every limit.
            pub const ALL: &[Self] = &[$(Self::$variant),*];

            /// The name.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)*
                }
            }

            /// The thing that it bounds.
            pub const fn meaning(self) -> &'static str {
                match self {
                    $(Self::$variant => $meaning,)*
                }
            }
        }
    };
}

limits! {
    /// Nodes along one axis of a grid. Default: 65,536
    axis_nodes AxisNodes "axis-nodes" "nodes along one axis of a grid",
        1 << 16, 1 << 12, u32::MAX as u64;
    /// Nodes in one grid. Default: 2^33 (2048 a side)
    nodes Nodes "nodes" "nodes of one grid",
        1 << 33, 1 << 27, 1 << 48;
    /// Channels of the colour grid. Default: 64
    channels Channels "channels" "channels of the colour grid",
        64, 64, 64;
    /// Bytes of one pickle, header or metadata text. Default: 64 MiB
    header_bytes HeaderBytes "header-bytes"
        "bytes of one pickle, header, JSON document or metadata text",
        64 << 20, 4 << 20, 1 << 32;
    /// Entries of an archive, tensors of a file. Default: 65,536
    entries Entries "entries" "entries of an archive, tensors of a file",
        1 << 16, 1 << 12, 1 << 32;
    /// Chunks of a container. Default: 4096
    chunks Chunks "chunks" "chunks of a container",
        1 << 12, 1 << 12, 1 << 24;
    /// Blocks of a level. Default: 2^26 (3250 nodes a side in blocks of 8)
    blocks Blocks "blocks" "blocks of a level of a container",
        1 << 26, 1 << 20, 1 << 40;
    /// Objects that a pickle makes. Default: 2,097,152
    pickle_objects PickleObjects "pickle-objects" "objects that a pickle makes",
        1 << 21, 1 << 16, 1 << 32;
    /// Bytes of tensors, chunks, tables and codes held at once because a file says so. Default: 16
    /// GiB
    memory Memory "memory"
        "bytes of tensors, chunks, tables and codes held at once because a file says so",
        16 << 30, 1 << 30, isize::MAX as u64;
}
