//! A `robot.toml`: a robot, or a sentence.

use crate::limits::{check_sentence, within_limits};
use dynid_io::mdh::{parse, MdhOptions};

/// One input.
pub fn run(bytes: &[u8]) {
    within_limits(|| match parse(bytes, "f", &MdhOptions::default()) {
        Ok(robot) => {
            let phi = robot.joints().iter().flat_map(|joint| joint.phi);
            assert!(phi.into_iter().all(f64::is_finite));
            let text = dynid_io::model_file::robot_to_text(&robot).expect("a robot is JSON");
            let again = dynid_io::model_file::robot_from_text(&text, "f").expect("its own text");
            assert_eq!(again, robot);
        }
        Err(error) => check_sentence(&error),
    });
}
