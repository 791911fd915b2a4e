//! `bake --manifest`: many scenes, one line each ([`line`]).
//!
//! 1. **Check** ([`read`]): every line is read and checked before any scene is baked. Only the
//!    names of the outputs stay in memory.
//! 2. **Select** ([`part`]): a line by index, which schedulers put into the environment, the lines
//!    of a shard, or all.
//! 3. **Bake** (`run`): a line is converted to words of the command line ([`words`]), which the
//!    program's own parser reads. A scene that fails does not stop the others.
//! 4. **Report** ([`result`]): a line of JSON as each scene ends.

mod arguments;
mod line;
mod options;
mod part;
mod read;
mod result;
mod run;
mod words;

pub use arguments::{ExplicitOptions, ManifestArguments};
pub use line::SceneLine;
pub use options::{OF_ALL, OptionKind};
pub use read::Lines;
pub use result::{SceneResult, Status};
pub use run::{BatchOptions, run};
pub use words::Words;
