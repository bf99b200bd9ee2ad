"""Everything that a gear's deflection may be made of, as columns beside each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid_rs.diagnosis.deflection.signals import GearSignals
from dynid_rs.diagnosis.deflection.system import System, centred
from dynid_rs.diagnosis.deflection.terms import (
    LEAST_SIDE,
    LEAST_TURN,
    PLAY,
    TERMS,
    Shapes,
    columns_of,
    has_shape,
    presliding,
    ripple_name,
    step,
)

FloatArray = NDArray[np.float64]

SPRING = ("compliance", "damping", "hysteresis")
"""Terms that make the way along which hysteresis remembers: a cubic part is one more gear in the row."""
MATTERS = 0.05
"""Directions of the load's error whose power is below this part of the noise they compete with are left out."""
BEND = 0.01
"""Relative change of a shape (of an order: absolute) over which its derivative is taken."""
NEAR = 0.1
"""Of the play's width: the distance over which its slope is taken."""
PATHS = 4
"""Times that the way is found again from the state that it leads to; the change falls at least threefold each time."""


@dataclass(frozen=True, eq=False)
class Gear:
    """One gear with everything that can be in it.

    Parameters
    ----------
    runs : sequence of GearSignals
        What was measured.
    turning : bool
        Whether the joint turns.
    shapes : Shapes
        What does not enter linearly.
    compliance : float
        [rad/(N m)], above zero.
    spread : float
        How many times as far off the load is as the covariance of its parameters says; at least 1.
    noise_power : float
        Of the slow noise [rad^2].
    turn : ndarray (n_directions, n_u)
        From the load's directions to those that matter beside the noise, `spread` included.
    z : list of ndarray (n,)
        State of the hysteretic part.
    rotor : float
        How much of the last error direction was taken off the load: a rotor on the motor's side of the gear.
    late : float
        Delay of the link channel beyond the one that is taken off already, of the last search [s].
    half_gap, cubic : float
        Play [rad] and bend [rad/(N m)^3] of the last fit: near zero load, an error of the load moves a gear with play
        much farther than its spring alone.
    """

    runs: Sequence[GearSignals]
    turning: bool
    shapes: Shapes
    compliance: float
    spread: float
    noise_power: float
    turn: FloatArray
    z: list[FloatArray]
    rotor: float = 0.0
    late: float = 0.0
    half_gap: float = 0.0
    cubic: float = 0.0
    lost: float = 0.0

    @cached_property
    def names(self) -> list[str]:
        """Terms that this gear can have."""
        possible = [name for name, term in TERMS.items() if self.turning or not term.turning]
        if max(float(np.ptp(run.q[run.used])) for run in self.runs) < LEAST_TURN and self.turning:
            possible.remove("eccentricity")
        pushed = np.concatenate([run.load[run.used] > 0 for run in self.runs]).mean()
        if not LEAST_SIDE < pushed < 1 - LEAST_SIDE:
            possible = [name for name in possible if name not in PLAY]
        return possible + [ripple_name(index) for index in range(len(self.shapes.orders))]

    @cached_property
    def errors(self) -> list[FloatArray]:
        """Deflection from the load's error, one standard deviation per direction, (n, n_u) per run."""
        return [self.yielding(run)[:, None] * (run.load_error @ self.turn) for run in self.runs]

    def yielding(self, run: GearSignals) -> FloatArray:
        """Change of the deflection per change of the load (n,) [rad/(N m)]."""
        near = NEAR * self.shapes.width
        play = step(run.load + near, self.shapes.width) - step(run.load - near, self.shapes.width)
        return np.asarray(self.compliance + 3 * self.cubic * run.load**2 + self.half_gap * play / (2 * near))

    def columns(self, name: str) -> list[FloatArray]:
        """Deflection per unit coefficient, (n, n_columns) per run."""
        return [columns_of(name, run, self.shapes, z, self.lost) for run, z in zip(self.runs, self.z, strict=True)]

    def system(
        self, names: Sequence[str] | None = None, further: Mapping[str, list[FloatArray]] | None = None
    ) -> System:
        """All terms, or `names`, and `further` columns (n, n_columns) beside the load's error."""
        names = self.names if names is None else names
        columns = {
            name: [centred(run, x) for run, x in zip(self.runs, self.columns(name), strict=True)] for name in names
        }
        for name, added in (further or {}).items():
            columns[name] = [centred(run, x) for run, x in zip(self.runs, added, strict=True)]
        errors = [centred(run, x) for run, x in zip(self.runs, self.errors, strict=True)]
        return System(self.runs, columns, errors, self.noise_power)

    def shape_columns(self, names: Sequence[str], u: FloatArray, x: FloatArray) -> dict[str, list[FloatArray]]:
        """Deflection per change of every shape in use (see `Shapes.bent`), at coefficients u, x; (n, 1) per run."""
        changes, first = {}, 0
        paths = self.path(names, u, x) if "hysteresis" in names else []
        for name in names:
            width = 2 if name == "eccentricity" or name.startswith("ripple") else 1
            own = x[first : first + width]
            first += width
            if not has_shape(name):
                continue
            ends = []
            for by in (-BEND, BEND):
                bent = replace(self, shapes=self.shapes.bent(name, by))
                bent = bent.remembering(paths) if name == "hysteresis" else bent
                ends.append([column @ own for column in bent.columns(name)])
            changes[f"{name}'"] = [(high - low)[:, None] / (2 * BEND) for low, high in zip(*ends, strict=True)]
        return changes

    def path(self, names: Sequence[str], u: FloatArray, x: FloatArray) -> list[FloatArray]:
        """Wind-up of the spring over every run, standstill included, (n,) each [rad]."""
        ways = [self.compliance * (run.load_error @ (self.turn @ u)) for run in self.runs]
        first = 0
        for name in names:
            columns = self.columns(name) if name in SPRING else []
            width = 2 if name == "eccentricity" or name.startswith("ripple") else 1
            for k, column in enumerate(columns):
                ways[k] = ways[k] + column @ x[first : first + width]
            first += width
        return ways

    def remembering(self, paths: Sequence[FloatArray]) -> Gear:
        """Return the same gear with the hysteretic state along other ways."""
        return replace(self, z=[presliding(path, self.shapes.distance) for path in paths])

    def on(self, runs: Sequence[GearSignals], names: Sequence[str], u: FloatArray, x: FloatArray) -> Gear:
        """Return the same gear in other runs, with coefficients that are known."""
        gear = replace(self, runs=runs)
        gear = gear.remembering([self.compliance * run.load for run in runs])
        for _ in range(PATHS if "hysteresis" in names else 0):
            gear = gear.remembering(gear.path(names, u, x))
        return gear

    def without_rotor(self, share: float) -> Gear:
        """Return the same gear with a load that does not hold `share` of what follows the hidden rotor's motion."""
        runs = [replace(run, load=run.load - share * run.load_error[:, -1]) for run in self.runs]
        return replace(self, runs=runs, rotor=self.rotor + share)

    def thinned(self, every: int) -> Gear:
        """Return the same gear with one sample out of `every`."""
        if every <= 1:
            return self
        return replace(self, runs=[run.thinned(every) for run in self.runs], z=[z[::every] for z in self.z])

    def believing(self, spread: float, noise_power: float) -> Gear:
        """Return the same gear with a load's error of another size, in the directions that matter then."""
        known = [spread * centred(run, self.yielding(run)[:, None] * run.load_error[:, :-1]) for run in self.runs]
        n = known[0].shape[1] + 1
        if n == 1:
            turn = np.zeros((self.runs[0].load_error.shape[1], 0))
        else:
            powers, vectors = np.linalg.eigh(np.sum([error.T @ error for error in known], axis=0))
            kept = vectors[:, powers > MATTERS * noise_power]
            turn = np.zeros((n, kept.shape[1] + 1))
            turn[:-1, :-1] = spread * kept
            turn[-1, -1] = 1.0
            if not any(np.any(run.load_error[:, -1]) for run in self.runs):
                turn = turn[:, :-1]
        return replace(self, spread=spread, noise_power=noise_power, turn=turn)
