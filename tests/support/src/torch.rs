//! Small checkpoints in PyTorch's layout: a pickle and two storages in a zip file.

use super::archive::archive;

/// A value of a checkpoint.
#[derive(Debug, Clone)]
pub enum Item {
    /// A float32 array.
    Floats(Vec<usize>, Vec<f32>),
    /// An array of bytes.
    Bytes(Vec<usize>, Vec<u8>),
    /// An array of signed bytes.
    Signed(Vec<usize>, Vec<i8>),
    /// An int64 array.
    Longs(Vec<usize>, Vec<i64>),
    Numbers(Vec<f64>),
    Number(f64),
    Int(i64),
    Flag(bool),
    Text(&'static str),
    None,
}

/// Values by the keys that lead to them, with slashes between.
#[derive(Debug, Clone, Default)]
pub struct TorchFile {
    pub items: Vec<(String, Item)>,
}

impl TorchFile {
    pub fn push(&mut self, key: impl Into<String>, item: Item) {
        self.items.push((key.into(), item));
    }

    /// A value, to be changed.
    pub fn item(&mut self, key: &str) -> &mut Item {
        &mut self.items.iter_mut().find(|item| item.0 == key).expect("such a value").1
    }

    /// The values of an array.
    pub fn floats(&self, key: &str) -> (&[usize], &[f32]) {
        match self.items.iter().find(|item| item.0 == key) {
            Some((_, Item::Floats(shape, values))) => (shape, values),
            other => panic!("{key}: {other:?}"),
        }
    }

    /// The pickle, the float32 numbers and the bytes.
    pub fn parts(&self) -> [Vec<u8>; 3] {
        let mut writer = Writer::default();
        writer.pickle.extend(b"\x80\x02");
        let items: Vec<(&str, &Item)> =
            self.items.iter().map(|(key, item)| (key.as_str(), item)).collect();
        writer.dict(&items);
        writer.pickle.push(b'.');
        [writer.pickle, writer.floats, writer.bytes]
    }

    /// The file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let [pickle, floats, bytes] = self.parts();
        archive(&[
            ("archive/data.pkl", &pickle),
            ("archive/data/0", &floats),
            ("archive/data/1", &bytes),
        ])
    }

    /// The same as the fuzz target `models` takes it.
    pub fn to_seed(&self) -> Vec<u8> {
        let prefixed = |part: Vec<u8>| [&(part.len() as u32).to_le_bytes()[..], &part].concat();
        self.parts().map(prefixed).concat()
    }
}

#[derive(Default)]
struct Writer {
    pickle: Vec<u8>,
    floats: Vec<u8>,
    bytes: Vec<u8>,
}

impl Writer {
    fn text(&mut self, text: &str) {
        self.pickle.push(b'X');
        self.pickle.extend((text.len() as u32).to_le_bytes());
        self.pickle.extend(text.as_bytes());
    }

    fn int(&mut self, value: i64) {
        self.pickle.extend(b"\x8a\x08");
        self.pickle.extend(value.to_le_bytes());
    }

    fn number(&mut self, value: f64) {
        self.pickle.push(b'G');
        self.pickle.extend(value.to_be_bytes());
    }

    fn dict(&mut self, items: &[(&str, &Item)]) {
        self.pickle.extend(b"}(");
        let mut done: Vec<&str> = Vec::new();
        for (key, item) in items {
            let Some((folder, _)) = key.split_once('/') else {
                self.text(key);
                self.item(item);
                continue;
            };
            if done.contains(&folder) {
                continue;
            }
            done.push(folder);
            let within: Vec<(&str, &Item)> = items
                .iter()
                .filter_map(|(key, item)| {
                    Some((key.strip_prefix(folder)?.strip_prefix('/')?, *item))
                })
                .collect();
            self.text(folder);
            self.dict(&within);
        }
        self.pickle.push(b'u');
    }

    fn item(&mut self, item: &Item) {
        match item {
            Item::Floats(shape, values) => {
                let first = self.floats.len() / 4;
                self.floats.extend(values.iter().flat_map(|value| value.to_le_bytes()));
                self.tensor(["FloatStorage", "0"], first, values.len(), shape);
            }
            Item::Bytes(shape, values) => {
                let first = self.bytes.len();
                self.bytes.extend(values);
                self.tensor(["ByteStorage", "1"], first, values.len(), shape);
            }
            Item::Signed(shape, values) => {
                let first = self.bytes.len();
                self.bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
                self.tensor(["CharStorage", "1"], first, values.len(), shape);
            }
            Item::Longs(shape, values) => {
                self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
                let first = self.bytes.len() / 8;
                self.bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
                self.tensor(["LongStorage", "1"], first, values.len(), shape);
            }
            Item::Numbers(values) => {
                self.pickle.extend(b"](");
                values.iter().for_each(|value| self.number(*value));
                self.pickle.push(b'e');
            }
            Item::Number(value) => self.number(*value),
            Item::Int(value) => self.int(*value),
            Item::Flag(value) => self.pickle.push(if *value { 0x88 } else { 0x89 }),
            Item::Text(text) => self.text(text),
            Item::None => self.pickle.push(b'N'),
        }
    }

    /// A tensor in C order whose storage ends with it.
    fn tensor(&mut self, [kind, key]: [&str; 2], first: usize, count: usize, shape: &[usize]) {
        self.pickle.extend(b"ctorch._utils\n_rebuild_tensor_v2\n((");
        self.text("storage");
        self.pickle.extend(format!("ctorch\n{kind}\n").bytes());
        self.text(key);
        self.text("cpu");
        self.int((first + count) as i64);
        self.pickle.extend(b"tQ");
        self.int(first as i64);
        let strides = (0..shape.len()).map(|axis| shape[axis + 1..].iter().product());
        for sizes in [shape.to_vec(), strides.collect()] {
            self.pickle.push(b'(');
            sizes.iter().for_each(|size| self.int(*size as i64));
            self.pickle.push(b't');
        }
        self.pickle.extend(b"\x89ccollections\nOrderedDict\n)RtR");
    }
}
