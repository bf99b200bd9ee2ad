//! Rows of numbers that go through one formula side by side, on whatever vector registers the processor has.
//!
//! A formula is written once, generic over [`Lanes`]: a row of samples, a row of joints, or a single number. [`run`]
//! picks the widest registers at run time, so that one build is fast everywhere.
//!
//! No operation mixes lanes, so that a lane's result does not depend on its neighbours, on its place or on how wide the
//! row is. On one machine a single number, four lanes and eight give the same bits: they differ between processors
//! only by whether `a * b + c` is rounded once (fused) or twice.
//!
//! Code between [`run`] and an operation is `#[inline(always)]` and holds no closure over lanes: what is not inlined
//! into the function that switches the instructions on is compiled without them.

mod few;
mod functions;
mod portable;
mod space;
#[cfg(target_arch = "x86_64")]
mod x86;

use core::ops::{Add, Div, Mul, Neg, Sub};
use core::sync::atomic::{AtomicU8, Ordering};

pub(crate) use few::Few;
pub use functions::{exp, expm1, ln, sin_cos, tanh};
pub use portable::Portable;
pub use space::{Matrix, Vector};

/// Lanes of the widest row. Buffers of rows are padded to a multiple of it.
pub const MOST_LANES: usize = 8;

/// A row of numbers.
pub trait Lanes:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The same row in memory; one type for single numbers of either kind of rounding.
    type Raw: Copy + Send + Sync + core::fmt::Debug;
    /// Four lanes with the same rounding.
    type Four: Lanes<Four = Self::Four>;
    /// Numbers in a row.
    const LEN: usize;
    /// Whether [`Self::mul_add`] rounds once.
    const FUSED: bool;
    /// A row of zeros in memory.
    const ZERO: Self::Raw;

    /// To memory.
    fn raw(self) -> Self::Raw;
    /// From memory.
    fn from_raw(raw: Self::Raw) -> Self;
    /// The same number in every lane.
    fn splat(x: f64) -> Self;
    /// The first numbers of `from`, which is long enough; NaN where it is not.
    fn load(from: &[f64]) -> Self;
    /// To the first places of `to`, which is long enough; nothing is written where it is not.
    fn store(self, to: &mut [f64]);
    /// The first lane of each, side by side.
    fn four(parts: [Self; 4]) -> Self::Four;
    /// A single number in each of four lanes.
    #[inline(always)]
    fn of_four(self) -> Self::Four
    where
        Self: Lanes<Raw = [f64; 1]>,
    {
        let [x] = self.raw();
        Self::Four::splat(x)
    }

    /// As many as `from` has, at most a row; zeros in the other lanes.
    #[inline(always)]
    fn load_some(from: &[f64]) -> Self {
        let mut numbers = [0.0; MOST_LANES];
        for (number, from) in numbers.iter_mut().take(Self::LEN).zip(from) {
            *number = *from;
        }
        Self::load(&numbers)
    }

    /// As many as `to` has places for, at most a row.
    #[inline(always)]
    fn store_some(self, to: &mut [f64]) {
        let mut numbers = [0.0; MOST_LANES];
        self.store(&mut numbers);
        for (to, number) in to.iter_mut().zip(&numbers[..Self::LEN]) {
            *to = *number;
        }
    }

    /// The square of the first [`Self::LEN`] rows, turned over: row k holds what stood in lane k. The rows after it are
    /// left as they are.
    #[inline(always)]
    fn transpose(mut rows: [Self; MOST_LANES]) -> [Self; MOST_LANES] {
        let mut numbers = [[0.0; MOST_LANES]; MOST_LANES];
        for (numbers, row) in numbers.iter_mut().zip(&rows[..Self::LEN]) {
            row.store(numbers);
        }
        for (lane, row) in rows[..Self::LEN].iter_mut().enumerate() {
            let mut column = [0.0; MOST_LANES];
            for (x, numbers) in column.iter_mut().zip(&numbers) {
                *x = numbers[lane];
            }
            *row = Self::load(&column);
        }
        rows
    }

    /// `self * factor + addend`, rounded once where the processor does so.
    fn mul_add(self, factor: Self, addend: Self) -> Self;
    /// `minuend - self * factor`, rounded once where the processor does so.
    fn mul_sub_from(self, factor: Self, minuend: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// `yes` where `self < other`, `no` elsewhere, also where one of them is not a number.
    fn if_less(self, other: Self, yes: Self, no: Self) -> Self;
    /// Bit k: whether lane k of `self` is less than that of `other`.
    fn less_bits(self, other: Self) -> u32;
    /// `yes` where the sign bit is set, `no` elsewhere.
    fn if_signed(self, yes: Self, no: Self) -> Self;
    /// The bits, moved up by `N` places.
    fn shift_left<const N: i32>(self) -> Self;
    /// The bits, moved down by `N` places.
    fn shift_right<const N: i32>(self) -> Self;
    /// Bits that are set in both.
    fn and(self, other: Self) -> Self;
    /// Bits that differ.
    fn xor(self, other: Self) -> Self;

    /// Magnitude.
    #[inline(always)]
    fn abs(self) -> Self {
        self.and(Self::splat(f64::from_bits(!SIGN)))
    }

    /// The sign bit alone.
    #[inline(always)]
    fn sign(self) -> Self {
        self.and(Self::splat(f64::from_bits(SIGN)))
    }

    /// The larger; `self` where `other` is not a number.
    #[inline(always)]
    fn at_least(self, other: Self) -> Self {
        self.if_less(other, other, self)
    }

    /// The smaller; `self` where `other` is not a number.
    #[inline(always)]
    fn at_most(self, other: Self) -> Self {
        other.if_less(self, other, self)
    }

    /// Every number through `function`, one by one.
    #[inline(always)]
    fn each(self, function: fn(f64) -> f64) -> Self {
        let mut numbers = [0.0; MOST_LANES];
        self.store(&mut numbers);
        for x in &mut numbers[..Self::LEN] {
            *x = function(*x);
        }
        Self::load(&numbers)
    }

    /// True if every number is less than the other row's.
    #[inline(always)]
    fn all_less(self, other: Self) -> bool {
        self.less_bits(other) == (1 << Self::LEN) - 1
    }

    /// True if a number is less than the other row's.
    #[inline(always)]
    fn any_less(self, other: Self) -> bool {
        self.less_bits(other) != 0
    }
}

const SIGN: u64 = 1 << 63;

/// Copies as many numbers as both have, a row at a time: a call of the library's copy takes longer than that of a few joints.
#[inline(always)]
pub(crate) fn copy<L: Lanes>(from: &[f64], to: &mut [f64]) {
    for (from, to) in from.chunks(L::LEN).zip(to.chunks_mut(L::LEN)) {
        L::load_some(from).store_some(to);
    }
}

/// A calculation that runs on any processor path.
pub trait Kernel {
    /// What comes out.
    type Output;

    /// `S` is a single number, `L` the widest row, both with the same rounding. Implement it `#[inline(always)]`.
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Self::Output;
}

/// A set of instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Path {
    /// What every processor of this kind has (NEON on 64-bit ARM).
    Baseline = 1,
    /// Four lanes, fused.
    Avx2 = 2,
    /// Eight lanes, fused.
    Avx512 = 3,
}

impl Path {
    /// Every path, narrowest first.
    pub const ALL: [Self; 3] = [Self::Baseline, Self::Avx2, Self::Avx512];

    /// Name for people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// True if this processor has the instructions.
    #[must_use]
    pub fn is_available(self) -> bool {
        self <= detected()
    }
}

/// Chosen path; 0 until the processor has been asked.
static CHOSEN: AtomicU8 = AtomicU8::new(0);

/// The path that [`run`] takes.
#[must_use]
pub fn path() -> Path {
    match CHOSEN.load(Ordering::Relaxed) {
        1 => Path::Baseline,
        2 => Path::Avx2,
        3 => Path::Avx512,
        _ => {
            let path = detected();
            CHOSEN.store(path as u8, Ordering::Relaxed);
            path
        }
    }
}

/// Takes `path` from now on, in this whole process: for tests and measurements of the narrower ones. False, and nothing
/// changes, if this processor does not have it.
pub fn use_path(path: Path) -> bool {
    let available = path.is_available();
    if available {
        CHOSEN.store(path as u8, Ordering::Relaxed);
    }
    available
}

/// `kernel` on [`path`].
#[inline]
pub fn run<K: Kernel>(kernel: K) -> K::Output {
    // `path` only ever gives one that is there.
    run_available(path(), kernel)
}

/// `kernel` on [`path`], but on four lanes at most: what runs once a robot or once a run, or has one number to work on, is
/// not worth the bytes that eight lanes take of a published file. The bits of its results are the same.
#[inline]
pub fn run_narrow<K: Kernel>(kernel: K) -> K::Output {
    match path() {
        #[cfg(target_arch = "x86_64")]
        Path::Avx512 | Path::Avx2 => x86::run_avx2(kernel),
        _ => kernel.run::<Portable<1, FUSED>, Portable<WIDEST, FUSED>>(),
    }
}

/// `kernel` on `path`, or on [`Path::Baseline`] if this processor does not have it.
#[inline]
pub fn run_on<K: Kernel>(path: Path, kernel: K) -> K::Output {
    let path = if path.is_available() {
        path
    } else {
        Path::Baseline
    };
    run_available(path, kernel)
}

#[inline(always)]
fn run_available<K: Kernel>(path: Path, kernel: K) -> K::Output {
    match path {
        #[cfg(target_arch = "x86_64")]
        Path::Avx512 => x86::run_avx512(kernel),
        #[cfg(target_arch = "x86_64")]
        Path::Avx2 => x86::run_avx2(kernel),
        _ => kernel.run::<Portable<1, FUSED>, Portable<WIDEST, FUSED>>(),
    }
}

/// Lanes of the baseline. Where a wider path is there too, only processors from before 2013 take it, and what four lanes
/// took of the published file (a tenth) is worth more; the bits are the same.
const WIDEST: usize = if cfg!(target_arch = "x86_64") { 1 } else { 4 };

/// Whether the baseline fuses: 64-bit ARM does, so does a build for one processor that has FMA.
const FUSED: bool = cfg!(any(target_arch = "aarch64", target_feature = "fma"));

#[cfg(target_arch = "x86_64")]
fn detected() -> Path {
    x86::detected()
}

#[cfg(not(target_arch = "x86_64"))]
fn detected() -> Path {
    Path::Baseline
}
