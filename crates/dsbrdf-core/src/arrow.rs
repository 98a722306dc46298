//! Normal equations in which blocks of unknowns (the colours of one channel) meet only the shared ones (the shapes).
//!
//! The Hessian is an arrow: its factorisation takes time in proportion to the number of blocks. Without blocks it is an
//! ordinary dense matrix.

/// A symmetric matrix with `blocks` blocks after the `shared` unknowns, and the gradient beside it.
#[derive(Clone, Debug)]
pub struct Arrow {
    pub shared: usize,
    pub block: usize,
    pub blocks: usize,
    /// (shared, shared), lower triangle.
    top: Vec<f64>,
    /// (blocks, block, shared).
    side: Vec<f64>,
    /// (blocks, block, block), lower triangles.
    diagonal: Vec<f64>,
    pub gradient: Vec<f64>,
}

impl Arrow {
    #[must_use]
    pub fn new(shared: usize, block: usize, blocks: usize) -> Self {
        Self {
            shared,
            block,
            blocks,
            top: vec![0.0; shared * shared],
            side: vec![0.0; blocks * block * shared],
            diagonal: vec![0.0; blocks * block * block],
            gradient: vec![0.0; shared + block * blocks],
        }
    }

    #[must_use]
    pub fn size(&self) -> usize {
        self.gradient.len()
    }

    pub fn clear(&mut self) {
        for part in [&mut self.top, &mut self.side, &mut self.diagonal, &mut self.gradient] {
            part.fill(0.0);
        }
    }

    /// The entry (i, j), i >= j; two unknowns of different blocks have none.
    #[inline(always)]
    pub fn entry(&mut self, i: usize, j: usize) -> &mut f64 {
        if i < self.shared {
            return &mut self.top[i * self.shared + j];
        }
        let at = i - self.shared;
        if j < self.shared {
            return &mut self.side[at * self.shared + j];
        }
        let (block, row) = (at / self.block, at % self.block);
        debug_assert_eq!((j - self.shared) / self.block, block);
        &mut self.diagonal[(block * self.block + row) * self.block + (j - self.shared) % self.block]
    }

    #[must_use]
    pub fn diagonal_entry(&self, i: usize) -> f64 {
        if i < self.shared {
            return self.top[i * self.shared + i];
        }
        let at = i - self.shared;
        self.diagonal[at * self.block + at % self.block]
    }

    /// The whole matrix, (size, size).
    #[must_use]
    pub fn dense(&self) -> Vec<f64> {
        let p = self.size();
        let mut full = vec![0.0; p * p];
        let mut set = |i: usize, j: usize, value: f64| {
            full[i * p + j] = value;
            full[j * p + i] = value;
        };
        for i in 0..self.shared {
            for j in 0..=i {
                set(i, j, self.top[i * self.shared + j]);
            }
        }
        for at in 0..self.blocks * self.block {
            for j in 0..self.shared {
                set(self.shared + at, j, self.side[at * self.shared + j]);
            }
            let row = at % self.block;
            for other in 0..=row {
                set(self.shared + at, self.shared + at - row + other, self.diagonal[at * self.block + other]);
            }
        }
        full
    }

    /// The factor of `H + damping diag(H)`, in which `held` unknowns are alone; none if not positive definite.
    #[must_use]
    pub fn factor(&self, damping: f64, held: &[bool]) -> Option<Factor> {
        let mut factor = Factor { matrix: self.clone() };
        let m = &mut factor.matrix;
        let (shared, block) = (m.shared, m.block);
        for i in 0..shared {
            for j in 0..i {
                if held[i] || held[j] {
                    m.top[i * shared + j] = 0.0;
                }
            }
            damp(&mut m.top[i * shared + i], damping, held[i]);
        }
        for b in 0..m.blocks {
            for row in 0..block {
                let (at, i) = (b * block + row, shared + b * block + row);
                for j in 0..shared {
                    if held[i] || held[j] {
                        m.side[at * shared + j] = 0.0;
                    }
                }
                for other in 0..row {
                    if held[i] || held[shared + b * block + other] {
                        m.diagonal[at * block + other] = 0.0;
                    }
                }
                damp(&mut m.diagonal[at * block + row], damping, held[i]);
            }
        }
        // Each block, what it leaves of the shared part, then that
        for b in 0..m.blocks {
            let (low, high) = (b * block * block, (b + 1) * block * block);
            let diagonal = &mut m.diagonal[low..high];
            if !cholesky(diagonal, block) {
                return None;
            }
            let side = &mut m.side[b * block * shared..(b + 1) * block * shared];
            for row in 0..block {
                for other in 0..row {
                    let l = diagonal[row * block + other];
                    let (above, below) = side.split_at_mut(row * shared);
                    subtract(l, &above[other * shared..(other + 1) * shared], &mut below[..shared]);
                }
                let inverse = 1.0 / diagonal[row * block + row];
                side[row * shared..(row + 1) * shared].iter_mut().for_each(|x| *x *= inverse);
            }
            for row in side.chunks_exact(shared.max(1)) {
                for i in 0..shared {
                    if row[i] != 0.0 {
                        subtract(row[i], &row[..=i], &mut m.top[i * shared..=i * shared + i]);
                    }
                }
            }
        }
        cholesky(&mut m.top, shared).then_some(factor)
    }
}

fn damp(diagonal: &mut f64, damping: f64, held: bool) {
    *diagonal = if held { 1.0 } else { *diagonal + damping * diagonal.max(1e-30) };
}

/// `y -= factor x`.
#[inline(always)]
fn subtract(factor: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y -= factor * x;
    }
}

#[inline(always)]
fn dot(x: &[f64], y: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (xs, ys) = (x.chunks_exact(8), y.chunks_exact(8));
    let rest: f64 = xs.remainder().iter().zip(ys.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in xs.zip(ys) {
        for lane in 0..8 {
            sums[lane] = x[lane].mul_add(y[lane], sums[lane]);
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// Lower factor of a symmetric matrix (n, n), in place; false if not positive definite.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn cholesky(m: &mut [f64], n: usize) -> bool {
    for i in 0..n {
        let (done, row) = m.split_at_mut(i * n);
        for j in 0..i {
            let other = &done[j * n..j * n + n];
            row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
        }
        let rest = row[i] - dot(&row[..i], &row[..i]);
        if rest.is_nan() || rest <= 0.0 {
            return false;
        }
        row[i] = rest.sqrt();
    }
    true
}

/// A triangular factor of an [`Arrow`].
pub struct Factor {
    matrix: Arrow,
}

impl Factor {
    /// Solves for `right`, in place.
    pub fn solve(&self, right: &mut [f64]) {
        let m = &self.matrix;
        let (shared, block) = (m.shared, m.block);
        let (top, rest) = right.split_at_mut(shared);
        for (b, x) in rest.chunks_exact_mut(block.max(1)).enumerate() {
            let l = &m.diagonal[b * block * block..(b + 1) * block * block];
            for row in 0..block {
                x[row] = (x[row] - dot(&l[row * block..row * block + row], &x[..row])) / l[row * block + row];
                subtract(x[row], &m.side[(b * block + row) * shared..(b * block + row + 1) * shared], top);
            }
        }
        for i in 0..shared {
            let row = &m.top[i * shared..i * shared + i];
            top[i] = (top[i] - dot(row, &top[..i])) / m.top[i * shared + i];
        }
        for i in (0..shared).rev() {
            top[i] /= m.top[i * shared + i];
            let (low, high) = top.split_at_mut(i);
            subtract(high[0], &m.top[i * shared..i * shared + i], low);
        }
        for (b, x) in rest.chunks_exact_mut(block.max(1)).enumerate() {
            let l = &m.diagonal[b * block * block..(b + 1) * block * block];
            for row in (0..block).rev() {
                let side = &m.side[(b * block + row) * shared..(b * block + row + 1) * shared];
                let later: f64 = (row + 1..block).map(|other| l[other * block + row] * x[other]).sum();
                x[row] = (x[row] - dot(side, top) - later) / l[row * block + row];
            }
        }
    }

    /// Logarithm of the determinant.
    #[must_use]
    pub fn log_det(&self) -> f64 {
        (0..self.matrix.size()).map(|i| 2.0 * self.matrix.diagonal_entry(i).ln()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A well-conditioned arrow with its gradient.
    fn example(shared: usize, block: usize, blocks: usize) -> Arrow {
        let mut arrow = Arrow::new(shared, block, blocks);
        let p = arrow.size();
        let number =
            |i: usize, j: usize| ((i * 37 + j * 101 + 11) as f64 * 0.618_033_988_749_894_9).fract() - 0.5;
        for i in 0..p {
            arrow.gradient[i] = number(i, 3);
            for j in 0..=i {
                let apart = i >= shared && j >= shared && (i - shared) / block != (j - shared) / block;
                if !apart {
                    *arrow.entry(i, j) = if i == j { 8.0 + number(i, i) } else { number(i, j) };
                }
            }
        }
        arrow
    }

    #[test]
    fn solves_and_has_the_determinant_of_the_dense_matrix() {
        for (shared, block, blocks) in [(5, 0, 0), (5, 3, 4), (0, 2, 3), (9, 1, 1)] {
            let arrow = example(shared, block, blocks);
            let p = arrow.size();
            let mut held = vec![false; p];
            held[p / 2] = true;
            for held in [vec![false; p], held] {
                let factor = arrow.factor(0.25, &held).unwrap();
                let mut x = arrow.gradient.clone();
                factor.solve(&mut x);
                let full = arrow.dense();
                for i in 0..p {
                    let product: f64 = if held[i] {
                        x[i]
                    } else {
                        (0..p)
                            .map(|j| {
                                let h = full[i * p + j] * if i == j { 1.25 } else { 1.0 };
                                if held[j] { 0.0 } else { h * x[j] }
                            })
                            .sum()
                    };
                    assert!((product - arrow.gradient[i]).abs() < 1e-12, "{shared} {block} {blocks} {i}");
                }
                let mut dense: Vec<f64> = (0..p * p)
                    .map(|at| {
                        let (i, j) = (at / p, at % p);
                        match (i == j, held[i] || held[j]) {
                            (true, true) => 1.0,
                            (true, false) => 1.25 * full[at],
                            (false, true) => 0.0,
                            (false, false) => full[at],
                        }
                    })
                    .collect();
                assert!(cholesky(&mut dense, p));
                let want: f64 = (0..p).map(|i| 2.0 * dense[i * p + i].ln()).sum();
                assert!((factor.log_det() - want).abs() < 1e-11);
            }
        }
    }

    #[test]
    fn refuses_what_is_not_positive_definite() {
        let mut arrow = example(3, 2, 2);
        *arrow.entry(0, 0) = -1.0;
        assert!(arrow.factor(0.0, &[false; 7]).is_none());
    }
}
