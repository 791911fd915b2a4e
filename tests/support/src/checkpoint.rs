//! A small checkpoint as a `.safetensors` file that says all that can be said, to be broken in one
//! way at a time.

use serde_json::{Map, Value, json};

use super::Random;

/// Nodes along each axis.
pub const NODES: [usize; 3] = [6, 5, 4];
/// Channels of colour and features.
pub const CHANNELS: usize = 7;

/// Named float32 arrays, and settings as text.
#[derive(Debug, Clone)]
pub struct Checkpoint {
    pub arrays: Vec<(&'static str, Vec<usize>, Vec<f32>)>,
    pub settings: Vec<(&'static str, &'static str)>,
}

impl Checkpoint {
    /// An opaque ball in empty space, four features, a network of one layer.
    pub fn sound() -> Self {
        let mut random = Random::new(8);
        let [nx, ny, nz] = NODES;
        let count = nx * ny * nz;
        let density = (0..count).map(|i| {
            let at = [i / (ny * nz), i / nz % ny, i % nz];
            let distance: f32 = (0..3).map(|axis| (at[axis] as f32 - 2.0).powi(2)).sum();
            if distance < 3.5 { 9.0 } else { -20.0 }
        });
        let density = density.collect();
        let color = (0..CHANNELS * count).map(|_| random.between(-4.0, 4.0)).collect();
        let inputs = 3 + CHANNELS;
        let weights = (0..3 * inputs).map(|_| random.between(0.1, 1.0)).collect();
        let arrays = vec![
            ("xyz_min", vec![3], vec![-1.0, -1.0, -1.0]),
            ("xyz_max", vec![3], vec![1.0, 0.75, 0.5]),
            ("act_shift", vec![1], vec![-4.0]),
            ("density.grid", vec![1, 1, nx, ny, nz], density),
            ("k0.grid", vec![1, CHANNELS, nx, ny, nz], color),
            ("rgbnet.0.weight", vec![3, inputs], weights),
            ("rgbnet.0.bias", vec![3], vec![0.0, 0.5, 1.0]),
        ];
        let settings = vec![
            ("num_voxels", "120"),
            ("num_voxels_base", "120"),
            ("viewbase_pe", "0"),
            ("rgbnet_direct", "True"),
        ];
        Self { arrays, settings }
    }

    /// The values of an array.
    pub fn values(&mut self, name: &str) -> &mut Vec<f32> {
        let own = self.arrays.iter_mut().find(|array| array.0 == name);
        &mut own.expect("such an array").2
    }

    /// The file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut header = Map::new();
        let texts = self.settings.iter().map(|&(key, text)| (key.to_owned(), Value::from(text)));
        header.insert("__metadata__".to_owned(), Value::Object(texts.collect()));
        let mut data: Vec<u8> = Vec::new();
        for (name, shape, values) in &self.arrays {
            let start = data.len();
            data.extend(values.iter().flat_map(|value| value.to_le_bytes()));
            let entry =
                json!({ "dtype": "F32", "shape": shape, "data_offsets": [start, data.len()] });
            header.insert((*name).to_owned(), entry);
        }
        let mut text = Value::Object(header).to_string().into_bytes();
        text.resize(text.len().next_multiple_of(8), b' ');
        [&(text.len() as u64).to_le_bytes()[..], &text, &data].concat()
    }
}
