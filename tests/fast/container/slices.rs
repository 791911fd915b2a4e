//! Slices of an unpacked container show its stored values.

use crate::common::asset::container;
use crate::common::{folder, unpack};
use mipvog::model::baked::Group;
use mipvog::picture;
use mipvog_outputs::unpack::{SliceFormat, write_slices};

#[test]
fn opacity_of_every_level_is_that_of_its_encoding() {
    // Coarser levels hold the root of the optical depth, opacity, and raw density.
    for name in ["dvgo.mask.mipvog", "dvgo.coverage.mipvog", "tiny.rate.mipvog"] {
        let container = container(name);
        let folder = folder();
        write_slices(&container, &[], SliceFormat::Png, folder.path(), false).expect("slices");
        let metadata = container.metadata();
        let unpacked = unpack(&container).expect("unpacked");
        let mut levels = 0;
        for (number, level) in metadata.levels.iter().enumerate() {
            let Some(encoding) = &level.density else { continue };
            let [nx, ny, nz] = level.dimensions;
            let density = unpacked.level(number, Group::Density);
            for x in 0..nx {
                let path = folder.path().join(format!("level{number}.opacity.x{x:04}.png"));
                let picture = picture::read(&path, 1 << 20).expect("a picture");
                assert_eq!((picture.width, picture.height), (nz, ny), "{name} {number}");
                let pixels = picture.bytes.as_chunks::<4>().0;
                for (pixel, &stored) in pixels.iter().zip(&density[x * ny * nz..]) {
                    let opacity = encoding.decode.activated(stored.into(), &metadata.activation);
                    assert_eq!(pixel[0], (opacity * 255.0 + 0.5) as u8, "{name}: level {number}");
                }
            }
            levels += 1;
        }
        assert!(levels > 1, "{name} has no coarser opacity");
    }
}
