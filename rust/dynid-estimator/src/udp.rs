//! Datagrams: one state in each, one answer back to whoever sent the last good one.

use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

use crate::stop::Stop;
use crate::sys;
use crate::wire;

/// A longer datagram cannot be sent \[bytes\].
const MOST_BYTES: usize = 65_507;

/// A socket and who is answered.
#[derive(Debug)]
pub struct Udp {
    socket: UdpSocket,
    /// Who sent the last datagram, and who sent the last good one.
    sender: Option<SocketAddr>,
    peer: Option<SocketAddr>,
}

impl Udp {
    /// Listens on `address`. With `patience` a receive waits so long, without it not at all.
    ///
    /// # Errors
    /// [`Stop`] if the address is none or taken, or answers would not fit into a datagram.
    pub fn listen(
        address: &str,
        patience: Option<Duration>,
        n_joints: usize,
        most_terms: usize,
    ) -> Result<Self, Stop> {
        let answer = wire::answer_bytes(n_joints, most_terms);
        if answer.max(wire::most_state_bytes(n_joints)) > MOST_BYTES {
            return Err(Stop::Because(format!(
                "--udp: an answer of {n_joints} joints has {answer} bytes, a datagram {MOST_BYTES} at most; use --shm"
            )));
        }
        let open = || -> io::Result<UdpSocket> {
            let socket = UdpSocket::bind(address)?;
            match patience {
                Some(patience) => socket.set_read_timeout(Some(patience))?,
                None => socket.set_nonblocking(true)?,
            }
            Ok(socket)
        };
        let socket = open().map_err(|error| {
            Stop::Because(format!(
                "--udp {address}: {error}; give an address and a port, such as 127.0.0.1:7000"
            ))
        })?;
        Ok(Self {
            socket,
            sender: None,
            peer: None,
        })
    }

    /// Where it listens.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// The next datagram, if one is there or comes in time. A longer one than `out` is cut, and so refused later.
    pub fn receive(&mut self, out: &mut [u8]) -> Option<usize> {
        // Whatever the error, nothing came; a socket that is broken for good shows as stale input.
        let (length, sender) = loop {
            match self.socket.recv_from(out) {
                // A signal that asks for something else than an end is no silence.
                Err(error) if error.kind() == io::ErrorKind::Interrupted && !sys::stop_asked() => {}
                received => break received.ok()?,
            }
        };
        self.sender = Some(sender);
        Some(length)
    }

    /// The last datagram was a state: its sender is answered from now on.
    pub fn trust_sender(&mut self) {
        self.peer = self.sender;
    }

    /// Answers, if there is anybody; a peer that has gone is not waited for.
    pub fn send(&self, bytes: &[u8]) {
        if let Some(peer) = self.peer {
            let _ = self.socket.send_to(bytes, peer);
        }
    }
}
