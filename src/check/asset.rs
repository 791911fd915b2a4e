//! Findings of a glTF asset: what general validators of glTF cannot know, its radiance fields and the
//! containers behind them.

use std::sync::Arc;

use gltf::json::Root;
use gltf::json::validation::{Error as RuleError, Validate};

use crate::asset::{Asset, Fields, rules};
use crate::bytes::SourceFile;
use crate::error::{Error, Place, Result};
use crate::finding::{Code, Finding, Report, checked};
use crate::limits::Limits;

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
    // Whatever a rule cannot read is a fault of the document.
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

/// What glTF 2.0 asks of every document, as far as it does not hang on extensions.
fn general_rules(asset: &Asset, report: &mut Report) -> Result<()> {
    let root = match Root::from_str(asset.text()) {
        Ok(root) => root,
        Err(error) => {
            let place = Place::Pointer(String::new());
            let found = format!("what does not fit the properties of glTF: {error}");
            let error = Error::malformed(place, found, "a document of glTF 2.0");
            return report(Finding { code: Code::AssetRule, error });
        }
    };
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
