//! Small models of other systems as `.safetensors` files, to be broken in one way at a time.

use serde_json::{Map, Value, json};

use super::Random;

/// Values of an array.
#[derive(Debug, Clone)]
pub enum Values {
    F32(Vec<f32>),
    I32(Vec<i32>),
    U16(Vec<u16>),
    U8(Vec<u8>),
}

impl Values {
    fn bytes(&self) -> (&'static str, Vec<u8>) {
        match self {
            Self::F32(values) => ("F32", values.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Self::I32(values) => ("I32", values.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Self::U8(values) => ("U8", values.clone()),
            Self::U16(values) => ("U16", values.iter().flat_map(|v| v.to_le_bytes()).collect()),
        }
    }
}

/// Named arrays, and settings as text.
#[derive(Debug, Clone, Default)]
pub struct SmallGrid {
    pub arrays: Vec<(&'static str, Vec<usize>, Values)>,
    pub settings: Vec<(&'static str, &'static str)>,
}

/// One of each kind.
pub const SMALL_GRIDS: [fn() -> SmallGrid; 9] = [
    plenoxels,
    spheres,
    lightning,
    lightning_spheres,
    sampled,
    sampled_blocks,
    plenoctree,
    gaussians,
    quantized,
];

fn random(seed: u64, count: usize, low: f32, high: f32) -> Values {
    let mut random = Random::new(seed);
    Values::F32((0..count).map(|_| random.between(low, high)).collect())
}

/// 5 x 4 x 3 cells, every second of which holds something.
pub fn plenoxels() -> SmallGrid {
    let links = (0..60).map(|cell| if cell % 2 == 0 { cell / 2 } else { -1 - cell % 3 });
    SmallGrid {
        arrays: vec![
            ("links", vec![5, 4, 3], Values::I32(links.collect())),
            ("density_data", vec![30, 1], random(1, 30, -4.0, 12.0)),
            ("sh_data", vec![30, 12], random(2, 360, -1.0, 1.0)),
            ("radius", vec![3], Values::F32(vec![1.0, 0.8, 0.6])),
            ("center", vec![3], Values::F32(vec![0.1, 0.0, -0.1])),
        ],
        settings: Vec::new(),
    }
}

/// The same with four layers of background around 6 x 3 directions, every third of which is empty.
pub fn spheres() -> SmallGrid {
    let links = (0..18).map(|link| if link % 3 == 2 { -1 } else { link / 3 * 2 + link % 3 });
    let mut grid = plenoxels();
    grid.arrays.extend([
        ("background_links", vec![6, 3], Values::I32(links.collect())),
        ("background_data", vec![12, 4, 4], random(5, 192, -2.0, 20.0)),
    ]);
    grid
}

/// The rows of [`plenoxels`] as PeRFception's checkpoints hold them, in 16 x 16 x 16 cells.
pub fn lightning() -> SmallGrid {
    let mut random = Random::new(12);
    let cells = (0..30).map(|row| 4000 - 97 * row).collect();
    let codes = (0..360).map(|_| random.below(256) as u8).collect();
    SmallGrid {
        arrays: vec![
            ("state_dict.model.links_idx", vec![30], Values::I32(cells)),
            ("state_dict.model.density_data", vec![30, 1], self::random(1, 30, -4.0, 12.0)),
            ("state_dict.model.sh_data", vec![30, 12], Values::U8(codes)),
            ("model.sh_data_min", vec![1, 12], Values::F32(vec![-1.0; 12])),
            ("model.sh_data_scale", vec![1, 12], Values::F32(vec![0.0078125; 12])),
        ],
        settings: Vec::new(),
    }
}

/// The same with the background of [`spheres`], quantized.
pub fn lightning_spheres() -> SmallGrid {
    let mut random = Random::new(13);
    let codes = (0..192).map(|_| random.below(256) as u8).collect();
    let mut grid = lightning();
    let links = spheres().arrays.into_iter().find(|array| array.0 == "background_links");
    let (_, shape, values) = links.expect("links");
    grid.arrays.extend([
        ("state_dict.model.background_links", shape, values),
        ("state_dict.model.background_data", vec![12, 4, 4], Values::U8(codes)),
        ("model.background_data_min", vec![1, 4, 4], Values::F32(vec![-2.0; 16])),
        ("model.background_data_scale", vec![1, 4, 4], Values::F32(vec![0.0625; 16])),
    ]);
    grid
}

/// 5 x 4 x 3 nodes of sampled arrays.
pub fn sampled() -> SmallGrid {
    SmallGrid {
        arrays: vec![
            ("density", vec![5, 4, 3], random(3, 60, -4.0, 12.0)),
            ("sh", vec![5, 4, 3, 3, 4], random(4, 720, -1.0, 1.0)),
            ("aabb", vec![2, 3], Values::F32(vec![-1.0, -0.8, -0.6, 1.0, 0.8, 0.6])),
        ],
        settings: vec![("clamp", "sigmoid"), ("offset", "0"), ("stepsize", "0.25")],
    }
}

/// Two blocks of 2 nodes a side, of plain colours.
pub fn sampled_blocks() -> SmallGrid {
    SmallGrid {
        arrays: vec![
            ("density", vec![2, 2, 2, 2], random(5, 16, 0.0, 12.0)),
            ("color", vec![2, 2, 2, 2, 3], random(6, 48, 0.0, 1.0)),
            ("blocks", vec![2, 3], Values::I32(vec![0, 0, 0, 1, 1, 0])),
            ("aabb", vec![2, 3], Values::F32(vec![-1.0, -1.0, -1.0, 1.0, 1.0, 1.0])),
        ],
        settings: vec![("block_size", "2"), ("background", "0, 0.5, 1")],
    }
}

/// The children of a root and of two of its cells.
fn children() -> Values {
    let mut children = vec![0; 24];
    (children[1], children[6]) = (1, 2);
    Values::I32(children)
}

/// Three nodes, harmonics of degree 1.
pub fn plenoctree() -> SmallGrid {
    SmallGrid {
        arrays: vec![
            ("child", vec![3, 2, 2, 2], children()),
            ("data", vec![3, 2, 2, 2, 13], random(7, 312, -1.0, 6.0)),
            ("invradius3", vec![3], Values::F32(vec![0.5, 0.4, 0.6])),
            ("offset", vec![3], Values::F32(vec![0.5, 0.5, 0.4])),
        ],
        settings: vec![("data_format", "SH4")],
    }
}

/// The same with two spherical Gaussians.
pub fn gaussians() -> SmallGrid {
    let mut grid = plenoctree();
    grid.arrays[1] = ("data", vec![3, 2, 2, 2, 7], random(8, 168, -1.0, 6.0));
    let extra = vec![1.0, 0.0, 0.6, 0.8, 0.5, 1.0, 0.0, 0.0];
    grid.arrays.push(("extra_data", vec![2, 4], Values::F32(extra)));
    grid.settings = vec![("data_format", "SG2")];
    grid
}

/// The same with one function as it is and three from code books.
pub fn quantized() -> SmallGrid {
    let mut grid = plenoctree();
    let entries = (0..72).map(|cell| cell % 5).collect();
    grid.arrays.splice(
        1..2,
        [
            ("sigma", vec![3, 2, 2, 2], random(9, 24, -3.0, 9.0)),
            ("quant_colors", vec![3, 5, 3], random(10, 45, -1.0, 1.0)),
            ("quant_map", vec![3, 3, 2, 2, 2], Values::U16(entries)),
            ("data_retained", vec![1, 3, 2, 2, 2, 3], random(11, 72, -1.0, 1.0)),
        ],
    );
    grid
}

impl SmallGrid {
    /// An array, to be changed.
    pub fn array(&mut self, name: &str) -> &mut (&'static str, Vec<usize>, Values) {
        self.arrays.iter_mut().find(|array| array.0 == name).expect("such an array")
    }

    /// The file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut header = Map::new();
        let texts = self.settings.iter().map(|&(key, text)| (key.to_owned(), Value::from(text)));
        header.insert("__metadata__".to_owned(), Value::Object(texts.collect()));
        let mut data: Vec<u8> = Vec::new();
        for (name, shape, values) in &self.arrays {
            let start = data.len();
            let (dtype, bytes) = values.bytes();
            data.extend(bytes);
            let entry =
                json!({ "dtype": dtype, "shape": shape, "data_offsets": [start, data.len()] });
            header.insert((*name).to_owned(), entry);
        }
        let mut text = Value::Object(header).to_string().into_bytes();
        text.resize(text.len().next_multiple_of(8), b' ');
        [&(text.len() as u64).to_le_bytes()[..], &text, &data].concat()
    }
}
