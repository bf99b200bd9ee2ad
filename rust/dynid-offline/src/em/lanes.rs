//! Samples side by side in the processor's registers, picked at run time: what [`super::pass`] is written in.
#![allow(unsafe_code)] // vector instructions are unsafe to call where the compiler does not know that they are there
                       // Safety of every intrinsic below: the types that hold registers are made only by `run`, which asks the processor first.
                       // Loads and stores go through slices of checked length.

use core::ops::{Add, Div, Mul, Sub};

/// Numbers of the widest row.
pub const MOST_LANES: usize = 8;

/// A row of numbers. Code over it is `#[inline(always)]` and holds no closure: what is not inlined into the function that
/// switches the instructions on is compiled without them.
pub trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// Numbers in a row.
    const LEN: usize;
    /// The same number in every lane.
    fn splat(x: f64) -> Self;
    /// The first numbers of `from`.
    fn load(from: &[f64]) -> Self;
    /// To the first places of `to`.
    fn store(self, to: &mut [f64]);
    /// `self * factor + addend`, rounded once where the processor does so.
    fn mul_add(self, factor: Self, addend: Self) -> Self;
    /// The larger; numbers only.
    fn at_least(self, other: Self) -> Self;
    /// Times 2 to the whole number in the lowest bits of `whole`; the result is a normal number.
    fn times_power_of_two(self, whole: Self) -> Self;
}

/// A calculation that runs on any processor.
pub trait Kernel {
    /// Implement it `#[inline(always)]`.
    fn run<L: Lanes>(self);
}

/// `kernel` with the widest registers of this processor.
pub fn run<K: Kernel>(kernel: K) {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq") {
            // SAFETY: the processor has the instructions.
            return unsafe { x86::run_avx512(kernel) };
        }
        // SAFETY: the processor has the instructions.
        return unsafe { x86::run_avx2(kernel) };
    }
    kernel.run::<Portable>();
}

/// `exp(x)` of numbers that are not positive; 3e-308 from -708 down. Relative error below 5e-15 to -30, 1e-13 to -708.
#[inline(always)]
pub fn exp_falling<L: Lanes>(x: L) -> L {
    /// Added it rounds to a whole number, which then stands in the lowest bits.
    const ROUND: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52
    /// Coefficients of r^10 down to 1: Chebyshev's fit of exp between the halves of -ln 2 and ln 2, off by 2.2e-16.
    const SERIES: [f64; 11] = [
        2.762_635_724_144_722_3e-7,
        2.764_018_079_620_985e-6,
        2.480_150_434_699_768_6e-5,
        0.000_198_411_702_704_400_67,
        0.001_388_888_893_248_859_9,
        0.008_333_333_385_667_782,
        0.041_666_666_666_573_14,
        0.166_666_666_665_544_06,
        0.500_000_000_000_000_6,
        1.000_000_000_000_006_7,
        1.0,
    ];
    let (x, round) = (x.at_least(L::splat(-708.0)), L::splat(ROUND));
    let whole = x.mul_add(L::splat(core::f64::consts::LOG2_E), round);
    let rest = (whole - round).mul_add(L::splat(-core::f64::consts::LN_2), x);
    // Even and odd powers side by side: half as long a chain of operations that wait for each other.
    let square = rest * rest;
    let (mut even, mut odd) = (L::splat(SERIES[0]), L::splat(SERIES[1]));
    for k in 1..5 {
        even = even.mul_add(square, L::splat(SERIES[2 * k]));
        odd = odd.mul_add(square, L::splat(SERIES[2 * k + 1]));
    }
    let even = even.mul_add(square, L::splat(SERIES[10]));
    odd.mul_add(rest, even).times_power_of_two(whole)
}

/// Four numbers of any processor; fused where every processor of the kind does so, elsewhere that would be a library call.
#[derive(Clone, Copy)]
pub struct Portable([f64; 4]);

macro_rules! portable_operator {
    ($trait:ident, $name:ident, $operator:tt) => {
        impl $trait for Portable {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                let ([a, b, c, d], [e, f, g, h]) = (self.0, other.0);
                Self([a $operator e, b $operator f, c $operator g, d $operator h])
            }
        }
    };
}
portable_operator!(Add, add, +);
portable_operator!(Sub, sub, -);
portable_operator!(Mul, mul, *);
portable_operator!(Div, div, /);

impl Lanes for Portable {
    const LEN: usize = 4;

    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self([x; 4])
    }

    #[inline(always)]
    fn load(from: &[f64]) -> Self {
        Self([from[0], from[1], from[2], from[3]])
    }

    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        to[..4].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        let mut out = addend;
        for lane in 0..4 {
            out.0[lane] = if cfg!(target_arch = "aarch64") {
                self.0[lane].mul_add(factor.0[lane], addend.0[lane])
            } else {
                self.0[lane] * factor.0[lane] + addend.0[lane]
            };
        }
        out
    }

    #[inline(always)]
    fn at_least(self, other: Self) -> Self {
        let mut out = self;
        for lane in 0..4 {
            if out.0[lane] < other.0[lane] {
                out.0[lane] = other.0[lane];
            }
        }
        out
    }

    #[inline(always)]
    fn times_power_of_two(self, whole: Self) -> Self {
        let mut out = self;
        for lane in 0..4 {
            let power = whole.0[lane].to_bits() << 52;
            out.0[lane] = f64::from_bits(out.0[lane].to_bits().wrapping_add(power));
        }
        out
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Add, Div, Kernel, Lanes, Mul, Sub};
    use core::arch::x86_64::*;

    /// # Safety
    /// The processor has these instructions.
    #[target_feature(enable = "avx2,fma,avx512f,avx512dq")]
    pub unsafe fn run_avx512<K: Kernel>(kernel: K) {
        kernel.run::<Avx512>();
    }

    /// # Safety
    /// The processor has these instructions.
    #[target_feature(enable = "avx2,fma")]
    pub unsafe fn run_avx2<K: Kernel>(kernel: K) {
        kernel.run::<Avx2>();
    }

    macro_rules! register {
        (
            $name:ident, $register:ty, $len:literal, $add:ident, $sub:ident, $mul:ident, $div:ident, $fma:ident,
            $splat:ident, $load:ident, $store:ident, $max:ident, $shift:ident, $add_bits:ident,
            $to_bits:ident, $from_bits:ident
        ) => {
            #[derive(Clone, Copy)]
            pub struct $name($register);

            register!(@operator $name, Add, add, $add);
            register!(@operator $name, Sub, sub, $sub);
            register!(@operator $name, Mul, mul, $mul);
            register!(@operator $name, Div, div, $div);

            impl Lanes for $name {
                const LEN: usize = $len;

                #[inline(always)]
                fn splat(x: f64) -> Self {
                    // SAFETY: see the head of this file.
                    Self(unsafe { $splat(x) })
                }

                #[inline(always)]
                fn load(from: &[f64]) -> Self {
                    let from = &from[..$len];
                    // SAFETY: see the head of this file; the slice is as long as the register.
                    Self(unsafe { $load(from.as_ptr()) })
                }

                #[inline(always)]
                fn store(self, to: &mut [f64]) {
                    let to = &mut to[..$len];
                    // SAFETY: see the head of this file; the slice is as long as the register.
                    unsafe { $store(to.as_mut_ptr(), self.0) }
                }

                #[inline(always)]
                fn mul_add(self, factor: Self, addend: Self) -> Self {
                    // SAFETY: see the head of this file.
                    Self(unsafe { $fma(self.0, factor.0, addend.0) })
                }

                #[inline(always)]
                fn at_least(self, other: Self) -> Self {
                    // SAFETY: see the head of this file.
                    Self(unsafe { $max(self.0, other.0) })
                }

                #[inline(always)]
                fn times_power_of_two(self, whole: Self) -> Self {
                    // SAFETY: see the head of this file.
                    Self(unsafe {
                        $from_bits($add_bits($to_bits(self.0), $shift::<52>($to_bits(whole.0))))
                    })
                }
            }
        };
        (@operator $name:ident, $trait:ident, $method:ident, $intrinsic:ident) => {
            impl $trait for $name {
                type Output = Self;

                #[inline(always)]
                fn $method(self, other: Self) -> Self {
                    // SAFETY: see the head of this file.
                    Self(unsafe { $intrinsic(self.0, other.0) })
                }
            }
        };
    }

    register!(
        Avx512,
        __m512d,
        8,
        _mm512_add_pd,
        _mm512_sub_pd,
        _mm512_mul_pd,
        _mm512_div_pd,
        _mm512_fmadd_pd,
        _mm512_set1_pd,
        _mm512_loadu_pd,
        _mm512_storeu_pd,
        _mm512_max_pd,
        _mm512_slli_epi64,
        _mm512_add_epi64,
        _mm512_castpd_si512,
        _mm512_castsi512_pd
    );
    register!(
        Avx2,
        __m256d,
        4,
        _mm256_add_pd,
        _mm256_sub_pd,
        _mm256_mul_pd,
        _mm256_div_pd,
        _mm256_fmadd_pd,
        _mm256_set1_pd,
        _mm256_loadu_pd,
        _mm256_storeu_pd,
        _mm256_max_pd,
        _mm256_slli_epi64,
        _mm256_add_epi64,
        _mm256_castpd_si256,
        _mm256_castsi256_pd
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `exp_falling` of every number, on every path, and the longest way from `f64::exp`.
    struct Exp<'a>(&'a [f64], &'a mut [f64]);

    impl Kernel for Exp<'_> {
        #[inline(always)]
        fn run<L: Lanes>(self) {
            for (x, out) in self
                .0
                .chunks_exact(L::LEN)
                .zip(self.1.chunks_exact_mut(L::LEN))
            {
                exp_falling(L::load(x)).store(out);
            }
        }
    }

    #[test]
    fn the_exponential_is_one_on_every_path() {
        let x: Vec<f64> = (0..800_000)
            .map(|k| -1e-3 * f64::from(k) * (1.0 + 1e-7 * f64::from(k)))
            .collect();
        let mut answers = [0; 3].map(|_| vec![0.0; x.len()]);
        let [widest, narrower, portable] = &mut answers;
        run(Exp(&x, widest));
        Exp(&x, portable).run::<Portable>();
        narrower.copy_from_slice(widest);
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the processor has the instructions.
            unsafe { x86::run_avx2(Exp(&x, narrower)) };
        }
        for answer in &answers {
            let mut worst = 0.0f64;
            for (x, value) in x.iter().zip(answer) {
                let exact = x.exp();
                let off = if *x > -708.0 {
                    (value / exact - 1.0).abs()
                } else {
                    *value
                };
                worst = worst.max(off);
                assert!(
                    off < if *x > -30.0 { 5e-15 } else { 1e-13 },
                    "{x}: {value} {exact}"
                );
            }
            println!("relative error at most {worst:.1e}");
        }
        assert_eq!(answers[0][0], 1.0);
        let mut far = [1.0; MOST_LANES];
        run(Exp(&[f64::MIN; MOST_LANES], &mut far));
        assert!(far.iter().all(|value| (0.0..4e-308).contains(value)));
    }
}
