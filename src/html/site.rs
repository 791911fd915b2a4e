//! The viewer's files, as `viewer/build.mjs` made them.

/// The page.
pub const PAGE: &str = include_str!("../../viewer/dist/index.html");
/// Its script.
pub const SCRIPT: &str = include_str!("../../viewer/dist/viewer.js");
/// The script of its workers.
pub const WORKER: &str = include_str!("../../viewer/dist/worker.js");
/// Decoders for compressed assets, which the page loads on demand.
pub const DECODERS: &str = include_str!("../../viewer/dist/decoders.js");
/// Its style.
pub const STYLE: &str = include_str!("../../viewer/dist/style.css");
