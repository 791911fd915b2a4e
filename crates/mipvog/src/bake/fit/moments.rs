//! The step of a number from its derivatives so far (Adam, Kingma and Ba 2015).

/// The final step length, as a fraction of the initial one.
const LAST_RATE: f32 = 0.1;
/// Decay of the running means of derivatives and of their squares.
const DECAYS: [f32; 2] = [0.9, 0.98];

/// Running means of a derivative and of its square.
#[derive(Debug, Clone, Copy, Default)]
pub struct Means([f32; 2]);

impl Means {
    /// Updates the means with a derivative, and returns the step. Derivatives far below `least`
    /// count as noise.
    #[inline]
    pub fn advance(&mut self, derivative: f32, lacks: [f32; 2], [rate, least]: [f32; 2]) -> f32 {
        let [mean, square] = &mut self.0;
        *mean += (1.0 - DECAYS[0]) * (derivative - *mean);
        *square += (1.0 - DECAYS[1]) * (derivative * derivative - *square);
        rate * (*mean / lacks[0]) / ((*square / lacks[1]).sqrt() + least)
    }
}

/// The bias correction of running means after this many steps, because they start at 0.
pub fn lacks(steps: u32) -> [f32; 2] {
    DECAYS.map(|decay| 1.0 - libm::powf(decay, steps as f32))
}

/// The current fraction of the initial step lengths; falls linearly to its final value.
pub fn fade(progress: f32) -> f32 {
    1.0 + (LAST_RATE - 1.0) * progress
}
