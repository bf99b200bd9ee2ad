//! Lanes as an array, for every processor; the compiler finds the registers.

use core::ops::{Add, Div, Mul, Neg, Sub};

use super::{Lanes, MOST_LANES};

/// `N` numbers, at most [`MOST_LANES`]; `FUSED` says whether `a * b + c` is rounded once.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct Portable<const N: usize, const FUSED: bool>([f64; N]);

macro_rules! lane_by_lane {
    ($trait:ident, $method:ident) => {
        impl<const N: usize, const FUSED: bool> $trait for Portable<N, FUSED> {
            type Output = Self;

            #[inline(always)]
            fn $method(mut self, other: Self) -> Self {
                for k in 0..N {
                    self.0[k] = self.0[k].$method(other.0[k]);
                }
                self
            }
        }
    };
}

lane_by_lane!(Add, add);
lane_by_lane!(Sub, sub);
lane_by_lane!(Mul, mul);
lane_by_lane!(Div, div);

impl<const N: usize, const FUSED: bool> Neg for Portable<N, FUSED> {
    type Output = Self;

    #[inline(always)]
    fn neg(mut self) -> Self {
        for k in 0..N {
            self.0[k] = -self.0[k];
        }
        self
    }
}

impl<const N: usize, const FUSED: bool> Lanes for Portable<N, FUSED> {
    type Raw = [f64; N];
    type Four = Portable<4, FUSED>;
    const LEN: usize = {
        assert!(N <= MOST_LANES && MOST_LANES.is_multiple_of(N));
        N
    };
    const FUSED: bool = FUSED;
    const ZERO: Self::Raw = [0.0; N];

    #[inline(always)]
    fn raw(self) -> Self::Raw {
        self.0
    }

    #[inline(always)]
    fn from_raw(raw: Self::Raw) -> Self {
        Self(raw)
    }

    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self([x; N])
    }

    #[inline(always)]
    fn load(from: &[f64]) -> Self {
        debug_assert!(from.len() >= N);
        Self(from.first_chunk().copied().unwrap_or([f64::NAN; N]))
    }

    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        debug_assert!(to.len() >= N);
        if let Some(to) = to.first_chunk_mut() {
            *to = self.0;
        }
    }

    #[inline(always)]
    fn four([a, b, c, d]: [Self; 4]) -> Self::Four {
        Portable([a.0[0], b.0[0], c.0[0], d.0[0]])
    }

    #[inline(always)]
    fn mul_add(mut self, factor: Self, addend: Self) -> Self {
        for k in 0..N {
            // Without the instruction `f64::mul_add` calls a function that takes a hundred times as long.
            self.0[k] = if FUSED {
                self.0[k].mul_add(factor.0[k], addend.0[k])
            } else {
                self.0[k] * factor.0[k] + addend.0[k]
            };
        }
        self
    }

    #[inline(always)]
    fn mul_sub_from(mut self, factor: Self, minuend: Self) -> Self {
        for k in 0..N {
            self.0[k] = if FUSED {
                (-self.0[k]).mul_add(factor.0[k], minuend.0[k])
            } else {
                minuend.0[k] - self.0[k] * factor.0[k]
            };
        }
        self
    }

    #[inline(always)]
    fn sqrt(mut self) -> Self {
        for k in 0..N {
            self.0[k] = self.0[k].sqrt();
        }
        self
    }

    #[inline(always)]
    fn if_less(mut self, other: Self, yes: Self, no: Self) -> Self {
        for k in 0..N {
            self.0[k] = if self.0[k] < other.0[k] {
                yes.0[k]
            } else {
                no.0[k]
            };
        }
        self
    }

    #[inline(always)]
    fn less_bits(self, other: Self) -> u32 {
        let mut bits = 0;
        for k in 0..N {
            bits |= u32::from(self.0[k] < other.0[k]) << k;
        }
        bits
    }

    #[inline(always)]
    fn if_signed(mut self, yes: Self, no: Self) -> Self {
        for k in 0..N {
            self.0[k] = if self.0[k].is_sign_negative() {
                yes.0[k]
            } else {
                no.0[k]
            };
        }
        self
    }

    #[inline(always)]
    fn shift_left<const BITS: i32>(mut self) -> Self {
        for k in 0..N {
            self.0[k] = f64::from_bits(self.0[k].to_bits() << BITS);
        }
        self
    }

    #[inline(always)]
    fn shift_right<const BITS: i32>(mut self) -> Self {
        for k in 0..N {
            self.0[k] = f64::from_bits(self.0[k].to_bits() >> BITS);
        }
        self
    }

    #[inline(always)]
    fn and(mut self, other: Self) -> Self {
        for k in 0..N {
            self.0[k] = f64::from_bits(self.0[k].to_bits() & other.0[k].to_bits());
        }
        self
    }

    #[inline(always)]
    fn xor(mut self, other: Self) -> Self {
        for k in 0..N {
            self.0[k] = f64::from_bits(self.0[k].to_bits() ^ other.0[k].to_bits());
        }
        self
    }
}
