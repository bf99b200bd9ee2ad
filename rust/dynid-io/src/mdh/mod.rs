//! `robot.toml` to [`RobotModel`]: a table of modified Denavit-Hartenberg rows, one per joint.
//!
//! ```toml
//! name = "two_axis"
//! angle = "deg"                       # of every angle in this file: "deg" or "rad"
//! gravity = [0.0, 0.0, -9.81]         # m/s^2 in the base frame; this is the default
//!
//! [base]                              # where row 1 starts, seen from the base frame; left out: in it
//! xyz = [0.0, 0.0, 0.4]               # m
//! rpy = [0.0, 0.0, 0.0]               # fixed-axis roll, pitch, yaw, as in a URDF
//!
//! [[joint]]
//! name = "shoulder"                   # left out: joint_1, joint_2, ...
//! link = "upper_arm"                  # what it carries; left out: link_1, link_2, ...
//! kind = "revolute"                   # the default; or "prismatic"
//! alpha = 0.0                         # twist about x of the frame before
//! a = 0.0                             # m, along that x
//! d = 0.2                             # m, along z, the joint's own axis; a prismatic joint's q is added
//! theta = -90.0                       # about z; a revolute joint's q is added
//! lower = -170.0                      # position; both or neither
//! upper = 170.0
//! velocity = 180.0                    # per s
//! acceleration = 720.0                # per s^2
//! effort = 250.0                      # N m
//! gear_ratio = 121.0                  # motor turns per joint turn
//! rotor_inertia = 3.2e-4              # kg m^2 of the motor itself; counts times gear_ratio^2
//! mass = 12.0                         # kg; mass, com and one of the two inertias go together
//! com = [0.1, 0.0, -0.02]             # m, centre of mass in the link's frame
//! inertia_com = { xx = 0.05, yy = 0.21, zz = 0.2, xy = 0.001, xz = 0.0, yz = 0.0 }   # kg m^2 about the centre
//!
//! [[joint]]
//! name = "elbow"
//! alpha = 90.0
//! a = 0.35
//! d = 0.0
//! theta = 0.0
//! mass = 5.0
//! com = [0.2, 0.0, 0.0]
//! inertia_origin = { xx = 0.01, yy = 0.24, zz = 0.24 }    # about the link's origin instead
//!
//! [tool]                              # bolted to the last link; left out: none
//! xyz = [0.3, 0.0, 0.0]
//! rpy = [0.0, 90.0, 0.0]
//! mass = 1.5
//! com = [0.0, 0.0, 0.05]
//! inertia_com = { xx = 0.004, yy = 0.004, zz = 0.002 }
//! inertia_rpy = [0.0, 0.0, 30.0]      # axes of inertia_com, turned against the frame; left out: not
//! ```
//!
//! # The convention
//! `T(i-1 -> i) = Rx(alpha) Tx(a) Rz(theta) Tz(d)` (Craig's, and the source paper's): frame `i` sits on axis `i`, and the link
//! behind joint `i` has frame `i`. Products of inertia are those of the inertia matrix, as in a URDF (`Ixy = -∫xy dm`).
//!
//! A row is what a URDF says with two joints, `<origin xyz="a 0 0" rpy="alpha 0 0"/>` fixed and `<origin xyz="0 0 d"
//! rpy="0 0 theta"/>` moving about `0 0 1`, and both files give the same robot to the last digit.
//!
//! # What is refused
//! Whatever is not written above: unknown keys (with the nearest valid one), missing ones, other kinds of values, numbers
//! that are not finite, an angle of more than a turn, names that stand twice. [`MdhError`] names file, line and column.

mod error;
mod robot;
mod table;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use dynid_core::robot::RobotModel;

pub use error::MdhError;

/// Largest file that is read \[bytes\]. 256 joints with all keys take a tenth.
const MAX_BYTES: usize = 1024 * 1024;

/// What replaces what the file says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MdhOptions {
    /// Acceleration of free fall in the base frame \[m/s²\]; the file's, or else `[0, 0, -9.81]`, if `None`.
    pub gravity: Option<[f64; 3]>,
    /// Rotor inertia reflected to the link side, one per joint \[kg·m², kg\].
    pub rotor_inertia: Option<Vec<f64>>,
}

/// Reads a `robot.toml`.
///
/// # Errors
/// [`MdhError::Io`] if the file cannot be read; otherwise as [`parse`].
pub fn load(path: &Path, options: &MdhOptions) -> Result<RobotModel, MdhError> {
    let io = |source| MdhError::Io {
        path: path.to_owned(),
        source,
    };
    // A pipe has no length to ask for: one byte beyond the limit is enough to refuse it.
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(io)?;
    file.take(MAX_BYTES as u64 + 1)
        .read_to_end(&mut bytes)
        .map_err(io)?;
    parse(bytes, &path.display().to_string(), options)
}

/// Reads a `robot.toml` from text or bytes; `source_name` stands in errors where a path would.
///
/// # Errors
/// [`MdhError::Invalid`] if the content is refused, [`MdhError::Option`] if an option does not fit it.
pub fn parse(
    text: impl AsRef<[u8]>,
    source_name: &str,
    options: &MdhOptions,
) -> Result<RobotModel, MdhError> {
    let source = table::Source::decode(source_name, text.as_ref())?;
    robot::read(&source, options)
}
