//! Which base columns the rows of one joint tell apart.
//!
//! Base columns are independent in the rows of all joints together; in those of one joint some are zero, and some follow
//! from others, in every state. They need not be folded: their columns of the factor follow from the others' as well, and no
//! factor of a single joint has to divide by what rounding leaves of zeros.

use dynid_core::lanes::{self, Kernel, Lanes, MOST_LANES};
use dynid_core::RobotModel;

use crate::base::probing_states;
use crate::error::OfflineError;
use crate::joint_columns::JointPlan;
use crate::probes::{Place, Probes};
use crate::triangle::{product, Columns};

/// What is left of a column, relative to the longest one, where it follows from those before it.
const NOTHING: f64 = 1e-13;

/// Of the base columns of one joint, in their order: those that are folded, and how the others follow from them.
pub(super) struct Structure {
    folded: Vec<usize>,
    others: Vec<usize>,
    /// `folded.len()` × `others.len()`, row-major; none falls on a later column.
    shares: Vec<f64>,
}

/// Rows of a joint beyond its columns: enough for what is left of a column to show.
const SPARE: usize = 12;

/// One for each joint, from random states: as with base parameters, it is a property of the geometry.
pub(super) fn structures(
    robot: &RobotModel,
    plan: &[JointPlan],
) -> Result<Vec<Structure>, OfflineError> {
    let most = plan.iter().map(|joint| joint.links.len()).max();
    let n_samples = (most.unwrap_or(0) + SPARE).next_multiple_of(MOST_LANES);
    let (q, dq, ddq) = probing_states(robot, n_samples, 0);
    let factors = lanes::run_narrow(Independent {
        robot,
        motion: [&q, &dq, &ddq],
        plan,
    });
    let of_joint = |(r, joint): (Vec<f64>, &JointPlan)| {
        let finite = r.iter().all(|x| x.is_finite());
        finite
            .then(|| Structure::new(&r, joint.links.len()))
            .ok_or(OfflineError::NonFinite { what: "rows" })
    };
    factors.into_iter().zip(plan).map(of_joint).collect()
}

/// For each joint the factor of its columns, with rows of zeros where one follows from those before it.
struct Independent<'a> {
    robot: &'a RobotModel,
    motion: [&'a [f64]; 3],
    plan: &'a [JointPlan],
}

impl Kernel for Independent<'_> {
    type Output = Vec<Vec<f64>>;

    #[inline(always)]
    fn run<S: Lanes<Raw = [f64; 1]>, L: Lanes>(self) -> Self::Output {
        let eights = self.motion[0].len() / self.robot.n_joints() / MOST_LANES;
        let columns = |joint: &JointPlan| Columns::zeros(joint.links.iter().map(|_| eights));
        let mut joints: Vec<Columns> = self.plan.iter().map(columns).collect();
        let place = |(j, joint): (usize, &JointPlan)| Place {
            matrix: j,
            first: 0,
            links: joint.links.clone(),
            first_column: 0,
        };
        let places: Vec<Place> = self.plan.iter().enumerate().map(place).collect();
        let probes = Probes {
            robot: self.robot,
            motion: self.motion,
            places: &places,
        };
        probes.fill::<L>(&mut joints);
        let mut factors = Vec::with_capacity(joints.len());
        for joint in &mut joints {
            let mut longest = 0.0_f64;
            for c in 0..joint.width() {
                let column = &*joint.column(c);
                longest = longest.max(product::<L>(column, column));
            }
            factors.push(joint.factor_above::<L>(NOTHING * NOTHING * longest));
        }
        factors
    }
}

impl Structure {
    /// From the factor of its columns, as many as `width`.
    fn new(r: &[f64], width: usize) -> Self {
        let (folded, others): (Vec<usize>, Vec<usize>) =
            (0..width).partition(|&c| r[c * width + c] > 0.0);
        let mut shares = vec![0.0; folded.len() * others.len()];
        for (o, &other) in others.iter().enumerate() {
            for i in (0..folded.partition_point(|&c| c < other)).rev() {
                let row = &r[folded[i] * width..(folded[i] + 1) * width];
                let later =
                    (i + 1..folded.len()).map(|k| row[folded[k]] * shares[k * others.len() + o]);
                let left = row[other] - later.sum::<f64>();
                shares[i * others.len() + o] = left / row[folded[i]];
            }
        }
        Self {
            folded,
            others,
            shares,
        }
    }

    /// What is folded of a joint's columns.
    pub(super) fn plan(&self, joint: &JointPlan) -> JointPlan {
        JointPlan {
            n_effect_columns: joint.n_effect_columns,
            links: self.folded.iter().map(|&c| joint.links[c]).collect(),
        }
    }

    /// Factor of all columns (of the effects, of the links, torque) from that of what was folded.
    pub(super) fn expand(&self, factor: &[f64], n_effect_columns: usize) -> Vec<f64> {
        let (n, n_links) = (self.folded.len(), self.folded.len() + self.others.len());
        let (narrow, width) = (n_effect_columns + n + 1, n_effect_columns + n_links + 1);
        // Where each folded column stands among all.
        let mut places: Vec<usize> = (0..n_effect_columns).collect();
        places.extend(self.folded.iter().map(|c| n_effect_columns + c));
        places.push(width - 1);
        let mut all = vec![0.0; width * width];
        for (row, &i) in factor.chunks_exact(narrow).zip(&places) {
            let to = &mut all[i * width..(i + 1) * width];
            for (x, &c) in row.iter().zip(&places) {
                to[c] = *x;
            }
            for (o, other) in self.others.iter().enumerate() {
                let links = row[n_effect_columns..].iter().take(n);
                let shares = self.shares[o..].iter().step_by(self.others.len());
                to[n_effect_columns + other] = links.zip(shares).map(|(x, share)| x * share).sum();
            }
        }
        all
    }
}
