//! Inverse dynamics and the joint-torque regressor of one state: joints in lanes for the sines, then along the chain.

use nalgebra::{Matrix3, Vector3};

use crate::chain::{JointState, Placement};
use crate::error::CoreError;
use crate::frames::Links;
use crate::lanes::{self, Kernel, Lanes, Portable, Vector, MOST_LANES};
use crate::link_params::N_LINK_PARAMS;
use crate::newton::{self, WrenchRow};
use crate::robot::{Joint, RobotModel};
use crate::single::{self, FourTwists, Moving};
use crate::slices::{mirror_fields, rows_mut, tail, Mirror};

/// A single number in memory.
type One = [f64; 1];

/// Scratch for one robot. All memory is taken here.
#[derive(Clone, Debug)]
pub struct Workspace {
    states: Vec<JointState<One>>,
    links: Links,
    wrenches: Vec<WrenchRow<One>>,
    twists: Vec<FourTwists>,
    /// What first halves hand to the second ones: what the first joint feels of its own link, and how the last link moves.
    own: f64,
    moving: Moving,
    /// Sines and cosines, each padded to whole rows.
    trig: [Vec<f64>; 2],
}

impl Workspace {
    /// Scratch for `robot`.
    #[must_use]
    pub fn new(robot: &RobotModel) -> Self {
        let n = robot.n_joints();
        let zero = [0.0];
        let rest = JointState {
            q: zero,
            sin: zero,
            cos: [1.0],
            dq: zero,
            ddq: zero,
        };
        let padded = vec![0.0; n.next_multiple_of(MOST_LANES)];
        Self {
            states: vec![rest; n],
            links: Links::new(robot.frames()),
            wrenches: vec![[[zero; 3]; 2]; n],
            twists: vec![FourTwists::default(); n.div_ceil(4)],
            own: 0.0,
            moving: Moving::default(),
            trig: [padded.clone(), padded],
        }
    }

    fn n_joints(&self) -> usize {
        self.states.len()
    }

    /// The states with sines and cosines, joints in lanes, four of them: eight wait longer for each other than they save, and
    /// slow down what follows; those of positions and `offsets` together, where there are some.
    #[inline(always)]
    fn take<L: Lanes>(&mut self, q: &[f64], dq: &[f64], ddq: &[f64], offsets: Option<&[f64]>) {
        let [sines, cosines] = &mut self.trig;
        let outputs = rows_mut(sines, L::LEN).zip(rows_mut(cosines, L::LEN));
        for (k, (sin, cos)) in outputs.take(q.len().div_ceil(L::LEN)).enumerate() {
            let mut angles = L::load_some(tail(q, k * L::LEN));
            if let Some(offsets) = offsets {
                angles = angles + L::load(tail(offsets, k * L::LEN));
            }
            let (s, c) = lanes::sin_cos(angles);
            s.store(sin);
            c.store(cos);
        }
        let trig = sines.iter().zip(cosines.iter());
        let motion = q.iter().zip(dq.iter().zip(ddq));
        for (state, ((q, (dq, ddq)), (sin, cos))) in self.states.iter_mut().zip(motion.zip(trig)) {
            *state = JointState {
                q: [*q],
                sin: [*sin],
                cos: [*cos],
                dq: [*dq],
                ddq: [*ddq],
            };
        }
    }
}

/// `Ok` if `slice` has `expected` values.
pub(crate) fn check_length(
    what: &'static str,
    slice: &[f64],
    expected: usize,
) -> Result<(), CoreError> {
    if slice.len() == expected {
        Ok(())
    } else {
        Err(CoreError::Length {
            what,
            expected,
            actual: slice.len(),
        })
    }
}

/// Joint placement at `q`: rotation (link to parent) and origin of the link frame in the parent frame.
#[must_use]
pub fn placement(joint: &Joint, q: f64) -> (Matrix3<f64>, Vector3<f64>) {
    placed(&Placement::new(joint), q)
}

/// [`placement`] of a joint whose numbers have been prepared.
#[must_use]
pub fn placed(place: &Placement, q: f64) -> (Matrix3<f64>, Vector3<f64>) {
    let one = Portable::<1, false>::splat;
    let (sin, cos) = lanes::sin_cos(one(q));
    let turn = place.turn(sin, cos);
    let number = |v: Vector<Portable<1, false>>| Vector3::from(v.raw().map(|[x]| x));
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let axes = axes.map(|axis| Vector::splat(&axis));
    let axes = place.to_parent(&turn, axes).map(number);
    (Matrix3::from_columns(&axes), number(place.origin(one(q))))
}

/// Inverse dynamics `tau = M(q) ddq + C(q, dq) + G(q)` of the links alone (Eq. 1 without friction, contact and residual).
/// `C(q, dq)` is the torque, even in dq (Eq. 3).
///
/// `q, dq, ddq`: n values \[rad, rad/s, rad/s²; m for prismatic joints\]; `phi`: 10 n values in the order of
/// [`crate::link_params`]; `tau`: n values \[N·m; N\]. Linear in `phi`, which need not be physical.
///
/// # Errors
/// [`CoreError::Length`] if a slice has the wrong length.
pub fn inverse_dynamics_into(
    robot: &RobotModel,
    workspace: &mut Workspace,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
    phi: &[f64],
    tau: &mut [f64],
) -> Result<(), CoreError> {
    let n = robot.n_joints();
    check_state(n, workspace, q, dq, ddq)?;
    check_length("phi", phi, N_LINK_PARAMS * n)?;
    check_length("tau", tau, n)?;
    lanes::run_narrow(Torque {
        robot,
        workspace,
        motion: [q, dq, ddq],
        phi,
        tau,
    });
    Ok(())
}

/// The first half of [`inverse_dynamics_into`], for a caller who has little time at once. Nothing else may use the workspace before
/// [`end_inverse_dynamics_into`].
///
/// # Errors
/// [`CoreError::Length`] if a slice has the wrong length.
pub(crate) fn begin_inverse_dynamics(
    robot: &RobotModel,
    workspace: &mut Workspace,
    [q, dq, ddq]: [&[f64]; 3],
    phi: &[f64],
) -> Result<(), CoreError> {
    let n = robot.n_joints();
    check_state(n, workspace, q, dq, ddq)?;
    check_length("phi", phi, N_LINK_PARAMS * n)?;
    lanes::run_narrow(BeginTorque {
        robot,
        workspace,
        motion: [q, dq, ddq],
        phi,
    });
    Ok(())
}

/// The second half.
///
/// # Errors
/// [`CoreError::Length`] if a slice has the wrong length.
pub(crate) fn end_inverse_dynamics_into(
    robot: &RobotModel,
    workspace: &Workspace,
    tau: &mut [f64],
) -> Result<(), CoreError> {
    let n = robot.n_joints();
    check_workspace(n, workspace)?;
    check_length("tau", tau, n)?;
    lanes::run_narrow(EndTorque {
        robot,
        workspace,
        tau,
    });
    Ok(())
}

struct BeginTorque<'a> {
    robot: &'a RobotModel,
    workspace: &'a mut Workspace,
    motion: [&'a [f64]; 3],
    phi: &'a [f64],
}

impl Kernel for BeginTorque<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = One>, L: Lanes>(self) {
        let ([q, dq, ddq], frames) = (self.motion, self.robot.frames());
        let workspace = self.workspace;
        workspace.take::<S::Four>(q, dq, ddq, Some(&frames.offsets));
        let links = workspace.links.of(frames, self.phi);
        let own = newton::outwards::<S>(frames, links, &workspace.states, &mut workspace.wrenches);
        [workspace.own] = own.raw();
    }
}

struct EndTorque<'a> {
    robot: &'a RobotModel,
    workspace: &'a Workspace,
    tau: &'a mut [f64],
}

impl Kernel for EndTorque<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = One>, L: Lanes>(self) {
        let (tau, _) = self.tau.as_chunks_mut::<1>();
        let Workspace {
            states, wrenches, ..
        } = self.workspace;
        let own = S::splat(self.workspace.own);
        newton::inwards(self.robot.frames(), states, wrenches, own, tau);
    }
}

/// [`inverse_dynamics_into`] of slices that fit.
pub(crate) struct Torque<'a> {
    pub robot: &'a RobotModel,
    pub workspace: &'a mut Workspace,
    pub motion: [&'a [f64]; 3],
    pub phi: &'a [f64],
    pub tau: &'a mut [f64],
}

impl Kernel for Torque<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = One>, L: Lanes>(self) {
        let [q, dq, ddq] = self.motion;
        let frames = self.robot.frames();
        self.workspace
            .take::<S::Four>(q, dq, ddq, Some(&frames.offsets));
        let Workspace {
            states,
            links,
            wrenches,
            ..
        } = self.workspace;
        let (tau, _) = self.tau.as_chunks_mut::<1>();
        let links = links.of(frames, self.phi);
        newton::inverse_dynamics::<S>(frames, links, states, wrenches, tau);
    }
}

/// Joint-torque regressor `Y` with `tau = Y phi` (Eq. 2 for one state).
///
/// `regressor`: n rows of 10 n values, row-major; row j is zero for the links before joint j. Units follow
/// [`inverse_dynamics_into`].
///
/// # Errors
/// [`CoreError::Length`] if a slice has the wrong length.
pub fn joint_torque_regressor_into(
    robot: &RobotModel,
    workspace: &mut Workspace,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
    regressor: &mut [f64],
) -> Result<(), CoreError> {
    let n = robot.n_joints();
    check_state(n, workspace, q, dq, ddq)?;
    check_length("regressor", regressor, n * n * N_LINK_PARAMS)?;
    lanes::run_narrow(Regressor {
        robot,
        workspace,
        motion: [q, dq, ddq],
        regressor,
    });
    Ok(())
}

struct Regressor<'a> {
    robot: &'a RobotModel,
    workspace: &'a mut Workspace,
    motion: [&'a [f64]; 3],
    regressor: &'a mut [f64],
}

impl Kernel for Regressor<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = One>, L: Lanes>(self) {
        let [q, dq, ddq] = self.motion;
        self.workspace.take::<S::Four>(q, dq, ddq, None);
        let Workspace { states, twists, .. } = self.workspace;
        single::joint_torque_regressor::<S>(self.robot, states, twists, self.regressor);
    }
}

/// The first half of the last link's columns of the regressor; nothing else may use the workspace before the second one,
/// [`end_last_link_into`].
///
/// # Errors
/// [`CoreError::Length`] if a slice has the wrong length.
pub(crate) fn begin_last_link(
    robot: &RobotModel,
    workspace: &mut Workspace,
    [q, dq, ddq]: [&[f64]; 3],
) -> Result<(), CoreError> {
    check_state(robot.n_joints(), workspace, q, dq, ddq)?;
    lanes::run_narrow(BeginLastLink {
        robot,
        workspace,
        motion: [q, dq, ddq],
    });
    Ok(())
}

struct BeginLastLink<'a> {
    robot: &'a RobotModel,
    workspace: &'a mut Workspace,
    motion: [&'a [f64]; 3],
}

impl Kernel for BeginLastLink<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = One>, L: Lanes>(self) {
        let [q, dq, ddq] = self.motion;
        self.workspace.take::<S::Four>(q, dq, ddq, None);
        let Workspace { states, twists, .. } = self.workspace;
        self.workspace.moving = single::last_link::<S>(self.robot, states, twists);
    }
}

/// The second half: ten entries per joint, torque per parameter of what the last link carries.
///
/// # Errors
/// [`CoreError::Length`] if a slice has the wrong length.
pub(crate) fn end_last_link_into(
    robot: &RobotModel,
    workspace: &Workspace,
    columns: &mut [[f64; N_LINK_PARAMS]],
) -> Result<(), CoreError> {
    let n = robot.n_joints();
    check_workspace(n, workspace)?;
    check_length("columns", columns.as_flattened(), n * N_LINK_PARAMS)?;
    lanes::run_narrow(EndLastLink {
        robot,
        workspace,
        columns,
    });
    Ok(())
}

struct EndLastLink<'a> {
    robot: &'a RobotModel,
    workspace: &'a Workspace,
    columns: &'a mut [[f64; N_LINK_PARAMS]],
}

impl Kernel for EndLastLink<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes<Raw = One>, L: Lanes>(self) {
        let Workspace { moving, twists, .. } = self.workspace;
        single::last_link_columns::<S>(self.robot, moving, twists, self.columns);
    }
}

fn check_state(
    n: usize,
    workspace: &Workspace,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
) -> Result<(), CoreError> {
    check_length("q", q, n)?;
    check_length("dq", dq, n)?;
    check_length("ddq", ddq, n)?;
    check_workspace(n, workspace)
}

fn check_workspace(n: usize, workspace: &Workspace) -> Result<(), CoreError> {
    if workspace.n_joints() == n {
        Ok(())
    } else {
        Err(CoreError::Length {
            what: "workspace",
            expected: n,
            actual: workspace.n_joints(),
        })
    }
}

impl Mirror for Workspace {
    fn mirror(&mut self, of: &Self) {
        mirror_fields!(self, of; states, wrenches, twists, trig; copied own, moving; kept links);
    }
}
