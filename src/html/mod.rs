//! Pages that show one container, for the web and for a disk.
//!
//! A *file* (`-o page.html`) holds the viewer, its worker and the container in base64. It opens from
//! a disk, and its content security policy allows no request. A *folder* holds the same as files,
//! beside a picture and a text for whoever uploads it: there the container streams, coarse to fine.
//!
//! Both are made of the built viewer, `viewer/dist/`: [`site`] has its files, which `app/serve`
//! serves too. [`page`] changes its page; `viewer/page/embedded.ts` reads the changes.

mod export;
mod notes;
mod page;
pub mod site;

pub use export::Html;
