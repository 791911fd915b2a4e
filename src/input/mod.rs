//! Trained models. [`tensor`] reads file syntax and knows no names. Each other folder reads one family of models.

pub mod checkpoint;
pub mod tensor;
