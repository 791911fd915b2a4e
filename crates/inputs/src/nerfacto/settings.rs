//! The settings of a training, `config.yml`; the checkpoint lacks some of them.

use std::path::Path;

use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::nerfstudio::{RunSettings, place};
use crate::source::{Assumption, SideFile};

/// Samples of a round, at most.
const MOST_SAMPLES: usize = 1 << 14;
/// Rounds of proposals, at most.
const MOST_ROUNDS: usize = 16;

/// The colour behind the last sample of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Background {
    /// Its own colour.
    LastSample,
    /// One colour.
    Color([f32; 3]),
}

/// The rendering settings that the checkpoint lacks.
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
    /// True if pictures use the mean of all appearances, not zeros.
    pub(super) mean_appearance: bool,
    /// Samples of each round, the last one's included.
    pub(super) samples: Vec<usize>,
    /// True if all rounds use the first network.
    pub(super) same_proposal: bool,
    /// True if even samples are evenly spaced in distance at first, and in its reciprocal beyond.
    pub(super) piecewise: bool,
    pub(super) far: f64,
    pub(super) background: Background,
    /// Sizes of levels where the checkpoint has none.
    pub(super) levels: [Option<u64>; 3],
}

/// Settings and their source.
#[derive(Debug)]
pub(super) struct Found {
    pub(super) settings: Settings,
    pub(super) file: Option<SideFile>,
    pub(super) assumption: Option<Assumption>,
}

/// Reads the settings of a checkpoint's run. `rounds` is the number of its proposal networks.
///
/// # Errors
/// `Unsupported` for another method than nerfacto, and values that no training has.
pub(super) fn find(checkpoint: &Path, rounds: usize, limits: &Limits) -> Result<Found> {
    found(RunSettings::of(checkpoint, limits)?, rounds)
}

fn found(mut run: RunSettings, rounds: usize) -> Result<Found> {
    let settings = Settings::of(&mut run, rounds).map_err(|error| run.blame(error))?;
    let (file, assumption) = run.told();
    Ok(Found { settings, file, assumption })
}

impl Settings {
    fn of(run: &mut RunSettings, networks: usize) -> Result<Self> {
        run.refuse_others("NerfactoModel", "nerfacto")?;
        // The class has a different default than the method, and older versions have none.
        let density = if run.is_there() { 1.0 } else { 0.01 };
        let rounds = run.count("num_proposal_iterations", 2, MOST_ROUNDS)?;
        let same_proposal = run.get("use_same_proposal_network", false, "true or false")?;
        if networks < if same_proposal { 1 } else { rounds } {
            let found = format!("{networks} networks for {rounds} rounds of proposals");
            return Err(Error::malformed(place("num_proposal_iterations"), found, "one for each"));
        }
        let mut samples = Vec::new();
        for (round, default) in (0..rounds).zip([256, 96].into_iter().chain(std::iter::repeat(96)))
        {
            let key = format!("num_proposal_samples_per_ray.{round}");
            samples.push(run.count(&key, default, MOST_SAMPLES)?);
        }
        samples.push(run.count("num_nerf_samples_per_ray", 48, MOST_SAMPLES)?);
        let expected = "a whole number";
        let mut proposals = Vec::new();
        for number in 0..networks {
            // Lists omit default values.
            let key = |key: &str| format!("proposal_net_args_list.{number}.{key}");
            let base = run.optional(&key("base_res"), expected)?.unwrap_or(16);
            let features = run.optional(&key("features_per_level"), expected)?.unwrap_or(2);
            proposals.push([base, features]);
        }
        let level = |key: &str| run.optional(key, expected);
        let levels = [level("num_levels")?, level("max_res")?, level("log2_hashmap_size")?];
        Ok(Self {
            base: run.get("base_res", 16, expected)?,
            proposals,
            features: run.get("features_per_level", 2, expected)?,
            mean_density: run.number("average_init_density", density, 1e9)?,
            contracted: !run.get("disable_scene_contraction", false, "true or false")?,
            mean_appearance: run.get("use_average_appearance_embedding", true, "true or false")?,
            samples,
            same_proposal,
            piecewise: sampler(run)?,
            far: run.number("far_plane", 1000.0, 1e10)?,
            background: background(run)?,
            levels,
        })
    }
}

fn sampler(run: &mut RunSettings) -> Result<bool> {
    let key = "proposal_initial_sampler";
    match run.get(key, "piecewise".to_owned(), "a name")?.as_str() {
        "piecewise" => Ok(true),
        "uniform" => Ok(false),
        other => Err(Error::unsupported(place(key), other, "piecewise or uniform")),
    }
}

fn background(run: &mut RunSettings) -> Result<Background> {
    let key = "background_color";
    match run.get(key, "last_sample".to_owned(), "a name")?.as_str() {
        "last_sample" => Ok(Background::LastSample),
        "white" => Ok(Background::Color([1.0; 3])),
        // A model that was trained over random colours has no background.
        "black" | "random" => Ok(Background::Color([0.0; 3])),
        other => Err(Error::unsupported(place(key), other, "last_sample, random, black or white")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan(text: &str) -> Result<Found> {
        found(RunSettings::of_text(text), 2)
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
        let none = super::found(RunSettings::default(), 2).expect("defaults");
        assert_eq!(none.settings.mean_density, 0.01);
    }
}
