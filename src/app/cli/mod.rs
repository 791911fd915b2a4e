//! The command line: arguments in, reports on stdout, progress and warnings on stderr.
//!
//! One file a verb. Verbs return their reports; printing and exit codes are here.

mod animation;
mod attach;
mod bake;
mod cameras;
mod common;
mod compare;
mod destination;
mod detach;
mod document;
mod field;
mod fit;
mod gate;
mod gltf;
mod incremental;
mod inspect;
mod interrupt;
mod outcome;
mod output;
mod picture;
mod pictures;
mod plan;
mod program;
mod progress;
mod render;
mod settings;
mod stored;
mod sweep;
mod unpack;
mod validate;
mod values;
mod view;
mod viewpoints;

pub use program::main;
