//! A `watch.json`: settings that a watch takes, or a sentence.

use std::sync::Arc;

use dynid_core::watch::Watch;
use dynid_io::watch_file::parse_watch;

use crate::arm::arm;
use crate::limits::{check_sentence, within_limits};

/// One input.
pub fn run(bytes: &[u8]) {
    within_limits(|| match parse_watch(bytes, "f") {
        Ok(file) => {
            assert!(file.healthy.check(file.joints.len()).is_ok());
            let model = Arc::new(arm());
            // Of other arms the lengths are wrong; that is all that may be.
            let made = Watch::new(model, file.settings, &file.healthy);
            assert!(made.is_ok() || file.joints.len() != 2);
        }
        Err(error) => check_sentence(&error),
    });
}
