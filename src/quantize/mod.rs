//! Values to codes, block by block.
//!
//! [`range`] picks the encoding of a level's group and proves its error bound, [`search`] the one with the
//! fewest bits within an error, [`code`] turns
//! values into integer codes and back, [`predict`] turns a block's codes into residuals that
//! compress well. Nodes that nobody needs hold what costs least, the predicted code, but density
//! far below the opacity threshold ([`crate::field::Activation::unseen_raw`]).

mod block;
mod code;
mod predict;
mod range;
mod search;

pub use block::{BlockEncoder, BlockSource};
pub use code::decode_codes;
pub use predict::{residual_bytes, unpredict};
pub use range::{Bits, color_encoding, density_encoding};
pub use search::{ValueSpan, encoding_within};
