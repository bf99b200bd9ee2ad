//! Where joints are held that are no part of the chain: at zero or as near to it as their range allows, followers where
//! the joint that they follow puts them.

use std::collections::HashMap;

use super::document::JointFacts;
use super::tree::Tree;

/// Positions beyond this are no robot's; multipliers of many followers in a row can lead there \[rad, m\].
const FARTHEST: f64 = 1e6;

/// The posture of all that is no part of the chain.
pub(super) struct Posture<'t> {
    joints: &'t [JointFacts],
    index: HashMap<&'t str, usize>,
    moves: Vec<bool>,
}

impl<'t> Posture<'t> {
    /// `moves` says of each joint whether it is part of the chain.
    pub(super) fn new(tree: &Tree<'t>, moves: &[bool]) -> Self {
        let joints = &tree.document.joints;
        let names = joints.iter().map(|facts| facts.name.as_str());
        Self {
            joints,
            index: names.zip(0..).collect(),
            moves: moves.to_vec(),
        }
    }

    /// The position \[rad, m\] of a joint that is held, or the joint of the chain that it follows.
    ///
    /// A joint that follows itself, over whichever others, or one that is not there, is held like one that follows none.
    pub(super) fn of(&self, joint: usize) -> Result<f64, usize> {
        let (mut scale, mut offset) = (1.0, 0.0);
        let mut leader = joint;
        for _ in 0..self.joints.len() {
            if leader != joint && self.moves[leader] {
                return Err(leader);
            }
            let facts = &self.joints[leader];
            let followed = facts.mimic.as_ref().filter(|_| facts.motion.has_axis());
            let Some((mimic, next)) =
                followed.and_then(|mimic| Some((mimic, *self.index.get(mimic.joint.as_str())?)))
            else {
                let position = scale * self.nearest_to_zero(leader) + offset + 0.0; // No -0 in sentences.
                let sound = position.abs() <= FARTHEST;
                return Ok(if sound {
                    position
                } else {
                    self.nearest_to_zero(joint)
                });
            };
            offset += scale * mimic.offset;
            scale *= mimic.multiplier;
            leader = next;
        }
        Ok(self.nearest_to_zero(joint))
    }

    fn nearest_to_zero(&self, joint: usize) -> f64 {
        let facts = &self.joints[joint];
        let [lower, upper] = facts.range;
        // A floating or planar joint has no axis to be moved along.
        if facts.motion.has_axis() {
            0.0_f64.max(lower).min(upper) + 0.0
        } else {
            0.0
        }
    }
}
