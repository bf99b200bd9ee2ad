"""Asks a running estimator for the torques of one motion: dynid-estimator model.json --udp 127.0.0.1:7000."""

import socket
import struct
import sys
import time

import numpy as np

VERSION = 1
Q, DQ, DDQ = 1, 2, 4


def state(sequence, t, q, dq, ddq):
    """Bytes of a state (docs/how_to/online.md)."""
    head = struct.pack("<4sHHIIQd", b"DYNS", VERSION, len(q), Q | DQ | DDQ, 0, sequence, t)
    return head + np.concatenate([q, dq, ddq]).astype("<f8").tobytes()


def answer(message):
    """Status, sequence, and rows of one number per joint: tau, standard deviation, (external torque), terms."""
    magic, version, n, status, _, _, sequence, _ = struct.unpack_from("<4sHHIHHQd", message)
    assert (magic, version) == (b"DYNT", VERSION)
    return status, sequence, np.frombuffer(message, "<f8", offset=32).reshape(-1, n)


def main(host, port, n_joints, count=1000):
    """Sends a slow motion a thousand times a second and prints every hundredth answer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.connect((host, int(port)))
        link.settimeout(1.0)
        phase = 0.3 * np.arange(int(n_joints))
        for k in range(int(count)):
            t = 0.001 * k
            q, dq, ddq = 0.5 * np.sin(t + phase), 0.5 * np.cos(t + phase), -0.5 * np.sin(t + phase)
            link.send(state(k, t, q, dq, ddq))
            sequence = None
            while sequence != k:  # silence before was answered too, as stale
                status, sequence, rows = answer(link.recv(65536))
            if k % 100 == 0:
                print(f"{sequence:6d}  status {status}  tau {np.round(rows[0], 3)}  +- {np.round(rows[1], 3)}")
            time.sleep(0.001)


if __name__ == "__main__":
    main(*sys.argv[1:])
