//! A container, unpacked or not, baked again.

use super::super::common::Common;
use super::super::progress::Bar;
use super::super::values::Background;
use super::super::view_report::ViewReport;
use super::arguments::Arguments;
use super::merge::with_others;
use super::report::Baked;
use crate::bake::{BakeOptions, Changes, Origin, bake, repack};
use crate::base::bytes::Output;
use crate::base::error::{Error, Place, Result};
use crate::model::field::Nonfinite;
use crate::unpacked::Unpacked;
use mipvog_inputs::MlpChoice;

/// Repacks a container's levels; bakes level 0 anew if an option requires it.
pub fn bake_again(
    arguments: &Arguments,
    (unpacked, input_bytes): (&Unpacked, u64),
    options: &BakeOptions,
    output: &mut Output,
    bar: &Bar,
    common: &Common,
) -> Result<Baked> {
    let stored = &arguments.stored;
    let metadata = &unpacked.metadata;
    let asked = |given: bool| given || arguments.preset.is_some();
    let states_errors = stored.has("max-error") || stored.has("quality");
    let changes = Changes {
        bits: asked(stored.has("bits")).then_some(options.bits),
        max_error: options.max_error.filter(|_| asked(states_errors)),
        max_bytes: options.max_bytes,
        zstd_level: asked(stored.has("zstd-level")).then_some(options.zstd_level),
        levels: options.levels.filter(|_| stored.has("levels")),
        lod_rule: options.lod_rule.filter(|_| stored.has("lod-rule")),
        lod_scale: stored.has("lod-scale").then_some(options.lod_scale),
        near: arguments.scene.near,
        far: arguments.scene.far,
        background: arguments.scene.background.map(|Background(color)| color),
        color_threshold: arguments.scene.color_threshold,
        ..Changes::default()
    };
    // A setting that the container already has is not a change.
    let anew = !arguments.merge.is_empty()
        || (asked(stored.has("filter")) && options.filter.name() != metadata.filter)
        || (asked(stored.has("alpha-threshold"))
            && options.alpha_threshold != metadata.alpha_threshold)
        || (asked(stored.has("block-size"))
            && metadata.levels.iter().any(|level| level.block_size != options.block_size));
    refuse_ignored(arguments, options, anew)?;
    changes.check(&metadata.march)?;
    let mut inputs = vec![arguments.input.clone()];
    let view = ViewReport::of(metadata.view.as_ref());
    if anew {
        options.check()?;
        let mut field = unpacked.field(&options.limits)?.ok_or_else(|| {
            Error::malformed(Place::File, "no densities of level 0", "some, to filter again")
        })?;
        changes.apply_to_scene(&mut field.scene);
        let mut origin = Origin::of_unpacked(unpacked);
        if let Some(merged) = with_others(&field, arguments, options, common)? {
            field = merged.field;
            for file in merged.files {
                origin.side_files.push((file.role, file.digest));
                inputs.push(file.path);
            }
            inputs.extend(merged.settings);
        }
        let report = bake(&field, options, &origin, output, bar)?;
        let resolved = options.to_json();
        return Ok(Baked {
            report,
            resolved,
            settings: Vec::new(),
            view,
            gate: None,
            inputs,
            unmeasured: None,
            input_bytes,
        });
    }
    let report = repack(unpacked, &changes, &options.limits, output, bar)?;
    let resolved = changes.to_json();
    let (settings, gate, unmeasured) = (Vec::new(), None, None);
    Ok(Baked { report, resolved, settings, view, gate, inputs, unmeasured, input_bytes })
}

/// Refuses options that repacking a container, or baking its finest level `anew`, would ignore.
fn refuse_ignored(arguments: &Arguments, options: &BakeOptions, anew: bool) -> Result<()> {
    let (scene, stored) = (&arguments.scene, &arguments.stored);
    let ignored = [
        ("--stepsize", scene.stepsize.is_some()),
        ("--coarse", scene.coarse.is_some()),
        ("--mlp", scene.mlp != MlpChoice::Auto),
        ("--scene-scale, --view or another option of models", scene.reads_a_model()),
        ("--cameras or --turntable", arguments.gate.measures()?),
        ("--memory", stored.has("memory")),
        ("--require-view-psnr", arguments.gate.required_view_psnr().is_some()),
        ("--fill-error", stored.has("fill-error") && !anew),
        ("--nonfinite empty", options.nonfinite == Nonfinite::Empty && !anew),
        (
            "--fit-steps, --fit-seconds, --fit-cameras or --photographs",
            arguments.fit.given() && !anew,
        ),
    ];
    match ignored.iter().find(|(_, given)| *given) {
        None => Ok(()),
        Some((option, _)) => Err(Error::usage(format!(
            "{option} has no effect on a container: it belongs to a trained input"
        ))),
    }
}
