//! Offline algebra between the formulas and the statistics: one pass over a run, then small triangles.
//!
//! ```text
//! states -> columns of all terms -> the same zero-phase low-pass on every column and on the torque -> decimated rows
//!        -> triangular factor R per joint and run -> merged in a fixed tree
//! ```
//!
//! Every result is the same to the last bit for any number of threads.

pub mod adjoint;
mod ahead;
pub mod base;
pub mod batch;
pub mod columns;
pub mod em;
pub mod error;
pub mod excitation;
pub mod extent;
pub mod factor;
pub mod filter;
pub mod fold;
pub mod friction_search;
mod in_band;
mod joint_columns;
pub mod likeliest;
pub mod observation;
pub mod points;
mod probes;
mod rows;
mod signs;
pub mod slope;
pub mod speed_columns;
mod triangle;
pub mod weighted;

pub use base::{base_parameters, BaseParameters};
pub use columns::{effect_columns, effect_torque, motor_torque, RunSignals};
pub use error::OfflineError;
pub use excitation::{Criterion, Excitation};
pub use extent::{extent, Extent};
pub use factor::{merge, triangular_factor};
pub use filter::ZeroPhase;
pub use fold::fold;
pub use friction_search::{FrictionSearch, SearchRun};
pub use likeliest::{likeliest, JointGram, Likeliest, Noise, NormalPrior};
pub use observation::{observe, Observation, RunStates, Sampling};
pub use slope::slope;
pub use weighted::{weighted_fit, WeightedFit};
