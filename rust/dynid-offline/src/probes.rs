//! Regressors at probing states, straight to columns with eight states side by side: no row is written in between.

use dynid_core::chain;
use dynid_core::lanes::{Lanes, MOST_LANES};
use dynid_core::link_params::N_LINK_PARAMS;
use dynid_core::RobotModel;

use crate::rows::StateRows;
use crate::triangle::Columns;

/// Where the rows of one joint go.
pub(crate) struct Place {
    /// Number of the matrix.
    pub(crate) matrix: usize,
    /// Its first row that is this joint's, in eights.
    pub(crate) first: usize,
    /// Column `first_column + i` takes the regressor's column `links[i]`.
    pub(crate) links: Vec<usize>,
    pub(crate) first_column: usize,
}

/// States whose regressors are asked.
pub(crate) struct Probes<'a> {
    pub(crate) robot: &'a RobotModel,
    /// q, dq and ddq, row-major.
    pub(crate) motion: [&'a [f64]; 3],
    /// One for each joint.
    pub(crate) places: &'a [Place],
}

impl Probes<'_> {
    /// Fills `matrices` from their first row on. Where states end before eight do, zeros follow.
    #[inline(always)]
    pub(crate) fn fill<L: Lanes>(&self, matrices: &mut [Columns]) {
        let n = self.robot.n_joints();
        let row = N_LINK_PARAMS * n;
        let n_samples = self.motion[0].len() / n;
        let mut states = StateRows::<L>::new(n);
        let mut twists = vec![[[L::ZERO; 3]; 2]; n];
        let mut regressor = vec![L::ZERO; n * row];
        for k in 0..n_samples.div_ceil(L::LEN) {
            let (eight, lane) = (k * L::LEN / MOST_LANES, k * L::LEN % MOST_LANES);
            states.take(self.motion, k);
            chain::joint_torque_regressor::<L>(
                self.robot,
                states.rows(),
                &mut twists,
                &mut regressor,
            );
            let there = n_samples - k * L::LEN;
            for (place, own) in self.places.iter().zip(regressor.chunks_exact(row)) {
                let matrix = &mut matrices[place.matrix];
                for (c, &link) in (place.first_column..).zip(&place.links) {
                    let to = &mut matrix.column(c)[place.first + eight];
                    L::from_raw(own[link]).store(&mut to[lane..]);
                    if there < L::LEN {
                        to[lane + there..].fill(0.0);
                    }
                }
            }
        }
    }
}
