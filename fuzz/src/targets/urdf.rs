//! A URDF as a stranger sends it: a robot that stands up to its own text, or a sentence.

use crate::limits::{check_sentence, within_limits};
use dynid_io::urdf::{parse_with_notes, UrdfOptions};

/// One input.
pub fn run(bytes: &[u8]) {
    within_limits(
        || match parse_with_notes(bytes, "f", &UrdfOptions::default()) {
            Ok(loaded) => {
                let phi = loaded.robot.joints().iter().flat_map(|joint| joint.phi);
                assert!(phi.into_iter().all(f64::is_finite));
                loaded.notes.iter().for_each(|note| check_sentence(note));
                // What a model file keeps of it is the same robot.
                let text =
                    dynid_io::model_file::robot_to_text(&loaded.robot).expect("a robot is JSON");
                let again =
                    dynid_io::model_file::robot_from_text(&text, "f").expect("its own text");
                assert_eq!(again, loaded.robot);
            }
            Err(error) => check_sentence(&error),
        },
    );
}
