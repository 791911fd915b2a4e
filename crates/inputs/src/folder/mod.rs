//! Common parts of SNeRG's and MERF's folders of assets: numbers of their parameters, axes, the
//! network, and the pictures beside them.

mod axes;
mod deferred;
mod network;
mod numbers;
mod pictures;
mod scene;
mod whole;

pub use axes::Axes;
pub use deferred::{added_light, assumption, drops_network, refuse_other_views};
pub use network::read_network;
pub use numbers::Numbers;
pub use pictures::{Folder, RGB, RGBA};
pub use scene::{raw_density, scene};
pub use whole::whole;
