//! What a watch remembers: numbers that a watch goes on with, or a sentence.

use std::sync::{Arc, OnceLock};

use dynid_core::watch::{Healthy, WatchSettings};
use dynid_core::{OnlineEstimator, Sample, TorqueModel};
use dynid_io::remembered::parse_remembered;

use crate::arm::arm;
use crate::limits::{check_sentence, within_limits};

static MODEL: OnceLock<Arc<TorqueModel>> = OnceLock::new();

/// States after which a row has ended, and the next one is judged.
const STEPS: u32 = 12;

/// One input.
pub fn run(bytes: &[u8]) {
    let model = MODEL.get_or_init(|| Arc::new(arm()));
    within_limits(|| match parse_remembered(bytes, "f") {
        Ok(found) => {
            let settings = WatchSettings {
                row: 0.005,
                ..WatchSettings::default()
            };
            let healthy = Healthy {
                frozen_after: vec![0.005; 2],
                ..Healthy::untold(2)
            };
            let online = OnlineEstimator::new(Arc::clone(model), None, None);
            let online = online.and_then(|online| online.watching(settings, &healthy));
            let mut online = online.expect("a watched arm");
            let recalled = online.watch_mut().map(|watch| watch.recall(&found.numbers));
            if recalled.is_some_and(|recalled| recalled.is_err()) {
                return;
            }
            for k in 0..STEPS {
                let moving = [0.1, 0.5 + 0.01 * f64::from(k)];
                let sample = Sample {
                    sequence: None,
                    time: 0.001 * f64::from(k),
                    motion: [
                        Some(&[0.2; 2]),
                        Some(&moving),
                        Some(&[0.1; 2]),
                        None,
                        None,
                        None,
                    ],
                    temperature: None,
                    tau: Some(&[3.0; 2]),
                };
                online.step(&sample).expect("a state of this arm");
                assert!(online.tau().iter().all(|tau| tau.is_finite()));
            }
        }
        Err(error) => check_sentence(&error),
    });
}
