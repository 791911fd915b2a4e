//! A server of the web viewer and one file, on the loopback address.
//!
//! [`request`] reads a browser's request, strictly and within limits; [`range`] understands byte
//! ranges; [`site`] holds the few names that are served, so that no path ever reaches the file
//! system. Here connections are accepted and answered, a thread each.

mod range;
mod request;
mod server;
mod site;

pub use server::Server;
pub use site::{Kind, Site};
