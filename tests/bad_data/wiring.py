"""Faults of names, signs and clocks: channels that belong to another joint, turn the other way, or come late."""

from __future__ import annotations

import numpy as np
from exam.draw import log_uniform

from bad_data.sets import RunSet, recorded
from bad_data.story import Story, Wanted, any_joint, columns_of, files_of, some_or_all


def swapped(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """Two joints' torques, positions, both, or motor encoders are exchanged, in one run or in all."""
    spoiled = made.copied()
    runs = some_or_all(rng, made)
    kind = ("tau", "q", "tau and q", "q_motor", "tau")[variant % 5]
    if kind == "q_motor" and made.case.n_encoders == 1:
        kind = "q"
    a, b = _loaded_pair(rng, made)
    link = ["q", "dq", "q_motor"]
    signals = {"tau": ["tau"], "q": link, "tau and q": ["tau", *link], "q_motor": ["q_motor"]}[kind]
    for k in runs:
        columns = spoiled.columns[k]
        for signal in signals:
            if f"{signal}_{a}" in columns:
                columns[f"{signal}_{a}"], columns[f"{signal}_{b}"] = columns[f"{signal}_{b}"], columns[f"{signal}_{a}"]
    code = {"tau": "torque_swapped", "q": "position_swapped", "tau and q": "joints_swapped", "q_motor": "motor_swapped"}
    named = columns_of(signals[0], (a, b)) + (columns_of("q", (a, b)) if kind == "tau and q" else ())
    wanted = Wanted((code[kind],), files_of(runs), named)
    return Story(f"{kind} of {a} and {b} in {'one run' if len(runs) == 1 else 'all runs'}", spoiled, wanted)


def _loaded_pair(rng: np.random.Generator, made: RunSet) -> tuple[int, int]:
    """Two joints, one of which carries a load: the last two of a hand may look alike."""
    n = made.n_joints
    loaded = [
        j for j in range(n) if np.vstack([s.tau_rigid for s in made.world.runs])[:, j].std() > made.world.coulomb[j]
    ]
    a = int(rng.choice(loaded)) if loaded else any_joint(rng, made)
    others = [j for j in range(n) if j != a]
    b = int(rng.choice(others))
    return min(a, b), max(a, b)


def signs(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """A torque, a position, both or a motor encoder of a joint with the other sign, in one run or in all."""
    spoiled = made.copied()
    runs = some_or_all(rng, made)
    kind = ("tau", "q", "all tau", "tau and q", "q_motor")[variant % 5]
    if kind == "q_motor" and made.case.n_encoders == 1:
        kind = "tau"
    a, _ = _loaded_pair(rng, made)
    joints = range(made.n_joints) if kind == "all tau" else (a,)
    link = ["q", "dq", "q_motor"]
    signals = {"tau": ["tau"], "all tau": ["tau"], "q": link, "tau and q": ["tau", *link], "q_motor": ["q_motor"]}[kind]
    for k in runs:
        for signal in signals:
            for j in joints:
                if f"{signal}_{j}" in spoiled.columns[k]:
                    spoiled.columns[k][f"{signal}_{j}"] *= -1
    code = {"tau": "torque_flipped", "q": "position_flipped", "tau and q": "joint_flipped", "q_motor": "motor_flipped"}
    named = columns_of(signals[0], list(joints)) + (columns_of("q", (a,)) if kind == "tau and q" else ())
    wanted = Wanted((code.get(kind, "torque_flipped"),), files_of(runs), named)
    return Story(f"{kind} of {list(joints)} in {'one run' if len(runs) == 1 else 'all runs'}", spoiled, wanted)


def delays(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """Torques that come late, of all joints or of one; link encoders that come late behind the motors'."""
    spoiled = made.copied()
    kind = ("all torques", "link encoders", "one torque", "all torques", "all torques")[variant % 5]
    if kind == "link encoders" and made.case.n_encoders == 1:
        kind = "all torques"
    delay = float(log_uniform(rng, 0.012, 0.06))
    a, _ = _loaded_pair(rng, made)
    joints = [a] if kind == "one torque" else list(range(made.n_joints))
    for k, s in enumerate(made.world.runs):
        if kind == "link encoders":
            for j in joints:
                columns = spoiled.columns[k]
                step = made.sensors.link_step[j]
                columns[f"q_{j}"] = np.round(np.interp(columns["t"] - delay, s.t, s.q[:, j]) / step) * step
            continue
        torque = made.world.motor_torque(s)
        torque[:, joints] = np.stack([np.interp(s.t - delay, s.t, torque[:, j]) for j in joints], axis=1)
        late = recorded(made, s, torque)
        spoiled.columns[k].update({f"tau_{j}": late[f"tau_{j}"] for j in joints})
    code, signals = ("encoder_delay", ("q", "q_motor")) if kind == "link encoders" else ("torque_late", ("tau",))
    columns = tuple(name for signal in signals for name in columns_of(signal, joints))
    wanted = Wanted((code,), files_of(tuple(range(made.n_runs))), columns, everywhere=True)
    return Story(f"{kind}, {1e3 * delay:.0f} ms", spoiled, wanted)


def current_called_torque(rng: np.random.Generator, made: RunSet, variant: int) -> Story:
    """Amperes in the columns of torque: every joint has a gain of its own, or all have one."""
    spoiled = made.copied()
    gains = np.asarray(log_uniform(rng, 4.0, 25.0, made.n_joints))
    if variant % 5 == 3:
        gains = np.full(made.n_joints, gains[0])
    runs = some_or_all(rng, made) if variant % 5 == 4 else tuple(range(made.n_runs))
    for k in runs:
        for j in range(made.n_joints):
            spoiled.columns[k][f"tau_{j}"] /= gains[j]
    wanted = Wanted(("current_as_torque",), files_of(runs), columns_of("tau", range(made.n_joints)))
    what = "one gain" if variant % 5 == 3 else "gains of each joint"
    return Story(f"{what}, {'one run' if len(runs) == 1 else 'all runs'}", spoiled, wanted)
