//! Rules of a container's metadata: values are in range and consistent. See `formats/mipvog.md`,
//! sections 4 to 6. [`super::generated`] has the ranges of single values.

use super::generated::ranges;
use super::held::Rules;
use crate::base::error::{Error, Place, Result};
use crate::base::finding::{Code, Report, strict};
use crate::base::limits::{self, LimitName, Limits};
use crate::model::baked::{
    Blend, Decode, DensityDomain, Encoding, Group, LevelMetadata, Metadata, NumberType,
    ViewMetadata,
};
use crate::model::directional::{DIRECTIONAL as DIRECTIONAL_VALUES, MOST_CHANNELS};
use crate::model::grid::{Bounds, Nodes};
use crate::model::scene::{ColorDomain, DensityFunction};

/// Allowed ratio of a shell's node spacing to that of the next smaller box.
pub const SPACING_RATIOS: std::ops::RangeInclusive<f64> = 1.5..=3.0;

/// Maximum number of nodes along a block's edge.
pub const LARGEST_BLOCK: usize = 64;

/// Checks that the metadata's values are in range and consistent. Returns `false` if levels cannot
/// be read with these values.
pub fn metadata(
    metadata: &Metadata,
    limits: &Limits,
    place: &Place,
    report: &mut Report,
) -> Result<bool> {
    let mut rules = Rules { sound: true, report };
    ranges(metadata, &mut rules)?;
    let channels = (metadata.features as u64).saturating_add(3);
    rules.hold("features", |place| {
        let what = "channels of colours and features";
        limits::check(LimitName::Channels, what, channels, limits.channels, place)
    })?;
    if let Some(ViewMetadata::Harmonics(harmonics)) = &metadata.view {
        rules.hold("view", |place| harmonics.rules.check(metadata.features, place))?;
    }
    for part in 0..metadata.parts().count() {
        level(metadata, part, limits, &mut rules)?;
    }
    shells(metadata, &mut rules)?;
    scene(metadata, place, &mut rules)?;
    if let Some(finest) = metadata.levels.first().filter(|_| rules.sound) {
        let (nodes, outer) = (Nodes(finest.dimensions), metadata.outer_bounds());
        rules.report(
            Code::RaySamples,
            metadata.march.check_nested(nodes, &metadata.bounds, &outer),
        )?;
    }
    // Mixing optical depths requires every level to have its own.
    let own = metadata.parts().all(|level| level.density.is_some());
    let mixed = metadata.blend == Blend::BeforeActivation || own;
    rules.require(
        mixed,
        "blend",
        "after_activation",
        "before_activation where a level has no density",
    )?;
    let first = metadata.levels.first().is_none_or(|level| level.density.is_some());
    rules.require(first, "levels[0].density", "null", "an encoding")?;
    Ok(rules.sound)
}

/// Rules that involve several values, except those of levels.
fn scene(metadata: &Metadata, place: &Place, rules: &mut Rules) -> Result<()> {
    let (march, activation) = (&metadata.march, &metadata.activation);
    let boxed = metadata.bounds.check(place);
    let found = boxed.err().map(|error| error.to_string()).unwrap_or_default();
    rules.require(found.is_empty(), "bounds", found, "finite corners, min below max")?;
    let relu = activation.function == DensityFunction::Relu;
    let shift = activation.shift;
    rules.require(!relu || shift == 0.0, "activation.shift", shift, "0 beside relu")?;
    let found = format!("{:?}", march.sampled);
    let outer = if rules.sound { metadata.outer_bounds() } else { metadata.bounds };
    let within = march.samples_within(&outer);
    rules.require(within, "march.sampled", found, "a box within that of the coarsest level")?;
    let far = march.far.unwrap_or(f32::INFINITY);
    rules.require(far > march.near, "march.far", far, "a number above near, or null")?;
    let lod = &metadata.level_of_detail;
    let bound = lod.bound.unwrap_or(0.0);
    let bends = lod.bends.as_slice();
    let found = format!("factor {}, bias {}, bound {bound}, bends {bends:?}", lod.factor, lod.bias);
    let expected = "a finite bias and bound, and slopes above 0";
    rules.require(lod.is_valid(), "level_of_detail", found, expected)
}

/// Rules of shells: their boxes are nested.
fn shells(metadata: &Metadata, rules: &mut Rules) -> Result<()> {
    let count = metadata.shells.len();
    if count == 0 {
        return Ok(());
    }
    let found = format!("{count} beside {} levels", metadata.levels.len());
    rules.require(count < metadata.levels.len(), "shells", found, "fewer than levels")?;
    let expected = "after_activation with shells";
    let mixed = metadata.blend == Blend::AfterActivation;
    rules.require(mixed, "blend", "before_activation", expected)?;
    let Some(finest) = metadata.levels.first().filter(|_| rules.sound) else { return Ok(()) };
    let mut smaller = (metadata.bounds, Nodes(finest.dimensions));
    for (number, shell) in metadata.shells.iter().enumerate() {
        let Some(bounds) = shell.bounds else { continue };
        let larger = (bounds, Nodes(shell.dimensions));
        let found = format!("{:?} to {:?}", bounds.min, bounds.max);
        let expected = format!(
            "a larger box around {:?} to {:?}, with nodes 1.5 to 3 times as far apart",
            smaller.0.min, smaller.0.max
        );
        let place = Place::Key(format!("shells[{number}].bounds"));
        let fits = bounds.check(&place).is_ok() && is_around(larger, smaller);
        let nested = if fits { Ok(()) } else { Err(Error::malformed(place, found, expected)) };
        rules.report(Code::NestedBoxes, nested)?;
        smaller = larger;
    }
    Ok(())
}

/// True if a box contains the `smaller` one and has about twice its node spacing.
pub fn is_around((bounds, nodes): (Bounds, Nodes), (smaller, finer): (Bounds, Nodes)) -> bool {
    let holds = bounds.min.iter().zip(smaller.min).all(|(&low, inner)| low <= inner)
        && bounds.max.iter().zip(smaller.max).all(|(&high, inner)| high >= inner);
    let spacings = nodes.spacing(&bounds).into_iter().zip(finer.spacing(&smaller));
    let mut ratios = spacings.map(|(own, finer)| own / finer);
    bounds != smaller && holds && ratios.all(|ratio| SPACING_RATIOS.contains(&ratio))
}

/// Rules of one level or shell.
fn level(metadata: &Metadata, part: usize, limits: &Limits, rules: &mut Rules) -> Result<()> {
    let Some(level) = metadata.part(part) else { return Ok(()) };
    let number = metadata.level_of_part(part);
    let is_shell = part >= metadata.levels.len();
    let key = |name: &str| match is_shell {
        true => format!("shells[{}].{name}", number - 1),
        false => format!("levels[{number}].{name}"),
    };
    let sizes = level.dimensions;
    // A shell may have any size; rules of boxes apply.
    let finer = match (is_shell, number.checked_sub(1)) {
        (false, Some(finer)) => {
            let shell = metadata.shell_of(finer).and_then(|shell| metadata.part(shell));
            shell.or(metadata.levels.get(finer)).map(|level| level.dimensions)
        }
        _ => None,
    };
    let found = format!("{:?}", level.bounds);
    rules.require(level.bounds.is_some() == is_shell, &key("bounds"), found, "those of shells")?;
    let sized = |place: &Place| {
        Nodes::checked(sizes.map(|size| size as u64), limits, place)?;
        match finer {
            Some(finer) if sizes.iter().zip(finer).any(|(&size, finer)| size > finer) => {
                let expected = format!("at most the finer level's {finer:?}");
                Err(Error::malformed(place.clone(), format!("{sizes:?}"), expected))
            }
            _ => Ok(()),
        }
    };
    let sizes_fit = sized(&Place::File).is_ok();
    rules.hold(&key("dimensions"), sized)?;
    let block = (1..=LARGEST_BLOCK).contains(&level.block_size);
    rules.require(block, &key("block_size"), level.block_size, "1 to 64")?;
    let (stored, inherited) = (level.blocks_stored, level.blocks_filled);
    let fits = block && sizes_fit && stored <= level.grid().total();
    rules.require(fits, &key("blocks_stored"), stored, "at most all blocks")?;
    let coarser = metadata.coarser(part);
    let inherits = coarser.is_some_and(LevelMetadata::has_integer_colors)
        && metadata.shares_box_with_coarser(part)
        && level.has_integer_colors()
        && inherited <= stored;
    rules.require(
        inherited == 0 || inherits,
        &key("blocks_filled"),
        inherited,
        "at most the stored blocks, of a level with a coarser one of the same box, both with colours in \
         integers",
    )?;
    rules.require(level.diffuse.is_some(), &key("diffuse"), "null", "an encoding")?;
    let layout = metadata.layout();
    let has_features = level.features.is_some() == (layout.features > 0);
    let found = if level.features.is_some() { "an encoding" } else { "null" };
    rules.require(has_features, &key("features"), found, "an encoding where there are features")?;
    let found = format!("{} encodings", level.bands.len());
    let expected = "one for each band of harmonics";
    rules.require(level.bands.len() == layout.degree, &key("bands"), found, expected)?;
    // Inherited values come from the next coarser level.
    let coarser_too = coarser.is_none_or(|coarser| coarser.directional.is_some());
    let fits = metadata.features + 3 + DIRECTIONAL_VALUES <= MOST_CHANNELS;
    rules.require(
        level.directional.is_none() || (coarser_too && fits),
        &key("directional"),
        "an encoding",
        "none where the next coarser level has none, or beside more than 58 features",
    )?;
    let is_root = level.density_domain() == DensityDomain::SqrtOpticalDepth;
    rules.require(
        level.anisotropy.as_ref().is_none_or(|encoding| is_root && encoding.empty == 0.0),
        &key("anisotropy"),
        "an encoding",
        "one whose empty value is 0, beside densities that decode as sqrt_optical_depth, or none",
    )?;
    let linear = metadata.color_domain() == ColorDomain::Linear;
    for group in Group::ALL {
        let Some(encoding) = level.encoding(group) else { continue };
        let sound =
            encoding_is_sound(encoding) && decodes(metadata, linear, group, encoding.decode);
        let found = format!("{:?} with {} bits", encoding.decode, encoding.bits);
        let expected = "a meaning of the group, a type with as many bits, a finite range";
        rules.require(sound, &key(group.name()), found, expected)?;
    }
    Ok(())
}

/// [`metadata`] for strict readers: the first violation is the error.
pub fn check_metadata(sound: &Metadata, limits: &Limits, place: &Place) -> Result<()> {
    metadata(sound, limits, place, &mut strict).map(|_| ())
}

/// True if the values of a group can be decoded this way. Levels that are blended before activation
/// must be decoded the same way.
fn decodes(metadata: &Metadata, linear: bool, group: Group, decode: Decode) -> bool {
    let harmonics = metadata.view.as_ref().and_then(ViewMetadata::harmonics);
    match (group, harmonics, metadata.blend) {
        (Group::Density, _, Blend::BeforeActivation) => {
            decode == Decode::Density(DensityDomain::Raw)
        }
        (Group::Density, _, Blend::AfterActivation) => decode.density().is_some(),
        (Group::Diffuse, Some(_), _) => decode == Decode::Coefficient(0),
        (Group::Band(band), _, _) => {
            matches!(decode, Decode::Coefficient(of) if usize::from(of) == band)
        }
        // Mixed levels must have the same meaning.
        (Group::Diffuse | Group::Features, _, _) if linear && metadata.view.is_none() => {
            decode == Decode::Linear
        }
        (Group::Diffuse | Group::Features, _, _) => decode == Decode::Logit,
        // It is added to the logits of a level.
        (Group::Directional, None, Blend::AfterActivation) if !linear => {
            decode == Decode::Directional
        }
        (Group::Directional, _, _) => false,
        (Group::Anisotropy, ..) => decode == Decode::Anisotropy,
    }
}

fn encoding_is_sound(encoding: &Encoding) -> bool {
    let bits = match encoding.number {
        NumberType::U8 => 1..=8,
        NumberType::U16 => 9..=16,
        NumberType::F16 => 16..=16,
        NumberType::F32 => 32..=32,
    };
    let range = if encoding.number.is_float() {
        let [center, step, curve] = [encoding.center, encoding.step, encoding.curve];
        center == 0.0 && step == 0.0 && curve == 0.0 && !encoding.empty_code
    } else {
        // The bits were checked first: there are at most 2^16 codes.
        bits.contains(&encoding.bits)
            && encoding.values().all(f32::is_finite)
            && encoding.values().is_sorted_by(|low, high| low < high)
    };
    let rest = encoding.empty.is_finite() && encoding.max_error >= 0.0;
    bits.contains(&encoding.bits) && range && rest && encoding.max_error.is_finite()
}
