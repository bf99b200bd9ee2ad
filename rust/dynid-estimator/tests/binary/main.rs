//! The binary from outside: what it answers, and what it refuses.

mod answers;
mod common;
mod live;
mod quiet;
mod refused;
