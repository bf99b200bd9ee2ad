//! Which chain is meant, where the file does not say: the longest one of driven joints, without the fingers.
//!
//! * It begins at the base and takes the longest branch at every fork, of equally long ones the first of the file.
//! * It ends before a joint that others follow (`<mimic>`: a gripper), before one that follows, and before one that floats.
//! * It ends on a moving link with several branches, each of fewer joints than the chain has up to there: fingers.
//!
//! Whoever means another one chooses a tip.

use super::document::Motion;
use super::error::UrdfError;
use super::source::Source;
use super::tree::Tree;

/// The end of the chain, and the ends of others that could be meant.
pub(super) struct Proposal {
    pub(super) tip: usize,
    pub(super) others: Vec<usize>,
}

/// The chain from `base` that is probably meant.
///
/// # Errors
/// [`UrdfError::Invalid`] where the only ways on lead over a joint without an axis: the base floats.
pub(super) fn proposal(tree: &Tree, source: &Source, base: usize) -> Result<Proposal, UrdfError> {
    let driven = driven(tree);
    let order = from_the_root(tree, base);
    // Longest way below each link, in driven joints.
    let mut reach = vec![0_usize; tree.below.len()];
    for &link in order.iter().rev() {
        reach[link] = ways(tree, &driven, link)
            .map(|joint| reach[tree.edges[joint].child] + usize::from(moves(tree, joint)))
            .max()
            .unwrap_or(0);
    }
    let longest = |joint: usize| reach[tree.edges[joint].child] + 1;
    let (mut tip, mut so_far) = (base, 0);
    let mut others = Vec::new();
    loop {
        let leaving = leaving(tree, &driven, tip);
        let most = leaving
            .iter()
            .map(|&joint| longest(joint))
            .max()
            .unwrap_or(0);
        let fingers = so_far > 0 && leaving.len() > 1 && most < so_far;
        let next = leaving
            .iter()
            .copied()
            .find(|&joint| longest(joint) == most);
        let next = next.filter(|_| !fingers);
        others.extend(
            leaving
                .iter()
                .filter(|&&joint| Some(joint) != next)
                .map(|&joint| end(tree, &driven, &reach, joint)),
        );
        let Some(joint) = next else { break };
        tip = tree.edges[joint].child;
        so_far += 1;
    }
    // Without a way on, a joint without an axis is no branch but the rest of the arm.
    if let Some(joint) = floating(tree, &order, tip).filter(|_| others.is_empty()) {
        return Err(no_axis(tree, source, joint));
    }
    if so_far == 0 {
        let mut joints = tree.document.joints.iter();
        let follower = joints.find_map(|facts| Some((facts, facts.mimic.as_ref()?)));
        if let Some((facts, mimic)) = follower {
            let message = "no joint moves that follows no other and is followed by none, so there is no serial chain; \
                           choose a tip, delete <mimic> or write type=\"fixed\"";
            let element = format!("<mimic> of joint \"{}\"", facts.name);
            return Err(source.refuse(mimic.at, element, message));
        }
    }
    Ok(Proposal { tip, others })
}

/// The first joint below `tip` that is neither fixed nor has an axis.
fn floating(tree: &Tree, order: &[usize], tip: usize) -> Option<usize> {
    let mut below = vec![false; tree.below.len()];
    below[tip] = true;
    for &link in order {
        if !below[link] {
            continue;
        }
        for &joint in &tree.below[link] {
            if moves(tree, joint) && !tree.document.joints[joint].motion.has_axis() {
                return Some(joint);
            }
            below[tree.edges[joint].child] = true;
        }
    }
    None
}

/// The refusal of a joint that is neither fixed nor has an axis.
pub(super) fn no_axis(tree: &Tree, source: &Source, joint: usize) -> UrdfError {
    let facts = &tree.document.joints[joint];
    let message = format!(
        "is of type \"{}\", expected revolute, continuous, prismatic or fixed; if the arm starts behind it, choose \
         base=\"{}\"",
        facts.motion.name(),
        facts.child.link
    );
    source.refuse(facts.at, format!("joint \"{}\"", facts.name), message)
}

fn moves(tree: &Tree, joint: usize) -> bool {
    tree.document.joints[joint].motion != Motion::Fixed
}

/// Per joint, whether the chain may go over it.
fn driven(tree: &Tree) -> Vec<bool> {
    let joints = &tree.document.joints;
    let followed: std::collections::HashSet<&str> = joints
        .iter()
        .filter_map(|facts| facts.mimic.as_ref())
        .map(|mimic| mimic.joint.as_str())
        .collect();
    let driven = |facts: &super::document::JointFacts| {
        facts.motion.has_axis() && facts.mimic.is_none() && !followed.contains(facts.name.as_str())
    };
    joints
        .iter()
        .map(|facts| facts.motion == Motion::Fixed || driven(facts))
        .collect()
}

/// Links below `base` and itself, parents first.
fn from_the_root(tree: &Tree, base: usize) -> Vec<usize> {
    let mut order = vec![base];
    let mut done = 0;
    while let Some(&link) = order.get(done) {
        done += 1;
        order.extend(
            tree.below[link]
                .iter()
                .map(|&joint| tree.edges[joint].child),
        );
    }
    order
}

/// Joints on `link` that the chain may go over, fixed ones too.
fn ways<'t>(tree: &'t Tree, driven: &'t [bool], link: usize) -> impl Iterator<Item = usize> + 't {
    let below = tree.below[link].iter().copied();
    below.filter(move |&joint| driven[joint])
}

/// Driven joints that leave the links which move with `link`, in the order of the file.
fn leaving(tree: &Tree, driven: &[bool], link: usize) -> Vec<usize> {
    let mut leaving = Vec::new();
    let mut todo = vec![link];
    while let Some(link) = todo.pop() {
        for joint in ways(tree, driven, link) {
            if moves(tree, joint) {
                leaving.push(joint);
            } else {
                todo.push(tree.edges[joint].child);
            }
        }
    }
    leaving.sort_unstable();
    leaving
}

/// Last moving link of the longest way over `joint`.
fn end(tree: &Tree, driven: &[bool], reach: &[usize], joint: usize) -> usize {
    let mut tip = tree.edges[joint].child;
    loop {
        let longest = |&joint: &usize| reach[tree.edges[joint].child];
        let next = leaving(tree, driven, tip)
            .into_iter()
            .rev()
            .max_by_key(longest);
        let Some(joint) = next else { return tip };
        tip = tree.edges[joint].child;
    }
}
