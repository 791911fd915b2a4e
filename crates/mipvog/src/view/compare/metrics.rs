//! Error metrics for two pictures with values from 0 to 1.

use crate::base::parallel;
use crate::picture::box_means;

/// A picture, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Colour over the background.
    pub color: Vec<[f32; 3]>,
    /// Colour without its view-dependent part, if known.
    pub diffuse: Option<Vec<[f32; 3]>>,
    /// Opacity, if known.
    pub opacity: Option<Vec<f32>>,
    /// Mean level of the samples, weighted by their share of the picture. `None` for blank pictures
    /// and photographs.
    pub level: Option<f64>,
}

impl Picture {
    /// True if the picture is blank: fully transparent.
    pub fn is_blank(&self) -> bool {
        self.opacity.as_ref().is_some_and(|all| all.iter().all(|opacity| *opacity == 0.0))
    }
}

/// The PSNR of identical pictures. A mean squared error below 1e-20 counts as 0.
const HIGHEST_PSNR: f64 = 200.0;
/// Standard deviation of the window of structural similarity, in pixels.
const WINDOW_DEVIATION: f64 = 1.5;
/// Radius of the window in pixels, without the centre.
const WINDOW_RADIUS: usize = 5;
/// Number of bins of the histogram of errors from 0 to 1.
const BINS: usize = 1 << 16;

/// The sum of all squared differences.
pub fn square_error(want: &[f32], got: &[f32]) -> f64 {
    let pairs = want.iter().zip(got);
    pairs.map(|(want, got)| (f64::from(*want) - f64::from(*got)).powi(2)).sum()
}

/// PSNR in dB, `-10 log10(mean squared error)`, from the sum of `count` squared errors.
pub fn psnr_of(square_error: f64, count: usize) -> f64 {
    let mean = square_error / count.max(1) as f64;
    if mean < 1e-20 { HIGHEST_PSNR } else { -10.0 * libm::log10(mean) }
}

/// PSNR in dB, `-10 log10(mean squared error)`.
pub fn psnr(want: &[f32], got: &[f32]) -> f64 {
    psnr_of(square_error(want, got), want.len())
}

/// Structural similarity (Wang et al. 2004): Gaussian window of 11 x 11 pixels with standard
/// deviation 1.5, population covariance, constants 0.01 and 0.03, data range 1. The result is the
/// mean over the channels and over the pixels whose window lies inside the picture. `None` if there
/// is no such pixel.
pub fn ssim(want: &Picture, got: &Picture) -> Option<f64> {
    let (width, height) = (want.width, want.height);
    let window = 2 * WINDOW_RADIUS + 1;
    if width < window || height < window {
        return None;
    }
    let channels = parallel::map(3, |channel| {
        let values = |picture: &Picture| -> Vec<f64> {
            picture.color.iter().map(|pixel| pixel[channel].into()).collect()
        };
        Ok(channel_ssim(&values(want), &values(got), width, height))
    });
    channels.ok().map(|means| means.iter().sum::<f64>() / 3.0)
}

fn channel_ssim(a: &[f64], b: &[f64], width: usize, height: usize) -> f64 {
    let product =
        |x: &[f64], y: &[f64]| -> Vec<f64> { x.iter().zip(y).map(|(x, y)| x * y).collect() };
    let blur = |values: &[f64]| blurred(values, width, height);
    let (mean_a, mean_b) = (blur(a), blur(b));
    let (aa, bb, ab) = (blur(&product(a, a)), blur(&product(b, b)), blur(&product(a, b)));
    let (c1, c2) = (0.01f64.powi(2), 0.03f64.powi(2));
    let similarity = |i: usize| {
        let (ma, mb) = (mean_a[i], mean_b[i]);
        let (va, vb, vab) = (aa[i] - ma * ma, bb[i] - mb * mb, ab[i] - ma * mb);
        ((2.0 * ma * mb + c1) * (2.0 * vab + c2)) / ((ma * ma + mb * mb + c1) * (va + vb + c2))
    };
    (0..mean_a.len()).map(similarity).sum::<f64>() / mean_a.len() as f64
}

/// The window's weighted mean, at each pixel whose window lies inside the picture.
fn blurred(values: &[f64], width: usize, height: usize) -> Vec<f64> {
    let falloff = |at: usize| {
        let distance = (at as f64 - WINDOW_RADIUS as f64) / WINDOW_DEVIATION;
        libm::exp(-0.5 * distance * distance)
    };
    let weights: Vec<f64> = (0..=2 * WINDOW_RADIUS).map(falloff).collect();
    let sum: f64 = weights.iter().sum();
    let (inner_width, inner_height) = (width - 2 * WINDOW_RADIUS, height - 2 * WINDOW_RADIUS);
    let mut rows = Vec::with_capacity(inner_width * height);
    for row in values.chunks_exact(width) {
        for window in row.windows(weights.len()) {
            rows.push(window.iter().zip(&weights).map(|(v, w)| v * w).sum::<f64>() / sum);
        }
    }
    let mut means = Vec::with_capacity(inner_width * inner_height);
    for y in 0..inner_height {
        for x in 0..inner_width {
            let column =
                weights.iter().enumerate().map(|(i, w)| rows[(y + i) * inner_width + x] * w);
            means.push(column.sum::<f64>() / sum);
        }
    }
    means
}

/// The distribution of absolute errors.
#[derive(Debug, Clone)]
pub struct Errors {
    histogram: Vec<u64>,
    largest: f64,
}

impl Default for Errors {
    fn default() -> Self {
        Self { histogram: vec![0; BINS + 1], largest: 0.0 }
    }
}

impl Errors {
    /// Adds the differences of two lists.
    pub fn add(&mut self, want: &[f32], got: &[f32]) {
        for (want, got) in want.iter().zip(got) {
            let error = (f64::from(*want) - f64::from(*got)).abs().min(1.0);
            self.largest = self.largest.max(error);
            // Rounded up, so that quantiles are never too low.
            self.histogram[(error * BINS as f64).ceil() as usize] += 1;
        }
    }

    /// The largest error.
    pub fn largest(&self) -> f64 {
        self.largest
    }

    /// The quantile of errors at this share, at most 2^-16 too large.
    pub fn quantile(&self, share: f64) -> f64 {
        let total: u64 = self.histogram.iter().sum();
        let mut left = (total as f64 * share).ceil();
        for (bin, &count) in self.histogram.iter().enumerate() {
            left -= count as f64;
            if left <= 0.0 {
                return (bin as f64 / BINS as f64).min(self.largest);
            }
        }
        self.largest
    }
}

impl Picture {
    /// Memory of the pixels in bytes.
    pub fn bytes(&self) -> u64 {
        let colors = self.color.len() + self.diffuse.as_ref().map_or(0, Vec::len);
        (12 * colors + 4 * self.opacity.as_ref().map_or(0, Vec::len)) as u64
    }

    /// Averages squares of `scale` by `scale` pixels. The remainder at the right and bottom is
    /// dropped.
    #[must_use]
    pub fn downsampled(&self, scale: usize) -> Self {
        let size = [self.width, self.height];
        let colors = |from: &[[f32; 3]]| -> Vec<[f32; 3]> {
            let [red, green, blue] =
                [0, 1, 2].map(|channel| box_means(size, scale, move |pixel| from[pixel][channel]));
            red.zip(green).zip(blue).map(|((red, green), blue)| [red, green, blue]).collect()
        };
        let opacity = self.opacity.as_ref();
        Self {
            width: self.width / scale,
            height: self.height / scale,
            color: colors(&self.color),
            diffuse: self.diffuse.as_deref().map(colors),
            opacity: opacity.map(|from| box_means(size, scale, |pixel| from[pixel]).collect()),
            level: self.level,
        }
    }

    /// The largest channel error of each pixel as a colour: from black for 0 through red and yellow
    /// to white for `full` and above.
    pub fn heat_map(&self, other: &Self, full: f32) -> Vec<u8> {
        let heat = |(a, b): (&[f32; 3], &[f32; 3])| {
            let error = (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max);
            let level = 3.0 * (error / full).min(1.0);
            [level, level - 1.0, level - 2.0].map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
        };
        self.color.iter().zip(&other.color).flat_map(heat).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: usize, height: usize, value: impl Fn(usize, usize) -> f32) -> Picture {
        let at = |i: usize| [value(i % width, i / width); 3];
        let color = (0..width * height).map(at).collect();
        Picture { width, height, color, diffuse: None, opacity: None, level: None }
    }

    #[test]
    fn equal_pictures_are_as_close_as_can_be() {
        let a = picture(16, 12, |x, y| (x * y % 7) as f32 / 7.0);
        assert_eq!(psnr(a.color.as_flattened(), a.color.as_flattened()), HIGHEST_PSNR);
        assert!((ssim(&a, &a).expect("large enough") - 1.0).abs() < 1e-12);
        assert_eq!(ssim(&picture(10, 40, |_, _| 0.0), &picture(10, 40, |_, _| 0.0)), None);
    }

    #[test]
    fn psnr_and_quantiles_agree_with_their_definitions() {
        let (want, got) = (vec![0.5f32; 1000], vec![0.6f32; 1000]);
        assert!((psnr(&want, &got) - 20.0).abs() < 1e-5);
        let mut errors = Errors::default();
        let ramp: Vec<f32> = (0..1000).map(|i| i as f32 / 1000.0).collect();
        errors.add(&ramp, &vec![0.0; 1000]);
        assert!((errors.quantile(0.99) - 0.989).abs() < 1e-3);
        assert!((errors.largest() - 0.999).abs() < 1e-6);
    }

    #[test]
    fn boxes_are_averaged() {
        let small = picture(5, 4, |x, y| (x + 10 * y) as f32).downsampled(2);
        assert_eq!((small.width, small.height), (2, 2));
        let values: Vec<f32> = small.color.iter().map(|pixel| pixel[0]).collect();
        assert_eq!(values, [5.5, 7.5, 25.5, 27.5]);
    }
}
