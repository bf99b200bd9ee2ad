"""What is hidden in a case: placed, scaled to the noise, put into the world, and measured there once more."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from exam.catalogue import MAKERS, STRANGERS
from exam.channels import late
from exam.declared import Declared, declare, rows_of, rows_of_smooth
from exam.draw import LATER, STRANGE, Case, Wish, stream
from exam.effects import Effect
from exam.sensors import Sensors, deflection_noise, make_sensors, noise_rows
from exam.world import States, World, gravity_difference, inverse_dynamics, make_world

FloatArray = NDArray[np.float64]

VISIBLE = 0.3
"""What is left of an effect counts from this on, over the noise; a world with less is clean."""
TRIES = 8
"""Places and shapes that are tried for a wish, and then other kinds."""
LARGEST = 0.6
"""No scaled effect takes more than this of a joint's torque (RMS over standard deviation)."""
FAST_RIPPLE = 12.0
"""Ripple of more cycles per turn passes above the band: it is sized against the noise at full rate."""
ALIKE = frozenset({"load_dependent_friction", "load_hysteresis"})
"""Kinds of which a case has one at most: together they are one."""
UNSEEN_ELASTICITY = 0.03
"""With one encoder gears yield no more than this over the noise, which no test sees, unless the case is about that."""


@dataclass(frozen=True, eq=False)
class Hidden:
    """An effect at its size: rows of what it adds, and what is left of it over the noise, per joint."""

    effect: Effect
    size: float
    rows: FloatArray
    ratio: FloatArray

    @property
    def strength(self) -> float:
        """The largest of the ratios."""
        return float(np.max(self.ratio))


@dataclass(frozen=True, eq=False)
class Exam:
    """A world with everything in it, and what anybody could know of it."""

    world: World
    sensors: Sensors
    noise: FloatArray
    declared: Declared
    hidden: tuple[Hidden, ...]
    elastic: Hidden | None

    @property
    def left(self) -> FloatArray:
        """What the declared model cannot imitate of everything together, per joint, over the noise."""
        parts = [one.rows for one in (*self.hidden, self.elastic) if one is not None and in_band(one.effect)]
        return self.declared.ratio(sum(parts, np.zeros_like(self.noise)))


def in_band(effect: Effect) -> bool:
    """Whether an effect is seen in the torque, in the band."""
    return effect.side != "gear" and not fast(effect)


def fast(effect: Effect) -> bool:
    """Whether an effect is a ripple above the band."""
    return effect.kind == "torque_ripple" and effect.shape["cycles"] > FAST_RIPPLE


def hide(case: Case) -> Exam:
    """Build the world of a case."""
    world = make_world(case)
    sensors = make_sensors(world)
    noise = noise_rows(world, sensors)
    declared = declare(world, _rms(noise))
    world = _with_gears(world, sensors, declared)
    chosen: list[tuple[Effect, float]] = []
    for k, wish in enumerate(case.wishes):
        chosen += _placed(world, sensors, declared, wish, k, {effect.kind for effect, _ in chosen})
    world = worked(world, chosen)
    noise = noise_rows(world, sensors)
    declared = declare(world, _rms(noise))
    hidden = tuple(measured(world, sensors, declared, effect, size) for effect, size in chosen)
    return Exam(world, sensors, noise, declared, hidden, _elasticity(world, declared))


def _rms(x: FloatArray) -> FloatArray:
    return np.sqrt(np.mean(x**2, axis=0))


def _placed(world, sensors, declared, wish: Wish, k: int, taken: set[str]) -> list[tuple[Effect, float]]:
    """Draw places for a wish until one shows; where none does another kind stands in."""
    rng = stream(world.case.seed, 10, k)
    makers = STRANGERS if wish.kind in STRANGE else MAKERS
    if taken & ALIKE:
        taken = taken | ALIKE
    apart = {wish.kind, *taken, *LATER}
    others = [kind for kind in makers if kind not in apart and _possible(kind, world.case)]
    kinds = [wish.kind] if wish.kind not in taken and _possible(wish.kind, world.case) else []
    for kind in [*kinds, *rng.permutation(others)]:
        for _ in range(TRIES):
            effect = makers[kind](rng, world)
            size = _size(world, sensors, declared, effect, wish.ratio)
            if size is not None:
                return [(effect, size)]
    return []


def _possible(kind: str, case: Case) -> bool:
    """Two encoders show gears; a gain among unknown gains is none."""
    return not (kind in ("backlash", "joint_elasticity") and case.n_encoders == 1) and not (
        kind == "torque_gain" and case.current
    )


def _size(world, sensors, declared, effect: Effect, wanted: float) -> float | None:
    """Size at which as much is left of an effect as is wanted, or as physics allows; None where that is too little."""
    if effect.natural:
        return 1.0 if measured(world, sensors, declared, effect, 1.0).strength >= VISIBLE else None
    size = effect.most if np.isfinite(effect.most) else 1e-3
    for _ in range(3):  # nearly linear: once would do for most
        strength = measured(world, sensors, declared, effect, size).strength
        if not strength > 0:
            return None
        size = min(size * wanted / strength, effect.most)
    if effect.side not in ("gear", "encoder"):
        torque = np.vstack([effect.part(world, s.recorded, size) for s in world.train])
        share = float(np.max(torque.std(axis=0) / world.torque_std))
        size *= min(1.0, LARGEST / share)
    strength = measured(world, sensors, declared, effect, size).strength
    return size if strength >= VISIBLE else None


def measured(world: World, sensors: Sensors, declared: Declared, effect: Effect, size: float) -> Hidden:
    """Return an effect with what is left of it, beside the declared model of this world."""
    if effect.side == "gear":
        rows = rows_of(world, [effect.part(world, s.recorded, size) for s in world.train])
        return Hidden(effect, size, rows, _gear_ratio(world, sensors, effect, rows))
    if fast(effect):
        parts = [effect.part(world, s.recorded, size) for s in world.train]
        ratio = _rms(np.vstack(parts)) / np.hypot(sensors.noise, sensors.quantum / np.sqrt(12))
        return Hidden(effect, size, rows_of(world, parts), ratio)
    if effect.side in ("arm", "encoder"):
        rows = rows_of_smooth(world, lambda s: effect.part(world, s, size))
    else:
        rows = rows_of(world, [effect.part(world, s, size)[:: s.every] for s in world.train])
    return Hidden(effect, size, rows, declared.ratio(rows))


def _gear_ratio(world: World, sensors: Sensors, effect: Effect, rows: FloatArray) -> FloatArray:
    """What is left in the deflection beside a constant, the speed (clocks), and the load if it is a gap."""
    j = effect.joints[0]
    load = rows_of(world, [s.recorded.tau_link for s in world.train])[:, j]
    speed = rows_of(world, [s.recorded.dq for s in world.train])[:, j]
    columns = np.stack([np.ones_like(load), speed, *([load] if effect.kind == "backlash" else [])], axis=1)
    columns = columns / np.linalg.norm(columns, axis=0)
    own = rows[:, j] - columns @ np.linalg.lstsq(columns, rows[:, j], rcond=None)[0]
    ratio = np.zeros(world.case.n_joints)
    ratio[j] = np.sqrt(np.mean(own**2)) / deflection_noise(world, sensors)[j]
    return ratio


def _with_gears(world: World, sensors: Sensors, declared: Declared) -> World:
    """Let the gears yield; with one encoder so little that nobody sees it, unless the case is about that."""
    case = world.case
    about_gears = any(wish.kind in ("backlash", "joint_elasticity") for wish in case.wishes)
    if not case.windup or (case.n_encoders == 2 and about_gears):
        return world
    share = stream(case.seed, 11).uniform(0.3, 1.0, case.n_joints)
    soft = _settled(replace(world, compliance=case.windup * share / world.torque_std))
    if case.n_encoders == 2 or case.elastic_gears:
        return soft
    left = _elasticity(soft, declared).strength
    harder = soft.compliance * min(1.0, UNSEEN_ELASTICITY / left)
    return _settled(replace(soft, compliance=harder))


def _settled(world: World) -> World:
    """Return the world with the motor side as its gears and loads have it."""
    return replace(world, runs=tuple(world.with_gears(s, s.tau_link) for s in world.runs))


def _elasticity(world: World, declared: Declared) -> Hidden | None:
    """What one encoder on yielding gears hides: the links are not where the motors are."""
    if world.case.n_encoders == 2 or not np.any(world.compliance):
        return None

    def part(world: World, s: States, size: float) -> FloatArray:
        links = inverse_dynamics(world.model, s.q, s.dq, s.ddq)
        return links - inverse_dynamics(world.model, s.q_motor, s.dq_motor, s.ddq_motor)

    rows = rows_of_smooth(world, lambda s: part(world, s, 1.0))
    joints = tuple(range(world.case.n_joints))
    effect = Effect("joint_elasticity", joints, "encoder", part, 1.0)
    return Hidden(effect, 1.0, rows, declared.ratio(rows))


def worked(world: World, chosen: list[tuple[Effect, float]]) -> World:
    """Return the world with what changes its states: the arm itself, loads behind the gears, the gears."""
    compliance, gap = world.compliance.copy(), world.gap.copy()
    for effect, size in chosen:
        if effect.kind == "joint_elasticity":
            compliance[effect.joints[0]] = size
        if effect.kind == "backlash":
            gap[effect.joints[0]] = size
    world = replace(world, compliance=compliance, gap=gap)
    runs = []
    for s in world.runs:
        arm = sum((e.part(world, s, size) for e, size in chosen if e.side == "arm"), np.zeros_like(s.q))
        link = sum((e.part(world, s, size) for e, size in chosen if e.side == "link"), np.zeros_like(s.q))
        rigid = s.tau_rigid + arm + _cross(world, s, chosen)
        runs.append(world.with_gears(replace(s, tau_rigid=rigid), rigid + link))
    return replace(world, runs=tuple(runs))


def _cross(world: World, s: States, chosen: list[tuple[Effect, float]]) -> FloatArray:
    """What a displaced joint and a turned gravity do together, beyond what each does alone."""
    kinds = {effect.kind: effect for effect, _ in chosen}
    if not {"gravity_tilt", "kinematic_error"} <= set(kinds):
        return np.zeros_like(s.q)
    turned, moved = (np.array(list(kinds[k].shape.values())) for k in ("gravity_tilt", "kinematic_error"))
    model = world.arm.model({kinds["kinematic_error"].joints[0]: moved})
    change = turned - world.model.gravity.linear
    return gravity_difference(model, change, s.q) - gravity_difference(world.model, change, s.q)


def shown_torque(exam: Exam, s: States) -> FloatArray:
    """Torque (n, n_joints) [N m] of one run as its channels would show it without noise."""
    world = exam.world
    of = {side: [h for h in exam.hidden if h.effect.side == side] for side in ("motor", "channel")}
    torque = world.motor_torque(s) + sum((h.effect.part(world, s, h.size) for h in of["motor"]), np.zeros_like(s.q))
    channel = {h.effect.kind: h for h in of["channel"]}
    j = {kind: list(h.effect.joints) for kind, h in channel.items()}
    for kind, power in (("torque_saturation", 3), ("torque_gain", 1)):
        if kind in channel:
            sign = np.sign(channel[kind].effect.truth(1.0).get("gain", 1.0))
            torque[:, j[kind]] += sign * channel[kind].size * torque[:, j[kind]] ** power
    if "torque_delay" in channel:
        torque[:, j["torque_delay"]] = late(s.t, torque, channel["torque_delay"].size)[:, j["torque_delay"]]
    return torque


def encoder_error(exam: Exam, s: States) -> FloatArray:
    """What encoders that are not centred show too much (n, n_joints) [rad]."""
    error = np.zeros_like(s.q)
    for hidden in exam.hidden:
        if hidden.effect.kind == "encoder_eccentricity":
            j = hidden.effect.joints[0]
            error[:, j] = hidden.size * np.sin(s.q[:, j] + hidden.effect.shape["phase"])
    return error
