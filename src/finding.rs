//! What validation finds: a stable code, how bad it is, and the error with its place.
//!
//! Rules report [`Finding`]s to whoever asked. A strict reader turns the first one into its error;
//! the validator collects them all. Either way there is one copy of each rule.

use crate::error::{Error, Result};

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The file must not be used.
    Error,
    /// The file works, but something is off.
    Warning,
}

macro_rules! codes {
    ($($(#[doc = $meaning:literal])+ $variant:ident = $name:literal, $severity:ident;)+) => {
        /// What kind of thing was found. Names are stable and never reused.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[non_exhaustive]
        pub enum Code {
            $($(#[doc = $meaning])+ $variant,)+
        }

        impl Code {
            /// Every code.
            pub const ALL: &'static [Self] = &[$(Self::$variant),+];

            /// Its stable name.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),+ }
            }

            /// How bad it is.
            pub const fn severity(self) -> Severity {
                match self { $(Self::$variant => Severity::$severity),+ }
            }

            /// What it means, in a sentence.
            pub const fn meaning(self) -> &'static str {
                match self { $(Self::$variant => concat!($($meaning),+)),+ }
            }
        }
    };
}

codes! {
    /// The file cannot be read, or is of no kind that can be checked.
    File = "file", Error;
    /// Signature, version or reserved bytes of the header are wrong, or the header is cut short.
    Header = "header", Error;
    /// The file needs a feature that this build does not know.
    Feature = "feature", Error;
    /// The file's length is not what its header says: it was cut short or something was appended.
    Length = "length", Error;
    /// The directory cannot be read, or its checksum does not match.
    Directory = "directory", Error;
    /// A chunk does not start where the one before it ended, or ends outside the file.
    ChunkBounds = "chunk-bounds", Error;
    /// A critical chunk that this build does not know.
    ChunkUnknown = "chunk-unknown", Error;
    /// A chunk that is there twice, out of order, or not announced by the metadata.
    ChunkUnexpected = "chunk-unexpected", Error;
    /// A chunk that must be there is not.
    ChunkMissing = "chunk-missing", Error;
    /// A chunk's bytes do not match its checksum.
    ChunkChecksum = "chunk-checksum", Error;
    /// The bytes between two chunks are not zero.
    Padding = "padding", Error;
    /// The directory states a prefix after which the level does not render.
    Prefix = "prefix", Error;
    /// Metadata is not canonical JSON, lacks a key, or has an unknown one.
    Metadata = "metadata", Error;
    /// A value of the metadata is out of range or contradicts another one.
    MetadataValue = "metadata-value", Error;
    /// The view network's layers do not fit each other, the metadata or their chunk.
    Network = "network", Error;
    /// The free-space mask is not what its chunk's header says.
    FreeSpace = "free-space", Error;
    /// Provenance is not canonical JSON.
    Provenance = "provenance", Error;
    /// A level's table of blocks does not decode, or does not fit the metadata.
    Table = "table", Error;
    /// An atlas does not decode, or does not fit the metadata.
    Atlas = "atlas", Error;
    /// The chunks of a GLB, the JSON of a glTF document, or its version cannot be read.
    Asset = "asset", Error;
    /// Something breaks a rule of glTF 2.0; Khronos' validator says more.
    AssetRule = "asset-rule", Warning;
    /// There are radiance fields, but extensionsUsed does not name their extension.
    ExtensionUsed = "extension-used", Error;
    /// The extension is in extensionsRequired, so that viewers refuse a file that they could show.
    ExtensionRequired = "extension-required", Error;
    /// A radiance field lacks a property, or one is of the wrong type or has an unknown value.
    FieldProperty = "field-property", Error;
    /// A radiance field names no container, two, bytes that are not there, or those of vertices or indices.
    FieldSource = "field-source", Error;
    /// The file that a radiance field names cannot be read.
    FieldMissing = "field-missing", Error;
    /// A property of a radiance field is not what its container says.
    FieldMetadata = "field-metadata", Error;
    /// The digest of a radiance field is not that of its container.
    FieldHash = "field-hash", Error;
    /// A node names a radiance field that is not there.
    FieldNode = "field-node", Error;
    /// No node names a radiance field, so that nothing shows it.
    FieldUnused = "field-unused", Warning;
    /// A node with a radiance field has no mesh, so that other viewers show nothing.
    FieldFallback = "field-fallback", Warning;
}

/// One thing that validation found.
#[derive(Debug)]
pub struct Finding {
    /// What kind of thing.
    pub code: Code,
    /// What exactly, and where.
    pub error: Error,
}

/// Gets findings as they are made; an error stops the walk.
pub type Report<'a> = dyn FnMut(Finding) -> Result<()> + 'a;

/// The report of a strict reader: the first finding is its error.
pub fn strict(finding: Finding) -> Result<()> {
    Err(finding.error)
}

/// Reports an error under a code and goes on with `None`, or hands the value through.
pub fn checked<T>(result: Result<T>, code: Code, report: &mut Report) -> Result<Option<T>> {
    match result {
        Ok(value) => Ok(Some(value)),
        Err(error) => {
            report(Finding { code, error })?;
            Ok(None)
        }
    }
}
