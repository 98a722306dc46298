//! Curves over x = cos(theta_d) in [0, 1]: a constant, a line, a parabola, or quadratic B-splines on equal spans.

/// Functions that are not zero at one x.
pub const WIDTH: usize = 3;

/// The basis of a curve of `size` coefficients: 1 is a constant, 2 a line, 3 a parabola, more are splines with
/// `size - 2` equal spans. Its functions are not negative and add up to one, so that a curve stays between its
/// least and its greatest coefficient.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Basis {
    pub size: usize,
}

impl Basis {
    #[must_use]
    pub fn spans(self) -> usize {
        self.size.max(WIDTH) - 2
    }

    /// Span that holds x.
    #[must_use]
    pub fn span(self, x: f64) -> usize {
        let spans = self.spans();
        ((x.max(0.0) * spans as f64) as usize).min(spans - 1)
    }

    /// The first function that is not zero at x, and the values of it and of the next two.
    #[must_use]
    pub fn at(self, x: f64) -> (usize, [f64; WIDTH]) {
        match self.size {
            1 => (0, [1.0, 0.0, 0.0]),
            2 => (0, [1.0 - x, x, 0.0]),
            _ => {
                let (span, spans) = (self.span(x), self.spans());
                let u = x * spans as f64 - span as f64;
                let low = (1.0 - u) * (1.0 - u) * if span == 0 { 1.0 } else { 0.5 };
                let high = u * u * if span == spans - 1 { 1.0 } else { 0.5 };
                (span, [low, 1.0 - low - high, high])
            }
        }
    }

    /// Value of the curve with these coefficients.
    #[must_use]
    pub fn value(self, coefficients: &[f64], x: f64) -> f64 {
        let (first, b) = self.at(x);
        coefficients[first..].iter().zip(b).map(|(c, b)| c * b).sum()
    }

    /// Where a straight line has the coefficients that it has as a curve of this basis (Greville).
    #[must_use]
    pub fn place(self, coefficient: usize) -> f64 {
        match self.size {
            1 => 0.5,
            2 => coefficient as f64,
            _ => ((coefficient as f64 - 0.5) / self.spans() as f64).clamp(0.0, 1.0),
        }
    }

    /// The curve as a polynomial of the place u in [0, 1] within each span: coefficients of 1, u, u^2.
    #[must_use]
    pub fn polynomials(self, coefficients: &[f64]) -> Vec<[f64; 3]> {
        match coefficients {
            [c] => vec![[*c, 0.0, 0.0]],
            [low, high] => vec![[*low, high - low, 0.0]],
            _ => (0..self.spans())
                .map(|span| {
                    let a = if span == 0 { 1.0 } else { 0.5 };
                    let b = if span == self.spans() - 1 { 1.0 } else { 0.5 };
                    let [low, middle, high] = [0, 1, 2].map(|i| coefficients[span + i]);
                    // low a (1 - u)^2 + middle (1 - a (1 - u)^2 - b u^2) + high b u^2
                    let (fall, rise) = (a * (low - middle), b * (high - middle));
                    [middle + fall, -2.0 * fall, fall + rise]
                })
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COEFFICIENTS: [f64; 8] = [0.3, -1.2, 2.5, 0.7, 0.1, -0.4, 1.9, 3.0];

    #[test]
    fn adds_up_to_one_and_is_smooth() {
        for size in 1..=8 {
            let basis = Basis { size };
            for i in 0..=1000 {
                let x = f64::from(i) / 1000.0;
                let (first, b) = basis.at(x);
                assert!((b.iter().sum::<f64>() - 1.0).abs() < 1e-15);
                assert!(b.iter().all(|&b| b >= -1e-15) && first + size.min(WIDTH) <= size.max(WIDTH));
                // The slope has no jump, inside spans or at knots
                let value = |x: f64| basis.value(&COEFFICIENTS[..size], x.clamp(0.0, 1.0));
                if (0.01..0.99).contains(&x) {
                    let (left, right) =
                        ((value(x) - value(x - 1e-6)) / 1e-6, (value(x + 1e-6) - value(x)) / 1e-6);
                    assert!((left - right).abs() < 1e-2, "{size} {x} {left} {right}");
                }
            }
        }
    }

    #[test]
    fn ends_in_its_outer_coefficients() {
        for size in 2..=8 {
            let c = &COEFFICIENTS[..size];
            assert_eq!(Basis { size }.value(c, 0.0), c[0]);
            assert!((Basis { size }.value(c, 1.0) - c[size - 1]).abs() < 1e-15);
        }
    }

    #[test]
    fn a_line_has_its_values_at_the_places_as_coefficients() {
        for size in 1..=8 {
            let basis = Basis { size };
            let line: Vec<f64> = (0..size).map(|i| 2.0 * basis.place(i) - 0.7).collect();
            for x in [0.0, 0.2, 0.5, 0.9, 1.0] {
                let want = if size == 1 { 0.3 } else { 2.0 * x - 0.7 };
                assert!((basis.value(&line, x) - want).abs() < 1e-14, "{size} {x}");
            }
        }
    }

    #[test]
    fn polynomials_are_the_curve() {
        for size in 1..=8 {
            let (basis, c) = (Basis { size }, &COEFFICIENTS[..size]);
            let parts = basis.polynomials(c);
            for i in 0..=100 {
                let x = f64::from(i) / 100.0;
                let span = basis.span(x);
                let u = x * basis.spans() as f64 - span as f64;
                let [a, b, d] = parts[span];
                assert!((a + u * (b + u * d) - basis.value(c, x)).abs() < 1e-14);
            }
        }
    }
}
