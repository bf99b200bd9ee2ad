//! Rotor inertia from `<transmission>`, as Drake writes it.
//!
//! ```xml
//! <transmission name="t1">
//!   <joint name="j1"/>
//!   <actuator name="m1">
//!     <drake:rotor_inertia value="1e-5"/>
//!     <drake:gear_ratio value="100"/>            <!-- or <mechanicalReduction>100</mechanicalReduction> -->
//!   </actuator>
//! </transmission>
//! ```
//!
//! Everything else of a transmission is passed over. A transmission without a rotor inertia is refused for a ratio of zero
//! only: no gear has one, whoever reads it.

use super::document::Rotor;
use super::elements::Fault;
use super::numbers::{moderate, not_negative, one};
use super::places::Place;
use super::tag::Tag;

/// A text that becomes a number only if a rotor inertia makes it count.
struct Claim {
    text: String,
    at: usize,
}

/// A `<transmission>` being read.
pub(super) struct OpenTransmission {
    at: usize,
    joints: Vec<Claim>,
    inertias: Vec<Claim>,
    gear_ratios: Vec<Claim>,
    reductions: Vec<Claim>,
}

/// More joints or actuators than this are not stored; two are too many already.
const ENOUGH: usize = 4;
/// Longest text of a ratio \[bytes\].
const MAX_TEXT: usize = 128;

impl OpenTransmission {
    pub(super) fn new(at: usize) -> Self {
        Self {
            at,
            joints: Vec::new(),
            inertias: Vec::new(),
            gear_ratios: Vec::new(),
            reductions: Vec::new(),
        }
    }

    /// Takes in a child or grandchild.
    pub(super) fn element(&mut self, tag: &Tag) -> Place {
        let (list, attribute, place) = match tag.name {
            "joint" => (&mut self.joints, "name", Place::Skip),
            "drake:rotor_inertia" => (&mut self.inertias, "value", Place::Skip),
            "drake:gear_ratio" => (&mut self.gear_ratios, "value", Place::Skip),
            "mechanicalReduction" => (&mut self.reductions, "", Place::Reduction),
            _ => return Place::Actuator,
        };
        if list.len() >= ENOUGH {
            return Place::Skip;
        }
        let text = tag
            .get(attribute)
            .map_or_else(String::new, |a| a.value.clone().into_owned());
        list.push(Claim { text, at: tag.at });
        place
    }

    /// Takes in the text of `<mechanicalReduction>`; a text that is too long is cut to one that is no number.
    pub(super) fn text(&mut self, text: &str) {
        if let Some(claim) = self.reductions.last_mut() {
            let fits = claim.text.len() + text.len() <= MAX_TEXT;
            claim.text.push_str(if fits { text } else { "…" });
        }
    }

    /// What stands for a gear ratio, by the element's name.
    fn ratios(&self) -> impl Iterator<Item = (&'static str, &Claim)> {
        let gears = self.gear_ratios.iter().map(|c| ("drake:gear_ratio", c));
        gears.chain(self.reductions.iter().map(|c| ("mechanicalReduction", c)))
    }

    /// The rotor, if one is declared.
    pub(super) fn finish(self) -> Result<Option<Rotor>, Fault> {
        let fault = |at, message: String| Err(Fault { at, message });
        for (name, text) in self.ratios() {
            let number: Option<f64> = text.text.trim().parse().ok();
            if number == Some(0.0) {
                return fault(
                    text.at,
                    format!("{name} is zero, expected rotor speed over joint speed; correct it, or delete the element"),
                );
            }
        }
        let Some(inertia) = self.inertias.first() else {
            return Ok(None);
        };
        let joint = match self.joints.as_slice() {
            [joint] => joint,
            other => {
                let count = other.len();
                let message = format!(
                    "a rotor inertia needs exactly one <joint> in its transmission, found {count}; \
                     delete it and use the option `rotor_inertia`"
                );
                return fault(self.at, message);
            }
        };
        for (claims, name) in [
            (&self.inertias, "drake:rotor_inertia"),
            (&self.gear_ratios, "drake:gear_ratio"),
        ] {
            if let Some(second) = claims.get(1) {
                return fault(
                    second.at,
                    format!("a second <{name}> in one transmission; keep one"),
                );
            }
        }
        let mend = "value=\"inertia\" in kg m^2, before the gear";
        let own = claim("drake:rotor_inertia", inertia, mend)?;
        let own = not_negative(
            "drake:rotor_inertia",
            own,
            "the rotor's own inertia in kg m^2",
        );
        let own = own.map_err(|message| Fault {
            at: inertia.at,
            message,
        })?;
        // The sign of a ratio is a direction; it goes with the square.
        let mut ratio: Option<f64> = None;
        for (name, text) in self.ratios() {
            let number = claim(name, text, "rotor speed over joint speed")?;
            if ratio.is_some_and(|other| other.abs() != number.abs()) {
                return fault(
                    text.at,
                    format!("{name} is {number}, but another ratio stands beside it; keep one"),
                );
            }
            ratio = Some(number);
        }
        let reflected = own * ratio.map_or(1.0, |r| r * r);
        Ok(Some(Rotor {
            joint: joint.text.clone(),
            reflected,
            gear_ratio: ratio.map(f64::abs),
            at: inertia.at,
        }))
    }
}

fn claim(name: &str, claim: &Claim, mend: &str) -> Result<f64, Fault> {
    one(name, &claim.text, mend)
        .and_then(|number| moderate(name, number))
        .map_err(|message| Fault {
            at: claim.at,
            message,
        })
}
