//! What was named already, and what of it is taken off the rows that follow.

use super::rows::{product, Row, N_LOAD};
use super::{Change, Kind, Said};
use crate::slices::{at, mirror_fields, rows as rows_of, set, Mirror};

/// What was named already; sums, and their variances.
#[derive(Clone, Debug)]
pub(super) struct Known {
    pub friction: Vec<f64>,
    pub gain: Vec<f64>,
    pub offset: Vec<f64>,
    pub delay: Vec<f64>,
    pub slip: Vec<f64>,
    /// Growth of an error without a name, which nothing is taken off for.
    pub unknown: Vec<f64>,
    pub load: [f64; N_LOAD],
    /// Six per joint, in the order above, and the mass's.
    pub variance: Vec<f64>,
}

impl Known {
    pub fn new(n: usize) -> Self {
        Self {
            friction: vec![0.0; n],
            gain: vec![0.0; n],
            offset: vec![0.0; n],
            delay: vec![0.0; n],
            slip: vec![0.0; n],
            unknown: vec![0.0; n],
            load: [0.0; N_LOAD],
            variance: vec![0.0; 6 * n + 1],
        }
    }

    /// Adds a change; of a load it is what the last argument says.
    pub fn add(&mut self, change: &Change, load: &[f64; N_LOAD]) {
        let (j, mut factor) = (change.joint, 1.0);
        let mut variance = change.std * change.std;
        let place = self.place(change.kind, j);
        let sizes: &mut [f64] = match change.kind {
            Kind::Friction => &mut self.friction,
            Kind::Gain => &mut self.gain,
            Kind::Offset => &mut self.offset,
            Kind::Delay => &mut self.delay,
            Kind::Slip => &mut self.slip,
            Kind::Unknown => &mut self.unknown,
            Kind::Load => {
                for (sum, more) in self.load.iter_mut().zip(load) {
                    *sum += more;
                }
                &mut []
            }
            // Nothing is taken off what is no torque.
            Kind::Frozen => return,
        };
        let before = at(sizes, j);
        let mut now = before + change.size;
        if change.kind == Kind::Unknown {
            // Errors multiply.
            now += before * change.size;
            factor = (1.0 + change.size) * (1.0 + change.size);
            variance *= (1.0 + before) * (1.0 + before);
        }
        set(sizes, j, now);
        let sum = factor * at(&self.variance, place) + variance;
        set(&mut self.variance, place, sum);
    }

    /// Where the variance of a kind on a joint is.
    fn place(&self, kind: Kind, joint: usize) -> usize {
        let n = self.friction.len();
        let row = match kind {
            Kind::Friction => 0,
            Kind::Gain => 1,
            Kind::Offset => 2,
            Kind::Delay => 3,
            Kind::Slip => 4,
            Kind::Unknown => 5,
            Kind::Load | Kind::Frozen => return 6 * n,
        };
        row * n + joint
    }

    /// Whether a load is taken off.
    pub fn has_load(&self) -> bool {
        self.load.iter().any(|size| *size != 0.0)
    }

    /// What was named, put together: one change per kind and joint.
    pub fn all(&self) -> impl Iterator<Item = Change> + '_ {
        let n = self.friction.len();
        let own = [
            (Kind::Friction, &self.friction),
            (Kind::Gain, &self.gain),
            (Kind::Offset, &self.offset),
            (Kind::Delay, &self.delay),
            (Kind::Slip, &self.slip),
            (Kind::Unknown, &self.unknown),
        ];
        let [mass, x, y, z, ..] = self.load;
        let own = own.into_iter().flat_map(move |(kind, sizes)| {
            let sizes = sizes.iter().enumerate();
            sizes.map(move |(joint, size)| (kind, joint, *size, [0.0; 3]))
        });
        let load = (Kind::Load, n.saturating_sub(1), mass, [x, y, z]);
        let named = own.chain([load]).filter(|(_, _, size, moments)| {
            *size != 0.0 || moments.iter().any(|moment| *moment != 0.0)
        });
        named.map(|(kind, joint, size, moments)| Change {
            kind,
            joint,
            size,
            std: at(&self.variance, self.place(kind, joint)).sqrt(),
            moments,
            said: Said::Settled,
            or: None,
        })
    }

    /// Takes it off what a row leaves, whose variance grows by what is not known of it.
    pub fn take_off(&self, row: &mut Row) {
        let n = self.friction.len();
        let own = [
            (&self.friction, &row.friction),
            (&self.gain, &row.torque),
            (&self.delay, &row.late),
        ];
        for ((sizes, columns), kind) in
            own.into_iter()
                .zip([Kind::Friction, Kind::Gain, Kind::Delay])
        {
            let variances = self.variance.iter().skip(self.place(kind, 0));
            let joints = row.left.iter_mut().zip(&mut row.variance);
            let sizes = sizes.iter().zip(variances);
            for (((left, sum), column), (size, variance)) in joints.zip(columns).zip(sizes) {
                *left -= size * column;
                *sum += variance * column * column;
            }
        }
        let variances = self.variance.iter().skip(self.place(Kind::Offset, 0));
        let joints = row.left.iter_mut().zip(&mut row.variance);
        for ((left, sum), (size, variance)) in joints.zip(self.offset.iter().zip(variances)) {
            *left -= size;
            *sum += variance;
        }
        let variances = self.variance.iter().skip(self.place(Kind::Slip, 0));
        let slips = rows_of(&row.slip, n).zip(self.slip.iter().zip(variances));
        for (columns, (size, variance)) in
            slips.filter(|(_, (size, variance))| **size != 0.0 || **variance != 0.0)
        {
            let joints = row.left.iter_mut().zip(&mut row.variance);
            for ((left, sum), column) in joints.zip(columns) {
                *left -= size * column;
                *sum += variance * column * column;
            }
        }
        if !self.has_load() {
            return;
        }
        // All of a load is known as well as its mass.
        let [mass, ..] = self.load;
        let variance = at(&self.variance, self.place(Kind::Load, 0));
        let part = if variance > 0.0 {
            variance / (mass * mass).max(variance)
        } else {
            0.0
        };
        let joints = row.left.iter_mut().zip(&mut row.variance);
        for ((left, sum), columns) in joints.zip(&row.load) {
            let torque = product(columns, &self.load);
            *left -= torque;
            *sum += part * torque * torque;
        }
    }
}

impl Mirror for Known {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(self, of; friction, gain, offset, delay, slip, unknown, variance; copied load; kept);
    }
}
