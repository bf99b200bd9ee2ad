//! What the operating system does for a real-time loop. The only module that is not plain Rust; elsewhere than on Linux its
//! requests are refused with a sentence.

#[cfg(target_os = "linux")]
mod linux;
#[cfg(target_os = "linux")]
pub use linux::*;

#[cfg(not(target_os = "linux"))]
mod elsewhere;
#[cfg(not(target_os = "linux"))]
pub use elsewhere::*;

/// Page faults of the calling thread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PageFaults {
    /// Served from memory.
    pub minor: u64,
    /// Served from disk.
    pub major: u64,
}
