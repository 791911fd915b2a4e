//! `compare`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use super::cameras::{CameraArguments, check_memory, checked_scales};
use super::common::Common;
use super::compare_page::ComparePage;
use super::detail::{check_levels, parse_levels, warn_of_figures};
use super::field::FieldArguments;
use super::folders::input_path;
use super::layout::{Table, columns, folded};
use super::outcome::{Outcome, counted, warn};
use super::output::{refuse_file_name, refuse_stdout};
use super::progress::Bar;
use super::scene::SceneArguments;
use super::settings::Settings;
use super::values::Background;
use crate::bake::Filter;
use crate::base::bytes::Provisional;
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::progress::Step;
use crate::model::camera::Camera;
use crate::picture;
use crate::report_page::FULL_HEAT;
use crate::view::compare::{FrameErrors, Reference, References, ScaleErrors, shared_photograph};
use crate::view::render::{LevelChoice, Renderer};

/// The columns of the table.
const FIGURES: &str = "PSNR: mean of the frames; pooled: of the error over all their pixels; largest \
                       and 99 %: error of a channel, 0 to 1; diffuse, opacity: PSNR of these alone";

/// Measure the error of a field at every scale
///
/// The reference is rendered at full size and averaged down to each scale. The field is rendered
/// with one ray per pixel at each scale, as in a distant viewer, so the error at smaller scales is
/// mostly aliasing. --difference renders both at the same size and compares those. Without cameras,
/// eight pictures are taken from around the scene.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mipvog-bake compare fine_last.tar scene.mipvog --stepsize 0.5 --cameras transforms.json
  mipvog-bake compare old.mipvog new.mipvog --turntable 8 --difference -o report.html
  mipvog-bake compare test/ scene.mipvog --cameras transforms.json --scales 1 -o errors/")]
pub struct Arguments {
    /// The reference: a container, a glTF asset, a trained input, or a folder of pictures
    #[arg(value_parser = input_path())]
    reference: PathBuf,
    /// The field to measure: a container, a glTF asset or a trained input
    #[arg(value_parser = input_path())]
    field: PathBuf,
    /// Folder for heat maps of the error, or a page NAME.html that shows reference, field and error
    /// side by side. Black is no error, white 0.25 or more
    #[arg(short, long, value_name = "DIR|PAGE.html")]
    output: Option<PathBuf>,
    /// Render both at the same size at each scale and compare those
    #[arg(long)]
    difference: bool,
    /// Scales to measure: 1 is full size, 2 a half, 4 a quarter
    #[arg(long, value_name = "S,...", value_delimiter = ',', default_value = "1,2,4,8",
          value_parser = clap::value_parser!(u16).range(1..=1024))]
    scales: Vec<u16>,
    /// Rays along each side of a pixel of the reference; with --difference, of both
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u8).range(1..=16))]
    supersample: u8,
    /// The level to read of the field: auto (the file's rule), off (level 0), or a number
    #[arg(long, value_name = "auto|off|K", default_value = "auto", value_parser = parse_levels)]
    level_of_detail: LevelChoice,
    /// Make coarser levels for a trained field, as `bake --filter` [default: only level 0]
    #[arg(long, value_name = "NAME")]
    filter: Option<Filter>,
    #[command(flatten)]
    which: FieldArguments,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    cameras: CameraArguments,
    #[command(flatten)]
    scene: SceneArguments,
}

/// What the errors at smaller scales compare.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
enum Measures {
    /// The field rendered at each scale, against the full-size reference averaged down.
    AgainstFullSize,
    /// Field and reference, both rendered at each scale.
    Difference,
}

/// The report of `compare`.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
pub(super) struct CompareReport {
    /// Path of the reference.
    reference: String,
    /// Path of the field.
    field: String,
    /// What the errors at smaller scales compare.
    measures: Measures,
    /// Rays along each side of a pixel of the reference; in a difference, of both sides.
    supersample: u8,
    /// Number of compared frames.
    frames: usize,
    /// Settings that the pictures were rendered with.
    settings: Settings,
    /// Errors at each scale.
    scales: Vec<ScaleErrors>,
}

/// Compares.
pub fn run(arguments: &Arguments, common: &Common) -> Result<Outcome> {
    if let Some(folder) = &arguments.output {
        refuse_stdout(folder, "heat maps go into a folder, or a page into a file")?;
        if arguments.page().is_none() {
            refuse_file_name(folder, "name a folder for heat maps, or a page.html")?;
        }
    }
    let bar = Bar::new(common);
    bar.plan(vec![(Step::Render, 1.0)]);
    let scene = &arguments.scene;
    let pictures = mipvog_inputs::file_of(&arguments.reference).is_dir();
    if pictures && arguments.difference {
        let message = "--difference renders both sides, which a folder of pictures does not allow";
        return Err(Error::usage(message).in_file(&arguments.reference));
    }
    let (which, cameras) = (arguments.which, arguments.cameras.file());
    which.check(&[&arguments.reference, &arguments.field])?;
    let cameras = cameras.as_ref();
    // Beside a model, options for models are not a mistake for a container.
    let is_baked = |path: &Path| Ok(which.container(path, &common.limits())?.is_some());
    let baked = match pictures {
        true => [false; 2],
        false => [is_baked(&arguments.reference)?, is_baked(&arguments.field)?],
    };
    let [of_reference, of_field] = baked.map(|is_baked| match is_baked && baked != [true; 2] {
        true => scene.of_container(),
        false => scene.clone(),
    });
    let mut field = of_field.open(&arguments.field, which, arguments.filter, cameras, common)?;
    check_levels(arguments.level_of_detail, &field)?;
    let reference = if pictures {
        let folder = arguments.reference.clone();
        let background = scene.background.map_or(field.view().background, |Background(b)| b);
        Reference::Pictures { folder, background, limits: common.limits() }
    } else {
        let mut opened = of_reference.open(&arguments.reference, which, None, cameras, common)?;
        arguments.warn_of_settings(&opened, common)?;
        if cameras.is_none() {
            of_reference.see_all(&mut opened);
        }
        Reference::Field(Box::new(opened))
    };
    if cameras.is_none() {
        of_field.see_all(&mut field);
    }
    arguments.cameras.warn_of_world(&field, common);
    let cameras = match arguments.cameras.given() {
        true => arguments.cameras.cameras(&field.view().bounds, common)?,
        false if pictures => {
            let message = "pictures need the cameras that took them: --cameras FILE";
            return Err(Error::usage(message).in_file(&arguments.reference));
        }
        false => arguments.cameras.around(&field, &bar)?,
    };
    if let Reference::Pictures { folder, .. } = &reference
        && let Some(message) = shared_photograph(folder, &cameras)
    {
        warn(&message, common);
    }
    check_memory(&cameras, arguments.supersample, &common.limits())?;
    let scales = checked_scales(&arguments.scales, &cameras)?;
    let mut made = Provisional::default();
    arguments.prepare(&cameras, &scales, &mut made)?;
    let supersample = arguments.supersample.into();
    let references = References::new(&reference, &cameras, &scales, supersample);
    let references = references.with_levels(arguments.level_of_detail);
    let mut references = if arguments.difference { references.alike() } else { references };
    let mut page = arguments.page().map(|_| ComparePage::new(&cameras, &scales));
    let heat = |frame: &FrameErrors| match &mut page {
        Some(page) => page.add(frame),
        None => arguments.write_heat_map(frame, &mut made),
    };
    let errors = references.compare(&field, &bar, heat)?;
    bar.check()?;
    let off = Some("--level-of-detail off").filter(|_| scales == [1]);
    warn_of_figures(&errors, &cameras, off, common);
    let report = CompareReport {
        reference: arguments.reference.to_string_lossy().into_owned(),
        field: arguments.field.to_string_lossy().into_owned(),
        measures: match arguments.difference {
            true => Measures::Difference,
            false => Measures::AgainstFullSize,
        },
        supersample: arguments.supersample,
        frames: cameras.len(),
        settings: Settings::of(field.view()),
        scales: errors,
    };
    let both_have_levels = match &reference {
        Reference::Field(other) => other.levels() > 1 && field.levels() > 1,
        Reference::Pictures { .. } => false,
    };
    if let (Some(path), Some(page)) = (arguments.page(), page) {
        let page = page.finish(
            &report.title(),
            &errors_table(&report.scales),
            &report.notes(both_have_levels),
        );
        made.write(path, page.as_bytes(), arguments.force)?;
    }
    made.keep();
    drop(bar);
    Outcome::new("compare", &report, report.text(both_have_levels, common))
}

/// A table of errors.
pub fn errors_text(errors: &[ScaleErrors]) -> String {
    errors_table(errors).text(columns())
}

fn errors_table(errors: &[ScaleErrors]) -> Table {
    let number = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    let heads = ["scale", "PSNR, dB", "pooled", "SSIM", "largest", "99 %", "diffuse", "opacity"];
    let mut table = Table::new(heads, 1);
    for error in errors {
        table.add([
            format!("1/{}", error.scale),
            format!("{:.2}", error.psnr),
            format!("{:.2}", error.pooled_psnr),
            number(error.ssim, 4),
            format!("{:.4}", error.max_abs),
            format!("{:.4}", error.p99_abs),
            number(error.psnr_diffuse, 2),
            number(error.psnr_opacity, 2),
        ]);
    }
    table
}

impl Arguments {
    /// Warns if the container's settings differ from those of the rendered reference.
    fn warn_of_settings(&self, reference: &Renderer, common: &Common) -> Result<()> {
        let Some(container) = self.which.container(&self.field, &common.limits())? else {
            return Ok(());
        };
        let metadata = container.metadata();
        let own = Settings::of_march(&metadata.march, metadata.background);
        let rendered = Settings::of(reference.view());
        for ((option, own), (_, rendered)) in own.values().into_iter().zip(rendered.values()) {
            if own != rendered {
                let field = self.field.display();
                let remedy = match own.as_str() {
                    "unlimited" => format!("leave out {option}"),
                    own => format!("pass {option} {own}"),
                };
                let message = format!(
                    "{field} was baked with {option} {own}, the reference has {rendered}: {remedy}"
                );
                warn(&message, common);
            }
        }
        Ok(())
    }

    /// The page to write, if the output is one.
    fn page(&self) -> Option<&Path> {
        let is_page = |path: &&PathBuf| {
            path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("html"))
        };
        self.output.as_ref().filter(is_page).map(PathBuf::as_path)
    }

    fn heat_map(&self, frame: &str, scale: usize) -> Option<PathBuf> {
        let folder = self.output.as_ref()?;
        Some(folder.join(format!("{frame}.s{scale}.error.png")))
    }

    /// Makes the folder for heat maps. Before rendering, refuses to replace existing files.
    fn prepare(&self, cameras: &[Camera], scales: &[usize], made: &mut Provisional) -> Result<()> {
        let Some(folder) = &self.output else { return Ok(()) };
        if let Some(page) = self.page() {
            if !self.force && page.symlink_metadata().is_ok() {
                return Err(Error::new(ErrorKind::Exists, Place::File).in_file(page));
            }
            let parent = page.parent().filter(|parent| !parent.as_os_str().is_empty());
            return parent.map_or(Ok(()), |parent| made.create_folder(parent));
        }
        let names = cameras.iter().flat_map(|camera| scales.iter().map(|&s| (&camera.name, s)));
        let mut maps = BTreeSet::new();
        for map in names.filter_map(|(name, scale)| self.heat_map(name, scale)) {
            if !self.force && map.symlink_metadata().is_ok() {
                return Err(Error::new(ErrorKind::Exists, Place::File).in_file(&map));
            }
            if !maps.insert(map.clone()) {
                let message = "two heat maps would have this name: pick each frame once";
                return Err(Error::usage(message).in_file(&map));
            }
        }
        made.create_folder(folder)
    }

    fn write_heat_map(&self, errors: &FrameErrors, made: &mut Provisional) -> Result<()> {
        let Some(path) = self.heat_map(errors.frame, errors.scale) else { return Ok(()) };
        let map = errors.want.heat_map(errors.got, FULL_HEAT);
        let png = picture::png(errors.want.width, errors.want.height, &map)?;
        made.write(&path, &png, self.force)
    }
}

impl CompareReport {
    fn title(&self) -> String {
        format!("{} against {}", self.field, self.reference)
    }

    /// The meaning of the figures.
    fn meaning(&self, both_have_levels: bool) -> Option<&'static str> {
        match (self.measures, both_have_levels) {
            (Measures::Difference, _) => Some("both rendered at the size of each scale"),
            (Measures::AgainstFullSize, _) if self.scales.len() <= 1 => None,
            (Measures::AgainstFullSize, true) => Some(
                "smaller scales compare one ray per pixel with the full-size picture averaged down, \
                 so they include aliasing; --difference leaves it out",
            ),
            (Measures::AgainstFullSize, false) => Some(
                "smaller scales compare one ray per pixel with the full-size picture averaged down, \
                 so they include aliasing",
            ),
        }
    }

    /// The notes of a page.
    fn notes(&self, both_have_levels: bool) -> Vec<String> {
        let settings = self.settings.values();
        let settings = settings.map(|(name, value)| format!("{name} {value}")).join(", ");
        let meaning = self.meaning(both_have_levels).map(str::to_owned);
        let frames = counted(self.frames, "frame");
        let settings = format!("{frames}; settings of the field: {settings}");
        [FIGURES.to_owned()].into_iter().chain(meaning).chain([settings]).collect()
    }

    fn text(&self, both_have_levels: bool, common: &Common) -> String {
        let psnr = self.scales.iter().find(|errors| errors.scale == 1);
        let psnr =
            psnr.map_or_else(String::new, |full| format!("{:.2} dB pooled, ", full.pooled_psnr));
        let frames = counted(self.frames, "frame");
        let line = format!("{}: {psnr}{frames}", self.title());
        let mut text = folded(&line, columns(), 4) + "\n";
        text += &errors_text(&self.scales);
        let mut add = |line: &str| text += &(folded(&format!("  {line}"), columns(), 4) + "\n");
        if common.verbose {
            add(FIGURES);
        }
        if let Some(meaning) = self.meaning(both_have_levels) {
            add(meaning);
        }
        text + &self.settings.text()
    }
}
