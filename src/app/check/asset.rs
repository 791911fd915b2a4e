//! Findings of a glTF asset that general validators of glTF cannot make: those of its radiance
//! fields and of the containers behind them.

use std::sync::Arc;

use gltf::json::mesh::Semantic;
use gltf::json::validation::{Checked, Error as RuleError, Validate};
use gltf::json::{Index, Root};

use crate::base::bytes::SourceFile;
use crate::base::error::{Error, Place, Result};
use crate::base::finding::{Code, Finding, Report, checked};
use crate::base::limits::Limits;
use crate::output::gltf::asset::{Asset, Fields, rules};

/// Reports everything that is wrong with an asset.
pub fn check(file: Arc<SourceFile>, limits: &Limits, report: &mut Report) -> Result<()> {
    let Some(asset) = checked(Asset::open(file, limits), Code::Asset, report)? else {
        return Ok(());
    };
    general_rules(&asset, report)?;
    let root = asset.document().and_then(|root| root.members());
    let Some(root) = checked(root, Code::Asset, report)? else { return Ok(()) };
    let fields = Fields::read(&asset, &root);
    let Some(fields) = checked(fields, Code::Asset, report)? else { return Ok(()) };
    // An unreadable rule is a fault of the document.
    checked(rules::document(&asset, &root, &fields, report), Code::Asset, report)?;
    for object in &fields.objects {
        let opened = checked(rules::field(&asset, &root, object, report), Code::Asset, report)?;
        let Some((container, offset)) = opened.flatten() else { continue };
        checked(rules::digest(object, &container, report), Code::Asset, report)?;
        rules::within(object, offset, report, |report| {
            checked(container.check_contents(report), Code::File, report).map(|_| ())
        })?;
    }
    Ok(())
}

/// Positions of vertices that lead nowhere. They are reported here and made to lead somewhere,
/// because the rules of the library look behind them unchecked.
fn positions(root: &mut Root, report: &mut Report) -> Result<()> {
    let accessors = root.accessors.len();
    let name = Checked::Valid(Semantic::Positions);
    for (i, mesh) in root.meshes.iter_mut().enumerate() {
        for (j, primitive) in mesh.primitives.iter_mut().enumerate() {
            let Some(index) = primitive.attributes.get_mut(&name) else { continue };
            if index.value() < accessors {
                continue;
            }
            let pointer = format!("/meshes/{i}/primitives/{j}/attributes/POSITION");
            let found = format!("accessor {}", index.value());
            let expected = format!("one of {accessors} from 0");
            let error = Error::malformed(Place::Pointer(pointer), found, expected);
            report(Finding { code: Code::AssetRule, error })?;
            *index = Index::new(0);
            if accessors == 0 {
                primitive.attributes.remove(&name);
            }
        }
    }
    Ok(())
}

/// Checks the rules of glTF 2.0 for every document that do not depend on extensions.
fn general_rules(asset: &Asset, report: &mut Report) -> Result<()> {
    let mut root = match Root::from_str(asset.text()) {
        Ok(root) => root,
        Err(error) => {
            let place = Place::Pointer(String::new());
            let found = format!("what does not fit the properties of glTF: {error}");
            let error = Error::malformed(place, found, "a document of glTF 2.0");
            return report(Finding { code: Code::AssetRule, error });
        }
    };
    positions(&mut root, report)?;
    let mut reported = Ok(());
    let mut add = |path: &dyn Fn() -> gltf::json::Path, rule| {
        let expected = match rule {
            // Required extensions are the business of viewers.
            RuleError::Unsupported => return,
            RuleError::IndexOutOfBounds => "a number of something that is there",
            RuleError::Missing => "a value that is not there",
            _ => "another value",
        };
        if reported.is_ok() {
            let path = path().to_string().replace(['.', '['], "/").replace(']', "");
            let place = Place::Pointer(format!("/{path}"));
            let error = Error::malformed(place, "a broken rule of glTF 2.0", expected);
            reported = report(Finding { code: Code::AssetRule, error });
        }
    };
    root.validate(&root, gltf::json::Path::new, &mut add);
    reported
}
