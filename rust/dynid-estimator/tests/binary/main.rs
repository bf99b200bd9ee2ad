//! The binary from outside: what it answers, and what it refuses.

mod answers;
mod asked;
mod common;
mod live;
mod quiet;
mod rates;
mod refused;
