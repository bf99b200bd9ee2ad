//! Where in the file the guard is, and which elements it reads there.

/// An open element that the guard reads, or [`Place::Skip`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    Robot,
    Link,
    Inertial,
    Joint,
    /// An element of attributes only, e.g. `<mass>`.
    Leaf,
    Transmission,
    Actuator,
    /// `<mechanicalReduction>`, whose number is its text.
    Reduction,
    /// An element that says nothing about the kinematics, with all that is in it.
    Skip,
}

/// Names that mean something to the kinematics, wherever they stand.
const KINEMATIC: [&str; 11] = [
    "link", "joint", "inertial", "mass", "inertia", "origin", "axis", "limit", "parent", "child",
    "mimic",
];

/// What an element's name means at a place.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Meaning {
    Read,
    Ignore,
    /// A kinematic element at a place where a reader would miss it.
    Misplaced,
    /// Probably a misspelt one of these.
    Misspelt(&'static str),
}

impl Place {
    /// Children that are read.
    fn reads(self) -> &'static [&'static str] {
        match self {
            Self::Robot => &["link", "joint", "transmission"],
            Self::Link => &["inertial"],
            Self::Inertial => &["origin", "mass", "inertia"],
            Self::Joint => &["origin", "parent", "child", "axis", "limit", "mimic"],
            Self::Transmission => &["joint", "actuator", "mechanicalReduction"],
            Self::Actuator => &[
                "mechanicalReduction",
                "drake:rotor_inertia",
                "drake:gear_ratio",
            ],
            Self::Leaf | Self::Reduction | Self::Skip => &[],
        }
    }

    /// Whether a stray or misspelt element here could change the robot.
    pub(super) fn is_kinematic(self) -> bool {
        matches!(
            self,
            Self::Robot | Self::Link | Self::Inertial | Self::Joint | Self::Leaf
        )
    }

    pub(super) fn meaning(self, name: &str) -> Meaning {
        if self.reads().contains(&name) {
            return Meaning::Read;
        }
        if !self.is_kinematic() {
            return Meaning::Ignore;
        }
        if KINEMATIC.contains(&name) {
            return Meaning::Misplaced;
        }
        match self.reads().iter().find(|known| is_near(name, known)) {
            Some(known) => Meaning::Misspelt(known),
            None => Meaning::Ignore,
        }
    }
}

/// The same but for upper case, or for one letter that is missing, added, wrong or swapped with its neighbour.
fn is_near(name: &str, known: &str) -> bool {
    if name.eq_ignore_ascii_case(known) {
        return true;
    }
    let (a, b) = (name.as_bytes(), known.as_bytes());
    if a.len().abs_diff(b.len()) > 1 {
        return false;
    }
    let head = a.iter().zip(b).take_while(|(x, y)| x == y).count();
    let tail = a
        .iter()
        .rev()
        .zip(b.iter().rev())
        .take_while(|(x, y)| x == y)
        .count();
    let (longer, shorter) = (a.len().max(b.len()), a.len().min(b.len()));
    if head + tail >= shorter {
        return true; // One letter missing or added.
    }
    let middle = |word: &[u8]| {
        word.get(head..word.len() - tail)
            .map(<[u8]>::to_vec)
            .unwrap_or_default()
    };
    let swapped = middle(a).into_iter().rev().eq(middle(b)) && longer - head - tail == 2;
    a.len() == b.len() && (head + tail + 1 == longer || swapped)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_slip_of_the_pen_is_near() {
        for name in ["Origin", "orgin", "originn", "origon", "oirgin", "xorigin"] {
            assert_eq!(
                Place::Joint.meaning(name),
                Meaning::Misspelt("origin"),
                "{name}"
            );
        }
        for name in [
            "dynamics",
            "calibration",
            "safety_controller",
            "gazebo",
            "o",
            "nigiro",
            "original",
        ] {
            assert_eq!(Place::Joint.meaning(name), Meaning::Ignore, "{name}");
        }
        assert_eq!(Place::Link.meaning("mass"), Meaning::Misplaced);
        assert_eq!(Place::Transmission.meaning("joints"), Meaning::Ignore);
    }
}
