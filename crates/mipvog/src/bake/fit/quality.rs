//! Quality of the rays of held-out pictures.
//!
//! Each scale has two numbers. Steps optimize the PSNR of all its rays. Later comparisons of two
//! fields use the mean of its pictures' PSNR. A picture that shows a thin box from its edge counts
//! little in the first and as much as any other in the second. So a fit must not be worse in
//! either.

use super::gradient::Gradient;
use super::target::Windows;
use super::trace::Rays;
use crate::base::error::{Error, Result};
use crate::base::parallel;
use crate::base::progress::Progress;

/// Rays of each scale, a multiple of [`PARTS`].
const RAYS: usize = 2048;
/// Number of parts that are traced in parallel; fixed, so that sums are reproducible.
const PARTS: usize = 8;

/// PSNR of held-out rays, in dB.
#[derive(Debug, Clone)]
pub struct ScaleQuality {
    /// Of each scale: all rays.
    pub psnr: Vec<f64>,
    /// Of each scale: the mean of its pictures.
    of_pictures: Vec<f64>,
}

impl ScaleQuality {
    /// The quality of the field that `rays` pass through.
    ///
    /// # Errors
    /// `Cancelled`.
    pub fn of<const C: usize>(rays: &Rays<C>, progress: &dyn Progress) -> Result<Self> {
        let scales = rays.targets.scales;
        let parts = parallel::map(scales * PARTS, |part| {
            let (scale, share) = (part / PARTS, RAYS / PARTS);
            let mut unused = Gradient::new(&[]);
            let mut squares = Squares::none(rays.targets.pictures);
            for number in part % PARTS * share..(part % PARTS + 1) * share {
                if progress.cancelled() {
                    return Err(Error::cancelled());
                }
                squares.add(rays.square(scale, number, Windows::Validation, &mut unused));
            }
            Ok(squares)
        })?;
        let of_scales: Vec<Squares> = parts.chunks(PARTS).map(Squares::sum).collect();
        let psnr = of_scales.iter().map(Squares::psnr).collect();
        let of_pictures = of_scales.iter().map(Squares::psnr_of_pictures).collect();
        Ok(Self { psnr, of_pictures })
    }

    /// The mean of all scales' PSNR.
    pub fn mean(&self) -> f64 {
        self.psnr.iter().sum::<f64>() / self.psnr.len().max(1) as f64
    }

    /// True if no scale is worse than `other`'s.
    pub fn is_nowhere_below(&self, other: &Self) -> bool {
        let above = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| a >= b);
        above(&self.psnr, &other.psnr) && above(&self.of_pictures, &other.of_pictures)
    }
}

/// Sums of squared errors over three channels.
struct Squares {
    all: f64,
    /// Of each picture, with its rays.
    pictures: Vec<(f64, usize)>,
}

impl Squares {
    fn none(pictures: usize) -> Self {
        Self { all: 0.0, pictures: vec![(0.0, 0); pictures] }
    }

    fn add(&mut self, ray: Option<(usize, f32)>) {
        let Some((picture, square)) = ray else { return };
        let square = f64::from(square);
        self.all += square;
        self.pictures[picture].0 += square;
        self.pictures[picture].1 += 1;
    }

    fn sum(parts: &[Self]) -> Self {
        let mut sum = Self::none(parts[0].pictures.len());
        for part in parts {
            sum.all += part.all;
            for (sum, part) in sum.pictures.iter_mut().zip(&part.pictures) {
                *sum = (sum.0 + part.0, sum.1 + part.1);
            }
        }
        sum
    }

    fn psnr(&self) -> f64 {
        psnr(self.all, RAYS)
    }

    fn psnr_of_pictures(&self) -> f64 {
        let seen = self.pictures.iter().filter(|(_, rays)| *rays > 0);
        let sum: f64 = seen.clone().map(|&(square, rays)| psnr(square, rays)).sum();
        sum / seen.count().max(1) as f64
    }
}

/// PSNR of a sum of squared errors of three channels, in dB.
fn psnr(square: f64, rays: usize) -> f64 {
    -10.0 * libm::log10((square / (3 * rays) as f64).max(1e-12))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quality(rays: &[(usize, f32)]) -> ScaleQuality {
        let mut squares = Squares::none(3);
        rays.iter().for_each(|&ray| squares.add(Some(ray)));
        let parts = Squares::sum(&[squares, Squares::none(3)]);
        ScaleQuality { psnr: vec![parts.psnr()], of_pictures: vec![parts.psnr_of_pictures()] }
    }

    #[test]
    fn a_picture_of_few_rays_counts_as_much_as_one_of_many() {
        let many = |square: f32| vec![(0, square); 100];
        let before = quality(&[many(0.03), vec![(2, 0.0003)]].concat());
        // From 20 and 40 dB to 23 and 30.
        let after = quality(&[many(0.015), vec![(2, 0.003)]].concat());
        assert!((before.of_pictures[0] - 30.0).abs() < 1e-6, "{before:?}");
        assert!((after.of_pictures[0] - 26.505).abs() < 1e-3, "{after:?}");
        assert!(after.psnr[0] > before.psnr[0] + 2.9);
        assert!(!after.is_nowhere_below(&before) && !before.is_nowhere_below(&after));
        assert!(before.is_nowhere_below(&before));
    }

    #[test]
    fn rays_without_a_picture_and_without_an_error_are_counted() {
        let mut none = Squares::none(1);
        none.add(None);
        assert_eq!((none.psnr(), none.psnr_of_pictures()), (120.0, 0.0));
        none.add(Some((0, 0.0)));
        assert_eq!((none.psnr(), none.psnr_of_pictures()), (120.0, 120.0));
    }
}
