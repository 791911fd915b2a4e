//! The settings of a training, `config.yml`, of which the checkpoint lacks some.

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use sha2::{Digest, Sha256};

use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::Limits;
use crate::plain_yaml::Plain;
use crate::source::{Assumption, SideFile};

/// The file's name.
pub(super) const NAME: &str = "config.yml";
/// Settings of the model stand under it.
const MODEL: &str = "pipeline.model.";
/// Samples of a round, at most.
const MOST_SAMPLES: usize = 1 << 14;
/// Rounds of proposals, at most.
const MOST_ROUNDS: usize = 16;

/// What lies behind the last sample of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Background {
    /// Its own colour.
    LastSample,
    /// One colour.
    Color([f32; 3]),
}

/// The settings that pictures depend on and that the checkpoint lacks.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Settings {
    /// Nodes along an axis of the first level.
    pub(super) base: u64,
    /// Features of a level; tables of PyTorch state theirs.
    pub(super) features: u64,
    /// The same two of each proposal.
    pub(super) proposals: Vec<[u64; 2]>,
    /// Density of a first output of 0.
    pub(super) mean_density: f64,
    /// True if space is contracted.
    pub(super) contracted: bool,
    /// True if pictures are taken with the mean of all appearances, not with zeros.
    pub(super) mean_appearance: bool,
    /// Samples of each round, the last one's included.
    pub(super) samples: Vec<usize>,
    /// True if all rounds ask the first network.
    pub(super) same_proposal: bool,
    /// True if even samples are even in distance at the start and in its reciprocal beyond.
    pub(super) piecewise: bool,
    pub(super) far: f64,
    pub(super) background: Background,
    /// Sizes of levels where the checkpoint has none.
    pub(super) levels: [Option<u64>; 3],
}

/// Settings with where they come from.
#[derive(Debug)]
pub(super) struct Found {
    pub(super) settings: Settings,
    pub(super) file: Option<SideFile>,
    pub(super) assumption: Option<Assumption>,
}

/// The file above the folder of a checkpoint, or beside it.
fn path_of(checkpoint: &Path) -> Option<PathBuf> {
    let folder = checkpoint.parent()?;
    let run = match (folder.file_name(), folder.parent()) {
        (Some(_), Some(run)) => run.to_owned(),
        _ => folder.join(".."),
    };
    [run.join(NAME), folder.join(NAME)].into_iter().find(|path| path.is_file())
}

/// Reads the settings of a checkpoint's run. `rounds` are the networks for proposals that it has.
///
/// # Errors
/// `Unsupported` for another method than nerfacto, and values that no training has.
pub(super) fn find(checkpoint: &Path, rounds: usize, limits: &Limits) -> Result<Found> {
    let Some(path) = path_of(checkpoint) else {
        return Scan { plain: Plain::default(), is_there: false, assumed: Vec::new() }
            .found(rounds);
    };
    let file = SourceFile::open(&path)?;
    let bytes = file.read(0, file.length(), limits.header_bytes)?;
    let plain = Plain::read(&String::from_utf8_lossy(&bytes));
    let scan = Scan { plain, is_there: true, assumed: Vec::new() };
    let mut found = scan.found(rounds).map_err(|error| error.in_file(&path))?;
    found.file = Some(SideFile { role: "config", path, digest: Sha256::digest(&bytes).into() });
    Ok(found)
}

/// The text while settings are taken from it.
struct Scan {
    plain: Plain,
    /// False where there is no file.
    is_there: bool,
    /// Settings that were not found, with their assumed values.
    assumed: Vec<String>,
}

impl Scan {
    fn found(mut self, rounds: usize) -> Result<Found> {
        self.refuse_others()?;
        let settings = self.settings(rounds)?;
        let (value, is_there) = (self.assumed.join(", "), self.is_there);
        let assumption = (!self.assumed.is_empty()).then(|| Assumption {
            key: NAME,
            message: match is_there {
                true => {
                    format!("{NAME} lacks some settings of the training: assuming {value}")
                }
                false => format!(
                    "there is no {NAME} two folders above the checkpoint, where nerfstudio keeps the \
                     training's settings: assuming its defaults, {value}; put it there, or pass the \
                     folder of the run"
                ),
            },
            value,
        });
        Ok(Found { settings, file: None, assumption })
    }

    /// Refuses methods that draw their pictures by rules of their own.
    fn refuse_others(&self) -> Result<()> {
        let target = self.plain.text(&format!("{MODEL}_target")).unwrap_or_default();
        let class = target.split_whitespace().next().unwrap_or_default();
        let class = class.rsplit(['.', ':']).next().unwrap_or_default();
        if class.is_empty() || class.ends_with("NerfactoModel") {
            return Ok(());
        }
        let method = self.plain.value("method_name").unwrap_or("unnamed");
        let found = format!("the method {method} (class {class})");
        let error = Error::unsupported(Place::Key("method_name".to_owned()), found, "nerfacto");
        Err(error.advise(
            "bake the run by nerfstudio's own code, with the Python module: python -m \
             mipvog_bake.nerfstudio RUN/config.yml -o scene.mipvog",
        ))
    }

    /// A setting of the model, or what is assumed instead.
    fn get<T: FromStr + Display>(&mut self, key: &str, default: T, expected: &str) -> Result<T> {
        let found = self.optional(key, expected)?;
        Ok(found.unwrap_or_else(|| {
            self.assumed.push(format!("{key} {default}"));
            default
        }))
    }

    /// A setting of the model that may be missing.
    fn optional<T: FromStr>(&self, key: &str, expected: &str) -> Result<Option<T>> {
        let path = format!("{MODEL}{key}");
        let Some(text) = self.plain.value(&path) else { return Ok(None) };
        let refuse = || Error::malformed(Place::Key(path.clone()), text, expected);
        text.parse().map(Some).map_err(|_| refuse())
    }

    /// A number of the model that has to be within a range.
    fn number(&mut self, key: &str, default: f64, most: f64) -> Result<f64> {
        let expected = format!("a number above 0, up to {most}");
        let found: f64 = self.get(key, default, &expected)?;
        if found > 0.0 && found <= most {
            return Ok(found);
        }
        let place = Place::Key(format!("{MODEL}{key}"));
        Err(Error::malformed(place, found.to_string(), expected))
    }

    fn count(&mut self, key: &str, default: usize, most: usize) -> Result<usize> {
        let expected = format!("1 to {most}");
        let found: usize = self.get(key, default, &expected)?;
        if (1..=most).contains(&found) {
            return Ok(found);
        }
        let place = Place::Key(format!("{MODEL}{key}"));
        Err(Error::malformed(place, found.to_string(), expected))
    }

    fn settings(&mut self, networks: usize) -> Result<Settings> {
        // The class has another default than the method, and versions before it have none.
        let density = if self.is_there { 1.0 } else { 0.01 };
        let rounds = self.count("num_proposal_iterations", 2, MOST_ROUNDS)?;
        let same_proposal = self.get("use_same_proposal_network", false, "true or false")?;
        if networks < if same_proposal { 1 } else { rounds } {
            let found = format!("{networks} networks for {rounds} rounds of proposals");
            let place = Place::Key(format!("{MODEL}num_proposal_iterations"));
            return Err(Error::malformed(place, found, "one for each"));
        }
        let mut samples = Vec::new();
        for (round, default) in (0..rounds).zip([256, 96].into_iter().chain(std::iter::repeat(96)))
        {
            let key = format!("num_proposal_samples_per_ray.{round}");
            samples.push(self.count(&key, default, MOST_SAMPLES)?);
        }
        samples.push(self.count("num_nerf_samples_per_ray", 48, MOST_SAMPLES)?);
        let expected = "a whole number";
        let mut proposals = Vec::new();
        for number in 0..networks {
            // Lists leave out what is the default.
            let key = |key: &str| format!("proposal_net_args_list.{number}.{key}");
            let base = self.optional(&key("base_res"), expected)?.unwrap_or(16);
            let features = self.optional(&key("features_per_level"), expected)?.unwrap_or(2);
            proposals.push([base, features]);
        }
        let level = |key: &str| self.optional(key, expected);
        let levels = [level("num_levels")?, level("max_res")?, level("log2_hashmap_size")?];
        Ok(Settings {
            base: self.get("base_res", 16, expected)?,
            proposals,
            features: self.get("features_per_level", 2, expected)?,
            mean_density: self.number("average_init_density", density, 1e9)?,
            contracted: !self.get("disable_scene_contraction", false, "true or false")?,
            mean_appearance: self.get("use_average_appearance_embedding", true, "true or false")?,
            samples,
            same_proposal,
            piecewise: self.sampler()?,
            far: self.number("far_plane", 1000.0, 1e10)?,
            background: self.background()?,
            levels,
        })
    }

    fn sampler(&mut self) -> Result<bool> {
        let key = "proposal_initial_sampler";
        match self.get(key, "piecewise".to_owned(), "a name")?.as_str() {
            "piecewise" => Ok(true),
            "uniform" => Ok(false),
            other => {
                let place = Place::Key(format!("{MODEL}{key}"));
                Err(Error::unsupported(place, other, "piecewise or uniform"))
            }
        }
    }

    fn background(&mut self) -> Result<Background> {
        let key = "background_color";
        match self.get(key, "last_sample".to_owned(), "a name")?.as_str() {
            "last_sample" => Ok(Background::LastSample),
            "white" => Ok(Background::Color([1.0; 3])),
            // Nothing is added to the pictures of a model that was trained over random colours.
            "black" | "random" => Ok(Background::Color([0.0; 3])),
            other => {
                let place = Place::Key(format!("{MODEL}{key}"));
                Err(Error::unsupported(place, other, "last_sample, random, black or white"))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan(text: &str) -> Result<Found> {
        Scan { plain: Plain::read(text), is_there: true, assumed: Vec::new() }.found(2)
    }

    #[test]
    fn settings_that_no_training_has_are_refused() {
        let model = |line: &str| scan(&format!("pipeline:\n  model:\n    {line}\n"));
        assert!(model("far_plane: 6.0").is_ok());
        for line in [
            "far_plane: 0",
            "far_plane: nan",
            "far_plane: *id001",
            "num_nerf_samples_per_ray: 0",
            "num_nerf_samples_per_ray: 99999999",
            "num_proposal_iterations: 3",
            "num_proposal_iterations: 99",
            "average_init_density: -1.0",
            "disable_scene_contraction: perhaps",
            "proposal_initial_sampler: spiral",
            "background_color: plaid",
            "base_res: -3",
            "_target: !!python/name:nerfstudio.models.splatfacto.SplatfactoModel ''",
        ] {
            assert!(model(line).is_err(), "{line}");
        }
        let same = "use_same_proposal_network: true\n    num_proposal_iterations: 5";
        assert_eq!(model(same).expect("five rounds").settings.samples, [256, 96, 96, 96, 96, 48]);
    }

    #[test]
    fn missing_settings_are_told() {
        let found = scan("pipeline:\n  model:\n    base_res: 32\n").expect("defaults");
        assert_eq!((found.settings.base, found.settings.mean_density), (32, 1.0));
        let told = found.assumption.expect("a warning").message;
        assert!(told.contains("far_plane 1000") && !told.contains("base_res"), "{told}");
        let none = Scan { plain: Plain::default(), is_there: false, assumed: Vec::new() };
        assert_eq!(none.found(2).expect("defaults").settings.mean_density, 0.01);
    }
}
