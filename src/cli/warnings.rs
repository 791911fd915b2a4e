//! The warnings of a run, which go to stderr immediately and into its report.

use std::sync::Mutex;

use crate::base::lock::lock;

/// Warnings in their order, each once.
#[derive(Debug, Default)]
pub struct Warnings(Mutex<Noted>);

#[derive(Debug, Default)]
struct Noted {
    /// The scene of a batch that is being baked.
    scene: Option<String>,
    texts: Vec<String>,
}

impl Warnings {
    /// Adds a warning. Returns it with the name of the scene, or `None` if it was added before.
    pub fn add(&self, text: &str) -> Option<String> {
        let mut noted = lock(&self.0);
        if noted.texts.iter().any(|other| other == text) {
            return None;
        }
        noted.texts.push(text.to_owned());
        let named = noted.scene.as_ref().map(|scene| format!("{scene}: {text}"));
        Some(named.unwrap_or_else(|| text.to_owned()))
    }

    /// Warnings so far.
    pub fn texts(&self) -> Vec<String> {
        lock(&self.0).texts.clone()
    }

    /// Begins with another scene of a batch.
    pub fn begin(&self, scene: &str) {
        *lock(&self.0) = Noted { scene: Some(scene.to_owned()), texts: Vec::new() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_warning_counts_once_and_names_its_scene() {
        let warnings = Warnings::default();
        assert_eq!(warnings.add("thin").as_deref(), Some("thin"));
        assert_eq!(warnings.add("thin"), None);
        warnings.begin("chair.tar");
        assert_eq!(warnings.add("thin").as_deref(), Some("chair.tar: thin"));
        assert_eq!(warnings.texts(), ["thin"]);
    }
}
