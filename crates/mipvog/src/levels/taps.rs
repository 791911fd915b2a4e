//! One axis of a level step: for each output node, weights of consecutive input nodes.
//!
//! Output node `o` of `M` lies at `u = o * (N - 1) / (M - 1)` among `N` input nodes. With
//! `i = floor(u)` and `f = u - i`, the resize is `(1 - f) * P[i] + f * P[i + 1]` where the low-pass
//! is `P[i] = sum_j w[j] * V[mirror(i + j)]`. Both together read `radius` nodes to either side, and
//! nodes that the mirror folds back lie in the same range, so each output node has one window.

use crate::model::grid::row;

/// Weights of one axis. All windows have the same length; unused weights are zero.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisTaps {
    inputs: usize,
    width: usize,
    first: Vec<usize>,
    weights: Vec<f64>,
    /// The output nodes `start..end` that read each input node.
    readers: Vec<(usize, usize)>,
}

impl AxisTaps {
    /// From `inputs` nodes to `outputs` through the low-pass `kernel` (odd, centred), both at
    /// least 2.
    pub fn new(inputs: usize, outputs: usize, kernel: &[f64]) -> Self {
        let radius = kernel.len() / 2;
        let width = (kernel.len() + 1).min(inputs);
        let mut first = Vec::with_capacity(outputs);
        let mut weights = vec![0.0; outputs * width];
        for output in 0..outputs {
            let numerator = output * (inputs - 1);
            let low = numerator / (outputs - 1);
            let fraction = (numerator % (outputs - 1)) as f64 / (outputs - 1) as f64;
            let start = low.saturating_sub(radius).min(inputs - width);
            first.push(start);
            for (node, share) in [(low, 1.0 - fraction), (low + 1, fraction)] {
                for (tap, weight) in kernel.iter().enumerate().filter(|_| share > 0.0) {
                    let input = mirror((node + tap) as isize - radius as isize, inputs);
                    weights[output * width + input - start] += share * weight;
                }
            }
        }
        let readers = |input: usize| {
            let start = first.partition_point(|first| first + width <= input);
            (start, first.partition_point(|&first| first <= input))
        };
        let readers = (0..inputs).map(readers).collect();
        Self { inputs, width, first, weights, readers }
    }

    /// Nodes of the axis before the step.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Nodes of the axis after the step.
    pub fn outputs(&self) -> usize {
        self.first.len()
    }

    /// The first input node of an output node's window, and the weights from there.
    pub fn window(&self, output: usize) -> (usize, &[f64]) {
        (self.first[output], &self.weights[output * self.width..][..self.width])
    }

    /// Weighted sums for the output nodes from `start` on; `inputs` are those of the input nodes
    /// from `first` on, as far as [`AxisTaps::inputs_of`] says.
    pub fn apply(&self, inputs: &[f64], first: usize, start: usize, outputs: &mut [f32]) {
        match self.width {
            2 => self.apply_windows::<2>(inputs, first, start, outputs),
            4 => self.apply_windows::<4>(inputs, first, start, outputs),
            6 => self.apply_windows::<6>(inputs, first, start, outputs),
            _ => {
                for (output, out) in (start..).zip(outputs) {
                    let (at, weights) = self.window(output);
                    *out = weighted_sum(&inputs[at - first..], weights) as f32;
                }
            }
        }
    }

    /// The same where the width is known: loops over it unroll.
    fn apply_windows<const WIDTH: usize>(
        &self,
        inputs: &[f64],
        first: usize,
        start: usize,
        outputs: &mut [f32],
    ) {
        let weights = &self.weights.as_chunks::<WIDTH>().0[start..];
        for ((&at, weights), out) in self.first[start..].iter().zip(weights).zip(outputs) {
            *out = weighted_sum(&inputs[at - first..at - first + WIDTH], weights) as f32;
        }
    }

    /// Input nodes `start..end` that the output nodes `start..end` read.
    pub fn inputs_of(&self, start: usize, end: usize) -> (usize, usize) {
        (self.first[start], self.first[end - 1] + self.width)
    }

    /// The same, extended so that loops over them are whole vectors.
    pub fn padded_inputs_of(&self, start: usize, end: usize) -> (usize, usize) {
        let (low, high) = self.inputs_of(start, end);
        (low, (low + (high - low).next_multiple_of(row::LANES)).min(self.inputs))
    }

    /// Output nodes `start..end` that read input node `input`.
    pub fn readers(&self, input: usize) -> (usize, usize) {
        self.readers[input]
    }

    /// Output nodes whose whole window lies below input node `end`.
    pub fn ready(&self, end: usize) -> usize {
        self.first.partition_point(|first| first + self.width <= end)
    }

    /// Adds to `outputs` every output node that reads a set input node; rows of bits.
    pub fn add_outputs(&self, inputs: &[u64], outputs: &mut [u64]) {
        for (start, end) in row::runs(inputs) {
            row::set_between(outputs, self.readers(start).0, self.readers(end - 1).1);
        }
    }

    /// Adds to `inputs` every input node that a set output node reads; rows of bits.
    pub fn add_inputs(&self, outputs: &[u64], inputs: &mut [u64]) {
        for (start, end) in row::runs(outputs) {
            let (start, end) = self.inputs_of(start, end);
            row::set_between(inputs, start, end);
        }
    }
}

#[inline(always)]
fn weighted_sum(values: &[f64], weights: &[f64]) -> f64 {
    values.iter().zip(weights).fold(0.0, |sum, (value, weight)| sum + weight * value)
}

/// Reflects a node number at the ends `0` and `count - 1`, without repeating them.
fn mirror(node: isize, count: usize) -> usize {
    let period = 2 * (count as isize - 1);
    let folded = node.rem_euclid(period);
    folded.min(period - folded) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::levels::Kernel;

    #[test]
    fn mirrors_repeat() {
        let folded: Vec<usize> = (-7..8).map(|node| mirror(node, 4)).collect();
        assert_eq!(folded, [1, 0, 1, 2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0, 1]);
        assert_eq!([-3, -2, -1, 0, 1, 2].map(|node| mirror(node, 2)), [1, 0, 1, 0, 1, 0]);
    }

    #[test]
    fn windows_hold_every_weight_and_sum_to_one() {
        for kernel in Kernel::ALL {
            let weights = kernel.weights();
            for inputs in 2..40 {
                let outputs = (inputs / 2).max(2);
                let taps = AxisTaps::new(inputs, outputs, &weights);
                for output in 0..outputs {
                    let (start, window) = taps.window(output);
                    assert!(start + window.len() <= inputs);
                    assert!((window.iter().sum::<f64>() - 1.0).abs() < 1e-15);
                }
            }
        }
    }

    #[test]
    fn readers_and_inputs_are_inverse() {
        for inputs in 2..40 {
            let taps = AxisTaps::new(inputs, (inputs / 2).max(2), &Kernel::Mean5.weights());
            for input in 0..inputs {
                let (start, end) = taps.readers(input);
                for output in 0..taps.outputs() {
                    let (low, high) = taps.inputs_of(output, output + 1);
                    let reads = (low..high).contains(&input);
                    assert_eq!(reads, (start..end).contains(&output), "{inputs} {input} {output}");
                }
            }
            assert_eq!((taps.ready(0), taps.ready(inputs)), (0, taps.outputs()));
        }
    }
}
