//! MessagePack documents, packed or not.

use std::io::{Read, Write};

/// A value of MessagePack.
#[derive(Clone)]
pub enum Pack {
    Int(i64),
    Float(f64),
    Bool(bool),
    Text(&'static str),
    Bytes(Vec<u8>),
    List(Vec<Pack>),
    Map(Vec<(&'static str, Pack)>),
    Raw(Vec<u8>),
}

impl Pack {
    pub fn bytes(&self) -> Vec<u8> {
        let mut out = Vec::new();
        self.write(&mut out);
        out
    }

    fn write(&self, out: &mut Vec<u8>) {
        let text = |text: &str, out: &mut Vec<u8>| {
            match text.len() {
                length @ 0..=31 => out.push(0xa0 | length as u8),
                length => out.extend([0xd9, length as u8]),
            }
            out.extend(text.as_bytes());
        };
        match self {
            Self::Int(value @ 0..=127) => out.push(*value as u8),
            Self::Int(value) => {
                out.push(0xd3);
                out.extend(value.to_be_bytes());
            }
            Self::Float(value) => {
                out.push(0xcb);
                out.extend(value.to_be_bytes());
            }
            Self::Bool(value) => out.push(0xc2 + u8::from(*value)),
            Self::Text(value) => text(value, out),
            Self::Bytes(bytes) => {
                out.push(0xc6);
                out.extend((bytes.len() as u32).to_be_bytes());
                out.extend(bytes);
            }
            Self::List(items) => {
                out.push(0xdc);
                out.extend((items.len() as u16).to_be_bytes());
                items.iter().for_each(|item| item.write(out));
            }
            Self::Map(entries) => {
                out.push(0x80 | entries.len() as u8);
                for (key, value) in entries {
                    text(key, out);
                    value.write(out);
                }
            }
            Self::Raw(bytes) => out.extend(bytes),
        }
    }

    /// Replaces the value that keys lead to, or adds it.
    pub fn set(&mut self, path: &[&'static str], value: Pack) {
        let (Self::Map(entries), [key, rest @ ..]) = (self, path) else { panic!("a map") };
        let found = entries.iter().position(|(name, _)| name == key);
        let at = found.unwrap_or_else(|| {
            entries.push((key, Self::Map(Vec::new())));
            entries.len() - 1
        });
        match rest {
            [] => entries[at].1 = value,
            rest => entries[at].1.set(rest, value),
        }
    }

    /// Takes the value out that keys lead to.
    pub fn remove(&mut self, path: &[&str]) {
        let Self::Map(entries) = self else { panic!("a map") };
        match path {
            [key] => entries.retain(|(name, _)| name != key),
            [key, rest @ ..] => {
                entries.iter_mut().find(|(name, _)| name == key).expect("there").1.remove(rest)
            }
            [] => {}
        }
    }

    /// Adds bytes to a binary value.
    pub fn append(&mut self, path: &[&str], more: &[u8]) {
        match (self, path) {
            (Self::Bytes(bytes), []) => bytes.extend(more),
            (Self::Map(entries), [key, rest @ ..]) => {
                entries
                    .iter_mut()
                    .find(|(name, _)| name == key)
                    .expect("there")
                    .1
                    .append(rest, more);
            }
            _ => panic!("a binary value"),
        }
    }
}

/// The bytes that a zlib stream holds.
pub fn unzlib(packed: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    flate2::read::ZlibDecoder::new(packed).read_to_end(&mut out).expect("a zlib stream");
    out
}

pub fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut out = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    out.write_all(bytes).expect("memory");
    out.finish().expect("memory")
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    out.write_all(bytes).expect("memory");
    out.finish().expect("memory")
}
