//! Figures for the distance of pictures, against scikit-image.

use crate::common::{fixture, tensor_values};
use mipvog::base::limits::Limits;
use mipvog::view::compare::Picture;
use mipvog::view::compare::metrics::ssim;
use mipvog_inputs::tensor;

#[test]
fn structural_similarity_equals_that_of_scikit_image() {
    let file = tensor::open(&fixture("golden/ssim.safetensors"), &Limits::default());
    let file = file.expect("vectors");
    for (name, width, height) in [("odd", 37, 29), ("wide", 40, 12), ("window", 11, 11)] {
        let values =
            |part: &str| tensor_values(&file, &format!("{name}.{part}")).expect("a vector");
        let picture = |part: &str| {
            let color = values(part).as_chunks::<3>().0.to_vec();
            assert_eq!(color.len(), width * height);
            Picture { width, height, color, diffuse: None, opacity: None, level: None }
        };
        let want = f64::from(values("ssim")[0]);
        let got = ssim(&picture("want"), &picture("got")).expect("large enough");
        // The vector is a float32; both sides sum in float64.
        assert!((got - want).abs() <= 1e-6, "{name}: {got} for {want}");
        // The test would be worth nothing if every pair were alike.
        assert!(want < 0.98, "{name}: {want}");
    }
}
