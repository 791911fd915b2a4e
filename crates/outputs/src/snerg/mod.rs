//! SNeRG's folders of assets, for its viewer and later ones.
//!
//! [`snerg`](mipvog_inputs::snerg::layout) describes the layout. A folder has cubic voxels, so
//! values are taken in the middle of each voxel:
//!
//! ```text
//! opacity  = 1 - exp(-density * voxel)
//! texel    = (colour * opacity, opacity), (features * opacity)      rounded to 8 bits
//! ```
//!
//! 1. [`grid`]: the voxels of the box, in the axes of OpenGL, and blocks of them.
//! 2. [`texels`]: the texels of a block; nearly transparent blocks are dropped.
//! 3. [`layout`]: places of blocks in the atlas, and the limits of the format.
//! 4. [`slices`]: pictures of four planes each, and Mip-VoG's coarser ones.
//! 5. [`parameters`]: sizes and the network as text.
//!
//! Rows of the first layer are reordered: the viewer has sines and cosines of a direction by
//! octave, then by axis. A network of another shape than the viewer's cannot be written. Colours
//! are then means over directions, as for harmonics.
//!
//! [`read_back`] opens the folder like any input, by the viewer's rules: values are interpolated
//! after activation, and the background is added before the network runs.

mod export;
mod grid;
mod layout;
mod parameters;
mod read_back;
mod slices;
mod texels;

pub use export::Snerg;
