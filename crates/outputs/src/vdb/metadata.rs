//! Metadata of files and of grids: names, types and values, sorted by name.

/// A value.
#[derive(Debug, Clone, PartialEq)]
pub enum MetaValue {
    /// A text.
    Text(String),
    /// A truth.
    Bool(bool),
    /// A count.
    Int(i64),
    /// A number.
    Float(f32),
    /// A voxel.
    Voxel([i32; 3]),
}

impl MetaValue {
    fn kind(&self) -> &'static str {
        match self {
            Self::Text(_) => "string",
            Self::Bool(_) => "bool",
            Self::Int(_) => "int64",
            Self::Float(_) => "float",
            Self::Voxel(_) => "vec3i",
        }
    }

    fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Text(text) => text.as_bytes().to_vec(),
            Self::Bool(value) => vec![u8::from(*value)],
            Self::Int(value) => value.to_le_bytes().to_vec(),
            Self::Float(value) => value.to_le_bytes().to_vec(),
            Self::Voxel(voxel) => voxel.iter().flat_map(|at| at.to_le_bytes()).collect(),
        }
    }
}

/// A text with its length before it.
pub fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat()
}

/// The bytes of metadata.
pub fn metadata(mut values: Vec<(&str, MetaValue)>) -> Vec<u8> {
    values.sort_by_key(|(name, _)| *name);
    let mut bytes = (values.len() as u32).to_le_bytes().to_vec();
    for (name, value) in values {
        let own = value.bytes();
        bytes.extend(text(name));
        bytes.extend(text(value.kind()));
        bytes.extend((own.len() as u32).to_le_bytes());
        bytes.extend(own);
    }
    bytes
}
