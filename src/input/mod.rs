//! Trained models. [`tensor`] reads file syntax and knows no names. Each other folder reads one
//! family of models.

pub mod checkpoint;
mod open;
mod settings;
pub mod tensor;

pub use checkpoint::Source;
pub use open::{inspect, open, open_tensors, open_with};
pub use settings::SceneSettings;
