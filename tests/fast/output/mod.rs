//! What goes out: pictures, figures, assets and files of other programs.

mod attach;
mod compare;
mod gltf;
mod mesh;
mod mesh_world;
mod random_scenes;
mod render_plain;
mod splat;
mod splat_files;
mod splat_world;
