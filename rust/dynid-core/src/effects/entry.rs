//! What the catalogue says about a kind of effect: its coefficients with their signs, its shape parameters with their rules.

use super::EffectInput;

/// One kind of effect. Its formula is in the file of the same name.
#[derive(Debug)]
pub struct Entry {
    /// Name in files and reports.
    pub kind: &'static str,
    /// Torque on joint j, as a formula for people.
    pub formula: &'static str,
    /// Linear coefficients of one joint.
    pub coefficients: &'static [Coefficient],
    /// Shape parameters of one joint.
    pub shape: &'static [ShapeParameter],
    /// Fields of [`EffectInput`] that the formula reads.
    pub signals: &'static [&'static str],
    /// Numbers per joint that it remembers from sample to sample, all zero before the first.
    pub memory: usize,
    /// Part of every declared model, so never found.
    pub declared: bool,
    /// What the rules of the single shape parameters do not say; the mend as the end of a sentence.
    pub check: fn(shape: &[f64]) -> Result<(), &'static str>,
    /// Torque of joint `j` per unit coefficient, written to `columns`.
    pub columns: fn(
        shape: &[f64],
        j: usize,
        input: &EffectInput<'_>,
        memory: &mut [f64],
        columns: &mut [f64],
    ),
}

impl Entry {
    /// True if the formula reads this field of [`EffectInput`].
    #[must_use]
    pub fn needs(&self, signal: &str) -> bool {
        self.signals.contains(&signal)
    }
}

/// A linear coefficient.
#[derive(Clone, Copy, Debug)]
pub struct Coefficient {
    /// Name in files and reports.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// What physics says about its sign; another one refutes the effect.
    pub sign: Sign,
}

/// What physics says about a coefficient.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sign {
    /// Nothing.
    Free,
    /// At least zero.
    NonNegative,
    /// At most zero.
    NonPositive,
}

impl Sign {
    /// Least and greatest value.
    #[must_use]
    pub fn bounds(self) -> (f64, f64) {
        match self {
            Self::Free => (f64::NEG_INFINITY, f64::INFINITY),
            Self::NonNegative => (0.0, f64::INFINITY),
            Self::NonPositive => (f64::NEG_INFINITY, 0.0),
        }
    }
}

/// A shape parameter: enters the formula other than linearly.
#[derive(Clone, Copy, Debug)]
pub struct ShapeParameter {
    /// Name in files and reports.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// What values it may have.
    pub rule: Rule,
    /// Values that a search begins with; combinations that [`Entry::check`] refuses are left out.
    pub grid: &'static [f64],
}

/// What values a shape parameter may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// Any finite number.
    Any,
    /// Above zero.
    Positive,
    /// At least zero.
    NonNegative,
    /// Index along the chain of another joint, or -1 for none; a search tries every other joint, so the grid is empty.
    Partner,
}

impl Rule {
    /// As the end of a sentence.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Any => "must be finite",
            Self::Positive => "must be positive",
            Self::NonNegative => "must be at least 0",
            Self::Partner => "must be the index of another joint, or -1 for none",
        }
    }

    /// True if joint `j` of `n_joints` may have `value`.
    #[must_use]
    pub fn allows(self, value: f64, j: usize, n_joints: usize) -> bool {
        value.is_finite()
            && match self {
                Self::Any => true,
                Self::Positive => value > 0.0,
                Self::NonNegative => value >= 0.0,
                Self::Partner => {
                    value == -1.0 || (0..n_joints).any(|other| other != j && value == other as f64)
                }
            }
    }
}

/// The joint that a value of [`Rule::Partner`] names.
#[must_use]
pub fn partner_of(value: f64) -> Option<usize> {
    (value >= 0.0).then_some(value as usize)
}
