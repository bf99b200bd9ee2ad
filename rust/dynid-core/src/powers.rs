//! Powers of two of a row, for sums of Gaussians: their exponents are scaled once, where a component is made, and nothing has
//! to be multiplied by ln 2 afterwards.

use crate::lanes::Lanes;

/// Adding this number rounds to the nearest integer n and leaves n + 1023, the exponent of 2^n as it is stored, in the lowest
/// bits of the sum.
const ROUND: f64 = 6_755_399_441_056_767.0; // 1.5 * 2^52 + 1023

/// `(2^r - 1) / r` on `|r| <= 1/2`, interpolated at Chebyshev's points: powers of ln 2 over factorials but for the last bits.
const POWER: [f64; 10] = [
    0.693_147_180_559_946_2,
    0.240_226_506_959_100_7,
    0.055_504_108_664_651_67,
    0.009_618_129_107_618_665,
    0.001_333_355_820_079_459_2,
    0.000_154_035_304_247_765_29,
    1.525_267_292_485_073_7e-5,
    1.321_545_163_322_143_4e-6,
    1.020_590_541_376_559_5e-7,
    7.070_977_866_508_138e-9,
];

/// `2^x` of numbers that are not positive, within 1e-15 of it; what would be below the least normal number (2e-308) is zero.
/// Not a number where `x` is not.
#[inline(always)]
pub fn power_falling<L: Lanes>(x: L) -> L {
    // There n is -1023, whose power of two has no bit.
    let x = x.at_least(L::splat(-1023.0));
    let rounded = x + L::splat(ROUND);
    let r = x - (rounded - L::splat(ROUND));
    let (square, f) = (r * r, &POWER);
    let fourth = square * square;
    let p0 = L::splat(f[1]).mul_add(r, L::splat(f[0]));
    let p1 = L::splat(f[3]).mul_add(r, L::splat(f[2]));
    let p2 = L::splat(f[5]).mul_add(r, L::splat(f[4]));
    let p3 = L::splat(f[7]).mul_add(r, L::splat(f[6]));
    let p4 = L::splat(f[9]).mul_add(r, L::splat(f[8]));
    let low = p1.mul_add(square, p0);
    let middle = p3.mul_add(square, p2);
    let series = p4.mul_add(fourth, middle).mul_add(fourth, low);
    series.mul_add(r, L::splat(1.0)) * rounded.shift_left::<52>()
}

#[cfg(test)]
mod tests {
    use super::power_falling;
    use crate::lanes::{run, Kernel, Lanes};

    struct Power(f64);

    impl Kernel for Power {
        type Output = f64;

        #[inline(always)]
        fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> f64 {
            let [power] = power_falling(S::splat(self.0)).raw();
            power
        }
    }

    #[test]
    fn it_is_the_library_s_to_fifteen_digits() {
        for k in 0..200_000 {
            let x = -0.005_101_3 * f64::from(k);
            let expected = x.exp2();
            let off = (run(Power(x)) - expected).abs();
            assert!(off <= 1e-15 * expected, "{x} {off:e} {expected:e}");
        }
        assert!(run(Power(0.0)).to_bits() == 1.0_f64.to_bits());
    }

    #[test]
    fn what_is_far_below_is_zero_and_no_number_stays_none() {
        for x in [-1023.0, -1e9, f64::MIN, f64::NEG_INFINITY] {
            assert!(run(Power(x)).to_bits() == 0, "{x}");
        }
        assert!(run(Power(f64::NAN)).is_nan());
    }
}
