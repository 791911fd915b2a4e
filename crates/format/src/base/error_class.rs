//! Classes of errors by the response of a program.

use super::error::ErrorKind;

/// Kinds of errors with the same response, such as an exit code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorClass {
    /// The request is invalid.
    Usage,
    /// The input is damaged, or not of the expected kind.
    Malformed,
    /// The input is valid, but not supported by this version.
    Unsupported,
    /// The operating system refused to read or write.
    InputOutput,
    /// The input needs more than the limits or the memory allow.
    Limit,
    /// The output would replace a file.
    Exists,
    /// The caller asked to stop.
    Cancelled,
}

impl ErrorKind {
    /// The class of this kind.
    pub const fn class(&self) -> ErrorClass {
        match self {
            Self::Usage { .. } | Self::InvalidOption { .. } => ErrorClass::Usage,
            Self::Truncated { .. }
            | Self::Overflow { .. }
            | Self::Checksum { .. }
            | Self::Malformed { .. }
            | Self::WrongKind { .. }
            | Self::NonFinite { .. } => ErrorClass::Malformed,
            Self::Unsupported { .. } => ErrorClass::Unsupported,
            Self::Io(_) => ErrorClass::InputOutput,
            Self::OverLimit { .. } | Self::TooLittleMemory { .. } => ErrorClass::Limit,
            Self::Exists | Self::IsInput => ErrorClass::Exists,
            Self::Cancelled => ErrorClass::Cancelled,
        }
    }
}
