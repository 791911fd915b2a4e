//! Distances to the nearest macro cell of a kind.

/// The Chebyshev distance of each cell from the nearest marked one, in cells, up to 255.
pub(super) fn distances(marked: Vec<bool>, counts: [usize; 3]) -> Vec<u8> {
    let mut distances: Vec<u8> =
        marked.into_iter().map(|marked| if marked { 0 } else { 255 }).collect();
    // One sweep from each end, over the 13 visited neighbours, is exact for this metric.
    sweep(&mut distances, counts);
    distances.reverse();
    sweep(&mut distances, counts);
    distances.reverse();
    distances
}

fn sweep(distances: &mut [u8], [nx, ny, nz]: [usize; 3]) {
    let mut least = vec![255u8; nz];
    for row in 0..nx * ny {
        let (x, y) = (row / ny, row % ny);
        least.fill(255);
        let below = (y.saturating_sub(1)..(y + 2).min(ny)).map(|y| (x.wrapping_sub(1), y));
        let beside = (y > 0).then(|| (x, y.wrapping_sub(1)));
        let (passed, own) = distances.split_at_mut(row * nz);
        for (x, y) in below.filter(|_| x > 0).chain(beside) {
            let neighbour = &passed[(x * ny + y) * nz..][..nz];
            least.iter_mut().zip(neighbour).for_each(|(least, &far)| *least = far.min(*least));
        }
        let own = &mut own[..nz];
        for (z, distance) in own.iter_mut().enumerate() {
            let around = &least[z.saturating_sub(1)..(z + 2).min(nz)];
            let nearest = around.iter().copied().min().unwrap_or(255);
            *distance = nearest.saturating_add(1).min(*distance);
        }
        for z in 1..nz {
            own[z] = own[z].min(own[z - 1].saturating_add(1));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_to_the_nearest_marked_cell() {
        let counts = [5, 4, 7];
        let place = |i: usize| [i / 28, i / 7 % 4, i % 7];
        for marked in [vec![], vec![0], vec![139], vec![30, 77], vec![6, 64, 120]] {
            let cells = (0..140).map(|i| marked.contains(&i)).collect();
            for (i, got) in distances(cells, counts).into_iter().enumerate() {
                let distance = |&other: &usize| {
                    let (a, b) = (place(i), place(other));
                    (0..3).map(|axis| a[axis].abs_diff(b[axis])).max()
                };
                let want = marked.iter().filter_map(distance).min().unwrap_or(255);
                assert_eq!(usize::from(got), want, "cell {i} of {marked:?}");
            }
        }
    }
}
