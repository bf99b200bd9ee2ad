//! One file per way in: bytes, and what has to hold of them.

mod contact_file;
mod datagrams;
mod lines;
mod memory;
mod model;
mod remembered;
mod robot_toml;
mod urdf;
mod watch_file;

/// Names and functions.
pub const ALL: [(&str, fn(&[u8])); 9] = [
    ("urdf", urdf::run),
    ("robot_toml", robot_toml::run),
    ("model", model::run),
    ("datagrams", datagrams::run),
    ("memory", memory::run),
    ("lines", lines::run),
    ("watch_file", watch_file::run),
    ("contact_file", contact_file::run),
    ("remembered", remembered::run),
];
