//! USD: a text that places an OpenVDB file beside it in a scene.
//!
//! A `Volume` has a field for each grid, `density` and `Cd`, and names the file by its relative
//! path. Programs render it with their volume material.

use std::fmt::Write;
use std::path::Path;

use super::export_files::{ExportFiles, WrittenFiles};
use super::format::{ExportFormat, ExportOptions, ExportSource, Exported, Shown, UpAxis};
use super::vdb::{Vdb, check_volume, write_volume};
use crate::base::error::{Error, ErrorKind, Result};
use crate::base::limits::Limits;
use crate::base::progress::Progress;
use crate::volume::SparseVolume;

/// A scene of USD as text, and the OpenVDB file that it names.
#[derive(Debug)]
pub struct Usd;

impl ExportFormat for Usd {
    fn name(&self) -> &'static str {
        "usd"
    }

    fn options(&self) -> &'static [&'static str] {
        Vdb.options()
    }

    fn check(&self, source: &ExportSource, options: &ExportOptions, output: &Path) -> Result<()> {
        if output.extension().is_none_or(|extension| extension != "usda") {
            let output = output.display();
            return Err(Error::usage(format!(
                "-o {output}: USD is written as text, so the name must end in .usda"
            )));
        }
        if stem(output).contains('@') {
            return Err(Error::usage("the name must not contain @, which delimits paths in USD"));
        }
        check_volume(source, options)
    }

    fn write(
        &self,
        source: &ExportSource,
        options: &ExportOptions,
        files: &mut ExportFiles,
        progress: &dyn Progress,
    ) -> Result<Exported> {
        let path = files.output().to_owned();
        let volume = path.with_extension("vdb");
        let output = files.create(volume.clone()).map_err(|error| match error.kind() {
            ErrorKind::Exists => error.advise(format!(
                "{} needs a volume of this name beside it: choose another name, or pass --force",
                path.display()
            )),
            _ => error,
        })?;
        let (exported, volume) = write_volume(source, options, output, progress)?;
        let text = scene(&stem(&path), &volume, options);
        files.add(path, text.as_bytes())?;
        Ok(exported)
    }

    fn read_back(
        &self,
        source: &ExportSource,
        files: &WrittenFiles,
        limits: &Limits,
    ) -> Result<Box<dyn Shown>> {
        Vdb.read_back(source, files, limits)
    }
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The text.
fn scene(stem: &str, volume: &SparseVolume, options: &ExportOptions) -> String {
    let [low, high] = volume.lattice.bounds();
    let (up, corners) = match options.up {
        UpAxis::Z => ("Z", [low, high]),
        UpAxis::Y => ("Y", [[low[0], low[2], -high[1]], [high[0], high[2], -low[1]]]),
    };
    let corner = |[x, y, z]: [f64; 3]| format!("({}, {}, {})", x as f32, y as f32, z as f32);
    let mut grids = vec![("density".to_owned(), "float", "fogVolume", "None")];
    grids.push(("Cd".to_owned(), "float3", "unknown", "Color"));
    let features = (0..volume.features).map(|channel| format!("feature_{channel}"));
    grids.extend(features.map(|name| (name, "float", "unknown", "None")));
    let mut text = format!(
        "#usda 1.0\n(\n    defaultPrim = \"Volume\"\n    metersPerUnit = 1\n    upAxis = \"{up}\"\n\
         )\n\ndef Volume \"Volume\"\n{{\n    float3[] extent = [{}, {}]\n",
        corner(corners[0]),
        corner(corners[1])
    );
    for (name, ..) in &grids {
        writeln!(text, "    rel field:{name} = </Volume/{name}>").ok();
    }
    for (name, kind, class, role) in &grids {
        write!(
            text,
            "\n    def OpenVDBAsset \"{name}\"\n    {{\n        token fieldClass = \"{class}\"\n        \
             token fieldDataType = \"{kind}\"\n        token fieldName = \"{name}\"\n        \
             asset filePath = @./{stem}.vdb@\n        token vectorDataRoleHint = \"{role}\"\n    }}\n"
        )
        .ok();
    }
    text + "}\n"
}
