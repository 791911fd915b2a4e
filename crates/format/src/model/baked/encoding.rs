//! Encodings: values to codes and back.
//!
//! ```text
//! u8, u16:  x = code - 2^(bits - 1),  value = center + x * (step + curve * (x * x))
//!           each operation rounded to f32, innermost first;
//!           where code 0 stands for emptiness, it decodes to `empty` instead
//! f16, f32: value = the number itself
//! ```
//!
//! Codes are dense around `center`, where an activation is steep, and sparse towards the ends,
//! where only proportions matter: a surface lies where interpolation between a node inside and one
//! far outside crosses the visible range.

use std::ops::RangeInclusive;

use super::generated::Encoding;
use crate::model::anisotropy::ANISOTROPY;
use crate::model::directional::DIRECTIONAL;
use crate::model::generated::NumberType;

/// Number of groups.
pub const GROUPS: usize = 8;

/// Values that share an encoding and a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// Density, one channel.
    Density,
    /// Diffuse colour, three channels.
    Diffuse,
    /// Specular features.
    Features,
    /// Coefficients of one band of harmonics, 1 to 3.
    Band(usize),
    /// Directional brightness of coarser levels: three channels.
    Directional,
    /// Anisotropy of coarser levels' density: five channels.
    Anisotropy,
}

/// A node's values other than density.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ColorLayout {
    /// Number of specular features; 0 with harmonics.
    pub features: usize,
    /// The highest band of harmonics; 0 without them.
    pub degree: usize,
    /// True if a level has directional brightness.
    pub directional: bool,
    /// True if a level has anisotropy, which is not a colour, but is stored after the colours.
    pub anisotropy: bool,
}

impl ColorLayout {
    /// Number of colour channels of a node.
    pub fn color_channels(self) -> usize {
        Group::COLORS.into_iter().map(|group| group.channels(self)).sum()
    }
}

impl Group {
    /// Every group, in the order of a level's chunks.
    pub const ALL: [Self; GROUPS] = [
        Self::Density,
        Self::Diffuse,
        Self::Features,
        Self::Band(1),
        Self::Band(2),
        Self::Band(3),
        Self::Directional,
        Self::Anisotropy,
    ];

    /// The groups of colour, which blocks can inherit.
    pub const COLORS: [Self; GROUPS - 2] = [
        Self::Diffuse,
        Self::Features,
        Self::Band(1),
        Self::Band(2),
        Self::Band(3),
        Self::Directional,
    ];

    /// Its name in metadata and in unpacked files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Density => "density",
            Self::Diffuse => "diffuse",
            Self::Features => "features",
            Self::Band(1) => "band_1",
            Self::Band(2) => "band_2",
            Self::Band(_) => "band_3",
            Self::Directional => "directional",
            Self::Anisotropy => "anisotropy",
        }
    }

    /// Channels of a node.
    pub const fn channels(self, layout: ColorLayout) -> usize {
        match self {
            Self::Density => 1,
            Self::Diffuse => 3,
            Self::Features => layout.features,
            Self::Band(band) if band <= layout.degree => 3 * (2 * band + 1),
            Self::Directional if layout.directional => DIRECTIONAL,
            Self::Anisotropy if layout.anisotropy => ANISOTROPY,
            Self::Band(_) | Self::Directional | Self::Anisotropy => 0,
        }
    }

    /// Its place in [`Self::ALL`].
    pub const fn index(self) -> usize {
        match self {
            Self::Density => 0,
            Self::Diffuse => 1,
            Self::Features => 2,
            Self::Band(band) => 2 + band,
            Self::Directional => GROUPS - 2,
            Self::Anisotropy => GROUPS - 1,
        }
    }

    /// True for one of [`Self::COLORS`]: otherwise the values are densities.
    pub const fn is_color(self) -> bool {
        !matches!(self, Self::Density | Self::Anisotropy)
    }

    /// True if the values are coefficients of functions of the view direction, which change with a
    /// rotation.
    pub const fn is_directional(self) -> bool {
        matches!(self, Self::Band(_) | Self::Directional | Self::Anisotropy)
    }
}

impl NumberType {
    /// Bytes of one code.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::F16 => 2,
            Self::F32 => 4,
        }
    }

    /// True if codes are numbers themselves.
    pub const fn is_float(self) -> bool {
        matches!(self, Self::F16 | Self::F32)
    }
}

impl Encoding {
    /// The highest integer code.
    pub fn last_code(&self) -> u32 {
        (1 << self.bits) - 1
    }

    /// The largest error of values that are moved by up to `moved` after encoding, rounded up.
    pub fn error_after(&self, moved: f64) -> f32 {
        if moved > 0.0 {
            ((f64::from(self.max_error) + moved) * (1.0 + 1e-6)) as f32
        } else {
            self.max_error
        }
    }

    /// The valid codes: those that `bits` can hold, or those of finite floats.
    pub fn codes(&self) -> RangeInclusive<u32> {
        match self.number {
            NumberType::U8 | NumberType::U16 => 0..=self.last_code(),
            NumberType::F16 => 0x0400..=0xfbff,
            NumberType::F32 => 0x0080_0000..=0xff7f_ffff,
        }
    }

    /// The values of all integer codes, lowest first; ascending in every valid encoding.
    pub fn values(&self) -> impl Iterator<Item = f32> {
        (0..=self.last_code()).map(|code| self.value(code))
    }

    /// The value of an integer code.
    pub fn value(&self, code: u32) -> f32 {
        if self.empty_code && code == 0 {
            return self.empty;
        }
        let x = code as f32 - (1u32 << (self.bits - 1)) as f32;
        self.center + x * (self.step + self.curve * (x * x))
    }
}
