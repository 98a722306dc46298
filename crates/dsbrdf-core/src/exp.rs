//! Exponentials and a logarithm in a form that compilers turn into vector instructions.
//!
//! No branch and no table. Fused multiply-adds round alike on every machine, so that all give the same bits; call it
//! from functions compiled for a target that has them.

const LOG2_E: f64 = std::f64::consts::LOG2_E;
/// `ln 2` in two parts; `n * LN2_HI` is exact for |n| < 2^20.
const LN2_HI: f64 = 6.931_471_803_691_238e-1;
const LN2_LO: f64 = 1.908_214_929_270_587_7e-10;
/// Adding it rounds to an integer and leaves that integer in the low bits.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// Arguments beyond are moved here: `exp` stays a normal, finite number.
const LOW: f64 = -708.0;
const HIGH: f64 = 709.0;

/// `exp(x) - 1` to about one unit in the last place for -708 <= x <= 709.
#[inline(always)]
pub fn expm1(x: f64) -> f64 {
    let (power, small) = split(x);
    power.mul_add(small, power - 1.0)
}

/// `exp(x)` to about one unit in the last place for -708 <= x <= 709.
#[inline(always)]
pub fn exp(x: f64) -> f64 {
    let (power, small) = split(x);
    power.mul_add(small, power)
}

/// `2^n` and `expm1(r)` with `x = n ln 2 + r`, |r| <= ln(2) / 2.
#[inline(always)]
fn split(x: f64) -> (f64, f64) {
    let x = x.clamp(LOW, HIGH);
    let shifted = x.mul_add(LOG2_E, ROUND);
    let n = shifted - ROUND;
    let r = (-n).mul_add(LN2_LO, (-n).mul_add(LN2_HI, x));

    // Taylor series in r^2, even and odd powers apart, for short dependency chains
    let r2 = r * r;
    let even =
        series(r2, [1.0 / 479_001_600.0, 1.0 / 3_628_800.0, 1.0 / 40_320.0, 1.0 / 720.0, 1.0 / 24.0, 0.5]);
    let odd = series(
        r2,
        [1.0 / 6_227_020_800.0, 1.0 / 39_916_800.0, 1.0 / 362_880.0, 1.0 / 5_040.0, 1.0 / 120.0, 1.0 / 6.0],
    );
    let power = f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
    (power, r.mul_add(r2 * odd, r2 * even) + r)
}

/// `ln(x)` to about two units in the last place for normal x > 0.
#[inline(always)]
pub fn ln(x: f64) -> f64 {
    // x = 2^n m with m within a factor of sqrt(2) of 1
    let bits = x.to_bits().wrapping_sub(0.5_f64.sqrt().to_bits());
    let n = ((bits as i64) >> 52) as f64;
    let m = f64::from_bits(x.to_bits().wrapping_sub(bits & 0xfff0_0000_0000_0000));
    // ln m = 2 artanh(z)
    let z = (m - 1.0) / (m + 1.0);
    let z2 = z * z;
    let even = series(z2, [0.0, 1.0 / 21.0, 1.0 / 19.0, 1.0 / 17.0, 1.0 / 15.0, 1.0 / 13.0]);
    let tail = series(z2, [even, 1.0 / 11.0, 1.0 / 9.0, 1.0 / 7.0, 1.0 / 5.0, 1.0 / 3.0]);
    let small = (2.0 * z).mul_add(z2 * tail, n * LN2_LO);
    n.mul_add(LN2_HI, (2.0 * z) + small)
}

/// Horner's rule, highest power first.
#[inline(always)]
fn series(x: f64, coefficients: [f64; 6]) -> f64 {
    coefficients.iter().fold(0.0, |sum, &c| sum.mul_add(x, c))
}

#[cfg(test)]
mod tests {
    use super::{exp, expm1, ln};

    #[test]
    fn agrees_with_the_standard_library() {
        let mut worst = 0.0_f64;
        for i in -70_000..=70_899 {
            let x = f64::from(i) * 0.01 + 1.234e-5;
            let want = x.exp_m1();
            worst = worst.max(((expm1(x) - want) / want).abs());
            worst = worst.max(((exp(x) - x.exp()) / x.exp()).abs());
        }
        assert!(worst < 4e-16, "{worst:e}");
    }

    #[test]
    fn keeps_relative_precision_near_zero() {
        for exponent in 1..300 {
            let x = 10.0_f64.powi(-exponent);
            for x in [x, -x] {
                let want = x.exp_m1();
                assert!(((expm1(x) - want) / want).abs() < 3e-16, "{x:e}");
            }
        }
        assert_eq!(expm1(0.0), 0.0);
    }

    #[test]
    fn logarithm_agrees_with_the_standard_library() {
        for i in 1..200_000 {
            for x in [f64::from(i) * 1e-5, (f64::from(i) * 0.003 - 300.0).exp()] {
                let want = x.ln();
                assert!((ln(x) - want).abs() <= 5e-16 * want.abs() + 1e-18, "{x:e}: {:e} {want:e}", ln(x));
            }
        }
        assert_eq!(ln(1.0), 0.0);
    }

    #[test]
    fn stays_finite_beyond_the_range() {
        assert!((expm1(-1e300) + 1.0).abs() < 1e-300);
        assert!(expm1(1e300).is_finite());
    }
}
