"""Currents that move the arm along a plan, before any controller has to correct it."""

import numpy as np

import dynid_rs as dyn

GAIN = np.array([14.9, 14.9, 12.5, 8.2, 8.2, 8.2])  # N m/A, as in arm.toml

# What the drives have to give, not what a torque channel that is late shows of it.
model = dyn.TorqueModel.load("found/model.json").with_torque_delay(0.0)
start, end, seconds = np.zeros(6), np.array([0.8, 0.5, -0.6, 0.4, 0.5, 1.0]), 1.2

# From rest to rest along a quintic: position, velocity, acceleration of every millisecond.
t = np.arange(0.0, seconds, 0.001)
s = (t / seconds)[:, None]
q = start + (end - start) * (10 * s**3 - 15 * s**4 + 6 * s**5)
dq = (end - start) * (30 * s**2 - 60 * s**3 + 30 * s**4) / seconds
ddq = (end - start) * (60 * s - 180 * s**2 + 120 * s**3) / seconds**2

total, terms, status = model.evaluate(q, dq, ddq, step=0.001)  # [N m]; every term of the sum by itself
print("current at its largest [A]:", np.abs(total / GAIN).max(axis=0).round(2))
for name, torque in zip(model.term_names, terms.transpose(1, 0, 2), strict=True):
    print(f"{name:>20} of joint_3: {np.abs(torque[:, 2]).max():6.2f} N m at most")
print("states outside of what the model was trained on:", np.count_nonzero(status & 2), "of", len(t))
