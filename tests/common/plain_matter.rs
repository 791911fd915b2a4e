//! The slow twin of filtering matter, in float64: see the module docs of `mips::matter`.

use mipvog_bake::mips::{Matter, Settled};

use super::plain::{all_nodes, index, opacity, sigmoid};

/// Amounts and weighted colours of level 0's channels, the first of them raw density.
pub fn lift(matter: &Matter, channels: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let shift = f64::from(matter.activation.shift);
    let reach = f64::from(matter.activation.interval) * f64::from(matter.reach);
    let amounts: Vec<f64> = channels[0].iter().map(|&raw| opacity(raw, shift, reach)).collect();
    let weighted = |color: &Vec<f64>| {
        color.iter().zip(&amounts).map(|(&raw, amount)| sigmoid(raw) * amount).collect()
    };
    let colors: Vec<Vec<f64>> = channels[1..].iter().map(weighted).collect();
    [vec![amounts.clone()], colors].concat()
}

/// What a level of `nodes` stores of lifted channels.
pub fn settle(nodes: [usize; 3], matter: &Matter, lifted: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let density = |&amount: &f64| {
        let depth = -(-amount.min(1.0 - 1e-7)).ln_1p() / f64::from(matter.reach);
        match matter.settled {
            Settled::SqrtOpticalDepth => depth.sqrt(),
            Settled::Opacity => -(-depth).exp_m1(),
        }
    };
    let total = |values: &[f64], at: [usize; 3]| {
        let range = |axis: usize| at[axis].saturating_sub(1)..=(at[axis] + 1).min(nodes[axis] - 1);
        let mut near = 0.0;
        for x in range(0) {
            for y in range(1) {
                near += range(2).map(|z| values[index(nodes, [x, y, z])]).sum::<f64>();
            }
        }
        values[index(nodes, at)] + 1e-4 * near
    };
    let color = |weighted: &Vec<f64>| {
        let color = |at| {
            let color = total(weighted, at) / total(&lifted[0], at).max(f64::MIN_POSITIVE);
            let color = color.clamp(1e-7, 1.0 - 1e-7);
            (color / (1.0 - color)).ln()
        };
        all_nodes(nodes).map(color).collect()
    };
    let colors: Vec<Vec<f64>> = lifted[1..].iter().map(color).collect();
    [vec![lifted[0].iter().map(density).collect()], colors].concat()
}
