//! A number that counts what is done to it: operations of a kernel, from the kernel itself.

use std::cell::Cell;
use std::ops::{Add, Div, Mul, Neg, Sub};

use dynid_core::lanes::{Lanes, Portable};

/// Operations on vector registers, by what executes them. A change of sign is none: it goes into what comes next.
#[derive(Clone, Copy, Debug, Default)]
pub struct Count {
    /// Products, with or without an addition.
    pub products: u32,
    /// Sums, comparisons, choices and bits.
    pub others: u32,
}

thread_local! {
    static COUNT: Cell<Count> = const { Cell::new(Count { products: 0, others: 0 }) };
}

/// What `work` does.
pub fn counted(work: impl FnOnce()) -> Count {
    COUNT.set(Count::default());
    work();
    COUNT.get()
}

fn product(x: f64) -> Counted {
    let count = COUNT.get();
    COUNT.set(Count {
        products: count.products + 1,
        ..count
    });
    Counted(x)
}

fn other(x: f64) -> Counted {
    let count = COUNT.get();
    COUNT.set(Count {
        others: count.others + 1,
        ..count
    });
    Counted(x)
}

fn bits(x: u64) -> Counted {
    other(f64::from_bits(x))
}

/// One lane.
#[derive(Clone, Copy, Debug)]
pub struct Counted(f64);

impl Add for Counted {
    type Output = Self;

    fn add(self, other_one: Self) -> Self {
        other(self.0 + other_one.0)
    }
}

impl Sub for Counted {
    type Output = Self;

    fn sub(self, other_one: Self) -> Self {
        other(self.0 - other_one.0)
    }
}

impl Mul for Counted {
    type Output = Self;

    fn mul(self, factor: Self) -> Self {
        product(self.0 * factor.0)
    }
}

impl Div for Counted {
    type Output = Self;

    fn div(self, divisor: Self) -> Self {
        product(self.0 / divisor.0)
    }
}

impl Neg for Counted {
    type Output = Self;

    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Lanes for Counted {
    type Raw = [f64; 1];
    type Four = Portable<4, true>;
    const LEN: usize = 1;
    const FUSED: bool = true;
    const ZERO: Self::Raw = [0.0];

    fn raw(self) -> Self::Raw {
        [self.0]
    }

    fn from_raw([x]: Self::Raw) -> Self {
        Self(x)
    }

    fn splat(x: f64) -> Self {
        Self(x)
    }

    fn load(from: &[f64]) -> Self {
        Self(from[0])
    }

    fn store(self, to: &mut [f64]) {
        to[0] = self.0;
    }

    fn four(parts: [Self; 4]) -> Self::Four {
        Portable::from_raw(parts.map(|part| part.0))
    }

    fn mul_add(self, factor: Self, addend: Self) -> Self {
        product(self.0.mul_add(factor.0, addend.0))
    }

    fn mul_sub_from(self, factor: Self, minuend: Self) -> Self {
        product((-self.0).mul_add(factor.0, minuend.0))
    }

    fn sqrt(self) -> Self {
        product(self.0.sqrt())
    }

    fn if_less(self, than: Self, yes: Self, no: Self) -> Self {
        let _ = other(self.0);
        other(if self.0 < than.0 { yes.0 } else { no.0 })
    }

    fn less_bits(self, than: Self) -> u32 {
        let _ = other(self.0);
        u32::from(self.0 < than.0)
    }

    fn if_signed(self, yes: Self, no: Self) -> Self {
        other(if self.0.is_sign_negative() {
            yes.0
        } else {
            no.0
        })
    }

    fn shift_left<const N: i32>(self) -> Self {
        bits(self.0.to_bits() << N)
    }

    fn shift_right<const N: i32>(self) -> Self {
        bits(self.0.to_bits() >> N)
    }

    fn and(self, mask: Self) -> Self {
        bits(self.0.to_bits() & mask.0.to_bits())
    }

    fn xor(self, mask: Self) -> Self {
        bits(self.0.to_bits() ^ mask.0.to_bits())
    }
}
