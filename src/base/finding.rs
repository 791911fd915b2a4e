//! Findings of validation: a stable code, a severity, and the error with its place.
//!
//! Rules report [`Finding`]s to their caller. A strict reader turns the first one into its error;
//! the validator collects them all. Either way there is one copy of each rule.

use crate::base::error::{Error, Result};

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The file must not be used.
    Error,
    /// The file works, but something is off.
    Warning,
}

macro_rules! codes {
    ($(
        $(#[doc = $meaning:literal])+
        $variant:ident = $name:literal, $severity:ident, at $place:literal, do $remedy:literal;
    )+) => {
        /// Kinds of findings. Names are stable and never reused.
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

            /// Its severity.
            pub const fn severity(self) -> Severity {
                match self { $(Self::$variant => Severity::$severity),+ }
            }

            /// Its meaning, in a sentence.
            pub const fn meaning(self) -> &'static str {
                match self { $(Self::$variant => concat!($($meaning),+)),+ }.trim_ascii()
            }

            /// The kind of place that such a finding has.
            pub const fn place(self) -> &'static str {
                match self { $(Self::$variant => $place),+ }
            }

            /// Advice to the file's owner.
            pub const fn remedy(self) -> &'static str {
                match self { $(Self::$variant => $remedy),+ }
            }
        }
    };
}

codes! {
    /// The file cannot be read, or is of no kind that can be checked.
    File = "file", Error,
        at "the file",
        do "check the path and what the file is";
    /// Signature, version or reserved bytes of the header are wrong, or the header is cut short.
    Header = "header", Error,
        at "byte",
        do "copy the file again, or bake again";
    /// The file needs a feature that this build does not know.
    Feature = "feature", Error,
        at "byte",
        do "use a newer version of this tool";
    /// The file's length is not what its header says: it was cut short or something was appended.
    Length = "length", Error,
        at "the file, or the byte where it should end",
        do "copy the file again, or bake again";
    /// The directory cannot be read, or its checksum does not match.
    Directory = "directory", Error,
        at "byte",
        do "copy the file again, or bake again";
    /// A chunk does not start where the one before it ended, or ends outside the file.
    ChunkBounds = "chunk-bounds", Error,
        at "chunk, or the file",
        do "copy the file again, or bake again";
    /// A critical chunk that this build does not know.
    ChunkUnknown = "chunk-unknown", Error,
        at "chunk",
        do "use a newer version of this tool";
    /// A chunk that is there twice, out of order, or not announced by the metadata.
    ChunkUnexpected = "chunk-unexpected", Error,
        at "chunk",
        do "bake again; tell whoever wrote the file";
    /// A chunk that must be there is not.
    ChunkMissing = "chunk-missing", Error,
        at "chunk",
        do "bake again; tell whoever wrote the file";
    /// A chunk's bytes do not match its checksum.
    ChunkChecksum = "chunk-checksum", Error,
        at "chunk",
        do "copy the file again, or bake again";
    /// The bytes between two chunks are not zero.
    Padding = "padding", Error,
        at "byte",
        do "copy the file again, or bake again";
    /// The directory states a prefix after which the level does not render.
    Prefix = "prefix", Error,
        at "chunk",
        do "bake again; tell whoever wrote the file";
    /// Metadata is not canonical JSON, lacks a key, or has an unknown one.
    Metadata = "metadata", Error,
        at "chunk",
        do "bake again; tell whoever wrote the file";
    /// A value of the metadata is out of range or contradicts another one.
    MetadataValue = "metadata-value", Error,
        at "key of the metadata",
        do "bake again; tell whoever wrote the file";
    /// Rays may take more samples than a renderer has to be ready for: the step length is too
    /// short.
    RaySamples = "ray-samples", Error,
        at "key of the metadata",
        do "bake again with a longer step";
    /// The view network's layers do not fit each other, the metadata or their chunk.
    Network = "network", Error,
        at "chunk or byte",
        do "bake again; tell whoever wrote the file";
    /// The free-space mask is not what its chunk's header says.
    FreeSpace = "free-space", Error,
        at "chunk or byte",
        do "bake again; tell whoever wrote the file";
    /// Provenance is not canonical JSON.
    Provenance = "provenance", Error,
        at "chunk",
        do "bake again; tell whoever wrote the file";
    /// A level's table of blocks does not decode, or does not fit the metadata.
    Table = "table", Error,
        at "chunk",
        do "bake again; tell whoever wrote the file";
    /// An atlas does not decode, or does not fit the metadata.
    Atlas = "atlas", Error,
        at "chunk or byte",
        do "bake again; tell whoever wrote the file";
    /// The chunks of a GLB, the JSON of a glTF document, or its version cannot be read.
    Asset = "asset", Error,
        at "JSON pointer, byte, or the file",
        do "export the asset again";
    /// Something breaks a rule of glTF 2.0; Khronos' validator says more.
    AssetRule = "asset-rule", Warning,
        at "JSON pointer",
        do "see what Khronos' validator says, and mend the asset where it was made";
    /// There are radiance fields, but extensionsUsed does not name their extension.
    ExtensionUsed = "extension-used", Error,
        at "JSON pointer",
        do "add the extension's name to extensionsUsed";
    /// The extension is in extensionsRequired, so that viewers refuse a file that they could show.
    ExtensionRequired = "extension-required", Error,
        at "JSON pointer",
        do "take the extension's name out of extensionsRequired";
    /// A radiance field lacks a property, or one is of the wrong type or has an unknown value.
    FieldProperty = "field-property", Error,
        at "JSON pointer",
        do "detach the field and attach it again";
    /// A radiance field names no container, two, bytes that are not there, or those of vertices or
    /// indices.
    FieldSource = "field-source", Error,
        at "JSON pointer",
        do "detach the field and attach it again";
    /// The file that a radiance field names cannot be read.
    FieldMissing = "field-missing", Error,
        at "JSON pointer or byte",
        do "put the container where the URI says";
    /// A property of a radiance field is not what its container says.
    FieldMetadata = "field-metadata", Error,
        at "JSON pointer",
        do "detach the field and attach it again";
    /// The digest of a radiance field is not that of its container.
    FieldHash = "field-hash", Error,
        at "JSON pointer",
        do "put back the container that was attached, or attach this one again";
    /// A node names a radiance field that is not there.
    FieldNode = "field-node", Error,
        at "JSON pointer",
        do "name a field that is there";
    /// No node names a radiance field, so that nothing shows it.
    FieldUnused = "field-unused", Warning,
        at "JSON pointer",
        do "put the field on a node, or detach it";
    /// A node with a radiance field has no mesh, so that other viewers show nothing.
    FieldFallback = "field-fallback", Warning,
        at "JSON pointer",
        do "give the node a mesh, or attach with one";
    /// A file of tensors cannot be read: it is damaged, holds refused instructions, or asks for too
    /// much.
    Input = "input", Error,
        at "byte, tensor or zip entry",
        do "save it again with a current version of what wrote it";
    /// The tensors make no scene that can be baked.
    Scene = "scene", Error,
        at "key or tensor",
        do "retrain, or pass the option that the message names";
    /// Something that a bake needs is not in the file; a default is taken.
    Unstated = "unstated", Warning,
        at "key",
        do "pass the option that the message names";
    /// The values of a tensor do not match the checksum that the file states.
    ValuesChecksum = "values-checksum", Error,
        at "tensor",
        do "copy the file again, or save it again";
    /// Values are infinite or not a number.
    ValuesNonfinite = "values-nonfinite", Error,
        at "tensor",
        do "retrain, or bake with option nonfinite: empty";
    /// Raw values lie beyond 10,000, where no training ends that has not diverged.
    ValuesRange = "values-range", Warning,
        at "tensor",
        do "look at the scene before it is baked; retrain if it is broken";
    /// No node's opacity over one interval is above 0.001, so that nothing is left of the scene.
    SpaceEmpty = "space-empty", Warning,
        at "tensor",
        do "retrain, or check the step length and the activation's shift";
    /// Of 100 nodes not one has an opacity over one interval of at most 0.001: nothing can be
    /// pruned.
    SpaceFull = "space-full", Warning,
        at "tensor",
        do "retrain with a loss that clears empty space, or check the activation's shift";
    /// A channel of colour or features has the same value at every visible node.
    ChannelDead = "channel-dead", Warning,
        at "tensor",
        do "train with fewer features";
    /// An input of the view network has no weight other than 0 in the first layer.
    NetworkUnused = "network-unused", Warning,
        at "key",
        do "train with fewer features or octaves";
}

/// One thing that validation found.
#[derive(Debug)]
pub struct Finding {
    /// The finding's kind.
    pub code: Code,
    /// The exact fault, with its place.
    pub error: Error,
}

impl Finding {
    /// The remedy that was given to the fault itself, else that of its code.
    pub fn remedy(&self) -> &str {
        self.error.advice().unwrap_or(self.code.remedy())
    }
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
