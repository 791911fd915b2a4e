//! Pages with one container, for web servers and for local files.
//!
//! A *file* (`-o page.html`) holds the viewer, its worker and the container in base64. It opens
//! from a disk, and its content security policy allows no request. A *folder* holds the same as
//! separate files, plus a picture and a text with instructions for uploading: there the container
//! streams, coarse to fine.
//!
//! Both are made of the built viewer, `viewer/dist/`: [`site`] has its files, which `app/serve`
//! serves too. [`page`] changes its page; `viewer/page/embedded.ts` reads the changes.

mod export;
mod notes;
mod page;
pub mod site;

pub use export::Html;
