//! The third loop online: one regression per joint on a pair of that joint's signals, or on signals that it names.

mod inputs;

pub use inputs::ResidualInputs;

use crate::error::CoreError;
use crate::lanes::{self, Kernel, Lanes, MOST_LANES};
use crate::mixture::{GaussianMixtureRegression, Prediction};
use crate::mixture_rows::{MixtureRows, Own, PredictionRow};
use crate::rbf::NormalisedRbf;
use crate::signal::MAX_INPUTS;
use crate::slices::{at, part, part_mut, tail};
use crate::state::State;

/// The load of the gears as the model predicts it, one value per joint.
#[derive(Clone, Copy, Debug)]
pub struct Load<'a> {
    /// Rigid-body torque \[N·m\].
    pub tau_link: &'a [f64],
    /// The same as the torque channel shows it \[torque unit\]; what compliances multiply.
    pub scaled: &'a [f64],
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

    /// Numbers that are torques, among others.
    fn torques(&self) -> &[f64] {
        match self {
            Self::Mixture(mixture) => mixture.means(),
            Self::Rbf(rbf) => rbf.weights(),
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
        let torques = joints.iter().flatten().flat_map(Regression::torques);
        if torques.into_iter().any(|x| x.abs() > crate::model::MOST) {
            return Err(CoreError::TooLarge {
                what: "a torque of the residual",
            });
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
