//! The low-pass before a level is halved.

/// A separable low-pass. Source: the paper's ablation over mean and gaussian filters of 3, 5 and 7
/// nodes and none; the gaussians' widths are those of the tests' oracle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kernel {
    /// Resize only.
    None,
    /// Mean of 3 nodes along each axis.
    Mean3,
    /// Mean of 5.
    Mean5,
    /// Mean of 7.
    Mean7,
    /// Gaussian over 3 nodes, standard deviation 0.8.
    Gauss3,
    /// Gaussian over 5 nodes, standard deviation 1.
    Gauss5,
    /// Gaussian over 7 nodes, standard deviation 1.5.
    Gauss7,
    /// Weights 1, 4, 1: a tent from a node to the next, over interpolated values.
    Tent,
}

impl Kernel {
    /// Every kernel of the paper's ablation.
    pub const ALL: [Self; 7] = [
        Self::None,
        Self::Mean3,
        Self::Mean5,
        Self::Mean7,
        Self::Gauss3,
        Self::Gauss5,
        Self::Gauss7,
    ];

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Mean3 => "mean3",
            Self::Mean5 => "mean5",
            Self::Mean7 => "mean7",
            Self::Gauss3 => "gauss3",
            Self::Gauss5 => "gauss5",
            Self::Gauss7 => "gauss7",
            Self::Tent => "tent",
        }
    }

    /// Weights along one axis: an odd number of centred weights, which sum to 1.
    pub fn weights(self) -> Vec<f64> {
        let gauss = |radius: i32, deviation: f64| {
            let falloff = |at: i32| {
                let distance = f64::from(at) / deviation;
                libm::exp(-0.5 * distance * distance)
            };
            let sum: f64 = (-radius..=radius).map(falloff).sum();
            (-radius..=radius).map(|at| falloff(at) / sum).collect()
        };
        match self {
            Self::None => vec![1.0],
            Self::Mean3 => vec![1.0 / 3.0; 3],
            Self::Mean5 => vec![1.0 / 5.0; 5],
            Self::Mean7 => vec![1.0 / 7.0; 7],
            Self::Gauss3 => gauss(1, 0.8),
            Self::Gauss5 => gauss(2, 1.0),
            Self::Gauss7 => gauss(3, 1.5),
            Self::Tent => vec![1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0],
        }
    }
}
