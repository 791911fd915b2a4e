//! One error type for the whole crate: the fault, its place, and a remedy.
//!
//! A [`Place`] is always absolute: byte offsets count from the start of the file, block numbers
//! from the start of their level. The caller that opens a file adds its name with
//! [`Error::in_file`].

use super::limit_table::LimitName;
use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};

pub use super::place::Place;

/// The remedy for files that only a later version of this program can read.
pub const NEWER: &str = "use a newer version of this tool";

/// The crate's result.
pub type Result<T> = std::result::Result<T, Error>;

/// An error with its place. One pointer wide, so a `Result<f32>` stays small.
#[derive(Debug)]
pub struct Error(Box<Details>);

#[derive(Debug)]
struct Details {
    kind: ErrorKind,
    place: Place,
    file: Option<PathBuf>,
    advice: Option<Cow<'static, str>>,
}

/// Kinds of errors.
#[derive(Debug)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The operating system refused to read or write.
    Io(std::io::Error),
    /// The caller asked to stop.
    Cancelled,
    /// The bytes end too early.
    Truncated {
        /// Bytes needed at the place.
        wanted: u64,
        /// Bytes left there.
        left: u64,
    },
    /// A number is larger than [`crate::base::limits::Limits`] allows.
    OverLimit {
        /// The limit that users may raise; none if it is fixed by the format or the reader.
        limit: Option<LimitName>,
        /// The thing that is counted.
        what: &'static str,
        /// Its count.
        asked: u64,
        /// The most that is allowed.
        allowed: u64,
    },
    /// The work needs more memory than the user allows.
    TooLittleMemory {
        /// Bytes that would be enough.
        least: u64,
        /// Bytes allowed.
        allowed: u64,
    },
    /// A product of counts does not fit the address space.
    Overflow {
        /// The thing that is counted.
        what: &'static str,
    },
    /// Stored and computed checksums differ: the bytes were damaged.
    Checksum {
        /// The summed bytes.
        what: String,
        /// Computed checksum of the bytes.
        found: u32,
        /// Checksum stated in the file.
        expected: u32,
    },
    /// The bytes break the rules of their format.
    Malformed {
        /// The value found.
        found: String,
        /// The value that the format requires.
        expected: String,
    },
    /// A file that is not of the expected kind, and not known to be damaged.
    WrongKind {
        /// The kind found.
        found: String,
        /// The accepted kinds.
        expected: String,
    },
    /// Well-formed, but of a version, feature or model that this build does not support.
    Unsupported {
        /// The value found.
        found: String,
        /// The supported values.
        expected: String,
    },
    /// A grid holds infinities or NaNs.
    NonFinite {
        /// Number of values that are not finite, among those read.
        count: u64,
        /// Channel, x, y, z of the first one.
        first: [usize; 4],
    },
    /// An option contradicts the input or another option.
    Usage {
        /// The contradiction.
        message: String,
    },
    /// An option has an invalid value.
    InvalidOption {
        /// The option's name in the library, in snake case.
        option: &'static str,
        /// Its value, or the other option that it contradicts.
        found: String,
        /// The valid values.
        expected: String,
    },
    /// The output already exists.
    Exists,
    /// The output is a file that is being read, under this or another name.
    IsInput,
}

impl Error {
    /// An error of this kind at this place.
    pub fn new(kind: ErrorKind, place: Place) -> Self {
        Self(Box::new(Details { kind, place, file: None, advice: None }))
    }

    /// Bytes that break their format's rules.
    pub fn malformed(place: Place, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::new(ErrorKind::Malformed { found: found.into(), expected: expected.into() }, place)
    }

    /// A file that is not of the expected kind, and not damaged either.
    pub fn wrong_kind(found: impl Into<String>, expected: impl Into<String>) -> Self {
        let (found, expected) = (found.into(), expected.into());
        Self::new(ErrorKind::WrongKind { found, expected }, Place::File)
    }

    /// A version, feature or model that this build does not support.
    pub fn unsupported(
        place: Place,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self::new(ErrorKind::Unsupported { found: found.into(), expected: expected.into() }, place)
    }

    /// An option that contradicts the input or another option.
    pub fn usage(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Usage { message: message.into() }, Place::File)
    }

    /// An option, named as in the library, with an invalid value.
    pub fn invalid_option(
        option: &'static str,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        let (found, expected) = (found.into(), expected.into());
        Self::new(ErrorKind::InvalidOption { option, found, expected }, Place::File)
    }

    /// Refuses an option's value unless `holds` is true.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::InvalidOption`].
    pub fn require_option(
        holds: bool,
        option: &'static str,
        found: impl fmt::Display,
        expected: &str,
    ) -> Result<()> {
        match holds {
            true => Ok(()),
            false => Err(Self::invalid_option(option, found.to_string(), expected)),
        }
    }

    /// Work that was stopped on request.
    pub fn cancelled() -> Self {
        Self::new(ErrorKind::Cancelled, Place::File)
    }

    /// A failure of the operating system on the file `path`.
    pub fn io(error: std::io::Error, path: &Path) -> Self {
        Self::new(ErrorKind::Io(error), Place::File).in_file(path)
    }

    /// Names the file, unless an inner layer already has.
    #[must_use]
    pub fn in_file(mut self, path: &Path) -> Self {
        self.0.file.get_or_insert_with(|| path.to_owned());
        self
    }

    /// Sets a remedy, for an error whose kind alone does not determine one.
    #[must_use]
    pub fn advise(mut self, remedy: impl Into<Cow<'static, str>>) -> Self {
        self.0.advice = Some(remedy.into());
        self
    }

    /// Marks the error's place as in a container that a value of a JSON document embeds, starting
    /// at byte `offset` of the file.
    #[must_use]
    pub fn within(mut self, pointer: &str, offset: u64) -> Self {
        let place = Box::new(std::mem::replace(&mut self.0.place, Place::File));
        self.0.place = Place::Within { pointer: pointer.to_owned(), place, offset };
        self
    }

    /// The error's kind.
    pub fn kind(&self) -> &ErrorKind {
        &self.0.kind
    }

    /// The kind of an error of the system; others are `Other`.
    pub fn io_kind(&self) -> std::io::ErrorKind {
        match &self.0.kind {
            ErrorKind::Io(error) => error.kind(),
            _ => std::io::ErrorKind::Other,
        }
    }

    /// The error's kind, without its place.
    pub fn into_kind(self) -> ErrorKind {
        self.0.kind
    }

    /// The place in the file.
    pub fn place(&self) -> &Place {
        &self.0.place
    }

    /// The file, once known.
    pub fn file(&self) -> Option<&Path> {
        self.0.file.as_deref()
    }

    /// The remedy that was set for this error, if any.
    pub fn advice(&self) -> Option<&str> {
        self.0.advice.as_deref()
    }

    /// The remedy, in a sentence.
    pub fn remedy(&self) -> Cow<'static, str> {
        if let Some(advice) = &self.0.advice {
            return advice.clone();
        }
        match &self.0.kind {
            ErrorKind::Io(error) => match error.kind() {
                std::io::ErrorKind::NotFound => "check the path".into(),
                std::io::ErrorKind::PermissionDenied => "check the permissions".into(),
                std::io::ErrorKind::IsADirectory => "pass a file instead of a directory".into(),
                std::io::ErrorKind::NotADirectory => "pass a directory".into(),
                std::io::ErrorKind::AddrInUse => "choose another port; 0 takes a free one".into(),
                std::io::ErrorKind::InvalidInput => "name a regular file".into(),
                std::io::ErrorKind::StorageFull => "free some space and run again".into(),
                std::io::ErrorKind::QuotaExceeded | std::io::ErrorKind::FileTooLarge => {
                    "raise the quota or the limit on file sizes, and run again".into()
                }
                std::io::ErrorKind::ReadOnlyFilesystem => "write to another folder".into(),
                _ => "check the disk and the path, then run again".into(),
            },
            ErrorKind::Cancelled => "run the same command again".into(),
            ErrorKind::Truncated { .. } | ErrorKind::Checksum { .. } => {
                "the file is cut short or damaged: copy or make it again".into()
            }
            ErrorKind::OverLimit { limit: Some(limit), .. } => {
                format!("raise the limit {} if this file is trusted", limit.name()).into()
            }
            ErrorKind::OverLimit { limit: None, .. } => "nothing allows more".into(),
            ErrorKind::TooLittleMemory { least, .. } => {
                format!("allow {least} bytes or more, or fewer threads").into()
            }
            ErrorKind::Malformed { .. }
                if matches!(self.0.place, Place::Key(_) | Place::Line(_)) =>
            {
                "correct this value, or make the file again".into()
            }
            ErrorKind::Overflow { .. } | ErrorKind::Malformed { .. } => {
                "the file is damaged, or its writer broke the format: make it again".into()
            }
            ErrorKind::WrongKind { .. } => "name a file of an expected kind".into(),
            ErrorKind::Unsupported { .. } => {
                "convert the file to what is expected; a newer version of this tool may know more"
                    .into()
            }
            ErrorKind::NonFinite { .. } => {
                "retrain, or bake with these values treated as empty".into()
            }
            ErrorKind::Usage { .. } | ErrorKind::InvalidOption { .. } => {
                "see the documentation of the option".into()
            }
            ErrorKind::Exists => "remove it, or allow it to be replaced".into(),
            ErrorKind::IsInput => "choose another name for the output".into(),
        }
    }
}

impl ErrorKind {
    /// Its name for programs, in snake case.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Io(_) => "io",
            Self::Cancelled => "cancelled",
            Self::Truncated { .. } => "truncated",
            Self::OverLimit { .. } => "over_limit",
            Self::TooLittleMemory { .. } => "too_little_memory",
            Self::Overflow { .. } => "overflow",
            Self::Checksum { .. } => "checksum",
            Self::Malformed { .. } => "malformed",
            Self::WrongKind { .. } => "wrong_kind",
            Self::Unsupported { .. } => "unsupported",
            Self::NonFinite { .. } => "non_finite",
            Self::Usage { .. } => "usage",
            Self::InvalidOption { .. } => "invalid_option",
            Self::Exists => "exists",
            Self::IsInput => "is_input",
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = self.file() {
            write!(f, "{}: ", file.display())?;
        }
        if self.0.place != Place::File {
            write!(f, "{}: ", self.0.place)?;
        }
        write!(f, "{}", self.0.kind)
    }
}

/// Megabytes with one digit, for people.
fn megabytes(tenths: u64) -> String {
    format!("{}.{} MB", tenths / 10, tenths % 10)
}

impl fmt::Display for ErrorKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(error) => write!(f, "{error}"),
            Self::Cancelled => write!(f, "stopped on request"),
            Self::Truncated { wanted, left } => {
                write!(f, "found {left} bytes, expected {wanted}")
            }
            Self::OverLimit { what, asked, allowed, .. } => {
                write!(f, "found {asked} {what}, expected at most {allowed}")
            }
            Self::TooLittleMemory { least, allowed } => {
                // Rounded in opposite directions, so that the need is shown as larger.
                let least = megabytes(least.div_ceil(100_000));
                let allowed = megabytes(allowed / 100_000);
                write!(f, "needs {least} of memory, the bound is {allowed}")
            }
            Self::Overflow { what } => {
                write!(f, "found a {what} beyond 2^63, expected one that fits in memory")
            }
            Self::Checksum { what, found, expected } => {
                write!(f, "found checksum {found:08x} over {what}, expected {expected:08x}")
            }
            Self::Malformed { found, expected } | Self::WrongKind { found, expected } => {
                write!(f, "found {found}, expected {expected}")
            }
            Self::Unsupported { found, expected } => {
                write!(f, "found {found}, which is not supported; expected {expected}")
            }
            Self::NonFinite { count, first: [channel, x, y, z] } => write!(
                f,
                "found {count} values that are not finite, the first in channel {channel} at node \
                 ({x}, {y}, {z}); expected finite numbers"
            ),
            Self::Usage { message } => write!(f, "{message}"),
            Self::InvalidOption { option, found, expected } => {
                write!(f, "option {option}: found {found}, expected {expected}")
            }
            Self::Exists => write!(f, "the output exists already"),
            Self::IsInput => {
                write!(f, "the output path is also an input")
            }
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match &self.0.kind {
            ErrorKind::Io(error) => Some(error),
            _ => None,
        }
    }
}
