//! Weighted isotonic regression: the best that any sum of hemi-EPD lobes could do, since each falls with theta_h.

/// Non-increasing values nearest to `y` in weighted least squares (pool adjacent violators).
#[must_use]
pub fn decreasing(y: &[f64], weight: &[f64]) -> Vec<f64> {
    // Blocks of (mean, weight, length)
    let mut blocks: Vec<(f64, f64, usize)> = Vec::with_capacity(y.len());
    for (&y, &w) in y.iter().zip(weight) {
        let mut block = (y, w, 1);
        while let Some(&(mean, total, len)) = blocks.last()
            && mean < block.0
        {
            let sum = total + block.1;
            block = ((mean * total + block.0 * block.1) / sum, sum, len + block.2);
            blocks.pop();
        }
        blocks.push(block);
    }
    blocks.iter().flat_map(|&(mean, _, len)| std::iter::repeat_n(mean, len)).collect()
}

#[cfg(test)]
mod tests {
    use super::decreasing;

    #[test]
    fn pools_what_rises_and_keeps_what_falls() {
        assert_eq!(decreasing(&[5.0, 4.0, 1.0], &[1.0; 3]), [5.0, 4.0, 1.0]);
        assert_eq!(decreasing(&[1.0, 2.0, 0.0], &[1.0, 3.0, 1.0]), [1.75, 1.75, 0.0]);
        assert_eq!(decreasing(&[1.0, 2.0, 3.0], &[1.0; 3]), [2.0; 3]);
    }
}
