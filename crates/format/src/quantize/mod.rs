//! Values to codes, plane by plane, and blocks of codes to bytes that compress well.
//!
//! Encodings: [`range`] picks the encoding of a level's group and proves its error bound,
//! [`linear`] does so for unbounded values, and [`search`] finds the fewest bits within an error.
//! Codes: [`code`] converts values to integer codes and back ([`nearest`], [`buckets`]), [`planes`]
//! converts whole planes, [`block`] cuts frames from them, [`coarsen`] simplifies codes of hardly
//! visible nodes, and [`inherited_colors`] makes codes from the next coarser level. Runs: [`run`]
//! converts the codes of many blocks to a run of residuals and back ([`write_run`], [`read_run`]),
//! with predictions ([`predict`]) whose weights are fitted to the run ([`modes`],
//! [`least_squares`]). Don't-care nodes hold the cheapest value, the mean of their neighbours, but
//! with density far below the opacity threshold
//! ([`crate::model::scene::Activation::invisible_raw`]).

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
