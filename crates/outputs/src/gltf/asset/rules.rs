//! Rules of an asset with radiance fields: `formats/MIPVOG_radiance_field/README.md`.

use serde_json::Value;

use super::document::{Asset, EXTENSION};
use super::fields::{Fields, container_bytes, one_of};
use super::json::{Members, Node};
use super::properties::{MIME_TYPE, RadianceField};
use crate::base::bytes::{hex, sha256};
use crate::base::error::{Error, ErrorKind, Place, Result};
use crate::base::finding::{Code, Finding, Report, checked, strict};
use crate::container::Container;

/// Checks that the extension is listed as used and never as required, and that nodes and fields
/// match.
pub fn document(asset: &Asset, root: &Members, fields: &Fields, report: &mut Report) -> Result<()> {
    let lists = |name: &str| -> Result<Option<String>> {
        let names = asset.list(root, name)?;
        let own = |value: &&Node| value.parse::<String>("a name").is_ok_and(|n| n == EXTENSION);
        Ok(names.iter().find(own).map(|value| value.pointer().to_owned()))
    };
    let any = !fields.objects.is_empty() || !fields.users.is_empty();
    if any && lists("extensionsUsed")?.is_none() {
        let place = Place::Pointer("/extensionsUsed".to_owned());
        let error = Error::malformed(place, "other names", format!("{EXTENSION} among them"));
        report(Finding { code: Code::ExtensionUsed, error })?;
    }
    if let Some(pointer) = lists("extensionsRequired")? {
        let expected = "other names: every viewer can show the fallback";
        let error = Error::malformed(Place::Pointer(pointer), EXTENSION, expected);
        report(Finding { code: Code::ExtensionRequired, error })?;
    }
    for user in &fields.users {
        if user.field >= fields.objects.len() {
            let found = format!("field {}", user.field);
            let expected = one_of(fields.objects.len());
            let error = Error::malformed(user.value.place(), found, expected);
            report(Finding { code: Code::FieldNode, error })?;
        }
        if user.object.get("mesh")?.is_none() {
            let expected = "one for viewers without the extension";
            let error = Error::malformed(user.object.place(), "no mesh", expected);
            report(Finding { code: Code::FieldFallback, error })?;
        }
    }
    for (number, object) in fields.objects.iter().enumerate() {
        if !fields.users.iter().any(|user| user.field == number) {
            let error =
                Error::malformed(object.place(), "a field that no node refers to", "a node");
            report(Finding { code: Code::FieldUnused, error })?;
        }
    }
    Ok(())
}

/// Checks one field: its properties, the place of its container, the container's structure and
/// metadata, and their consistency. Returns the container and its offset in the containing file;
/// `None` if reading cannot continue. Strict errors of the container name that file.
pub fn field(
    asset: &Asset,
    root: &Members,
    object: &Node,
    report: &mut Report,
) -> Result<Option<(Container, u64)>> {
    let field = object.parse::<RadianceField>("the properties of a radiance field");
    let Some(field) = checked(field, Code::FieldProperty, report)? else { return Ok(None) };
    if field.mime_type != MIME_TYPE {
        let place = Place::Pointer(format!("{}/mimeType", object.pointer()));
        let error = Error::malformed(place, format!("{:?}", field.mime_type), MIME_TYPE);
        report(Finding { code: Code::FieldProperty, error })?;
    }
    let container_bytes = match container_bytes(asset, root, &field, object) {
        Ok(container_bytes) => container_bytes,
        Err(error) => {
            let absent = matches!(error.kind(), ErrorKind::Io(_));
            let code = if absent { Code::FieldMissing } else { Code::FieldSource };
            report(Finding { code, error })?;
            return Ok(None);
        }
    };
    plain_view(asset, root, &field, report)?;
    let offset = container_bytes.offset;
    let path = container_bytes.file.path().to_owned();
    let container = within(object, offset, report, |report| {
        Container::walk(container_bytes.file, asset.limits(), report)
    });
    let container = container.map_err(|error| error.in_file(&path))?;
    let container = container.map(|container| container.inside(object.pointer(), offset));
    let Some(container) = container else { return Ok(None) };
    agreement(&field, object, &container, report)?;
    Ok(Some((container, offset)))
}

/// Checks that a container's buffer view holds plain bytes, not vertices or indices.
fn plain_view(
    asset: &Asset,
    root: &Members,
    field: &RadianceField,
    report: &mut Report,
) -> Result<()> {
    let Some(number) = field.buffer_view else { return Ok(()) };
    let views = asset.list(root, "bufferViews")?;
    for name in ["target", "byteStride"] {
        if let Some(value) = views.get(number).map(|view| view.get(name)).transpose()?.flatten() {
            let found = format!("a {name} of a container's buffer view");
            let error = Error::malformed(value.place(), found, "none");
            report(Finding { code: Code::FieldSource, error })?;
        }
    }
    Ok(())
}

/// Runs a check of a field's container; findings get the field's place.
pub fn within<T>(
    object: &Node,
    offset: u64,
    report: &mut Report,
    walk: impl FnOnce(&mut Report) -> Result<T>,
) -> Result<T> {
    let place = |error: Error| error.within(object.pointer(), offset);
    let mut inner = |finding: Finding| report(Finding { error: place(finding.error), ..finding });
    walk(&mut inner)
}

/// Checks that properties match the container.
fn agreement(
    field: &RadianceField,
    object: &Node,
    container: &Container,
    report: &mut Report,
) -> Result<()> {
    let expected = RadianceField {
        uri: field.uri.clone(),
        buffer_view: field.buffer_view,
        mime_type: field.mime_type.clone(),
        sha256: field.sha256.clone(),
        ..RadianceField::of_container(container)?
    };
    let (found, expected) = (as_map(field)?, as_map(&expected)?);
    let names = found.keys().chain(expected.keys().filter(|name| !found.contains_key(*name)));
    for name in names {
        let (found, expected) = (found.get(name), expected.get(name));
        if found != expected {
            let shown =
                |value: Option<&Value>| value.map_or("nothing".to_owned(), Value::to_string);
            let place = Place::Pointer(format!("{}/{name}", object.pointer()));
            let expected = format!("{}, as the container says", shown(expected));
            let error = Error::malformed(place, shown(found), expected);
            report(Finding { code: Code::FieldMetadata, error })?;
        }
    }
    Ok(())
}

fn as_map(field: &RadianceField) -> Result<serde_json::Map<String, Value>> {
    match serde_json::to_value(field) {
        Ok(Value::Object(map)) => Ok(map),
        _ => Err(Error::malformed(Place::File, "a number that is not finite", "finite numbers")),
    }
}

/// Checks that the digest of a field matches the container's bytes.
pub fn digest(object: &Node, container: &Container, report: &mut Report) -> Result<()> {
    let stated: String = match object.get("sha256")? {
        Some(stated) => stated.parse("a digest")?,
        None => return Ok(()),
    };
    let found = hex(&sha256(container.file())?);
    if stated == found {
        return Ok(());
    }
    let place = Place::Pointer(format!("{}/sha256", object.pointer()));
    let error = Error::malformed(place, stated, format!("{found}, that of the container's bytes"));
    report(Finding { code: Code::FieldHash, error })
}

impl Asset {
    /// Opens the container of a field.
    ///
    /// # Errors
    /// The first fault of the field, its container, or their consistency; the digest is left to the
    /// validator.
    pub fn open_field(&self, number: usize) -> Result<Container> {
        let opened = self.try_open_field(number).map_err(|error| error.in_file(self.path()))?;
        // A strict walk ends with an error or a container.
        opened.ok_or_else(|| Error::malformed(Place::File, "no container", "one"))
    }

    fn try_open_field(&self, number: usize) -> Result<Option<Container>> {
        let root = self.document()?.members()?;
        let fields = Fields::read(self, &root)?;
        match fields.objects.get(number) {
            Some(object) => {
                let opened = field(self, &root, object, &mut strict)?;
                Ok(opened.map(|(container, _)| container))
            }
            None if fields.objects.is_empty() => {
                let place = Place::Pointer(format!("/extensions/{EXTENSION}"));
                Err(Error::malformed(place, "an asset without radiance fields", "one or more"))
            }
            None => {
                let expected = format!("one of {} fields from 0", fields.objects.len());
                Err(Error::invalid_option("field", number.to_string(), expected))
            }
        }
    }
}
