//! What the guard remembers of a file: names, references and places, which a URDF reader forgets.

/// How a joint moves, by its `type`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Motion {
    Fixed,
    Revolute,
    Continuous,
    Prismatic,
    Floating,
    Planar,
}

impl Motion {
    /// The values of `type`, in the order of the refusal's sentence.
    const NAMES: [(&'static str, Self); 6] = [
        ("revolute", Self::Revolute),
        ("continuous", Self::Continuous),
        ("prismatic", Self::Prismatic),
        ("fixed", Self::Fixed),
        ("floating", Self::Floating),
        ("planar", Self::Planar),
    ];

    pub(super) fn from_name(name: &str) -> Option<Self> {
        Self::NAMES
            .iter()
            .find(|(known, _)| *known == name)
            .map(|&(_, motion)| motion)
    }

    pub(super) fn name(self) -> &'static str {
        Self::NAMES
            .iter()
            .find(|(_, motion)| *motion == self)
            .map_or("", |(name, _)| name)
    }

    /// One degree of freedom along or about `<axis>`.
    pub(super) fn has_axis(self) -> bool {
        matches!(self, Self::Revolute | Self::Continuous | Self::Prismatic)
    }
}

/// A link by name, as `<parent>` and `<child>` give it.
#[derive(Clone, Debug)]
pub(super) struct Reference {
    pub(super) link: String,
    pub(super) at: usize,
}

/// A `<link>`.
pub(super) struct LinkFacts {
    pub(super) name: String,
    pub(super) at: usize,
}

/// A second `<origin>` of a joint.
#[derive(Clone, Copy)]
pub(super) struct SecondOrigin {
    pub(super) at: usize,
    /// Both have the same `rpy`, so gravity reads the same either way.
    pub(super) same_rotation: bool,
}

/// A `<mimic>`: the position is `multiplier` times that of `joint`, plus `offset`.
#[derive(Clone, Debug)]
pub(super) struct Mimic {
    pub(super) at: usize,
    pub(super) joint: String,
    pub(super) multiplier: f64,
    pub(super) offset: f64,
}

/// A `<joint>`.
pub(super) struct JointFacts {
    pub(super) name: String,
    pub(super) at: usize,
    pub(super) motion: Motion,
    pub(super) parent: Reference,
    pub(super) child: Reference,
    /// Greatest acceleration, which urdf-rs does not know \[rad/s², m/s²\].
    pub(super) acceleration: f64,
    /// Least and greatest position \[rad, m\].
    pub(super) range: [f64; 2],
    pub(super) mimic: Option<Mimic>,
    pub(super) second_origin: Option<SecondOrigin>,
}

/// A rotor that a `<transmission>` declares.
pub(super) struct Rotor {
    pub(super) joint: String,
    /// Rotor inertia times the gear ratio squared \[kg·m², kg\].
    pub(super) reflected: f64,
    /// Motor turns per joint turn, without its sign, if it is declared.
    pub(super) gear_ratio: Option<f64>,
    pub(super) at: usize,
}

/// A whole file, links and joints in the order of the file.
pub(super) struct Document {
    pub(super) name: String,
    pub(super) root_at: usize,
    pub(super) links: Vec<LinkFacts>,
    pub(super) joints: Vec<JointFacts>,
    pub(super) rotors: Vec<Rotor>,
    /// The kinematic elements written anew: nothing implied, nothing else; what urdf-rs reads.
    pub(super) clean: String,
}
