"""Shares memory with a running estimator: dynid-estimator model.json --shm arm --rate 1000."""

import mmap
import struct
import sys
import time

import numpy as np
from udp_client import answer, state


class Slots:
    """The two slots of the file, seen as 8-byte words: on x86 a store of one word is whole and in order."""

    def __init__(self, path):
        with open(path, "r+b") as file:
            self.memory = mmap.mmap(file.fileno(), 0)
        self.words = memoryview(self.memory).cast("Q")
        magic, version, self.n_joints, self.states, _, self.answers, _ = struct.unpack_from("<4sHHIIII", self.memory)
        assert (magic, version) == (b"DYNM", 1)

    def send(self, message):
        """Leaves a state."""
        at = self.states
        counter = self.words[at // 8] | 1
        self.words[at // 8] = counter
        self.words[at // 8 + 1] = len(message)
        self.memory[at + 16 : at + 16 + len(message)] = message
        self.words[at // 8] = counter + 1

    def receive(self):
        """The newest answer, or None while there is none."""
        at = self.answers
        counter = self.words[at // 8]
        message = self.memory[at + 16 : at + 16 + self.words[at // 8 + 1]]
        whole = counter % 2 == 0 and counter > 0 and self.words[at // 8] == counter
        return answer(message) if whole else None


def main(path, count=1000):
    """Leaves a slow motion, a state a millisecond, and prints every hundredth answer."""
    slots = Slots(path)
    phase = 0.3 * np.arange(slots.n_joints)
    for k in range(int(count)):
        t = 0.001 * k
        slots.send(state(k, t, 0.5 * np.sin(t + phase), 0.5 * np.cos(t + phase), -0.5 * np.sin(t + phase)))
        time.sleep(0.001)
        found = slots.receive()
        if k % 100 == 99 and found:
            status, sequence, rows = found
            print(f"{sequence:6d}  status {status}  tau {np.round(rows[0], 3)}  +- {np.round(rows[1], 3)}")


if __name__ == "__main__":
    main(*sys.argv[1:])
