//! The losses of all edges, to a quarter of an octave.

/// Losses in the order of edges.
pub(super) struct Losses {
    /// Upper bits: non-negative floats sort like their bits.
    classes: Vec<u16>,
    /// Edges of each class.
    counts: Vec<usize>,
}

/// Sign, exponent and two bits of the mantissa.
const BITS: u32 = 14;

impl Default for Losses {
    fn default() -> Self {
        Self { classes: Vec::new(), counts: vec![0; 1 << BITS] }
    }
}

impl Losses {
    /// Adds the loss of the next edge, not negative.
    pub(super) fn add(&mut self, loss: f64) {
        let class = (loss.to_bits() >> (u64::BITS - BITS)) as u16;
        self.classes.push(class);
        self.counts[usize::from(class)] += 1;
    }

    /// For each edge, true if it is among those with the least losses: more than `least`, and
    /// about `wanted`.
    pub(super) fn cheapest(&self, least: usize, wanted: usize) -> impl Iterator<Item = bool> {
        let (mut sum, mut limit) = (0, 0);
        for (class, count) in (0u16..).zip(&self.counts).filter(|(_, count)| **count > 0) {
            if sum > least && sum + count > wanted {
                break;
            }
            (sum, limit) = (sum + count, class);
        }
        self.classes.iter().map(move |class| *class <= limit)
    }
}
