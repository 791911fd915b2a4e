//! A source, for bakes and pictures.

use mipvog::bake::{BakeInput, Origin};
use serde_json::json;
use sha2::{Digest as _, Sha256};

use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::model::field::Grid;
use crate::source::{SideFile, Source};
use crate::view::render::{Renderer, TrainedLevels};

impl<'a> From<&'a Source> for BakeInput<'a> {
    fn from(source: &'a Source) -> Self {
        Self { field: &source.field, origin: source.origin() }
    }
}

impl Source {
    /// The origin for a bake of it.
    pub fn origin(&self) -> Origin {
        let assumptions = self.assumptions.iter();
        Origin {
            kind: format!("{} {}", self.family.name(), self.kind.name()),
            digest: self.digest,
            covers_values: match &self.field.density {
                Grid::Array(_) => self.field.density.has_checksum(),
                Grid::Values(_) => self.has_checksums,
            },
            side_files: side_files(&self.side_files),
            assumptions: assumptions.map(|a| json!({ "key": a.key, "value": a.value })).collect(),
        }
    }

    /// Renders it by the rules of its own program, with coarser levels if `levels` has a filter.
    /// All of its values are read.
    ///
    /// # Errors
    ///
    /// As [`Renderer::trained`], and `Usage` for coarser levels of a model with rules of its own.
    pub fn renderer(&self, levels: Option<TrainedLevels>, limits: &Limits) -> Result<Renderer> {
        let Some(model) = &self.model else {
            return Renderer::trained(&self.field, levels, limits);
        };
        if levels.is_some() {
            let name = self.family.name();
            return Err(Error::usage(format!(
                "--filter makes coarser levels of nodes, and an unbaked {name} model is rendered \
                 by its own rules, which have none: bake it first"
            )));
        }
        Renderer::of_model(&self.field, &**model, limits)
    }
}

/// Roles and digests; files of the same role share one digest, in order.
fn side_files(files: &[SideFile]) -> Vec<(&'static str, [u8; 32])> {
    let mut roles: Vec<&'static str> = Vec::new();
    let mut new = |file: &SideFile| {
        let is_new = !roles.contains(&file.role);
        roles.extend(is_new.then_some(file.role));
        is_new
    };
    let firsts: Vec<&SideFile> = files.iter().filter(|file| new(file)).collect();
    let joined = firsts.into_iter().map(|first| {
        let same = files.iter().filter(|file| file.role == first.role);
        if same.clone().count() == 1 {
            return (first.role, first.digest);
        }
        let mut sum = Sha256::new();
        same.for_each(|file| sum.update(file.digest));
        (first.role, sum.finalize().into())
    });
    joined.collect()
}
