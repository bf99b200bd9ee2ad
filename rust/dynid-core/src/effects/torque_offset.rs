//! A constant torque per joint: `tau_j = o_j`.

/// Offset of the torque channel, or the even part of friction \[N·m\].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TorqueOffset;

impl TorqueOffset {
    /// One column of ones.
    pub fn columns_into(self, columns: &mut [f64]) {
        columns[0] = 1.0;
    }
}
