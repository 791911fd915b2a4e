//! Rendered frames as pictures.

use crate::base::error::Result;
use crate::picture::{self, Samples};
use crate::view::render::Frame;

/// 8-bit values as in training: clamped, times 255, rounded to nearest.
fn byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// Three bytes per pixel, over the background.
pub fn rgb8(frame: &Frame) -> Vec<u8> {
    frame.color.as_flattened().iter().map(|&value| byte(value)).collect()
}

/// Four bytes per pixel: colours without the background, not premultiplied.
pub fn rgba8(frame: &Frame, background: [f32; 3]) -> Vec<u8> {
    let pixels = frame.color.iter().zip(&frame.transmittance);
    let pixel = |(color, &left): (&[f32; 3], &f32)| {
        let opacity = 1.0 - left;
        let own = |channel: usize| match opacity > 0.0 {
            true => byte((color[channel] - left * background[channel]) / opacity),
            false => 0,
        };
        let alpha = byte(opacity);
        // A fully transparent pixel has no colour.
        if alpha == 0 { [0; 4] } else { [own(0), own(1), own(2), alpha] }
    };
    pixels.flat_map(pixel).collect()
}

/// A PNG, over the background or without it.
pub fn png(frame: &Frame, without_background: Option<[f32; 3]>) -> Result<Vec<u8>> {
    let values = match without_background {
        Some(background) => rgba8(frame, background),
        None => rgb8(frame),
    };
    picture::png(frame.width, frame.height, &values)
}

/// An EXR of colour over the background, opacity, distance and level.
pub fn exr(frame: &Frame) -> Result<Vec<u8>> {
    let color = |channel: usize| frame.color.iter().map(|pixel| pixel[channel]).collect();
    let opacity = frame.transmittance.iter().map(|left| 1.0 - left).collect();
    let channels: [(&str, Vec<f32>); 6] = [
        ("R", color(0)),
        ("G", color(1)),
        ("B", color(2)),
        ("A", opacity),
        ("Z", frame.distance.clone()),
        ("L", frame.level.clone()),
    ];
    let channels = channels.into_iter().map(|(name, values)| (name.to_owned(), values)).collect();
    picture::exr(frame.width, frame.height, channels, Samples::Single)
}

/// A PNG of all scales side by side, each enlarged to the first one's height without smoothing.
pub fn contact_sheet(frames: &[Frame]) -> Result<Vec<u8>> {
    let height = frames.iter().map(|frame| frame.height).max().unwrap_or(1);
    let zoom = |frame: &Frame| (height / frame.height).max(1);
    let width: usize = frames.iter().map(|frame| frame.width * zoom(frame)).sum();
    let mut sheet = vec![255; 3 * width * height];
    let mut left = 0;
    for frame in frames {
        let (zoom, pixels) = (zoom(frame), rgb8(frame));
        for y in 0..height.min(frame.height * zoom) {
            for x in 0..frame.width * zoom {
                let from = 3 * (y / zoom * frame.width + x / zoom);
                let to = 3 * (y * width + left + x);
                sheet[to..to + 3].copy_from_slice(&pixels[from..from + 3]);
            }
        }
        left += frame.width * zoom;
    }
    picture::png(width, height, &sheet)
}
