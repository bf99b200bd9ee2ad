//! Effects: torques that are linear in their coefficients. A torque model is a sum of them.
//!
//! `tau_j = columns_j(input; shape, memory) · coefficients_j`. One file per effect with its formula, one entry in the
//! [`catalogue`] with its names. The same columns are fitted offline and summed online, so the two cannot drift apart.

mod bearing_friction;
pub mod catalogue;
mod counterbalance;
mod coupled_friction;
pub mod entry;
mod friction;
mod friction_hysteresis;
mod gear_hysteresis;
mod held;
mod inertial_coupling;
mod joint_spring;
mod load_dependent_friction;
mod load_hysteresis;
mod motor_torque;
mod position_dependent_friction;
mod rotor_inertia;
pub mod row;
pub(crate) mod smooth_friction;
mod speed_row;
mod stribeck;
mod temperature_friction;
mod thermal_friction;
mod torque_offset;
mod torque_ripple;
mod torque_saturation;

pub use catalogue::CATALOGUE;
pub use entry::Entry;
pub use friction::{friction_columns, PaperFriction, FRICTION_NAMES, N_FRICTION};
pub use motor_torque::{motor_torque_into, SIGNAL as TAU_MOTOR};
pub use row::JointRow;
use smooth_friction::SmoothFriction;
pub use smooth_friction::{SignSlopes, N_SLOPES};
pub use speed_row::SpeedRow;

use crate::dynamics::check_length;
use crate::error::{CoreError, EffectError};
use crate::lanes;
use crate::slices::{part, part_mut, rows};
use crate::state::State;

/// Upper bound on [`Effect::n_columns`]; columns of one joint fit in an array of this length.
pub const MAX_COLUMNS: usize = N_FRICTION;

/// What an effect sees of one sample. No measured torque is among it.
#[derive(Clone, Copy, Debug)]
pub struct EffectInput<'a> {
    /// Link side and motor side, on one clock, and the temperature where it is measured.
    pub state: State<'a>,
    /// Rigid-body torque that the model predicts, per joint \[N·m\]: the load of the gears.
    pub tau_link: &'a [f64],
    /// Torque that the model predicts at the motor, per joint \[torque unit\]: [`motor_torque_into`].
    pub tau_motor: &'a [f64],
    /// Time since the sample before \[s\].
    pub step: f64,
    /// The sign of the motor's speed of the joint that is asked, rounded as the effect rounds it, where it is known already:
    /// of many samples at once it takes a part of the time ([`Effect::sign_row`]). An input that has it is for one joint.
    pub sign: Option<f64>,
}

/// A kind of effect with its shape parameters.
#[derive(Clone, Debug)]
pub struct Effect {
    entry: &'static Entry,
    /// One row of shape parameters per joint, row-major.
    shape: Vec<f64>,
    /// Between which angles of every joint it is what its formula says ([`held`]); empty: anywhere.
    held: Vec<[f64; 2]>,
}

impl PartialEq for Effect {
    fn eq(&self, other: &Self) -> bool {
        self.kind() == other.kind() && self.shape == other.shape && self.held == other.held
    }
}

impl Effect {
    /// The effect `kind` of the [`catalogue`] with the shape parameters it names, one value per joint each.
    ///
    /// `held_from` and `held_to` may stand beside them: angles at which a function of the joint's own angle ends; beyond
    /// them it keeps the value that it has there.
    ///
    /// # Errors
    /// [`EffectError`] if there is no such kind, a name or a length does not fit, or a value is out of its range.
    pub fn new(
        kind: &str,
        shape: &[(impl AsRef<str>, impl AsRef<[f64]>)],
    ) -> Result<Self, EffectError> {
        let entry = catalogue::find(kind).ok_or_else(|| EffectError::Kind(kind.to_owned()))?;
        let given: Vec<&str> = shape.iter().map(|(name, _)| name.as_ref()).collect();
        let named = |wanted: &str| {
            let at = given.iter().position(|name| *name == wanted);
            at.map(|at| shape[at].1.as_ref())
        };
        let n_given = shape.first().map_or(0, |(_, values)| values.as_ref().len());
        let absent: Vec<(&str, Vec<f64>)> = entry
            .shape
            .iter()
            .filter(|wanted| named(wanted.name).is_none())
            .filter_map(|wanted| Some((wanted.name, vec![wanted.absent?; n_given])))
            .collect();
        let or_absent = |wanted: &str| {
            let own = absent.iter().find(|(name, _)| *name == wanted);
            named(wanted).or(own.map(|(_, values)| values.as_slice()))
        };
        let values = entry
            .shape
            .iter()
            .filter_map(|wanted| or_absent(wanted.name))
            .collect::<Vec<&[f64]>>();
        let ends = held::NAMES.map(named);
        let held = match ends {
            [Some(from), Some(to)] => held::ranges(entry, from, to)?,
            _ => Vec::new(),
        };
        let n_ends = if held.is_empty() { 0 } else { ends.len() };
        let n_names = entry.shape.len() - absent.len() + n_ends;
        if values.len() != entry.shape.len() || given.len() != n_names {
            return Err(EffectError::Names {
                entry,
                given: given.join(", "),
            });
        }
        let n_joints = values.first().map_or(held.len(), |first| first.len());
        let lengths = entry.shape.iter().map(|parameter| parameter.name);
        let lengths = lengths.zip(values.iter().map(|values| values.len()));
        let of_held = (!held.is_empty()).then_some((held::NAMES[0], held.len()));
        for (what, actual) in lengths.chain(of_held) {
            if actual == 0 || actual != n_joints {
                return Err(EffectError::Lengths {
                    entry,
                    what,
                    actual,
                    expected: n_joints,
                });
            }
        }
        let shape: Vec<f64> = (0..n_joints)
            .flat_map(|j| values.iter().map(move |values| values[j]))
            .collect();
        for (joint, row) in shape.chunks_exact(entry.shape.len().max(1)).enumerate() {
            check_row(entry, joint, n_joints, row)?;
        }
        Ok(Self { entry, shape, held })
    }

    /// [`Effect::shape`] without what is as where it is not given: what a file has to hold.
    #[must_use]
    pub fn shape_to_write(&self) -> Vec<(&'static str, Vec<f64>)> {
        let mut shape = self.shape();
        shape.retain(|(name, values)| {
            let absent = self.entry.where_absent(name);
            absent.is_none_or(|absent| values.iter().any(|value| *value != absent))
        });
        shape
    }

    /// Reflected rotor inertia.
    #[must_use]
    pub fn rotor_inertia() -> Self {
        Self::without_shape(&CATALOGUE[0])
    }

    /// Constant torque: sensor offset, or the even part of friction.
    #[must_use]
    pub fn torque_offset() -> Self {
        Self::without_shape(&CATALOGUE[1])
    }

    /// The paper's friction, with lambda of Eq. 9 and eps of Eqs. 10-11 per joint \[rad/s\].
    ///
    /// # Errors
    /// [`EffectError`] if lengths differ, a threshold is negative or a width is not positive.
    pub fn friction(
        velocity_threshold: &[f64],
        transition_width: &[f64],
    ) -> Result<Self, EffectError> {
        Self::new(
            friction::KIND,
            &[
                ("velocity_threshold", velocity_threshold),
                ("transition_width", transition_width),
            ],
        )
    }

    fn without_shape(entry: &'static Entry) -> Self {
        Self {
            entry,
            shape: Vec::new(),
            held: Vec::new(),
        }
    }

    /// What the catalogue says about it.
    #[must_use]
    pub fn entry(&self) -> &'static Entry {
        self.entry
    }

    /// Name in files and reports.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        self.entry.kind
    }

    /// True for a part of the declared model: what the catalogue calls so ([`Entry::declared`]), and Coulomb's friction whose
    /// sign is told by the way, which is hysteresis over a way that is too short for a gear.
    #[must_use]
    pub fn is_declared(&self) -> bool {
        self.entry.declared || friction_hysteresis::is_sign(self.entry, &self.shape)
    }

    /// Names of the coefficients of one joint.
    pub fn coefficient_names(&self) -> impl Iterator<Item = &'static str> {
        self.entry.coefficients.iter().map(|c| c.name)
    }

    /// Columns per joint.
    #[must_use]
    pub fn n_columns(&self) -> usize {
        self.entry.coefficients.len()
    }

    /// Numbers that it remembers from sample to sample for `n_joints`; all zero before the first sample.
    #[must_use]
    pub fn memory_len(&self, n_joints: usize) -> usize {
        self.entry.memory * n_joints
    }

    /// Shape parameters by name, one value per joint each; `held_from` and `held_to` last, where it has them.
    #[must_use]
    pub fn shape(&self) -> Vec<(&'static str, Vec<f64>)> {
        let width = self.entry.shape.len();
        let column = |k: usize| self.shape.iter().skip(k).step_by(width).copied().collect();
        let own = (0..width).map(|k| (self.entry.shape[k].name, column(k)));
        let ends = held::NAMES.into_iter().enumerate();
        let ends = ends.map(|(end, name)| (name, self.held.iter().map(|r| r[end]).collect()));
        own.chain(ends.filter(|_| self.is_held())).collect()
    }

    /// True if it ends at angles of its joints, and keeps its value beyond them.
    #[must_use]
    pub fn is_held(&self) -> bool {
        !self.held.is_empty()
    }

    /// The partner of joint `j`, and its coefficients over those of `j`; `None` where the effect acts on `j` alone.
    #[must_use]
    pub fn reaction(&self, j: usize) -> Option<(usize, Vec<f64>)> {
        let parameters = self.entry.shape;
        let own = self.shape.get(j * parameters.len()..)?;
        let named = |wanted: &str| {
            let at = parameters.iter().position(|p| p.name == wanted)?;
            own.get(at).copied()
        };
        let partner = entry::partner_of(named("partner")?)?;
        let ratio = named("ratio").unwrap_or(1.0).abs();
        let powers = self.entry.diagnosis.reaction;
        Some((
            partner,
            powers.iter().map(|&power| ratio.powi(power)).collect(),
        ))
    }

    /// Torque of joint `j` per unit coefficient, written to `columns` (length [`Self::n_columns`]).
    ///
    /// `memory` (length [`Self::memory_len`]) goes one sample on: call it once per joint and sample, in order of time.
    pub fn columns_into(
        &self,
        j: usize,
        input: &EffectInput<'_>,
        memory: &mut [f64],
        columns: &mut [f64],
    ) {
        let own = self.own_shape(j);
        if let Some(range) = self.held.get(j) {
            return held::columns(self.entry, own, j, *range, input, columns);
        }
        let m = self.entry.memory;
        let memory = part_mut(memory, j * m, (j + 1) * m);
        (self.entry.columns)(own, j, input, memory, columns);
    }

    /// Shape parameters of joint `j`.
    #[inline(always)]
    fn own_shape(&self, j: usize) -> &[f64] {
        let width = self.entry.shape.len();
        part(&self.shape, j * width, (j + 1) * width)
    }

    /// # Errors
    /// [`CoreError::Length`] if the shape parameters are not those of `n_joints`.
    pub fn check(&self, n_joints: usize) -> Result<(), CoreError> {
        if self.is_held() && self.held.len() != n_joints {
            return Err(CoreError::Length {
                what: held::NAMES[0],
                expected: n_joints,
                actual: self.held.len(),
            });
        }
        match self.entry.shape.first() {
            None => Ok(()),
            Some(first) if self.shape.len() != n_joints * self.entry.shape.len() => {
                Err(CoreError::Length {
                    what: first.name,
                    expected: n_joints,
                    actual: self.shape.len() / self.entry.shape.len(),
                })
            }
            Some(_) => Ok(()),
        }
    }
}

/// Range of every shape parameter of one joint, and what holds between them.
fn check_row(
    entry: &'static Entry,
    joint: usize,
    n_joints: usize,
    row: &[f64],
) -> Result<(), CoreError> {
    let shape = |what, rule| CoreError::Shape {
        kind: entry.kind,
        what,
        joint,
        rule,
    };
    for (parameter, value) in entry.shape.iter().zip(row) {
        if !parameter.rule.allows(*value, joint, n_joints) {
            return Err(shape(parameter.name, parameter.rule.words()));
        }
    }
    (entry.check)(row).map_err(|rule| shape("shape", rule))
}

/// An effect with its size: what a model stores and an estimator sums.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectTerm {
    effect: Effect,
    coefficients: Vec<f64>,
    in_lanes: InLanes,
}

/// Laws of friction, one of which every model has: shapes and coefficients once more, with joints in lanes.
#[derive(Clone, Debug, PartialEq)]
enum InLanes {
    Paper(Vec<f64>),
    Smooth(Vec<f64>),
    /// Any other effect.
    None,
}

impl EffectTerm {
    /// `coefficients`: `n_joints` rows of [`Effect::n_columns`] values, row-major.
    ///
    /// # Errors
    /// [`CoreError`] if a length is wrong or a number is not finite.
    pub fn new(effect: Effect, coefficients: Vec<f64>, n_joints: usize) -> Result<Self, CoreError> {
        effect.check(n_joints)?;
        check_length("coefficients", &coefficients, n_joints * effect.n_columns())?;
        if !coefficients.iter().all(|x| x.is_finite()) {
            return Err(CoreError::NonFiniteParameter);
        }
        let padded = || friction::padded(&effect.shape, &coefficients, effect.n_columns());
        let in_lanes = match effect.kind() {
            friction::KIND => InLanes::Paper(padded()),
            smooth_friction::KIND => InLanes::Smooth(padded()),
            _ => InLanes::None,
        };
        Ok(Self {
            effect,
            coefficients,
            in_lanes,
        })
    }

    /// The effect and its shape.
    #[must_use]
    pub fn effect(&self) -> &Effect {
        &self.effect
    }

    /// Coefficients, row-major by joint.
    #[must_use]
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients
    }

    /// Torque of every joint \[N·m\], written to `tau`; `memory` (length [`Effect::memory_len`]) goes one sample on.
    pub fn torque_into(&self, input: &EffectInput<'_>, memory: &mut [f64], tau: &mut [f64]) {
        struct Term<'a>(&'a EffectTerm, &'a EffectInput<'a>, [&'a mut [f64]; 2]);

        impl lanes::Kernel for Term<'_> {
            type Output = ();

            #[inline(always)]
            fn run<S: lanes::Lanes<Raw = [f64; 1]>, L: lanes::Lanes>(self) {
                let Self(term, input, [memory, tau]) = self;
                term.torque_on::<L>(input, memory, tau);
            }
        }

        lanes::run(Term(self, input, [memory, tau]));
    }

    /// [`Self::torque_into`] within a step that is on its path already.
    #[inline(always)]
    pub(crate) fn torque_on<L: lanes::Lanes>(
        &self,
        input: &EffectInput<'_>,
        memory: &mut [f64],
        tau: &mut [f64],
    ) {
        let dq = input.state.dq_motor;
        match &self.in_lanes {
            InLanes::Paper(numbers) => {
                friction::torque_in_lanes::<L, PaperFriction, N_FRICTION>(numbers, dq, tau);
            }
            InLanes::Smooth(numbers) => {
                use smooth_friction::N_COLUMNS;
                friction::torque_in_lanes::<L, SmoothFriction, N_COLUMNS>(numbers, dq, tau);
            }
            InLanes::None => self.joint_by_joint(input, memory, tau),
        }
    }

    #[inline(never)]
    fn joint_by_joint(&self, input: &EffectInput<'_>, memory: &mut [f64], tau: &mut [f64]) {
        let width = self.effect.n_columns();
        let mut columns = [0.0; MAX_COLUMNS];
        for (j, (tau, coefficients)) in tau
            .iter_mut()
            .zip(rows(&self.coefficients, width))
            .enumerate()
        {
            let own = columns.get_mut(..width).unwrap_or_default();
            self.effect.columns_into(j, input, memory, own);
            *tau = columns
                .iter()
                .zip(coefficients)
                .map(|(column, coefficient)| column * coefficient)
                .sum();
        }
    }
}
