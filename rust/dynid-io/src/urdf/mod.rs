//! URDF to [`RobotModel`].
//!
//! ```text
//! bytes -> source (UTF-8, size) -> xml (well-formed, limits) -> guard (elements, numbers) -> urdf-rs (values)
//!       -> tree (references, loops) -> chain (base to tip) -> merge (fixed links lumped) -> RobotModel
//! ```
//!
//! urdf-rs alone overflows the stack on nested tags, drops tokens that are no numbers, and reads an absent limit as zero.
//! It therefore gets a text that the guard has written anew.
//!
//! # What is read
//! * `<link>` with `<inertial>`; `<joint>` with `<origin>`, `<parent>`, `<child>`, `<axis>`, `<limit>`; rotor inertia from
//!   `<transmission>` in Drake's notation (`drake:rotor_inertia`, `drake:gear_ratio` or `mechanicalReduction`).
//! * `<limit>` may hold `acceleration`, as in URDF 1.2.
//! * `rpy` is fixed-axis roll, pitch, yaw \[rad\]; the inertia is about the centre of mass, in the inertial frame.
//! * An absent `<axis>` is `1 0 0`; any length but zero is brought to one.
//! * Limits that are not declared are infinite; so are those beyond 1e12, and positions of a continuous joint. Of `lower` and `upper` one alone
//!   leaves the other at zero, as the specification has it.
//! * `<axis>`, `<limit>` and `<mimic>` of joints that do not move are not looked at. An attribute of `<limit>` that nobody
//!   here knows is passed over where lower, upper, velocity and effort are all given.
//! * A link without `<inertial>` weighs nothing.
//!
//! # Which joints make the chain
//! * The way from `base` (the root, if none is given) to `tip`. Without `tip` the longest one of driven joints is proposed,
//!   of equally long ones the first of the file. It ends before a joint that others follow (`<mimic>`), as a gripper has
//!   one, and where a moving link has several branches, each shorter than the chain up to there: fingers.
//!   [`Loaded::choice`] says in one sentence what was chosen.
//! * Links fixed to a moving link are lumped into it. The base has no dynamics: what is fixed to it is dropped, and
//!   branches that hang on it are passed over; so is everything above `base`, as if `base` stood still.
//! * A branch that moves and hangs on a moving link is carried in one posture: each joint at zero, or as near to it as its
//!   limits allow, a follower where the joint that it follows puts it. One that follows a joint of the chain is refused:
//!   its weight would depend on that joint's position.
//! * The first joint is placed in the frame of the base link, and gravity is given in that frame.
//!
//! # What is passed over
//! `<visual>`, `<collision>`, `<material>`, `<gazebo>`, `<ros2_control>`, `<dynamics>`, `<safety_controller>`,
//! `<calibration>` and whatever else is unknown, with all that is in it, attributes with a prefix (`drake:...`), and unknown
//! attributes of `<link>` and `<joint>`. [`load_with_notes`] lists them.
//!
//! # What is refused
//! Whatever two readers could understand differently, with line, column, element and mend: see [`UrdfError`].

mod chain;
mod clean;
mod document;
mod edit;
mod elements;
mod error;
mod guard;
mod merge;
mod minimal;
mod numbers;
mod parts;
mod places;
mod posture;
mod propose;
mod source;
mod spans;
mod tag;
mod transmission;
mod tree;
mod xml;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use dynid_core::robot::RobotModel;
use nalgebra::{Matrix3, Vector3};

pub use edit::with_physical;
pub use error::UrdfError;
pub use minimal::minimal;

pub(crate) use edit::triple;
pub(crate) use minimal::unlike_any;

use source::{Notes, Source};

/// What the file does not say.
#[derive(Clone, Debug, PartialEq)]
pub struct UrdfOptions {
    /// Link that stands still; the root of the tree if `None`.
    pub base: Option<String>,
    /// Link at the end of the chain; if `None` the end of the longest one, see the module's documentation.
    pub tip: Option<String>,
    /// Acceleration of free fall in the base link's frame \[m/s²\].
    pub gravity: [f64; 3],
    /// Rotor inertia reflected to the link side, one per moving joint in chain order \[kg·m², kg\]; replaces whatever the
    /// file declares.
    pub rotor_inertia: Option<Vec<f64>>,
}

impl Default for UrdfOptions {
    fn default() -> Self {
        Self {
            base: None,
            tip: None,
            gravity: [0.0, 0.0, -9.81],
            rotor_inertia: None,
        }
    }
}

/// A robot, and what its reader should know about the file.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The chain.
    pub robot: RobotModel,
    /// One sentence on the chain that was chosen, where the file leaves a choice.
    pub choice: Option<String>,
    /// Links that stand still, with the base or in a body of the chain.
    pub links: Vec<PlacedLink>,
    /// Sentences about what was passed over, lumped or normalised, each with `file:line:column`.
    pub notes: Vec<String>,
}

/// A link, and how it stands in the link that carries it.
#[derive(Clone, Debug)]
pub struct PlacedLink {
    /// Its name.
    pub name: String,
    /// The joint of the chain that moves it, counted from 0; none for what stands still with the base.
    pub joint: Option<usize>,
    /// From its axes to those of the frame of that joint's link, of the base link for what stands still.
    pub rotation: Matrix3<f64>,
    /// Its origin in that frame \[m\].
    pub translation: Vector3<f64>,
}

/// Reads a URDF file.
///
/// # Errors
/// [`UrdfError::Io`] if the file cannot be read; otherwise as [`parse`].
pub fn load(path: &Path, options: &UrdfOptions) -> Result<RobotModel, UrdfError> {
    load_with_notes(path, options).map(|loaded| loaded.robot)
}

/// Reads a URDF from text or bytes; `source_name` stands in errors where a path would.
///
/// # Errors
/// [`UrdfError::Invalid`] if the content is refused, [`UrdfError::Option`] if an option does not fit it.
pub fn parse(
    text: impl AsRef<[u8]>,
    source_name: &str,
    options: &UrdfOptions,
) -> Result<RobotModel, UrdfError> {
    parse_with_notes(text, source_name, options).map(|loaded| loaded.robot)
}

/// As [`load`], with the notes.
///
/// # Errors
/// As [`load`].
pub fn load_with_notes(path: &Path, options: &UrdfOptions) -> Result<Loaded, UrdfError> {
    let name = path.display().to_string();
    let io = |source| UrdfError::Io {
        path: path.to_owned(),
        source,
    };
    let file = File::open(path).map_err(io)?;
    let limit = source::MAX_BYTES as u64;
    if file.metadata().map_err(io)?.len() > limit {
        return Err(source::too_large(&name));
    }
    let mut bytes = Vec::new();
    // Pipes have no length: one byte beyond the limit is enough to refuse them.
    file.take(limit + 1).read_to_end(&mut bytes).map_err(io)?;
    parse_with_notes(bytes, &name, options)
}

/// As [`parse`], with the notes.
///
/// # Errors
/// As [`parse`].
pub fn parse_with_notes(
    text: impl AsRef<[u8]>,
    source_name: &str,
    options: &UrdfOptions,
) -> Result<Loaded, UrdfError> {
    if !options.gravity.iter().all(|g| g.is_finite()) {
        let message = format!(
            "is {:?}, expected three finite numbers in m/s^2",
            options.gravity
        );
        return Err(UrdfError::Option {
            file: source_name.to_owned(),
            option: "gravity",
            message,
        });
    }
    let source = Source::decode(source_name, text.as_ref())?;
    let mut notes = Notes::default();
    let document = guard::read(&source, &mut notes)?;
    let tree = tree::Tree::new(&document, &source)?;
    let chain = chain::find(&tree, &source, options, &mut notes)?;
    let urdf = read_values(&document, &source)?;
    let robot = merge::robot_model(&tree, &chain.bodies, &urdf, &source, options)?;
    let links = merge::placed_links(&tree, &chain.bodies, &urdf);
    Ok(Loaded {
        robot,
        choice: chain.choice,
        links,
        notes: notes.into_list(),
    })
}

/// The numbers, read by urdf-rs from the text that the guard wrote; links and joints keep their order.
fn read_values(
    document: &document::Document,
    source: &Source,
) -> Result<urdf_rs::Robot, UrdfError> {
    let refuse = |message: String| source.refuse(document.root_at, "<robot>", message);
    let urdf = urdf_rs::read_from_string(&document.clean)
        .map_err(|error| refuse(format!("urdf-rs: {error}")))?;
    let complete =
        urdf.links.len() == document.links.len() && urdf.joints.len() == document.joints.len();
    if complete {
        Ok(urdf)
    } else {
        Err(refuse("urdf-rs lost a link or a joint".to_owned()))
    }
}
