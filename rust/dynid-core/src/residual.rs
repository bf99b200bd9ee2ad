//! The third loop online: one regression per joint on a pair of that joint's signals, or on signals that it names.

use core::ops::Range;

use crate::error::CoreError;
use crate::lanes::{self, Kernel, Lanes, Portable, MOST_LANES};
use crate::mixture::{GaussianMixtureRegression, Prediction};
use crate::mixture_rows::{MixtureRows, Own, PredictionRow};
use crate::rbf::NormalisedRbf;
use crate::signal::{Signal, SignalKind, MAX_INPUTS};
use crate::slices::{at, part, part_mut, tail};
use crate::state::State;

/// What the regressions see. Section 5 of the paper names the first two pairs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ResidualInputs {
    /// Deflection `q_motor - q` and its rate, channel delay taken out (two encoders).
    Deflection,
    /// Motor-side position and velocity of the joint.
    JointState,
    /// Deflection less what the link's own torque winds up, `q_motor - q - compliance * tau_link` with the **predicted**
    /// rigid-body torque, and the deflection's rate. What the gear holds back is left over; the load, which is a
    /// hundred times larger and already in the rigid body, is not.
    LoadFreeDeflection,
    /// Signals by name, of any joint: one list per joint, at most [`MAX_INPUTS`] long, empty where there is no regression.
    Signals(Vec<Vec<Signal>>),
}

/// The load of the gears as the model predicts it, one value per joint.
#[derive(Clone, Copy, Debug)]
pub struct Load<'a> {
    /// Rigid-body torque \[N·m\].
    pub tau_link: &'a [f64],
    /// The same as the torque channel shows it \[torque unit\]; what compliances multiply.
    pub scaled: &'a [f64],
}

impl ResidualInputs {
    /// The pairs that have a name of their own.
    pub const PAIRS: [Self; 3] = [Self::Deflection, Self::JointState, Self::LoadFreeDeflection];

    /// Name in files.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Deflection => "deflection",
            Self::JointState => "joint_state",
            Self::LoadFreeDeflection => "load_free_deflection",
            Self::Signals(_) => "signals",
        }
    }

    /// True if they need an encoder on either side of the gear: signals do where they name both sides of one.
    #[must_use]
    pub fn two_encoders(&self) -> bool {
        match self {
            Self::JointState => false,
            Self::Deflection | Self::LoadFreeDeflection => true,
            Self::Signals(joints) => joints.iter().any(|signals| names_both_sides(signals)),
        }
    }

    /// Signals by name, one list per joint; `None` for the pairs.
    #[must_use]
    pub fn signals(&self) -> Option<&[Vec<Signal>]> {
        match self {
            Self::Signals(joints) => Some(joints),
            _ => None,
        }
    }

    /// Number of inputs of joint `j`.
    #[must_use]
    pub fn len(&self, j: usize) -> usize {
        self.signals()
            .map_or(2, |joints| joints.get(j).map_or(0, Vec::len))
    }

    /// The inputs of joint `j` at a state, [`Self::len`] of them in front. `wind_up` is `compliance * tau_link` \[rad\], read
    /// by the load-free deflection; `tau_link` is read by signals of that name.
    #[must_use]
    pub fn at(
        &self,
        j: usize,
        state: &State<'_>,
        wind_up: f64,
        tau_link: &[f64],
    ) -> [f64; MAX_INPUTS] {
        let mut u = [0.0; MAX_INPUTS];
        match self.signals() {
            None => {
                let [first, second] =
                    self.pairs::<Portable<1, false>>(state, j..j + 1, Lanes::splat(wind_up));
                [u[0], u[1]] = [first.raw()[0], second.raw()[0]];
            }
            Some(joints) => {
                let own = joints.get(j).map_or(&[][..], Vec::as_slice);
                for (u, signal) in u.iter_mut().zip(own) {
                    *u = signal.at(state, tau_link);
                }
            }
        }
        u
    }

    /// The pairs of a row of joints; zeros for signals by name.
    #[inline(always)]
    fn pairs<L: Lanes>(&self, state: &State<'_>, joints: Range<usize>, wind_up: L) -> [L; 2] {
        let row = |signal| L::load_some(part(signal, joints.start, joints.end));
        let motor = [row(state.q_motor), row(state.dq_motor)];
        let [deflection, rate] = [motor[0] - row(state.q), motor[1] - row(state.dq)];
        match self {
            Self::Deflection => [deflection, rate],
            Self::JointState => motor,
            Self::LoadFreeDeflection => [deflection - wind_up, rate],
            Self::Signals(_) => [L::splat(0.0); 2],
        }
    }

    /// # Errors
    /// [`CoreError`] if signals are not one list per joint, too many, or of joints that there are not.
    fn check(&self, n_joints: usize) -> Result<(), CoreError> {
        let Some(joints) = self.signals() else {
            return Ok(());
        };
        if joints.len() != n_joints {
            return Err(CoreError::Length {
                what: "residual signals",
                expected: n_joints,
                actual: joints.len(),
            });
        }
        for (joint, signals) in joints.iter().enumerate() {
            if signals.len() > MAX_INPUTS {
                return Err(CoreError::Range {
                    what: "number of signals of a joint's residual",
                });
            }
            if let Some(signal) = signals.iter().find(|signal| signal.joint >= n_joints) {
                return Err(CoreError::SignalJoint {
                    joint,
                    other: signal.joint,
                });
            }
        }
        Ok(())
    }
}

fn names_both_sides(signals: &[Signal]) -> bool {
    use SignalKind::{Ddq, DdqMotor, Dq, DqMotor, QMotor, Q};
    let names = |kind, joint| signals.contains(&Signal { kind, joint });
    signals.iter().any(|signal| match signal.kind {
        Q => names(QMotor, signal.joint),
        Dq => names(DqMotor, signal.joint),
        Ddq => names(DdqMotor, signal.joint),
        _ => false,
    })
}

/// How a joint's residual torque follows from its inputs. The choice is the user's.
#[derive(Clone, Debug, PartialEq)]
pub enum Regression {
    /// Eqs. 31-39.
    Mixture(GaussianMixtureRegression),
    /// Eqs. 27-30.
    Rbf(NormalisedRbf),
}

impl Regression {
    /// Name in files and for people.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Mixture(_) => "mixture",
            Self::Rbf(_) => "rbf",
        }
    }

    /// Inputs that it takes.
    #[must_use]
    pub fn n_inputs(&self) -> usize {
        match self {
            Self::Mixture(mixture) => mixture.n_inputs(),
            Self::Rbf(rbf) => rbf.n_inputs(),
        }
    }

    /// Mean, variance and distance from the data at `u`.
    #[must_use]
    pub fn predict(&self, u: &[f64]) -> Prediction {
        match self {
            Self::Mixture(mixture) => mixture.predict(u),
            Self::Rbf(rbf) => rbf.predict(u),
        }
    }

    fn second_moment(&self) -> f64 {
        match self {
            Self::Mixture(mixture) => mixture.second_moment(),
            Self::Rbf(rbf) => rbf.second_moment(),
        }
    }
}

impl From<GaussianMixtureRegression> for Regression {
    fn from(mixture: GaussianMixtureRegression) -> Self {
        Self::Mixture(mixture)
    }
}

impl From<NormalisedRbf> for Regression {
    fn from(rbf: NormalisedRbf) -> Self {
        Self::Rbf(rbf)
    }
}

/// Residual torque `tau_u` of Eq. 26.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    inputs: ResidualInputs,
    compliance: Vec<f64>,
    joints: Vec<Option<Regression>>,
    /// The same numbers with joints in lanes: one entry for every [`MOST_LANES`] joints.
    lanes: Vec<JointLanes>,
    /// True where every regression is a mixture on a pair: then nothing is done joint by joint.
    only_pairs: bool,
}

/// Distance in widths up to which a regression on two inputs is trusted fully, and the one from which it is not trusted
/// at all. Between them its torque fades, so that leaving the data is not a step.
const TRUSTED: (f64, f64) = (4.0, 6.0);

/// What every further input adds to both: a normal cloud of any dimension (1 to 6) then has the same part of its samples
/// beyond them (3e-4 and 2e-8, within a factor of two), because distances grow with the number of inputs.
const TRUSTED_PER_INPUT: f64 = 0.25;

/// Greater variances are an overflow.
const MOST_VARIANCE: f64 = 1e300;

impl Residual {
    /// `joints`: one regression per joint, `None` where the third loop did not pay.
    ///
    /// # Errors
    /// [`CoreError`] if a regression does not have as many inputs as there are (two, or the signals that are named for
    /// its joint), or signals do not fit the joints.
    pub fn new(inputs: ResidualInputs, joints: Vec<Option<Regression>>) -> Result<Self, CoreError> {
        inputs.check(joints.len())?;
        for (joint, regression) in joints.iter().enumerate() {
            let Some(regression) = regression else {
                continue;
            };
            if regression.n_inputs() != inputs.len(joint) {
                return Err(CoreError::ResidualInputs {
                    joint,
                    actual: regression.n_inputs(),
                    expected: inputs.len(joint),
                });
            }
        }
        let pairs_alone = |joint: &Option<Regression>| !matches!(joint, Some(Regression::Rbf(_)));
        Ok(Self {
            only_pairs: inputs.signals().is_none() && joints.iter().all(pairs_alone),
            inputs,
            compliance: vec![0.0; joints.len()],
            lanes: joints.chunks(MOST_LANES).map(JointLanes::new).collect(),
            joints,
        })
    }

    /// With the gears' compliance \[rad per torque unit\], one per joint; zeros until it is given.
    ///
    /// # Errors
    /// [`CoreError`] if the length is wrong or a number negative or not finite.
    pub fn with_compliance(mut self, compliance: Vec<f64>) -> Result<Self, CoreError> {
        crate::dynamics::check_length("compliance", &compliance, self.joints.len())?;
        if !compliance.iter().all(|c| c.is_finite() && *c >= 0.0) {
            return Err(CoreError::Range { what: "compliance" });
        }
        for (lanes, own) in self.lanes.iter_mut().zip(compliance.chunks(MOST_LANES)) {
            lanes.compliance[..own.len()].copy_from_slice(own);
        }
        self.compliance = compliance;
        Ok(self)
    }

    /// Which signals the regressions see.
    #[must_use]
    pub fn inputs(&self) -> &ResidualInputs {
        &self.inputs
    }

    /// Compliance of the gears \[rad per torque unit\], one per joint.
    #[must_use]
    pub fn compliance(&self) -> &[f64] {
        &self.compliance
    }

    /// The regressions, one per joint.
    #[must_use]
    pub fn joints(&self) -> &[Option<Regression>] {
        &self.joints
    }

    /// Torque of every joint \[N·m\] into `tau`; true if some joint was so far from the data that its torque was faded.
    ///
    /// `load` is the predicted rigid-body torque. `variance` \[(N·m)²\] comes with what the model leaves on each
    /// joint. Where a regression is trusted it is replaced by the regression's own, which holds that noise too; where
    /// it fades, by that of a residual about which nothing is known, on top of the noise.
    pub fn torque_into(
        &self,
        state: &State<'_>,
        load: Load<'_>,
        tau: &mut [f64],
        variance: &mut [f64],
    ) -> bool {
        lanes::run(ResidualTorque {
            residual: self,
            state,
            load,
            tau,
            variance,
        })
    }

    /// Answers of the regressions that are not mixtures, and the inputs of the mixtures where these are not a pair.
    fn single_joints(&self, first: usize, state: &State<'_>, load: Load<'_>) -> Singles {
        let mut singles = Singles::default();
        let signals = self.inputs.signals().is_some();
        let joints = self.joints.iter().skip(first).take(MOST_LANES);
        for (lane, joint) in joints.enumerate() {
            let j = first + lane;
            let inputs = || {
                let wind_up = at(&self.compliance, j) * at(load.scaled, j);
                self.inputs.at(j, state, wind_up, load.tau_link)
            };
            match joint {
                Some(Regression::Rbf(rbf)) => {
                    let answer = rbf.predict(&inputs());
                    let numbers = [answer.mean, answer.variance, answer.distance_squared];
                    set_lane(&mut singles.answers, lane, numbers);
                }
                Some(Regression::Mixture(_)) if signals => {
                    set_lane(&mut singles.inputs, lane, inputs());
                }
                _ => {}
            }
        }
        singles
    }
}

/// Writes a column of rows.
fn set_lane<const N: usize>(rows: &mut [[f64; MOST_LANES]; N], lane: usize, column: [f64; N]) {
    for (row, x) in rows.iter_mut().zip(column) {
        if let Some(place) = row.get_mut(lane) {
            *place = x;
        }
    }
}

/// What [`MOST_LANES`] joints do one by one.
#[derive(Default)]
struct Singles {
    inputs: [[f64; MOST_LANES]; MAX_INPUTS],
    answers: [[f64; MOST_LANES]; 3],
}

/// Numbers of [`MOST_LANES`] joints.
#[derive(Clone, Debug, PartialEq)]
struct JointLanes {
    mixtures: MixtureRows,
    /// 1 where there is a regression, and where it is a mixture.
    present: [f64; MOST_LANES],
    mixture: [f64; MOST_LANES],
    compliance: [f64; MOST_LANES],
    /// Distances up to which a regression is trusted fully, and from which on not at all.
    near: [f64; MOST_LANES],
    far: [f64; MOST_LANES],
    /// What is expected of the square of a residual about which nothing is known.
    moment: [f64; MOST_LANES],
}

impl JointLanes {
    fn new(joints: &[Option<Regression>]) -> Self {
        let own = joints.iter().map(|joint| match joint {
            Some(Regression::Mixture(own)) => Some((own.n_inputs(), own.components())),
            _ => None,
        });
        let of = |value: &dyn Fn(&Regression) -> f64| {
            let mut lanes = [0.0; MOST_LANES];
            for (lane, joint) in lanes.iter_mut().zip(joints) {
                *lane = joint.as_ref().map_or(0.0, value);
            }
            lanes
        };
        let further = |joint: &Regression| TRUSTED_PER_INPUT * (joint.n_inputs() as f64 - 2.0);
        Self {
            mixtures: MixtureRows::side_by_side(&own.collect::<Vec<_>>()),
            present: of(&|_| 1.0),
            mixture: of(&|joint| f64::from(u8::from(matches!(joint, Regression::Mixture(_))))),
            compliance: [0.0; MOST_LANES],
            near: of(&|joint| TRUSTED.0 + further(joint)),
            far: of(&|joint| TRUSTED.1 + further(joint)),
            moment: of(&Regression::second_moment),
        }
    }
}

impl JointLanes {
    /// Answers where not every joint has a mixture on a pair.
    #[inline(always)]
    fn mixed<L: Lanes>(
        &self,
        residual: &Residual,
        singles: &Singles,
        pair: [L; 2],
        first: usize,
    ) -> PredictionRow<L> {
        let mut u = [L::splat(0.0); MAX_INPUTS];
        if residual.inputs.signals().is_some() {
            for (u, row) in u.iter_mut().zip(&singles.inputs) {
                *u = L::load(tail(row, first));
            }
        } else {
            [u[0], u[1]] = pair;
        }
        let u = u.get(..self.mixtures.n_inputs()).unwrap_or_default();
        let own = self.mixtures.predict(u, Own(first));
        let mixture = L::load(tail(&self.mixture, first));
        let [mean, variance, distance_squared] = &singles.answers;
        let zero = L::splat(0.0);
        PredictionRow {
            mean: zero.if_less(mixture, own.mean, L::load(tail(mean, first))),
            variance: zero.if_less(mixture, own.variance, L::load(tail(variance, first))),
            distance_squared: zero.if_less(
                mixture,
                own.distance_squared,
                L::load(tail(distance_squared, first)),
            ),
        }
    }
}

/// [`Residual::torque_into`], joints in lanes.
pub(crate) struct ResidualTorque<'a> {
    pub residual: &'a Residual,
    pub state: &'a State<'a>,
    pub load: Load<'a>,
    pub tau: &'a mut [f64],
    pub variance: &'a mut [f64],
}

impl Kernel for ResidualTorque<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> bool {
        let residual = self.residual;
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let mut faded = false;
        for (group, lanes) in residual.lanes.iter().enumerate() {
            let start = group * MOST_LANES;
            let singles = if residual.only_pairs {
                None
            } else {
                Some(residual.single_joints(start, self.state, self.load))
            };
            let mut first = 0;
            while first < MOST_LANES && start + first < self.tau.len() {
                let from = start + first;
                let joints = from..self.tau.len().min(from + L::LEN);
                let scaled = L::load_some(part(self.load.scaled, joints.start, joints.end));
                let wind_up = L::load(tail(&lanes.compliance, first)) * scaled;
                let pair = residual.inputs.pairs(self.state, joints.clone(), wind_up);
                let own = match &singles {
                    None => lanes.mixtures.predict(&pair, Own(first)),
                    Some(singles) => lanes.mixed(residual, singles, pair, first),
                };
                let PredictionRow {
                    mean,
                    variance: own_variance,
                    distance_squared,
                } = own;
                let distance = distance_squared.sqrt();

                let near = L::load(tail(&lanes.near, first));
                let far = L::load(tail(&lanes.far, first));
                // A NaN distance (an overflow) is not less than anything and so trusts nothing.
                let share = ((far - distance) / (far - near)).at_most(one);
                let trust = distance.if_less(far, share, zero);
                let noise = L::load_some(part(self.variance, joints.start, joints.end));
                let unknown = (one - trust) * (noise + L::load(tail(&lanes.moment, first)));
                let known = zero.if_less(trust, trust * own_variance, zero);
                let torque = zero.if_less(trust, trust * mean, zero);
                let spread = (unknown + known).at_most(L::splat(MOST_VARIANCE));

                let present = L::load(tail(&lanes.present, first));
                faded |= trust.any_less(present);
                zero.if_less(present, torque, zero).store_some(part_mut(
                    self.tau,
                    joints.start,
                    joints.end,
                ));
                zero.if_less(present, spread, noise).store_some(part_mut(
                    self.variance,
                    joints.start,
                    joints.end,
                ));
                first += L::LEN;
            }
        }
        faded
    }
}

#[cfg(test)]
mod tests;
