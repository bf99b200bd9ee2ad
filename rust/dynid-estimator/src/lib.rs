//! `dynid-estimator MODEL.json`: states in on stdin, the torque of every term out on stdout, one line per line; or both as
//! datagrams or in shared memory, paced or driven by what comes.
//!
//! ```text
//! stdin -> Lines -> csv / json \                                      / Writer -> stdout
//!                                Frame -> Cycle (OnlineEstimator)
//! UDP, shared memory -> wire   /                                      \ wire -> UDP, shared memory
//! ```
//!
//! The program is `main.rs`, which calls [`main`]; the rest is a library so that fuzzing reaches its readers
//! ([`fuzzing`]).
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
mod changes;
#[cfg(test)]
mod counting;
mod cycle;
mod frame;
#[doc(hidden)]
pub mod fuzzing;
mod histogram;
mod info;
mod input;
mod live;
mod output;
mod pace;
mod rate;
mod realtime;
mod rehearsal;
mod remember;
mod run;
mod shm;
mod stop;
mod swap;
mod sys;
mod timing;
mod udp;
mod wire;

use std::io::{self, BufWriter, Write};
use std::process::ExitCode;
use std::sync::Arc;

use args::{Command, Run};
use stop::Stop;

/// The program: reads its arguments, works, and says with one sentence why it could not.
pub fn main() -> ExitCode {
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
        Command::Run(run) => {
            let Run {
                model: path,
                formats,
                mut settings,
                changes,
                remember,
                contacts,
                real_time,
                transport,
                watch,
            } = *run;
            let model = dynid_io::load(&path)?;
            settings.watch = match changes {
                Some(changes) => Some(Arc::new(dynid_io::load_watch(&changes)?)),
                None => None,
            };
            settings.remember = remember;
            if let Some((contacts, per_hour)) = contacts {
                settings.take_contacts(dynid_io::load_contact(&contacts)?, per_hour);
            }
            let watched = watch.then_some(path);
            if let Some(transport) = transport {
                let report = live::run(model, &transport, &settings, &real_time, watched)?;
                return report.map_or(Ok(()), |report| print(&report));
            }
            if sys::stdout_is_closed() {
                return Err(Stop::no_output());
            }
            let mut out = BufWriter::with_capacity(1 << 16, io::stdout().lock());
            sys::catch_signals(watched.is_some())
                .map_err(|error| Stop::Because(error.to_string()))?;
            let stdin = sys::stdin(real_time.end())
                .map_err(|error| Stop::Because(format!("stdin: {error}")))?;
            let done = run::run(
                model, formats, &settings, &real_time, watched, stdin, &mut out,
            );
            // What was answered before a broken line still leaves.
            out.flush().map_err(Stop::output)?;
            // stdout holds the torques.
            if let Some(report) = done? {
                let _ = io::stderr().write_all(report.as_bytes());
            }
            Ok(())
        }
    }
}

fn print(text: &str) -> Result<(), Stop> {
    if sys::stdout_is_closed() {
        return Err(Stop::no_output());
    }
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())
        .and_then(|()| out.flush())
        .map_err(Stop::output)
}
