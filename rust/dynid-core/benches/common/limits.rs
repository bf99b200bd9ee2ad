//! What this machine can do in one thread, on the lanes of one path: arithmetic out of registers, numbers out of caches and
//! out of memory, and the clock.

use std::hint::black_box;
use std::time::Instant;

use dynid_core::lanes::{self, Kernel, Lanes};

const ROUNDS: usize = 60;
/// Sums side by side: more than the latency of two multiply-adds a cycle asks for, fewer than there are registers.
const CHAINS: usize = 12;
/// Steps of the clock's reading.
const STEPS: usize = 40_000;
/// Bytes that lie well inside the first cache, the second, and none.
const PLACES: [usize; 3] = [16 << 10, 512 << 10, 1 << 30];

/// Ceilings of one thread.
pub struct Limits {
    /// Multiply-adds of numbers per nanosecond.
    pub multiply_adds: f64,
    /// Arithmetic of numbers per nanosecond where every second operation is an addition: on some processors additions have
    /// units of their own.
    pub arithmetic: f64,
    /// Bytes read per nanosecond from the first cache, the second, and memory.
    pub read: [f64; 3],
    /// Bytes written per nanosecond to them.
    pub written: [f64; 3],
    /// Cycles per nanosecond.
    pub clock: f64,
}

struct Sums {
    repeats: usize,
    additions: bool,
}

impl Kernel for Sums {
    /// Numbers that went in.
    type Output = usize;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> usize {
        let (factor, addend) = (L::splat(black_box(0.999)), L::splat(black_box(1e-3)));
        let mut sums = [L::splat(1.0); CHAINS];
        for _ in 0..self.repeats {
            for (k, sum) in sums.iter_mut().enumerate() {
                *sum = if self.additions && k % 2 == 1 {
                    *sum + addend
                } else {
                    sum.mul_add(factor, addend)
                };
            }
        }
        black_box(sums.map(Lanes::raw));
        self.repeats * CHAINS * L::LEN
    }
}

struct Read<'a>(&'a [f64]);

impl Kernel for Read<'_> {
    type Output = usize;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> usize {
        let mut largest = [L::splat(0.0); 8];
        for rows in self.0.chunks_exact(8 * L::LEN) {
            for (largest, row) in largest.iter_mut().zip(rows.chunks_exact(L::LEN)) {
                *largest = largest.xor(L::load(row));
            }
        }
        black_box(largest.map(Lanes::raw));
        size_of_val(self.0)
    }
}

struct Written<'a>(&'a mut [f64]);

impl Kernel for Written<'_> {
    type Output = usize;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> usize {
        let number = L::splat(black_box(1.0));
        for row in self.0.chunks_exact_mut(L::LEN) {
            number.store(row);
        }
        size_of_val(self.0)
    }
}

/// The most of `rounds` rounds: things per nanosecond.
fn most(rounds: usize, mut work: impl FnMut() -> usize) -> f64 {
    let mut most = 0.0_f64;
    for _ in 0..rounds {
        let start = Instant::now();
        let things = work();
        most = most.max(things as f64 / start.elapsed().as_nanos() as f64);
    }
    most
}

/// Measured now, on the path that is chosen.
pub fn measured() -> Limits {
    let sums = |additions| {
        let repeats = 20_000;
        most(ROUNDS, || lanes::run(Sums { repeats, additions }))
    };
    let mut read = [0.0; 3];
    let mut written = [0.0; 3];
    for (place, bytes) in PLACES.into_iter().enumerate() {
        let mut numbers = vec![1.0; bytes / size_of::<f64>()];
        // As long as a pass through memory.
        let (rounds, repeats) = if place == 2 {
            (3, 1)
        } else {
            (ROUNDS, (4 << 20) / bytes)
        };
        read[place] = most(rounds, || {
            (0..repeats)
                .map(|_| lanes::run(Read(black_box(&numbers))))
                .sum()
        });
        written[place] = most(rounds, || {
            (0..repeats)
                .map(|_| lanes::run(Written(black_box(&mut numbers))))
                .sum()
        });
    }
    // A shift, an exclusive or and a product wait for each other: one, one and three cycles on every processor of today.
    let clock = most(ROUNDS, || {
        let mut x = black_box(u64::MAX);
        for _ in 0..STEPS {
            x = (x ^ (x >> 7)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        }
        black_box(x);
        5 * STEPS
    });
    Limits {
        multiply_adds: sums(false),
        arithmetic: sums(true),
        read,
        written,
        clock,
    }
}
