//! The arguments of `bake`, and the kinds of input.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{ArgGroup, Args};

use super::super::common::Common;
use super::super::field::FieldArguments;
use super::super::fit::FitArguments;
use super::super::folders::input_path;
use super::super::gate::GateArguments;
use super::super::gltf::GltfArguments;
use super::super::guess::{container_name, container_names, is_folder_name};
use super::super::incremental::IncrementalArguments;
use super::super::manifest::{ExplicitOptions, ManifestArguments};
use super::super::scene::SceneArguments;
use super::super::stdin;
use super::super::stored::StoredArguments;
use super::super::thumbnail::ThumbnailArguments;
use super::super::values::by_name;
use super::super::view_report::ColorFit;
use crate::bake::{BakeOptions, Preset};
use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::container::Container;
use crate::unpacked::Unpacked;
use mipvog_inputs::tensor::{self, TensorFile};

/// The output where none is named: of a manifest, whose lines name theirs, and of a forecast.
const NO_OUTPUT: &str = ".";

/// Bake a trained scene to a container
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("source").required(true).args(["input", "manifest"])))]
#[command(after_help = "\
Examples:
  mipvog-bake bake fine_last.tar --stepsize 0.5 --near 2 --far 6 -o scene.mipvog
  mipvog-bake bake fine_last.tar --preset web --gltf scene.glb -o scene.mipvog
  mipvog-bake bake fine_last.tar -o scene.mipvog --cameras transforms.json --require-psnr 40
  mipvog-bake bake scenes/*/fine_last.tar -o baked/
  mipvog-bake bake --manifest scenes.jsonl --if-changed -o baked/")]
pub struct Arguments {
    // First: the others take their values out of the matches.
    #[command(flatten)]
    pub given: ExplicitOptions,
    /// Trained models, containers or glTF assets with one; - means standard input. A model is a
    /// file, or the folder of a training, of SNeRG or of MERF
    #[arg(id = "input", value_name = "INPUT", value_parser = input_path())]
    pub inputs: Vec<PathBuf>,
    /// The one of the inputs that is baked.
    #[arg(skip)]
    pub input: PathBuf,
    /// Container to write; - means standard output. A folder, with a slash at its end, takes a
    /// container for each input. With --manifest, the folder of all outputs
    #[arg(
        short,
        long,
        value_name = "OUT.mipvog|DIR/",
        default_value = NO_OUTPUT,
        hide_default_value = true,
        required_unless_present_any = ["manifest", "dry_run"]
    )]
    pub output: PathBuf,
    /// Forecast time, memory and size, and write nothing; parts of the scene are baked
    #[arg(long)]
    pub dry_run: bool,
    /// Overwrite the output if it exists
    #[arg(long)]
    pub force: bool,
    /// Add the scene of this file, at its place in the world; may be given several times. The grid
    /// of INPUT is extended to hold the other scenes
    #[arg(long, value_name = "FILE")]
    pub merge: Vec<PathBuf>,
    /// Set of options; explicit options override it
    #[arg(long, value_parser = by_name::<Preset>())]
    pub preset: Option<Preset>,
    #[command(flatten)]
    pub thumbnail: ThumbnailArguments,
    #[command(flatten)]
    pub which: FieldArguments,
    #[command(flatten, next_help_heading = "Size and error")]
    pub stored: StoredArguments,
    #[command(flatten, next_help_heading = "Fit")]
    pub fit: FitArguments,
    #[command(flatten, next_help_heading = "Scene")]
    pub scene: SceneArguments,
    #[command(flatten, next_help_heading = "Quality gate")]
    pub gate: GateArguments,
    #[command(flatten, next_help_heading = "glTF")]
    pub gltf: GltfArguments,
    #[command(flatten, next_help_heading = "Incremental builds")]
    pub incremental: IncrementalArguments,
    #[command(flatten, next_help_heading = "Batches")]
    pub many: ManifestArguments,
    /// The input, where it is no file.
    #[arg(skip)]
    pub held: Option<Arc<SourceFile>>,
    /// The fit that its colours come from, where it was made before.
    #[arg(skip)]
    pub color_fit: Option<ColorFit>,
}

/// The content of an input.
pub enum Content {
    /// A trained scene.
    Trained(TensorFile),
    /// A container's levels.
    Stored(Box<Unpacked>),
}

/// An open input.
pub struct Input {
    /// Its content.
    pub content: Content,
    /// Bytes of a container, and those that were read: all levels are in memory.
    container_bytes: [u64; 2],
    /// The file that is read during the bake, if there is one.
    file: Option<Arc<SourceFile>>,
}

impl Input {
    /// A container, or else the tensors of a file.
    fn of(
        container: Option<Container>,
        tensors: impl FnOnce() -> Result<TensorFile>,
        limits: &Limits,
    ) -> Result<Self> {
        if let Some(container) = container {
            let content = Content::Stored(Box::new(Unpacked::of_container(&container)?));
            let file = container.file();
            let container_bytes = [file.length(), file.bytes_read()];
            return Ok(Self { content, container_bytes, file: None });
        }
        let tensors = tensors()?;
        let file = Some(Arc::clone(&tensors.file));
        let content = match tensors.unpacked_metadata() {
            Some(_) => Content::Stored(Box::new(mipvog_inputs::unpacked::open(&tensors, limits)?)),
            None => Content::Trained(tensors),
        };
        Ok(Self { content, container_bytes: [0; 2], file })
    }

    /// Its bytes.
    pub fn length(&self) -> u64 {
        self.container_bytes[0] + self.file.as_ref().map_or(0, |file| file.length())
    }

    /// Bytes that were read of it so far.
    pub fn bytes_read(&self) -> u64 {
        self.container_bytes[1] + self.file.as_ref().map_or(0, |file| file.bytes_read())
    }
}

impl Arguments {
    /// Takes the input, and the container in a folder, where there is one of them.
    pub fn settle(&mut self) {
        let [input] = &*self.inputs else { return };
        self.input.clone_from(input);
        if self.dry_run && self.output == Path::new(NO_OUTPUT) {
            self.output = container_name(input);
        }
        if is_folder_name(&self.output)
            && let Ok(names) = container_names(&self.inputs, &self.output)
            && let Some(name) = names.into_iter().next()
        {
            self.output = name;
        }
    }

    /// The container of each of several inputs.
    ///
    /// # Errors
    /// `Usage` for an output that is no folder, and where two containers would have one name.
    pub fn outputs(&self) -> Result<Vec<PathBuf>> {
        let output = &self.output;
        if !(is_folder_name(output) || output.is_dir()) {
            let message = format!("-o {}: several inputs go into a folder", output.display());
            let advice = format!("name a folder: -o {}/", output.with_extension("").display());
            return Err(Error::usage(message).advise(advice));
        }
        container_names(&self.inputs, output)
    }

    /// Opens the input, by its content.
    pub fn open(&self, limits: &Limits) -> Result<Input> {
        let Some(held) = &self.held else {
            self.which.check(&[&self.input])?;
            return self.open_file(&self.input, limits);
        };
        let container = self.which.container_of(Arc::clone(held), limits)?;
        Input::of(container, || tensor::open_file(held, limits), limits)
    }

    /// Opens a file as an input, by its content.
    pub fn open_file(&self, path: &Path, limits: &Limits) -> Result<Input> {
        let container = self.which.container(path, limits)?;
        Input::of(container, || tensor::open(&stdin::resolve(path)?, limits), limits)
    }
    /// The options that all arguments but the cameras of [`BakeOptions::seen_from`] give. The
    /// settings of a container stay, unless an option or a preset says otherwise.
    pub fn options(&self, content: &Content, common: &Common) -> Result<BakeOptions> {
        let mut options = match (self.preset, content) {
            (Some(preset), _) => preset.options(),
            (None, Content::Stored(unpacked)) => {
                BakeOptions::of_container(&unpacked.metadata, &unpacked.provenance)
            }
            (None, Content::Trained(_)) => BakeOptions::default(),
        };
        let measures = self.gate.measures()?;
        self.stored.apply(&mut options, measures)?;
        self.fit.apply(&mut options, || self.gate.cameras_of_file(common), common)?;
        options.limits = common.limits();
        // Those of a container count only where it is baked anew, and are checked there.
        self.check_options(&options, matches!(content, Content::Trained(_)))?;
        Ok(options)
    }

    /// Refuses values that no input is baked with. No file is opened.
    pub fn check_values(&self) -> Result<()> {
        let mut options = self.preset.map_or_else(BakeOptions::default, Preset::options);
        self.stored.apply(&mut options, self.gate.measures()?)?;
        self.fit.apply_numbers(&mut options);
        self.check_options(&options, true)
    }

    fn check_options(&self, options: &BakeOptions, is_trained: bool) -> Result<()> {
        let measures = self.gate.measures()?;
        if options.memory.is_some() && measures {
            let message = "--memory excludes --cameras and --turntable: pictures are rendered \
                           from the whole field; use compare afterwards";
            return Err(Error::usage(message));
        }
        if options.memory.is_some() && self.gate.required_view_psnr().is_some() {
            let message = "--memory excludes --require-view-psnr: it reads the whole container";
            return Err(Error::usage(message));
        }
        if self.fit.given() && !options.filter.is_fitted() {
            let message = "--fit-steps, --fit-seconds, --fit-cameras and --photographs need \
                           --filter fit";
            return Err(Error::usage(message));
        }
        if is_trained {
            options.check()?;
        }
        self.scene.source_options().check()?;
        if !measures && options.sees() {
            let message =
                "--min-weight and --coarseness need --cameras or --turntable to be seen from";
            return Err(Error::usage(message));
        }
        Ok(())
    }
}
