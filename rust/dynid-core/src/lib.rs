//! Every formula of a torque model that runs in real time.
//!
//! ```text
//! tau = rigid body(q, dq, ddq; phi)  +  sum of effects(state)  +  residual(state)
//! ```
//!
//! Nothing in this crate opens a file, starts a thread or knows Python; nothing allocates after `new`.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout
)]

pub mod adapt;
pub mod chain;
pub mod delay_line;
pub mod differentiator;
pub mod dynamics;
pub mod effects;
pub mod error;
pub mod estimator;
pub mod frames;
mod intake;
pub mod kernel;
pub mod lanes;
pub mod limits;
pub mod link_params;
pub mod mixture;
mod mixture_rows;
pub mod model;
pub mod momentum;
pub mod newton;
pub mod observer;
pub mod online;
pub mod physical;
mod placement;
pub mod powers;
pub mod rbf;
pub mod residual;
mod rest;
pub mod robot;
pub mod signal;
mod single;
mod slices;
pub mod state;
mod step;
pub mod stream;
mod track;
mod turn;
pub mod uncertainty;
pub mod watch;

pub use adapt::{AdaptSettings, Adaptation};
pub use differentiator::Differentiator;
pub use dynamics::{inverse_dynamics_into, joint_torque_regressor_into, Workspace};
pub use effects::{Effect, EffectInput, EffectTerm};
pub use error::{CoreError, EffectError};
pub use estimator::{Status, TorqueEstimator};
pub use link_params::LinkParams;
pub use mixture::GaussianMixtureRegression;
pub use model::{Domain, EncoderError, ErrorBand, TorqueModel};
pub use momentum::{momentum_into, MomentumWorkspace};
pub use observer::{MomentumObserver, ObserverSettings};
pub use online::{OnlineEstimator, Sample};
pub use physical::PhysicalSet;
pub use rbf::NormalisedRbf;
pub use residual::{Load, Regression, Residual, ResidualInputs};
pub use robot::{Joint, JointKind, JointLimits, RobotModel};
pub use signal::{Signal, SignalKind, MAX_INPUTS};
pub use slices::all_finite;
pub use state::State;
pub use uncertainty::Uncertainty;
