//! `dynid-estimator MODEL.json`: states in on stdin, the torque of every term out on stdout, one line per line.
//!
//! ```text
//! stdin -> Lines -> csv / json -> Frame -> Cycle (OnlineEstimator) -> Writer -> stdout
//! ```
//!
//! No formula lives here: the numbers are those of [`dynid_core::OnlineEstimator`].

#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::print_stdout,
        clippy::print_stderr
    )
)]

mod args;
mod cycle;
mod frame;
mod info;
mod input;
mod output;
mod run;
mod stop;

use std::io::{self, BufWriter, Write};
use std::process::ExitCode;

use args::Command;
use stop::Stop;

fn main() -> ExitCode {
    match work() {
        Ok(()) => ExitCode::SUCCESS,
        Err(stop) => {
            if let Stop::Because(sentence) = &stop {
                run::tell("error", sentence);
            }
            stop.exit_code()
        }
    }
}

fn work() -> Result<(), Stop> {
    match args::parse(lexopt::Parser::from_env())? {
        Command::Print(text) => print(&text),
        Command::Info {
            model,
            json,
            settings,
        } => {
            let model = dynid_io::load(&model)?;
            print(&if json {
                info::json(&model, &settings)
            } else {
                info::text(&model, &settings)
            })
        }
        Command::Run {
            model,
            input,
            output,
            settings,
        } => {
            let model = dynid_io::load(&model)?;
            let mut out = BufWriter::with_capacity(1 << 16, io::stdout().lock());
            let done = run::run(
                model,
                (input, output),
                &settings,
                io::stdin().lock(),
                &mut out,
            );
            // What was answered before a broken line still leaves.
            out.flush().map_err(Stop::output)?;
            done
        }
    }
}

fn print(text: &str) -> Result<(), Stop> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())
        .and_then(|()| out.flush())
        .map_err(Stop::output)
}
