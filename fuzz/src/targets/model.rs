//! A `model.json`: a model whose torques are numbers and whose text reads as itself, or a sentence.

use std::sync::Arc;

use dynid_core::{State, TorqueEstimator, TorqueModel};

use crate::limits::{check_sentence, within_limits};
use dynid_io::model_file::{parse, to_text};
use sha2::{Digest, Sha256};

/// What stands for a checksum in the corpus: a forger can count too, so the right one is put in its place.
const BLANK: &[u8] = &[b'0'; 64];

fn with_checksum(bytes: &[u8]) -> Vec<u8> {
    let mut forged = bytes.to_vec();
    if let Some(at) = bytes.windows(64).position(|window| window == BLANK) {
        let digest = Sha256::digest(bytes);
        let digits = digest
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect::<String>();
        forged[at..at + 64].copy_from_slice(digits.as_bytes());
    }
    forged
}

/// One input.
pub fn run(bytes: &[u8]) {
    within_limits(|| match parse(&with_checksum(bytes), "f") {
        Ok(model) => {
            let text = to_text(&model).expect("a model is JSON");
            let again = parse(text.as_bytes(), "f").expect("its own text");
            assert_eq!(to_text(&again).expect("a model is JSON"), text);
            check_torques(&Arc::new(model));
        }
        Err(error) => check_sentence(&error),
    });
}

/// Torques of a model in a few states.
///
/// # Panics
/// If one is not finite.
fn check_torques(model: &Arc<TorqueModel>) {
    let n = model.robot().n_joints();
    let mut estimator = TorqueEstimator::new(Arc::clone(model));
    let mut tau = vec![0.0; n];
    for value in [0.0, 0.5, -1.0, 3.0] {
        let row = vec![value; n];
        let state = State::single(&row, &row, &row);
        let done = estimator.estimate_into(&state, &mut tau);
        assert!(done.is_ok(), "{done:?}");
        assert!(tau.iter().all(|x| x.is_finite()), "{tau:?}");
    }
}
