//! `dynid-estimator`: see the library, of which this is the program.

use std::process::ExitCode;

fn main() -> ExitCode {
    dynid_estimator::main()
}
