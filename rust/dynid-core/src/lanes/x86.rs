//! Lanes in the registers of AVX2 and AVX-512.
//!
//! A single number is a register of two that hold the same: what is written as a vector already is not packed into
//! vectors by the compiler, whose shuffles took more than half the time of a recursion along a chain.
#![expect(
    unsafe_code,
    reason = "vector instructions are unsafe to call where the compiler does not know that the processor has them"
)]
// Safety of every intrinsic below: these types are private to `lanes`; the only functions that name them are `run_avx2`
// and `run_avx512`, which ask the processor first. Loads and stores go through slices of checked length.

use core::arch::x86_64::*;
use core::ops::{Add, Div, Mul, Neg, Sub};

use super::{Kernel, Lanes, Path, MOST_LANES};

macro_rules! register {
    (
        $(#[$doc:meta])* $name:ident, $register:ty, $len:literal, raw $raw:ty, $to_raw:ident, $from_raw:ident,
        add $add:ident, sub $sub:ident, mul $mul:ident, div $div:ident,
        fma $fma:ident, fnma $fnma:ident, sqrt $sqrt:ident, splat $splat:ident, load $load:ident, store $store:ident,
        load_some $load_some:ident, store_some $store_some:ident,
        less $less:ident, less_bits $less_bits:ident, signed $signed:ident, max $max:ident, min $min:ident,
        shift $shift:ident, $back:ident, and $and:ident, xor $xor:ident,
        to_bits $to_bits:ident, from_bits $from_bits:ident, transpose $transpose:ident, front $front:ident
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        #[repr(transparent)]
        pub struct $name($register);

        register!(@operator $name, Add, add, $add);
        register!(@operator $name, Sub, sub, $sub);
        register!(@operator $name, Mul, mul, $mul);
        register!(@operator $name, Div, div, $div);

        impl Neg for $name {
            type Output = Self;

            #[inline(always)]
            fn neg(self) -> Self {
                self.xor(Self::splat(-0.0))
            }
        }

        impl Lanes for $name {
            type Raw = $raw;
            type Four = Avx2;
            const LEN: usize = $len;
            const FUSED: bool = true;
            // SAFETY: all bits zero are a row of zeros.
            const ZERO: Self::Raw = unsafe { core::mem::zeroed() };

            #[inline(always)]
            fn raw(self) -> Self::Raw {
                // SAFETY: see the head of this file.
                unsafe { $to_raw(self.0) }
            }

            #[inline(always)]
            fn from_raw(raw: Self::Raw) -> Self {
                // SAFETY: see the head of this file.
                Self(unsafe { $from_raw(raw) })
            }

            #[inline(always)]
            fn splat(x: f64) -> Self {
                // SAFETY: see the head of this file.
                Self(unsafe { $splat(x) })
            }

            #[inline(always)]
            fn load(from: &[f64]) -> Self {
                debug_assert!(from.len() >= $len);
                let Some(from) = from.first_chunk::<$len>() else {
                    return Self::splat(f64::NAN);
                };
                // SAFETY: see the head of this file; the array is as long as the register, alignment is not asked.
                Self(unsafe { $load(from.as_ptr()) })
            }

            #[inline(always)]
            fn store(self, to: &mut [f64]) {
                debug_assert!(to.len() >= $len);
                if let Some(to) = to.first_chunk_mut::<$len>() {
                    // SAFETY: see the head of this file; the array is as long as the register, alignment is not asked.
                    unsafe { $store(to.as_mut_ptr(), self.0) }
                }
            }

            #[inline(always)]
            fn load_some(from: &[f64]) -> Self {
                let n = from.len().min($len);
                // SAFETY: see the head of this file; masked lanes are not touched.
                Self(unsafe { $load_some(from.as_ptr(), n) })
            }

            #[inline(always)]
            fn store_some(self, to: &mut [f64]) {
                let n = to.len().min($len);
                // SAFETY: see the head of this file; masked lanes are not touched.
                unsafe { $store_some(to.as_mut_ptr(), self.0, n) }
            }

            #[inline(always)]
            fn four([a, b, c, d]: [Self; 4]) -> Avx2 {
                // SAFETY: see the head of this file.
                unsafe {
                    let front = _mm_unpacklo_pd($front(a.0), $front(b.0));
                    let back = _mm_unpacklo_pd($front(c.0), $front(d.0));
                    Avx2(_mm256_set_m128d(back, front))
                }
            }

            #[inline(always)]
            fn transpose(rows: [Self; MOST_LANES]) -> [Self; MOST_LANES] {
                // SAFETY: see the head of this file.
                unsafe { $transpose(rows) }
            }

            #[inline(always)]
            fn mul_add(self, factor: Self, addend: Self) -> Self {
                // SAFETY: see the head of this file.
                Self(unsafe { $fma(self.0, factor.0, addend.0) })
            }

            #[inline(always)]
            fn mul_sub_from(self, factor: Self, minuend: Self) -> Self {
                // SAFETY: see the head of this file.
                Self(unsafe { $fnma(self.0, factor.0, minuend.0) })
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                // SAFETY: see the head of this file.
                Self(unsafe { $sqrt(self.0) })
            }

            #[inline(always)]
            fn at_least(self, other: Self) -> Self {
                // Gives the second operand where they are equal or one is not a number.
                // SAFETY: see the head of this file.
                Self(unsafe { $max(other.0, self.0) })
            }

            #[inline(always)]
            fn at_most(self, other: Self) -> Self {
                // SAFETY: see the head of this file.
                Self(unsafe { $min(other.0, self.0) })
            }

            #[inline(always)]
            fn if_less(self, other: Self, yes: Self, no: Self) -> Self {
                // SAFETY: see the head of this file.
                Self(unsafe { $less(self.0, other.0, yes.0, no.0) })
            }

            #[inline(always)]
            fn less_bits(self, other: Self) -> u32 {
                // SAFETY: see the head of this file.
                unsafe { $less_bits(self.0, other.0) }
            }

            #[inline(always)]
            fn if_signed(self, yes: Self, no: Self) -> Self {
                // SAFETY: see the head of this file.
                Self(unsafe { $signed(self.0, yes.0, no.0) })
            }

            #[inline(always)]
            fn shift_left<const BITS: i32>(self) -> Self {
                // SAFETY: see the head of this file.
                Self(unsafe { $from_bits($shift($to_bits(self.0), _mm_cvtsi32_si128(BITS))) })
            }

            #[inline(always)]
            fn shift_right<const BITS: i32>(self) -> Self {
                // SAFETY: see the head of this file.
                Self(unsafe { $from_bits($back($to_bits(self.0), _mm_cvtsi32_si128(BITS))) })
            }

            #[inline(always)]
            fn and(self, other: Self) -> Self {
                // SAFETY: see the head of this file.
                Self(unsafe { $from_bits($and($to_bits(self.0), $to_bits(other.0))) })
            }

            #[inline(always)]
            fn xor(self, other: Self) -> Self {
                // SAFETY: see the head of this file.
                Self(unsafe { $from_bits($xor($to_bits(self.0), $to_bits(other.0))) })
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
    /// One number, in both lanes of a register.
    One, __m128d, 1, raw [f64; 1], low, both,
    add _mm_add_pd, sub _mm_sub_pd, mul _mm_mul_pd, div _mm_div_pd,
    fma _mm_fmadd_pd, fnma _mm_fnmadd_pd, sqrt _mm_sqrt_pd,
    splat _mm_set1_pd, load _mm_loaddup_pd, store _mm_storel_pd,
    load_some load_some_128, store_some store_some_128,
    less less_128, less_bits less_bits_128, signed signed_128, max _mm_max_pd, min _mm_min_pd,
    shift _mm_sll_epi64, _mm_srl_epi64, and _mm_and_si128, xor _mm_xor_si128,
    to_bits _mm_castpd_si128, from_bits _mm_castsi128_pd, transpose same, front same
);

register!(
    /// Four lanes.
    Avx2, __m256d, 4, raw __m256d, same, same,
    add _mm256_add_pd, sub _mm256_sub_pd, mul _mm256_mul_pd, div _mm256_div_pd,
    fma _mm256_fmadd_pd, fnma _mm256_fnmadd_pd, sqrt _mm256_sqrt_pd,
    splat _mm256_set1_pd, load _mm256_loadu_pd, store _mm256_storeu_pd,
    load_some load_some_256, store_some store_some_256,
    less less_256, less_bits less_bits_256, signed signed_256, max _mm256_max_pd, min _mm256_min_pd,
    shift _mm256_sll_epi64, _mm256_srl_epi64, and _mm256_and_si256, xor _mm256_xor_si256,
    to_bits _mm256_castpd_si256, from_bits _mm256_castsi256_pd, transpose transpose_256, front _mm256_castpd256_pd128
);

register!(
    /// Eight lanes.
    Avx512, __m512d, 8, raw __m512d, same, same,
    add _mm512_add_pd, sub _mm512_sub_pd, mul _mm512_mul_pd, div _mm512_div_pd,
    fma _mm512_fmadd_pd, fnma _mm512_fnmadd_pd, sqrt _mm512_sqrt_pd,
    splat _mm512_set1_pd, load _mm512_loadu_pd, store _mm512_storeu_pd,
    load_some load_some_512, store_some store_some_512,
    less less_512, less_bits less_bits_512, signed signed_512, max _mm512_max_pd, min _mm512_min_pd,
    shift _mm512_sll_epi64, _mm512_srl_epi64, and _mm512_and_si512, xor _mm512_xor_si512,
    to_bits _mm512_castpd_si512, from_bits _mm512_castsi512_pd, transpose transpose_512, front _mm512_castpd512_pd128
);

// Below: what is more than one instruction. Without features of their own, because the compiler then must inline them where
// there are such; a call for one blend costs more than the blend. Unsafe for the same reason as the instructions.

/// A register is the same in memory.
#[inline(always)]
unsafe fn same<R>(register: R) -> R {
    register
}

#[inline(always)]
unsafe fn low(register: __m128d) -> [f64; 1] {
    [_mm_cvtsd_f64(register)]
}

#[inline(always)]
unsafe fn both([x]: [f64; 1]) -> __m128d {
    _mm_set1_pd(x)
}

#[inline(always)]
unsafe fn less_128(a: __m128d, b: __m128d, yes: __m128d, no: __m128d) -> __m128d {
    _mm_blendv_pd(no, yes, _mm_cmplt_pd(a, b))
}

#[inline(always)]
unsafe fn less_bits_128(a: __m128d, b: __m128d) -> u32 {
    _mm_movemask_pd(_mm_cmplt_pd(a, b)) as u32 & 1
}

#[inline(always)]
unsafe fn signed_128(sign: __m128d, yes: __m128d, no: __m128d) -> __m128d {
    _mm_blendv_pd(no, yes, sign)
}

/// # Safety
/// `from` has `n` numbers, at most one.
#[inline(always)]
unsafe fn load_some_128(from: *const f64, n: usize) -> __m128d {
    if n == 0 {
        return _mm_setzero_pd();
    }
    _mm_loaddup_pd(from)
}

/// # Safety
/// `to` has `n` places, at most one.
#[inline(always)]
unsafe fn store_some_128(to: *mut f64, row: __m128d, n: usize) {
    if n > 0 {
        _mm_storel_pd(to, row);
    }
}

#[inline(always)]
unsafe fn less_256(a: __m256d, b: __m256d, yes: __m256d, no: __m256d) -> __m256d {
    _mm256_blendv_pd(no, yes, _mm256_cmp_pd::<_CMP_LT_OQ>(a, b))
}

#[inline(always)]
unsafe fn less_bits_256(a: __m256d, b: __m256d) -> u32 {
    _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(a, b)) as u32
}

#[inline(always)]
unsafe fn less_bits_512(a: __m512d, b: __m512d) -> u32 {
    u32::from(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b))
}

#[inline(always)]
unsafe fn signed_256(sign: __m256d, yes: __m256d, no: __m256d) -> __m256d {
    _mm256_blendv_pd(no, yes, sign)
}

#[inline(always)]
unsafe fn less_512(a: __m512d, b: __m512d, yes: __m512d, no: __m512d) -> __m512d {
    _mm512_mask_blend_pd(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b), no, yes)
}

#[inline(always)]
unsafe fn signed_512(sign: __m512d, yes: __m512d, no: __m512d) -> __m512d {
    _mm512_mask_blend_pd(_mm512_movepi64_mask(_mm512_castpd_si512(sign)), no, yes)
}

/// The first `n` lanes of four.
#[inline(always)]
unsafe fn mask_256(n: usize) -> __m256i {
    _mm256_cmpgt_epi64(_mm256_set1_epi64x(n as i64), _mm256_setr_epi64x(0, 1, 2, 3))
}

/// # Safety
/// `from` has `n` numbers, at most four.
#[inline(always)]
unsafe fn load_some_256(from: *const f64, n: usize) -> __m256d {
    _mm256_maskload_pd(from, mask_256(n))
}

/// Without a masked store, which takes some processors as long as twenty whole ones.
///
/// # Safety
/// `to` has `n` places, at most four.
#[inline(always)]
unsafe fn store_some_256(to: *mut f64, row: __m256d, n: usize) {
    if n == 4 {
        return _mm256_storeu_pd(to, row);
    }
    let (mut rest, mut at) = (_mm256_castpd256_pd128(row), to);
    if n >= 2 {
        _mm_storeu_pd(at, rest);
        (rest, at) = (_mm256_extractf128_pd::<1>(row), at.add(2));
    }
    if n % 2 == 1 {
        _mm_storel_pd(at, rest);
    }
}

/// # Safety
/// `from` has `n` numbers, at most eight.
#[inline(always)]
unsafe fn load_some_512(from: *const f64, n: usize) -> __m512d {
    _mm512_maskz_loadu_pd(((1_u32 << n) - 1) as __mmask8, from)
}

/// # Safety
/// `to` has `n` places, at most eight.
#[inline(always)]
unsafe fn store_some_512(to: *mut f64, row: __m512d, n: usize) {
    _mm512_mask_storeu_pd(to, ((1_u32 << n) - 1) as __mmask8, row);
}

/// Four rows of four turned over.
#[inline(always)]
unsafe fn transpose_256(rows: [Avx2; MOST_LANES]) -> [Avx2; MOST_LANES] {
    let [a, b, c, d, e, f, g, h] = rows;
    // Neighbours side by side, then halves.
    let (ab_even, ab_odd) = (_mm256_unpacklo_pd(a.0, b.0), _mm256_unpackhi_pd(a.0, b.0));
    let (cd_even, cd_odd) = (_mm256_unpacklo_pd(c.0, d.0), _mm256_unpackhi_pd(c.0, d.0));
    [
        Avx2(_mm256_permute2f128_pd::<0x20>(ab_even, cd_even)),
        Avx2(_mm256_permute2f128_pd::<0x20>(ab_odd, cd_odd)),
        Avx2(_mm256_permute2f128_pd::<0x31>(ab_even, cd_even)),
        Avx2(_mm256_permute2f128_pd::<0x31>(ab_odd, cd_odd)),
        e,
        f,
        g,
        h,
    ]
}

/// Eight rows of eight turned over.
#[inline(always)]
unsafe fn transpose_512(rows: [Avx512; MOST_LANES]) -> [Avx512; MOST_LANES] {
    let [a, b, c, d, e, f, g, h] = rows;
    let [ab, cd, ef, gh] = [
        _mm512_unpacklo_pd(a.0, b.0),
        _mm512_unpacklo_pd(c.0, d.0),
        _mm512_unpacklo_pd(e.0, f.0),
        _mm512_unpacklo_pd(g.0, h.0),
    ];
    let [first, third, fifth, seventh] = quarters([ab, cd, ef, gh]);
    let [ab, cd, ef, gh] = [
        _mm512_unpackhi_pd(a.0, b.0),
        _mm512_unpackhi_pd(c.0, d.0),
        _mm512_unpackhi_pd(e.0, f.0),
        _mm512_unpackhi_pd(g.0, h.0),
    ];
    let [second, fourth, sixth, eighth] = quarters([ab, cd, ef, gh]);
    [first, second, third, fourth, fifth, sixth, seventh, eighth]
}

/// Four rows of four quarters turned over.
#[inline(always)]
unsafe fn quarters([a, b, c, d]: [__m512d; 4]) -> [Avx512; 4] {
    const EVEN: i32 = 0b10_00_10_00;
    const ODD: i32 = 0b11_01_11_01;
    let (even_front, even_back) = (
        _mm512_shuffle_f64x2::<EVEN>(a, b),
        _mm512_shuffle_f64x2::<EVEN>(c, d),
    );
    let (odd_front, odd_back) = (
        _mm512_shuffle_f64x2::<ODD>(a, b),
        _mm512_shuffle_f64x2::<ODD>(c, d),
    );
    [
        Avx512(_mm512_shuffle_f64x2::<EVEN>(even_front, even_back)),
        Avx512(_mm512_shuffle_f64x2::<EVEN>(odd_front, odd_back)),
        Avx512(_mm512_shuffle_f64x2::<ODD>(even_front, even_back)),
        Avx512(_mm512_shuffle_f64x2::<ODD>(odd_front, odd_back)),
    ]
}

/// The widest path of this processor.
pub fn detected() -> Path {
    let avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
    let avx512 = is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl");
    match (avx2, avx512) {
        (true, true) => Path::Avx512,
        (true, false) => Path::Avx2,
        _ => Path::Baseline,
    }
}

/// [`Path::Avx2`], which must be available.
#[inline]
pub fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    #[target_feature(enable = "avx2,fma")]
    fn inner<K: Kernel>(kernel: K) -> K::Output {
        kernel.run::<One, Avx2>()
    }
    debug_assert!(Path::Avx2.is_available());
    // SAFETY: the only caller, `run_available`, is given paths that this processor has.
    unsafe { inner(kernel) }
}

/// [`Path::Avx512`], which must be available.
#[inline]
pub fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    #[target_feature(enable = "avx2,fma,avx512f,avx512dq,avx512vl")]
    fn inner<K: Kernel>(kernel: K) -> K::Output {
        kernel.run::<One, Avx512>()
    }
    debug_assert!(Path::Avx512.is_available());
    // SAFETY: the only caller, `run_available`, is given paths that this processor has.
    unsafe { inner(kernel) }
}
