//! Prefixes that model wrappers add to the names of weights, and dictionaries in which some
//! programs save weights.
//!
//! | wrapper | before the names |
//! |---|---|
//! | PyTorch's `DataParallel`, `DistributedDataParallel`, `AveragedModel` | `module.` |
//! | `torch.compile` | `_orig_mod.` |
//! | nerfstudio on several devices | `_model.module.`, `module._model.` |

use std::borrow::Cow;
use std::collections::BTreeSet;

use super::names::STATE;
use crate::tensor::{TensorFile, Value};

/// Prefixes from wrappers.
const WRAPPERS: [&str; 2] = ["module.", "_orig_mod."];
/// Prefixes from saving code; a wrapper's prefix may follow any of these.
const HEADS: [&str; 7] = [
    "",
    "model_state_dict.",
    "state_dict.",
    "model.",
    "network_state_dict.",
    "_model.",
    "pipeline._model.",
];
/// Dictionaries that are used as [`STATE`] if they hold a density.
const OUTER: [&str; 3] = ["state_dict", "model", "network_state_dict"];
/// Names of densities.
const DENSITIES: [&str; 3] = ["density.grid", "density", "density.xy_plane"];

/// The file with the model's own names, for all readers of checkpoints.
pub fn unwrapped(file: &TensorFile) -> Cow<'_, TensorFile> {
    let Value::Dict(entries) = &file.root else { return Cow::Borrowed(file) };
    let mut current = Cow::Borrowed(entries.as_slice());
    // Weights in dictionaries of the file, then weights of the file itself.
    let inner: Vec<_> = entries.iter().map(|(_, value)| renamed(value.entries())).collect();
    if inner.iter().any(Option::is_some) {
        let values = entries.iter().zip(inner).map(|((key, value), inner)| {
            (key.clone(), inner.map_or_else(|| value.clone(), Value::Dict))
        });
        current = Cow::Owned(values.collect());
    }
    for change in [renamed, with_state] {
        if let Some(changed) = change(&current) {
            current = Cow::Owned(changed);
        }
    }
    match current {
        Cow::Borrowed(_) => Cow::Borrowed(file),
        Cow::Owned(entries) => {
            Cow::Owned(TensorFile { root: Value::Dict(entries), ..file.clone() })
        }
    }
}

/// The entries without wrapper prefixes; none if there are no prefixes.
fn renamed(entries: &[(String, Value)]) -> Option<Vec<(String, Value)>> {
    let mut names: Vec<Cow<'_, str>> = entries.iter().map(|(name, _)| name.into()).collect();
    let mut is_changed = false;
    while let Some((head, prefix)) = shared_prefix(&names) {
        for name in &mut names {
            if let Some(rest) = name.strip_prefix(&prefix) {
                *name = format!("{head}{rest}").into();
            }
        }
        is_changed = true;
    }
    let names = names.into_iter().map(Cow::into_owned);
    is_changed.then(|| names.zip(entries).map(|(name, (_, value))| (name, value.clone())).collect())
}

/// A saver's prefix, and the same followed by a wrapper's prefix that names start with. If
/// stripping it would create a duplicate name, it is not a wrapper's.
fn shared_prefix(names: &[Cow<'_, str>]) -> Option<(&'static str, String)> {
    let known: BTreeSet<&str> = names.iter().map(AsRef::as_ref).collect();
    HEADS.iter().find_map(|head| {
        let prefixes = WRAPPERS.iter().map(|wrapper| format!("{head}{wrapper}"));
        let mut fitting = prefixes.filter(|prefix| {
            let mut rests =
                names.iter().filter_map(|name| name.strip_prefix(prefix.as_str())).peekable();
            rests.peek().is_some()
                && rests.all(|rest| {
                    !rest.is_empty() && !known.contains(format!("{head}{rest}").as_str())
                })
        });
        fitting.next().map(|prefix| (*head, prefix))
    })
}

/// The entries with weights moved from another key to [`STATE`]; none if they are there already.
fn with_state(entries: &[(String, Value)]) -> Option<Vec<(String, Value)>> {
    let flat = format!("{STATE}.");
    if entries.iter().any(|(name, _)| name == STATE || name.starts_with(&flat)) {
        return None;
    }
    let holds_density = |value: &Value| DENSITIES.iter().any(|name| value.get(name).is_some());
    let nested = OUTER
        .iter()
        .find(|outer| entries.iter().any(|(name, value)| name == *outer && holds_density(value)));
    if let Some(outer) = nested {
        let key = |name: &String| if name == outer { STATE.to_owned() } else { name.clone() };
        return Some(entries.iter().map(|(name, value)| (key(name), value.clone())).collect());
    }
    let outer = OUTER.iter().find(|outer| {
        let is_density = |name: &str| {
            let rest = name.strip_prefix(*outer).and_then(|rest| rest.strip_prefix('.'));
            rest.is_some_and(|rest| DENSITIES.contains(&rest))
        };
        entries.iter().any(|(name, _)| is_density(name))
    })?;
    let key = |name: &String| match name.strip_prefix(outer) {
        Some(rest) if rest.starts_with('.') => format!("{STATE}{rest}"),
        _ => name.clone(),
    };
    Some(entries.iter().map(|(name, value)| (key(name), value.clone())).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(names: &[&str]) -> Vec<(String, Value)> {
        names.iter().map(|name| ((*name).to_owned(), Value::None)).collect()
    }

    fn names(entries: &[(String, Value)]) -> Vec<&str> {
        entries.iter().map(|(name, _)| name.as_str()).collect()
    }

    #[test]
    fn prefixes_of_wrappers_go_wherever_they_stand() {
        for (before, after) in [
            (&["module.density.grid", "module.k0.grid"][..], &["density.grid", "k0.grid"][..]),
            (&["_orig_mod.module.density"], &["density"]),
            (&["module._orig_mod.density"], &["density"]),
            (&["n_averaged", "module.density"], &["n_averaged", "density"]),
            (&["_model.module.field.a", "datamanager.b"], &["_model.field.a", "datamanager.b"]),
            (&["module._model.field.a", "module.b"], &["_model.field.a", "b"]),
            (&["_model._orig_mod.field.a"], &["_model.field.a"]),
            (
                &["model_state_dict.module.density", "xyz_min"],
                &["model_state_dict.density", "xyz_min"],
            ),
            (&["model.module.encoder.offsets"], &["model.encoder.offsets"]),
        ] {
            let found = renamed(&plain(before)).expect("a wrapper");
            assert_eq!(names(&found), after);
        }
        // Names that would become duplicates stay.
        for own in [&["module.density", "density"][..], &["density.module"], &["module."], &[]] {
            assert!(renamed(&plain(own)).is_none(), "{own:?}");
        }
    }

    #[test]
    fn weights_are_found_under_the_keys_of_other_programs() {
        let dict = |names: &[&str]| Value::Dict(plain(names));
        for outer in OUTER {
            let entries = vec![
                ("epoch".to_owned(), Value::Int(1)),
                (outer.to_owned(), dict(&["density.grid", "k0.grid"])),
            ];
            assert_eq!(names(&with_state(&entries).expect("weights")), ["epoch", STATE]);
            let flat =
                [format!("{outer}.density.grid"), format!("{outer}.k0.grid"), "epoch".into()];
            let flat: Vec<(String, Value)> =
                flat.into_iter().map(|name| (name, Value::None)).collect();
            let found = with_state(&flat).expect("weights");
            assert_eq!(
                names(&found),
                ["model_state_dict.density.grid", "model_state_dict.k0.grid", "epoch"]
            );
        }
        let others = vec![("state_dict".to_owned(), dict(&["density_plane.0"]))];
        assert!(with_state(&others).is_none());
        let both =
            vec![(STATE.to_owned(), dict(&["density"])), ("model".to_owned(), dict(&["density"]))];
        assert!(with_state(&both).is_none());
    }
}
