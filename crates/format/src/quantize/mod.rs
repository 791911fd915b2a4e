//! Values to codes, plane by plane, and blocks of codes to bytes that compress well.
//!
//! [`range`] picks the encoding of a level's group and proves its error bound, [`linear`] that of
//! values without bounds, [`search`] the one with the fewest bits within an error, [`code`] turns
//! values into integer codes and back ([`nearest`], [`buckets`]), [`planes`] those of whole planes,
//! [`block`] cuts frames from them, [`coarsen`] drops some of them at nodes that pictures hardly
//! show, [`inherited_colors`] makes them from the
//! next coarser level's, [`run`] turns the codes of many blocks into a run of residuals and back
//! ([`write_run`], [`read_run`]), from predictions ([`predict`]) whose weights are fitted to it
//! ([`modes`], [`least_squares`]). Don't-care nodes hold the cheapest value, the mean of their neighbours, but
//! density far below the opacity threshold ([`crate::model::scene::Activation::invisible_raw`]).

mod block;
mod buckets;
mod coarsen;
mod code;
mod code_word;
mod frame;
mod inherited_colors;
mod lanes;
mod least_squares;
mod linear;
mod modes;
mod nearest;
mod planes;
mod predict;
mod range;
mod read_run;
mod run;
mod search;
mod sums;
mod value_range;
mod write_run;

pub use block::{BlockEncoder, BlockSource};
pub use coarsen::Coarsening;
pub use code::decode_codes;
pub use code_word::Code;
pub use frame::{Frame, FrameShape, RunBytes};
pub use inherited_colors::InheritedColors;
pub use linear::{encoding_over, planned_encoding};
pub use planes::{CodePlanes, CodeSlab, GroupCodes, Moved};
pub use range::{Bits, color_encoding, density_encoding, is_laid_over_values};
pub use run::{encoder_bytes, run_bytes, run_codes};
pub use search::encoding_within;
pub use value_range::ValueRange;
