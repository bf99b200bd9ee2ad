//! Files in and out: a URDF or a `robot.toml` becomes a [`dynid_core::RobotModel`], a `model.json` a
//! [`dynid_core::TorqueModel`] and back, a `watch.json` a [`WatchFile`], and
//! what a watch remembers comes back after a restart.
//!
//! Nothing read from a file can execute, recurse or allocate without bound, and no input ends in a panic.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout
)]

pub mod c_header;
pub mod contact_file;
mod frame;
pub mod mdh;
pub mod mjcf;
pub mod model_file;
pub mod remembered;
mod small_file;
mod text;
pub mod urdf;
pub mod watch_file;
mod whole;

pub use c_header::CHeaderError;
pub use contact_file::{load_contact, ContactFile};
pub use model_file::{load, parse, save, ModelFileError};
pub use remembered::{load_remembered, Remembered};
pub use text::shorten_said;
pub use watch_file::{load_watch, WatchFile};
pub use whole::check_replaceable;
