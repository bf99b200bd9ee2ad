//! Columns of a row of speeds: what is handed on to loops over joints or along a run.

use crate::lanes::Lanes;

/// N columns of every speed, with two shape parameters.
///
/// A type, not a function: one that is handed on as a value is compiled by itself, without the registers of who calls it,
/// and every instruction on lanes is a call there, which took about ten times as long.
pub trait SpeedRow<const N: usize> {
    /// The columns of a row of speeds `v`.
    fn row<L: Lanes>(v: L, first: L, second: L) -> [L; N];
}
