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
    /// Part of declared models, so never found: smooth friction takes the place of the paper's, the others are in all.
    pub declared: bool,
    /// What a search for it and a report of it go by.
    pub diagnosis: Diagnosis,
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

    /// What shape parameter `name` is where it is not given; `None` where it has to be.
    #[must_use]
    pub fn where_absent(&self, name: &str) -> Option<f64> {
        let own = self.shape.iter().find(|parameter| parameter.name == name);
        own.and_then(|parameter| parameter.absent)
    }

    /// Where width and sharpness of the sign of the joint's own speed stand among the shape parameters, if it has one.
    pub(super) fn sign(&self) -> Option<[usize; 2]> {
        let at = |wanted| {
            let same = |parameter: &ShapeParameter| parameter.relative_to == Some(wanted);
            self.shape.iter().position(same)
        };
        let of_two = self
            .shape
            .iter()
            .any(|parameter| matches!(parameter.rule, Rule::Partner));
        let both = [
            at(Reference::FrictionWidth)?,
            at(Reference::FrictionSharpness)?,
        ];
        (!of_two).then_some(both)
    }

    /// What a joint must have, and its runs must show, before the effect can be found there: [`Diagnosis::requires`] and what
    /// follows from the signals.
    pub fn requirements(&self) -> impl Iterator<Item = Need> + use<'_> {
        let of_signals = [("tau_link", Need::Load), ("temperature", Need::Temperature)];
        let needed = of_signals
            .into_iter()
            .filter(|(signal, _)| self.needs(signal));
        let own = self.diagnosis.requires.iter().copied();
        own.chain(needed.map(|(_, need)| need))
    }
}

/// What a search for an effect and a report of it go by.
#[derive(Clone, Copy, Debug)]
pub struct Diagnosis {
    /// Where it can act.
    pub places: Places,
    /// Looked for where it is not declared.
    pub sought: bool,
    /// What it needs beside its signals.
    pub requires: &'static [Need],
    /// Signal and its unit that a report draws the torque against (`{torque}`: the channel's); `None`: its own column.
    pub drawn_against: Option<(&'static str, &'static str)>,
    /// What its partner feels of it, coefficient by coefficient, as a power of the ratio's size: forces between two joints act
    /// on both by their power. Empty: it acts on a joint alone.
    pub reaction: &'static [i32],
    /// Largest part of the motor's torque that it may add within the trained load, where more is no physics.
    pub most_relative: Option<f64>,
}

/// Where an effect can act.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Places {
    /// On a joint.
    Joint,
    /// On any two joints.
    Pair,
    /// On two joints that follow each other in the chain.
    Neighbours,
}

impl Places {
    /// In files and reports.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Joint => "joint",
            Self::Pair => "pair",
            Self::Neighbours => "neighbours",
        }
    }
}

/// What a joint must have, or its runs must show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// An encoder on either side of the gear.
    TwoEncoders,
    /// A joint that turns.
    Revolute,
    /// A load that the model predicts.
    Load,
    /// A measured temperature.
    Temperature,
}

impl Need {
    /// In files and reports.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::TwoEncoders => "two_encoders",
            Self::Revolute => "revolute",
            Self::Load => "load",
            Self::Temperature => "temperature",
        }
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
    /// Values that a search begins with; combinations that [`Entry::check`] refuses are left out, and so are values outside
    /// of the [`Range`], which are for those who plan motions.
    pub grid: &'static [f64],
    /// Whose size the values of the grid are parts of; `None`: they are in the parameter's own unit.
    pub relative_to: Option<Reference>,
    /// Between which values a search goes on, in the parameter's own unit; `None`: the grid's alone.
    pub range: Option<Range>,
    /// What it is where it is not given, as in older files; `None`: it has to be.
    pub absent: Option<f64>,
    /// The shape parameter that a search does not let it fall below.
    pub not_below: Option<&'static str>,
}

impl ShapeParameter {
    /// The same with a grid that is relative to what the runs show.
    #[must_use]
    pub const fn of(self, reference: Reference) -> Self {
        Self {
            relative_to: Some(reference),
            ..self
        }
    }

    /// The same, not searched below another shape parameter.
    #[must_use]
    pub const fn not_below(self, other: &'static str) -> Self {
        Self {
            not_below: Some(other),
            ..self
        }
    }

    /// The same, searched between the grid's values.
    #[must_use]
    pub const fn refined(self, scale: Scale, lowest: f64, highest: f64) -> Self {
        Self {
            range: Some(Range {
                scale,
                lowest,
                highest,
            }),
            ..self
        }
    }
}

/// What a fit and its runs show of a joint, to which a shape parameter is relative.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reference {
    /// The width of friction's step, which the parameter is equal to: nothing is searched. The grid, in its own unit, is for
    /// those who have no fit.
    FrictionWidth,
    /// The sharpness of friction's step, in the same way.
    FrictionSharpness,
    /// The standard deviation of the load that the model predicts.
    Load,
    /// The greatest speed.
    Speed,
    /// The chain: values are places along it from the joint, and those where there is none are left out.
    Chain,
}

impl Reference {
    /// In files and reports.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::FrictionWidth => "friction_width",
            Self::FrictionSharpness => "friction_sharpness",
            Self::Load => "load",
            Self::Speed => "speed",
            Self::Chain => "chain",
        }
    }
}

/// Bounds of a search between the values of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// In what even steps are taken.
    pub scale: Scale,
    /// Least value; of a logarithm, least magnitude.
    pub lowest: f64,
    /// Greatest value; of a logarithm, greatest magnitude.
    pub highest: f64,
}

/// In what a search takes even steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// The logarithm of the magnitude; the sign stays.
    Log,
    /// The value.
    Linear,
}

impl Scale {
    /// In files and reports.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Log => "log",
            Self::Linear => "linear",
        }
    }
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
    /// Along the chain, -1 or 1.
    Side,
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
            Self::Side => "must be -1 (the joint before) or 1 (the joint behind)",
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
                Self::Side => value.abs() == 1.0,
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
