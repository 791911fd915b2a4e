//! Plain values of a tensor file: the contents of a pickle or a header.

use super::array::Tensor;
use super::unread::unread;
use crate::base::error::{Error, Place, Result};
use crate::base::limits::{self, Budget, Limits};

/// Maximum elements of a tensor that represents a setting.
const SETTING_ELEMENTS: u64 = 64;

/// Most bytes that are read for a setting.
const SETTING_BYTES: u64 = 4 << 20;

/// Maximum bytes of a value's full name, with the names of its dictionaries: each value has its own
/// copy.
const NAME_BYTES: u64 = 4096;

/// Refuses a name of this many bytes that is too long.
pub(in crate::tensor) fn check_name(bytes: usize, place: &Place) -> Result<()> {
    limits::check_fixed("bytes of a name", bytes as u64, NAME_BYTES, place)
}

/// The name of a value in the dictionary `outer`.
pub(super) fn joined_name(outer: &str, name: &str, place: &Place) -> Result<String> {
    check_name(outer.len() + 1 + name.len(), place)?;
    Ok(if outer.is_empty() { name.to_owned() } else { format!("{outer}.{name}") })
}

/// A value of a tensor file.
#[derive(Debug, Clone)]
pub enum Value {
    /// Nothing.
    None,
    /// True or false.
    Bool(bool),
    /// A whole number.
    Int(i64),
    /// A number.
    Float(f64),
    /// Text.
    Text(String),
    /// An array of numbers.
    Tensor(Tensor),
    /// Values in order.
    List(Vec<Value>),
    /// Values by key, in the file's order; keys other than text were converted to text.
    Dict(Vec<(String, Value)>),
    /// An object of an unsupported kind, which this names.
    Opaque(String),
}

impl Value {
    /// The value of `key`, of a dictionary that has it.
    pub fn get(&self, key: &str) -> Option<&Self> {
        self.entries().iter().find(|(found, _)| found == key).map(|(_, value)| value)
    }

    /// The value at the path `keys` through nested dictionaries.
    pub fn at(&self, keys: &[&str]) -> Option<&Self> {
        keys.iter().try_fold(self, |value, key| value.get(key))
    }

    /// Keys and values of a dictionary; empty for other values.
    pub fn entries(&self) -> &[(String, Self)] {
        match self {
            Self::Dict(entries) => entries,
            _ => &[],
        }
    }

    /// The tensor, if this is one.
    pub fn tensor(&self) -> Option<&Tensor> {
        match self {
            Self::Tensor(tensor) => Some(tensor),
            _ => None,
        }
    }

    /// True if this is `None`.
    pub fn is_none(&self) -> bool {
        matches!(self, Self::None)
    }

    /// Its kind, in a word or two.
    pub fn describe(&self) -> String {
        match self {
            Self::None => "None".into(),
            Self::Bool(value) => value.to_string(),
            Self::Int(value) => value.to_string(),
            Self::Float(value) => value.to_string(),
            Self::Text(text) => format!("{:?}", text.chars().take(80).collect::<String>()),
            Self::Tensor(t) => match t.unread_kind() {
                Some(kind) => kind.to_owned(),
                None => format!("a {} tensor of shape {:?}", t.element().name(), t.shape()),
            },
            Self::List(values) => format!("a list of {}", values.len()),
            Self::Dict(entries) => format!("a dictionary of {}", entries.len()),
            Self::Opaque(kind) => kind.clone(),
        }
    }

    /// The kind of an unsupported value.
    pub fn unread_kind(&self) -> Option<&str> {
        match self {
            Self::Opaque(kind) => Some(kind),
            Self::Tensor(tensor) => tensor.unread_kind(),
            _ => None,
        }
    }

    /// The error if the value is unsupported; none otherwise.
    pub fn unread_error(&self, place: Place) -> Option<Error> {
        self.unread_kind().map(|kind| unread(place, kind))
    }

    /// The value at the place of an error, in this value or nested in it.
    pub fn at_place(&self, place: &Place) -> Option<&Self> {
        let (Place::Tensor(name) | Place::Key(name)) = place else { return None };
        self.named(name)
    }

    fn named(&self, name: &str) -> Option<&Self> {
        if name.is_empty() {
            return Some(self);
        }
        self.entries().iter().find_map(|(key, value)| {
            let rest = name.strip_prefix(key.as_str())?;
            match rest.strip_prefix('.') {
                Some(rest) => value.named(rest),
                None => rest.is_empty().then_some(value),
            }
        })
    }

    /// A number, whether Python's, NumPy's or a tensor of one element.
    pub fn number(&self, key: &str) -> Result<f64> {
        match self.numbers(key)?.as_slice() {
            &[number] => Ok(number),
            _ => Err(self.unlike(key, "one number")),
        }
    }

    /// A whole number, likewise.
    pub fn integer(&self, key: &str) -> Result<i64> {
        if let Self::Int(value) = self {
            return Ok(*value);
        }
        let number = self.number(key)?;
        // Above 2^53, float64 no longer distinguishes neighbours.
        if number.fract() != 0.0 || number.abs() > 9_007_199_254_740_992.0 {
            return Err(self.unlike(key, "a whole number"));
        }
        #[expect(clippy::cast_possible_truncation, reason = "a whole number below 2^53")]
        Ok(number as i64)
    }

    /// A truth value, likewise; 0 and 1 count.
    pub fn boolean(&self, key: &str) -> Result<bool> {
        match (self, self.number(key)) {
            (Self::Bool(value), _) => Ok(*value),
            (_, Ok(0.0)) => Ok(false),
            (_, Ok(1.0)) => Ok(true),
            (_, Err(error)) if self.unread_kind().is_some() => Err(error),
            _ => Err(self.unlike(key, "true or false")),
        }
    }

    /// Three numbers, in a tensor or a list.
    pub fn vector3(&self, key: &str) -> Result<[f64; 3]> {
        <[f64; 3]>::try_from(self.numbers(key)?).map_err(|_| self.unlike(key, "three numbers"))
    }

    /// The numbers of a small tensor, a list of numbers, or a number.
    pub fn numbers(&self, key: &str) -> Result<Vec<f64>> {
        match self {
            Self::Bool(value) => Ok(vec![f64::from(u8::from(*value))]),
            Self::Int(value) => Ok(vec![*value as f64]),
            Self::Float(value) => Ok(vec![*value]),
            Self::Tensor(tensor)
                if tensor.count() <= SETTING_ELEMENTS && tensor.unread_kind().is_none() =>
            {
                let limits = Limits::default().with_memory(SETTING_BYTES);
                tensor.read_f64(&mut Budget::new(&limits))
            }
            Self::List(values) if values.len() as u64 <= SETTING_ELEMENTS => {
                values.iter().map(|value| value.number(key)).collect()
            }
            _ => Err(self.unlike(key, "a few numbers")),
        }
    }

    fn unlike(&self, key: &str, expected: &str) -> Error {
        if let Some(error) = self.unread_error(Place::Key(key.into())) {
            return error;
        }
        Error::malformed(Place::Key(key.into()), self.describe(), expected)
    }
}
