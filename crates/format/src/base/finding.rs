//! Findings of validation: a stable code, a severity, and the error with its place.
//!
//! Rules report [`Finding`]s to their caller. A strict reader turns the first one into its error;
//! the validator collects them all. Either way there is one copy of each rule.

use crate::base::error::{Error, Result};

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "schemas", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The file must not be used.
    Error,
    /// The file can be used, but something is suspicious.
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
    /// The file cannot be read, or is not of a supported kind.
    File = "file", Error,
        at "the file",
        do "check the path and the kind of the file";
    /// The header has a wrong signature, version or reserved byte, or is truncated.
    Header = "header", Error,
        at "byte",
        do "copy the file again, or bake again";
    /// The file needs a feature that this build does not support.
    Feature = "feature", Error,
        at "byte",
        do "use a newer version of this tool";
    /// The file's length differs from its header: it was truncated, or something was appended.
    Length = "length", Error,
        at "the file, or the byte where it should end",
        do "copy the file again, or bake again";
    /// The directory cannot be read, or its checksum does not match.
    Directory = "directory", Error,
        at "byte",
        do "copy the file again, or bake again";
    /// A chunk does not start where the previous one ended, or ends outside the file.
    ChunkBounds = "chunk-bounds", Error,
        at "chunk, or the file",
        do "copy the file again, or bake again";
    /// A critical chunk is unknown to this build.
    ChunkUnknown = "chunk-unknown", Error,
        at "chunk",
        do "use a newer version of this tool";
    /// A chunk is duplicated, out of order, or not announced by the metadata.
    ChunkUnexpected = "chunk-unexpected", Error,
        at "chunk",
        do "bake again; report the bug to whoever wrote the file";
    /// A required chunk is missing.
    ChunkMissing = "chunk-missing", Error,
        at "chunk",
        do "bake again; report the bug to whoever wrote the file";
    /// A chunk's bytes do not match its checksum.
    ChunkChecksum = "chunk-checksum", Error,
        at "chunk",
        do "copy the file again, or bake again";
    /// The bytes between two chunks are not zero.
    Padding = "padding", Error,
        at "byte",
        do "copy the file again, or bake again";
    /// The directory states a prefix that is not sufficient to render the level.
    Prefix = "prefix", Error,
        at "chunk",
        do "bake again; report the bug to whoever wrote the file";
    /// The metadata is not canonical JSON, lacks a key, or has an unknown key.
    Metadata = "metadata", Error,
        at "chunk",
        do "bake again; report the bug to whoever wrote the file";
    /// A value of the metadata is out of range or contradicts another value.
    MetadataValue = "metadata-value", Error,
        at "key of the metadata",
        do "bake again; report the bug to whoever wrote the file";
    /// Rays may take more samples than renderers must support: the step length is too short.
    RaySamples = "ray-samples", Error,
        at "key of the metadata",
        do "bake again with a longer step";
    /// A box of nested ones does not lie around the next smaller one, or its nodes are not about
    /// twice as far apart.
    NestedBoxes = "nested-boxes", Error,
        at "key of the metadata",
        do "bake again; report the bug to whoever wrote the file";
    /// The view network's layers do not match each other, the metadata or their chunk.
    Network = "network", Error,
        at "chunk or byte",
        do "bake again; report the bug to whoever wrote the file";
    /// The free-space mask differs from the header of its chunk.
    FreeSpace = "free-space", Error,
        at "chunk or byte",
        do "bake again; report the bug to whoever wrote the file";
    /// The provenance is not canonical JSON.
    Provenance = "provenance", Error,
        at "chunk",
        do "bake again; report the bug to whoever wrote the file";
    /// The thumbnail is no PNG file, or larger than 1024 pixels along a side.
    Thumbnail = "thumbnail", Error,
        at "chunk",
        do "bake again with another --thumbnail; report the bug to whoever wrote the file";
    /// A level's table of blocks does not decode, or does not match the metadata.
    Table = "table", Error,
        at "chunk",
        do "bake again; report the bug to whoever wrote the file";
    /// An atlas does not decode, or does not match the metadata.
    Atlas = "atlas", Error,
        at "chunk or byte",
        do "bake again; report the bug to whoever wrote the file";
    /// The chunks of a GLB, the JSON of a glTF document, or its version cannot be read.
    Asset = "asset", Error,
        at "JSON pointer, byte, or the file",
        do "export the asset again";
    /// The asset breaks a rule of glTF 2.0; Khronos' validator gives details.
    AssetRule = "asset-rule", Warning,
        at "JSON pointer",
        do "run Khronos' validator, and fix the asset in the program that made it";
    /// The asset has radiance fields, but extensionsUsed does not list their extension.
    ExtensionUsed = "extension-used", Error,
        at "JSON pointer",
        do "add the extension's name to extensionsUsed";
    /// The extension is in extensionsRequired, so viewers refuse an asset that they could show.
    ExtensionRequired = "extension-required", Error,
        at "JSON pointer",
        do "remove the extension's name from extensionsRequired";
    /// A radiance field lacks a property, or a property has the wrong type or an unknown value.
    FieldProperty = "field-property", Error,
        at "JSON pointer",
        do "detach the field and attach it again";
    /// A radiance field refers to no container, to two, to missing bytes, or to bytes of vertices
    /// or indices.
    FieldSource = "field-source", Error,
        at "JSON pointer",
        do "detach the field and attach it again";
    /// The file that a radiance field refers to cannot be read.
    FieldMissing = "field-missing", Error,
        at "JSON pointer or byte",
        do "put the container at the URI";
    /// A property of a radiance field differs from its container.
    FieldMetadata = "field-metadata", Error,
        at "JSON pointer",
        do "detach the field and attach it again";
    /// The digest of a radiance field does not match its container.
    FieldHash = "field-hash", Error,
        at "JSON pointer",
        do "restore the container that was attached, or attach this one again";
    /// A node refers to a radiance field that does not exist.
    FieldNode = "field-node", Error,
        at "JSON pointer",
        do "refer to an existing field";
    /// No node refers to a radiance field, so it is never shown.
    FieldUnused = "field-unused", Warning,
        at "JSON pointer",
        do "put the field on a node, or detach it";
    /// A node with a radiance field has no mesh, so other viewers show nothing.
    FieldFallback = "field-fallback", Warning,
        at "JSON pointer",
        do "give the node a mesh, or attach with one";
    /// A file of tensors cannot be read: it is damaged, contains refused instructions, or exceeds a
    /// limit.
    Input = "input", Error,
        at "byte, tensor or zip entry",
        do "save it again with a current version of the program that wrote it";
    /// The tensors do not form a scene that can be baked.
    Scene = "scene", Error,
        at "key or tensor",
        do "retrain, or pass the option that the message names";
    /// The file lacks a setting that a bake needs; a default is used.
    Unstated = "unstated", Warning,
        at "key",
        do "pass the option that the message names if this is wrong";
    /// The values of a tensor do not match the checksum that the file states.
    ValuesChecksum = "values-checksum", Error,
        at "tensor",
        do "copy the file again, or save it again";
    /// Values are infinite or not a number.
    ValuesNonfinite = "values-nonfinite", Error,
        at "tensor",
        do "retrain, or bake with option nonfinite: empty";
    /// Raw values exceed 10,000, which happens only if training diverged.
    ValuesRange = "values-range", Warning,
        at "tensor",
        do "check the scene before baking; retrain if it is broken";
    /// No node has an opacity over one interval above 0.001, so the scene is empty.
    SpaceEmpty = "space-empty", Warning,
        at "tensor",
        do "retrain, or check the step length and the activation's shift";
    /// Less than 1 % of the nodes have an opacity over one interval of at most 0.001: nothing can
    /// be pruned.
    SpaceFull = "space-full", Warning,
        at "tensor",
        do "retrain with a loss that clears empty space, or check the activation's shift";
    /// A channel of colour or features has the same value at every visible node.
    ChannelDead = "channel-dead", Warning,
        at "tensor",
        do "train with fewer features";
    /// All weights of an input of the view network are 0 in the first layer.
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

/// Reports an error under a code and returns `None`, or passes the value through.
pub fn checked<T>(result: Result<T>, code: Code, report: &mut Report) -> Result<Option<T>> {
    match result {
        Ok(value) => Ok(Some(value)),
        Err(error) => {
            report(Finding { code, error })?;
            Ok(None)
        }
    }
}
