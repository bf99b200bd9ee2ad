//! A `contact.json`: an observer's uncertainty that a model takes and that answers numbers, or a sentence.

use std::sync::Arc;

use dynid_core::{OnlineEstimator, Sample};
use dynid_io::contact_file::parse_contact;

use crate::arm::arm;
use crate::limits::{check_sentence, within_limits};

/// One input.
pub fn run(bytes: &[u8]) {
    within_limits(|| match parse_contact(bytes, "f") {
        Ok(file) => {
            let online = OnlineEstimator::new(Arc::new(arm()), Some(file.step), None)
                .and_then(|online| online.observing(file.settings))
                .and_then(|online| online.knowing(Arc::new(file.uncertainty)));
            // It may be of another arm; that is all that may be.
            let Ok(mut online) = online else {
                return;
            };
            for k in 0..8 {
                let x = [0.1 * f64::from(k), -0.2];
                let sample = Sample {
                    sequence: None,
                    time: f64::from(k) * file.step,
                    motion: [Some(&x), Some(&x), Some(&x), None, None, None],
                    temperature: None,
                    tau: Some(&[50.0, -1e9]),
                };
                online.step(&sample).expect("a sample of this arm");
                let observer = online.observer().expect("it was made with one");
                let mut said = observer.external().iter().chain(observer.guide());
                assert!(said.all(|x| x.is_finite()));
            }
        }
        Err(error) => check_sentence(&error),
    });
}
