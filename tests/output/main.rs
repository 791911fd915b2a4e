//! What goes out: pictures, figures, assets and files of other programs.

#[path = "../common/mod.rs"]
mod common;

mod attach;
mod compare;
mod export;
mod export_pages;
mod gltf;
mod gltf_tools;
mod mesh;
mod probe;
mod render_plain;
mod splat;
mod usd;
