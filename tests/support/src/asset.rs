//! glTF assets in memory: random ones as others might write them, and their parts.

use std::path::Path;
use std::sync::Arc;

use mipvog::base::bytes::{Output, SourceFile};
use mipvog::base::error::Result;
use mipvog::base::limits::Limits;
use mipvog::container::Container;
use mipvog_outputs::gltf::asset::Asset;
use mipvog_outputs::gltf::attach::{AttachOptions, attach, detach};
use serde_json::Value;

use super::{Random, fixture};

pub const NAME: &str = "MIPVOG_radiance_field";

/// Type and bytes of a chunk.
pub type Chunk = ([u8; 4], Vec<u8>);

/// A GLB of a document and chunks: type and bytes, written as they are with padding of zeros.
pub fn glb(document: &str, chunks: &[Chunk]) -> Vec<u8> {
    let mut json = document.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = Vec::new();
    for (kind, content) in [(*b"JSON", json)].iter().chain(chunks) {
        let padded = content.len().next_multiple_of(4);
        bytes.extend((padded as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(content);
        bytes.resize(bytes.len() + padded - content.len(), 0);
    }
    let mut whole = b"glTF".to_vec();
    whole.extend(2u32.to_le_bytes());
    whole.extend((12 + bytes.len() as u32).to_le_bytes());
    whole.extend(bytes);
    whole
}

/// Text of the document, and the other chunks, of a GLB or a `.gltf`.
pub fn parts(bytes: &[u8]) -> (String, Vec<Chunk>) {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).expect("UTF-8");
    if !bytes.starts_with(b"glTF") {
        return (text(bytes), Vec::new());
    }
    let mut chunks = Vec::new();
    let mut at = 12;
    while at < bytes.len() {
        let length = u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four")) as usize;
        let kind: [u8; 4] = bytes[at + 4..at + 8].try_into().expect("four");
        chunks.push((kind, bytes[at + 8..at + 8 + length].to_vec()));
        at += 8 + length;
    }
    let (_, json) = chunks.remove(0);
    (text(&json), chunks)
}

/// The document alone.
pub fn document(bytes: &[u8]) -> Value {
    serde_json::from_str(&parts(bytes).0).expect("JSON")
}

/// The asset with its document changed, as an editor would write it.
pub fn changed(bytes: &[u8], change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let (text, chunks) = parts(bytes);
    let mut value: Value = serde_json::from_str(&text).expect("JSON");
    change(&mut value);
    match bytes.starts_with(b"glTF") {
        true => glb(&value.to_string(), &chunks),
        false => value.to_string().into_bytes(),
    }
}

pub fn open(bytes: &[u8], path: &Path) -> Result<Asset> {
    std::fs::write(path, bytes).expect("writable");
    Asset::open(Arc::new(SourceFile::open(path)?), &Limits::default())
}

/// A golden container.
pub fn container(name: &str) -> Container {
    let file = SourceFile::open(&fixture("baked").join(name)).expect("a golden container");
    Container::open(Arc::new(file), &Limits::default()).expect("a container")
}

fn written(folder: &Path, write: impl FnOnce(&Path, &mut Output) -> Result<()>) -> Result<Vec<u8>> {
    let path = folder.join("written.asset");
    let mut output = Output::create(&path, true)?;
    write(&path, &mut output)?;
    output.finish()?;
    Ok(std::fs::read(&path).expect("written"))
}

/// The asset with a golden container attached.
pub fn attached(
    folder: &Path,
    asset: &[u8],
    name: &str,
    options: &AttachOptions,
) -> Result<Vec<u8>> {
    let asset = open(asset, &folder.join("in.asset"))?;
    let beside = folder.join(name);
    std::fs::copy(fixture("baked").join(name), &beside).expect("copied");
    written(folder, |path, output| {
        attach(&asset, &container(name), &beside, path, options, output).map(|_| ())
    })
}

/// The asset without a field, or without any.
pub fn detached(folder: &Path, asset: &[u8], field: Option<usize>) -> Result<Vec<u8>> {
    let asset = open(asset, &folder.join("in.asset"))?;
    written(folder, |_, output| detach(&asset, field, output).map(|_| ()))
}

/// A random document as text, with white space, unknown extensions, odd numbers, and lists that may
/// be missing or empty; and the bytes of its buffer.
pub struct Written {
    random: Random,
    pub text: String,
    pub bin: Option<Vec<u8>>,
    /// Nodes that it has.
    pub nodes: usize,
}

impl Written {
    pub fn new(seed: u64, is_glb: bool) -> Self {
        let mut random = Random::new(seed);
        let nodes = random.below(4);
        let buffer = is_glb && random.below(3) > 0;
        let bin = buffer.then(|| (0..1 + random.below(90)).map(|_| random.bits() as u8).collect());
        let mut written = Self { random, text: String::new(), bin, nodes };
        let members = written.members(is_glb);
        written.text = written.object(members);
        written
    }

    /// As a file: the chunk BIN may be padded more than need be, and others may follow.
    pub fn file(&mut self, is_glb: bool) -> Vec<u8> {
        if !is_glb {
            return self.text.clone().into_bytes();
        }
        let mut chunks = Vec::new();
        if let Some(bin) = &self.bin {
            let mut bin = bin.clone();
            if self.random.below(3) == 0 {
                bin.resize(bin.len().next_multiple_of(4) + 4 * self.random.below(20), 7);
            }
            chunks.push((*b"BIN\0", bin));
        }
        for kind in [*b"ABCD", *b"wxyz"] {
            if self.random.below(3) == 0 {
                let length = 4 * self.random.below(9);
                chunks.push((kind, (0..length).map(|_| self.random.bits() as u8).collect()));
            }
        }
        glb(&self.text, &chunks)
    }

    fn members(&mut self, is_glb: bool) -> Vec<String> {
        let mut members = vec![r#""asset":{"version":"2.0","minVersion": "2.0"}"#.to_owned()];
        let count = self.nodes;
        if count > 0 || self.random.below(4) == 0 {
            let nodes: Vec<String> = (0..count).map(|i| self.node(i)).collect();
            members.push(format!("\"nodes\":{}", self.array(nodes)));
        }
        match self.random.below(4) {
            0 => {}
            1 => members.push("\"scenes\":[ ]".to_owned()),
            kind => {
                let listed: Vec<String> = (0..count).map(|node| node.to_string()).collect();
                let list = match self.random.below(3) {
                    0 => "\"name\":\"only\"".to_owned(),
                    1 => "\"nodes\": [\n]".to_owned(),
                    _ => format!("\"nodes\":{}", self.array(listed)),
                };
                members.push(format!("\"scenes\":[{{}},{{{list}}}]"));
                if kind == 2 {
                    members.push("\"scene\":1".to_owned());
                }
            }
        }
        if let Some(bin) = &self.bin {
            let mut views = vec![format!("{{\"buffer\":0,\"byteLength\":{}}}", bin.len())];
            views.push("{\"byteLength\":1,\"buffer\":0,\"extras\":[0.10]}".to_owned());
            members.push(format!("\"buffers\":[{{\"byteLength\":{}}}]", bin.len()));
            members.push(format!("\"bufferViews\":{}", self.array(views)));
        } else if is_glb && self.random.below(3) == 0 {
            members.push("\"buffers\":[],\"bufferViews\":[]".to_owned());
        }
        match self.random.below(4) {
            0 => members.push("\"extensionsUsed\":[]".to_owned()),
            1 => members.push("\"extensionsUsed\":[\"EXT_a\", \"EXT_b\"]".to_owned()),
            2 => members.push(format!("\"extensionsUsed\" : [\"{NAME}\"]")),
            _ => {}
        }
        match self.random.below(5) {
            0 => members.push("\"extensions\":{}".to_owned()),
            1 => members.push("\"extensions\":{\"EXT_a\":{\"é\\n\":[1E+2,-0.0]}}".to_owned()),
            2 => members.push(format!("\"extensions\":{{ \"{NAME}\":{{}},\"EXT_b\":{{}} }}")),
            3 => members.push(format!("\"extensions\":{{\"{NAME}\":{{\"radianceFields\":[]}}}}")),
            _ => {}
        }
        if self.random.below(2) == 0 {
            members.push("\"extras\":{\"attached\":1.50,\"z\":0,\"a\":null}".to_owned());
        }
        for i in (1..members.len()).rev() {
            members.swap(i, self.random.below(i + 1));
        }
        members
    }

    fn node(&mut self, number: usize) -> String {
        let mut members = vec![format!("\"name\":\"node {number}\"")];
        match self.random.below(4) {
            0 => members.push("\"extensions\":{}".to_owned()),
            1 => members.push("\"extensions\":{\"EXT_n\":{\"node\":0}}".to_owned()),
            2 => members.clear(),
            _ => {}
        }
        self.object(members)
    }

    fn object(&mut self, members: Vec<String>) -> String {
        self.list(members, '{', '}')
    }

    fn array(&mut self, elements: Vec<String>) -> String {
        self.list(elements, '[', ']')
    }

    fn list(&mut self, items: Vec<String>, open: char, close: char) -> String {
        let mut text = open.to_string();
        for (i, item) in items.iter().enumerate() {
            let comma = if i > 0 { "," } else { "" };
            text += &format!("{}{comma}{}{item}", self.space(), self.space());
        }
        text + self.space() + &close.to_string()
    }

    fn space(&mut self) -> &'static str {
        ["", "", " ", "\n  ", "\t\r\n"][self.random.below(5)]
    }
}
