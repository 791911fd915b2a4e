//! A server of the web viewer and one file, on the loopback address.
//!
//! [`request`] parses requests strictly and within limits; [`range`] parses byte ranges; [`site`]
//! has a fixed set of names, so that no path reaches the file system. This module accepts
//! connections and answers each in its own thread.

mod range;
mod request;
mod server;
mod site;

pub use server::Server;
pub use site::{Kind, Site};
