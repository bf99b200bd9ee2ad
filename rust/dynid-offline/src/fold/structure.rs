//! Which base columns the rows of one joint tell apart.
//!
//! Base columns are independent in the rows of all joints together; in those of one joint some are zero, and some follow
//! from others, in every state. They need not be folded: their columns of the factor follow from the others' as well, and no
//! factor of a single joint has to divide by what rounding leaves of zeros.

use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::RobotModel;

use crate::base::probing_states;
use crate::batch::joint_torque_regressor;
use crate::error::OfflineError;
use crate::factor::triangular_factor;
use crate::joint_columns::JointPlan;

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
    let n = robot.n_joints();
    let row = N_LINK_PARAMS * n;
    let most = plan.iter().map(|joint| joint.links.len()).max();
    let n_samples = most.unwrap_or(0) + SPARE;
    let (q, dq, ddq) = probing_states(robot, n_samples, 0);
    let mut rows = vec![0.0; n_samples * n * row];
    joint_torque_regressor(robot, &q, &dq, &ddq, &mut rows)?;
    let of_joint = |(j, joint): (usize, &JointPlan)| {
        Structure::new(&joint.links, || rows.chunks_exact(row).skip(j).step_by(n))
    };
    plan.iter().enumerate().map(of_joint).collect()
}

impl Structure {
    /// From the `rows` of a joint, in which its columns stand at `links`.
    fn new<'a, I: Iterator<Item = &'a [f64]>>(
        links: &[usize],
        rows: impl Fn() -> I,
    ) -> Result<Self, OfflineError> {
        let width = links.len();
        let factor = |order: &[usize]| {
            let columns = |row: &'a [f64]| order.iter().map(|&c| row[links[c]]);
            let rows: Vec<f64> = rows().flat_map(columns).collect();
            triangular_factor(&rows, width)
        };
        let mut order: Vec<usize> = (0..width).collect();
        if width == 0 {
            return Ok(Self {
                folded: order,
                others: Vec::new(),
                shares: Vec::new(),
            });
        }
        let r = factor(&order)?;
        let length = |c: usize| (0..=c).map(|i| r[i * width + c].powi(2)).sum::<f64>();
        let longest = (0..width).map(length).fold(0.0, f64::max).sqrt();
        let (folded, others): (Vec<usize>, Vec<usize>) = order
            .iter()
            .partition(|&c| r[c * width + c] > NOTHING * longest);
        let mut shares = vec![0.0; folded.len() * others.len()];
        if !others.is_empty() {
            // Once more, with the others last: what is left of one of them is not taken from those after it.
            order.clear();
            order.extend(folded.iter().chain(&others));
            let r = factor(&order)?;
            for (o, &other) in others.iter().enumerate() {
                for i in (0..folded.partition_point(|&c| c < other)).rev() {
                    let later = (i + 1..folded.len())
                        .map(|k| r[i * width + k] * shares[k * others.len() + o]);
                    let left = r[i * width + folded.len() + o] - later.sum::<f64>();
                    shares[i * others.len() + o] = left / r[i * width + i];
                }
            }
        }
        Ok(Self {
            folded,
            others,
            shares,
        })
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
