//! Sine, cosine, exponential, logarithm and hyperbolic tangent of a row, without a branch on what is common.
//!
//! Reductions and polynomials are the classical ones (Cody and Waite; the kernels of fdlibm for sine and cosine, Chebyshev's
//! points for exponential and logarithm). Errors stay below two units in the last place; the tests measure them.

use super::{Lanes, SIGN};

/// Adding and taking away this number rounds to the nearest integer, which is then in the lowest bits of the sum.
const ROUND: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52

/// Arguments of sine and cosine from here on go to the library: the reduction below has no bits for them.
const FAR: f64 = 32_768.0;

/// pi/2 in parts whose products with a whole number below 2^15 are exact: where a product is rounded before the difference
/// these have 33 bits, the next 33 and the rest. Where it is not, the difference to all of the first 53 bits is exact.
const HALF_PI: [f64; 3] = [
    f64::from_bits(0x3FF9_21FB_5440_0000),
    f64::from_bits(0x3DD0_B461_1A60_0000),
    f64::from_bits(0x3BA3_198A_2E03_7073),
];
const FUSED_HALF_PI: [f64; 2] = [core::f64::consts::FRAC_PI_2, 6.123_233_995_736_766e-17];

/// `-1/3!, 1/5!, ...`, fitted on a quarter turn.
const SINE: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];

/// `1/4!, -1/6!, ...`, fitted on a quarter turn.
const COSINE: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_82e-11,
];

/// Sine and cosine of `x` \[rad\]. Not a number where `x` is not finite.
#[inline(always)]
pub fn sin_cos<L: Lanes>(x: L) -> (L, L) {
    let rounded = x.mul_add(L::splat(core::f64::consts::FRAC_2_PI), L::splat(ROUND));
    let n = rounded - L::splat(ROUND);
    let r = if L::FUSED {
        let [first, rest] = FUSED_HALF_PI.map(L::splat);
        n.mul_sub_from(rest, n.mul_sub_from(first, x))
    } else {
        let [first, next, rest] = HALF_PI.map(L::splat);
        x - n * first - n * next - n * rest
    };
    let square = r * r;
    let fourth = square * square;
    let (s, c) = (sine(r, square, fourth), cosine(square, fourth));
    // Odd quarters swap the two; the second bit of the quarter is the sign of the sine, one quarter on of the cosine.
    let odd = rounded.shift_left::<63>();
    let sign = L::splat(f64::from_bits(SIGN));
    let half = rounded.shift_left::<62>().and(sign);
    let sin = odd.if_signed(c, s).xor(half);
    let cos = odd.if_signed(s, c).xor(half).xor(odd);
    if x.abs().all_less(L::splat(FAR)) {
        (sin, cos)
    } else {
        far(x, sin, cos)
    }
}

/// `sin, cos`, replaced by the library's where `x` is far.
#[cold]
fn far<L: Lanes>(x: L, sin: L, cos: L) -> (L, L) {
    let (far_sin, far_cos) = (x.each(f64::sin), x.each(f64::cos));
    let bound = L::splat(FAR);
    (
        x.abs().if_less(bound, sin, far_sin),
        x.abs().if_less(bound, cos, far_cos),
    )
}

/// Sine on a quarter turn about zero.
#[inline(always)]
fn sine<L: Lanes>(r: L, square: L, fourth: L) -> L {
    let [first, a, b, c, d, e] = SINE.map(L::splat);
    let upper = e.mul_add(square, d);
    let middle = c.mul_add(square, b);
    let lower = a.mul_add(square, first);
    let series = upper.mul_add(fourth, middle).mul_add(fourth, lower);
    (square * r).mul_add(series, r)
}

/// Cosine on a quarter turn about zero.
#[inline(always)]
fn cosine<L: Lanes>(square: L, fourth: L) -> L {
    let [a, b, c, d, e, f] = COSINE.map(L::splat);
    let upper = f.mul_add(square, e);
    let middle = d.mul_add(square, c);
    let lower = b.mul_add(square, a);
    let series = upper.mul_add(fourth, middle).mul_add(fourth, lower);
    let head = square.mul_sub_from(L::splat(0.5), L::splat(1.0));
    fourth.mul_add(series, head)
}

/// ln 2 in two parts: 33 bits and the rest.
const LN_2: [f64; 2] = [
    f64::from_bits(0x3FE6_2E42_FEE0_0000),
    f64::from_bits(0x3DEA_39EF_3579_3C76),
];

/// `(exp(r) - 1 - r) / r^2` on `|r| <= ln(2) / 2`, interpolated at Chebyshev's points: `1/2!, 1/3!, ...` but for the last
/// bits. With the factor `r^2` the error is 2e-17 of `exp(r)`; Taylor's series needs two terms more.
const EXPONENTIAL: [f64; 10] = [
    0.500_000_000_000_000_1,
    0.166_666_666_666_666_69,
    0.041_666_666_666_623_74,
    0.008_333_333_333_330_032,
    0.001_388_888_891_740_644_7,
    0.000_198_412_698_632_018_28,
    2.480_152_099_682_569_7e-5,
    2.755_726_822_996_322_7e-6,
    2.762_023_056_750_69e-7,
    2.510_049_478_890_504_2e-8,
];

/// `x = n ln 2 + r`: n, and `exp(r) - 1`.
#[inline(always)]
fn reduced<L: Lanes>(x: L) -> (L, L) {
    let rounded = x.mul_add(L::splat(core::f64::consts::LOG2_E), L::splat(ROUND));
    let n = rounded - L::splat(ROUND);
    let r = n.mul_sub_from(L::splat(LN_2[0]), x);
    let r = n.mul_sub_from(L::splat(LN_2[1]), r);
    let (square, f) = (r * r, &EXPONENTIAL);
    let fourth = square * square;
    // Pairs, then pairs of pairs: a third of the latency of Horner's chain.
    let p0 = L::splat(f[1]).mul_add(r, L::splat(f[0]));
    let p1 = L::splat(f[3]).mul_add(r, L::splat(f[2]));
    let p2 = L::splat(f[5]).mul_add(r, L::splat(f[4]));
    let p3 = L::splat(f[7]).mul_add(r, L::splat(f[6]));
    let p4 = L::splat(f[9]).mul_add(r, L::splat(f[8]));
    let low = p1.mul_add(square, p0);
    let middle = p3.mul_add(square, p2);
    let series = p4.mul_add(fourth, middle).mul_add(fourth, low);
    (n, series.mul_add(square, r))
}

/// `2^n` for integers n from -1022 to 1023.
#[inline(always)]
fn power_of_two<L: Lanes>(n: L) -> L {
    (n + L::splat(ROUND + 1023.0)).shift_left::<52>()
}

/// `exp(x)`; zero below -745.2, infinite above 709.8, not a number where `x` is not.
#[inline(always)]
pub fn exp<L: Lanes>(x: L) -> L {
    let x = x.at_least(L::splat(-746.0)).at_most(L::splat(710.0));
    let (n, less_one) = reduced(x);
    // In two steps, so that results below the least normal number come out.
    let half = n.mul_add(L::splat(0.5), L::splat(ROUND)) - L::splat(ROUND);
    (less_one + L::splat(1.0)) * power_of_two(half) * power_of_two(n - half)
}

/// `exp(x) - 1`, exact in the small; infinite above 709, not a number where `x` is not.
#[inline(always)]
pub fn expm1<L: Lanes>(x: L) -> L {
    let x = x.at_least(L::splat(-50.0)).at_most(L::splat(710.0));
    let (n, less_one) = reduced(x);
    // n reaches 1024, 2^n does not.
    let scale = power_of_two(n - L::splat(1.0));
    let half = L::splat(0.5);
    let half_of_it = less_one.mul_add(scale, scale - half);
    half_of_it + half_of_it
}

/// `tanh(x)`, odd to the last bit; not a number where `x` is not.
#[inline(always)]
pub fn tanh<L: Lanes>(x: L) -> L {
    let size = x.abs().at_most(L::splat(25.0));
    let fall = expm1(size * L::splat(-2.0));
    (fall / (fall + L::splat(2.0))).abs().xor(x.sign())
}

/// The bits of a number's fraction, and 2^52, whose lowest bits are a whole number's.
const FRACTION: f64 = f64::from_bits((1 << 52) - 1);
const WHOLE: f64 = 4_503_599_627_370_496.0;

/// `(ln((1 + s) / (1 - s)) / s - 2) / s^2` on `1/sqrt(2) <= (1 + s) / (1 - s) <= sqrt(2)` in powers of `s^2`, interpolated at
/// Chebyshev's points: `2/3, 2/5, 2/7, ...` but for the last bits. With the factor `s^2 / 2` the error is 5e-18 of the
/// logarithm.
const LOGARITHM: [f64; 7] = [
    0.666_666_666_666_667,
    0.399_999_999_998_988_33,
    0.285_714_286_262_799_1,
    0.222_222_110_851_277_02,
    0.181_828_927_419_940_8,
    0.153_316_014_464_840_86,
    0.146_179_340_312_780_2,
];

/// `ln(x)` of normal numbers above zero; of less, zero included, that of the least normal one; not a number where `x` is
/// not finite.
#[inline(always)]
pub fn ln<L: Lanes>(x: L) -> L {
    let one = L::splat(1.0);
    // Zero, and no number where x is none or infinite.
    let nothing = x * L::splat(0.0);
    let x = x.at_least(L::splat(f64::MIN_POSITIVE));
    let exponent = x.shift_right::<52>().xor(L::splat(WHOLE)) - L::splat(WHOLE + 1023.0);
    let part = x.and(L::splat(FRACTION)).xor(one);
    // From 1 to 2 so far.
    let middle = L::splat(core::f64::consts::SQRT_2);
    let exponent = middle.if_less(part, exponent + one, exponent);
    let part = middle.if_less(part, part * L::splat(0.5), part);
    let s = (part - one) / (part + one);
    let square = s * s;
    let fourth = square * square;
    let [a, b, c, d, e, f, g] = LOGARITHM.map(L::splat);
    let upper = g.mul_add(square, f).mul_add(square, e);
    let middle = d.mul_add(square, c);
    let lower = b.mul_add(square, a);
    let series = upper.mul_add(fourth, middle).mul_add(fourth, lower);
    let rest = (s * square).mul_add(series, s + s) + nothing;
    let [first, last] = LN_2.map(L::splat);
    exponent.mul_add(first, exponent.mul_add(last, rest))
}
