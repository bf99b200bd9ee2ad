//! Where points of the links are in space, and how a function of these places moves with q.

use dynid_core::dynamics::placed;
use dynid_core::{JointKind, RobotModel};
use nalgebra::{Matrix3, Vector3};

use crate::error::OfflineError;

/// A point fixed to a link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkPoint {
    /// Index of the link.
    pub link: usize,
    /// Place in the link frame \[m\].
    pub place: Vector3<f64>,
}

/// Places of `points` in the base frame \[m\]: n_samples × n_points × 3 into `places`, for `q` (n_samples × n).
///
/// # Errors
/// [`OfflineError::Shape`] if lengths disagree or a link does not exist.
pub fn point_places(
    robot: &RobotModel,
    points: &[LinkPoint],
    q: &[f64],
    places: &mut [f64],
) -> Result<(), OfflineError> {
    check(robot, points, q, places.len())?;
    let mut frames = Vec::with_capacity(robot.n_joints());
    for (q, places) in q
        .chunks_exact(robot.n_joints())
        .zip(places.chunks_exact_mut(3 * points.len()))
    {
        link_frames(robot, q, &mut frames);
        for (point, place) in points.iter().zip(places.chunks_exact_mut(3)) {
            let (rotation, origin) = frames[point.link];
            place.copy_from_slice((origin + rotation * point.place).as_slice());
        }
    }
    Ok(())
}

/// Gradient of `sum of weights . places` with respect to q, n_samples × n; `weights`: n_samples × n_points × 3.
///
/// # Errors
/// [`OfflineError::Shape`] if lengths disagree or a link does not exist.
pub fn point_gradient(
    robot: &RobotModel,
    points: &[LinkPoint],
    q: &[f64],
    weights: &[f64],
    gradient: &mut [f64],
) -> Result<(), OfflineError> {
    check(robot, points, q, weights.len())?;
    if gradient.len() != q.len() {
        return Err(OfflineError::Shape { what: "gradient" });
    }
    let n = robot.n_joints();
    let mut frames = Vec::with_capacity(n);
    for ((q, weights), gradient) in q
        .chunks_exact(n)
        .zip(weights.chunks_exact(3 * points.len()))
        .zip(gradient.chunks_exact_mut(n))
    {
        link_frames(robot, q, &mut frames);
        gradient.fill(0.0);
        for (point, weight) in points.iter().zip(weights.chunks_exact(3)) {
            let weight = Vector3::from_column_slice(weight);
            let (rotation, origin) = frames[point.link];
            let place = origin + rotation * point.place;
            for (j, joint) in robot.joints()[..=point.link].iter().enumerate() {
                let (rotation, origin) = frames[j];
                let axis = rotation * joint.axis;
                gradient[j] += match joint.kind {
                    JointKind::Revolute => axis.cross(&(place - origin)).dot(&weight),
                    JointKind::Prismatic => axis.dot(&weight),
                };
            }
        }
    }
    Ok(())
}

/// Rotation and origin of every link frame in the base frame.
fn link_frames(robot: &RobotModel, q: &[f64], frames: &mut Vec<(Matrix3<f64>, Vector3<f64>)>) {
    frames.clear();
    let mut outer = (Matrix3::identity(), Vector3::zeros());
    for (place, &q) in robot.placements().iter().zip(q) {
        let (rotation, origin) = placed(place, q);
        outer = (outer.0 * rotation, outer.1 + outer.0 * origin);
        frames.push(outer);
    }
}

fn check(
    robot: &RobotModel,
    points: &[LinkPoint],
    q: &[f64],
    length: usize,
) -> Result<(), OfflineError> {
    let n = robot.n_joints();
    if points.is_empty() || points.iter().any(|point| point.link >= n) {
        return Err(OfflineError::Shape { what: "points" });
    }
    if !q.len().is_multiple_of(n) || length != q.len() / n * 3 * points.len() {
        return Err(OfflineError::Shape { what: "places" });
    }
    Ok(())
}
