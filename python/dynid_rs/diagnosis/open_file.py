"""`open.json`: open questions on the disk, for whoever designs the next experiment or goes on after it.

A precision is kept as the root of its diagonal and the upper triangle of what is left when that is divided out, nine
digits each: numbers of one size, whatever the units. A checksum over all of it says whether it is as it was written.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from dynid_rs import _core
from dynid_rs.base.errors import DataError
from dynid_rs.base.json_file import read_json
from dynid_rs.base.quoting import shown, shown_value
from dynid_rs.base.symmetric import DIGITS, packed, unpacked
from dynid_rs.diagnosis.any_function import MOST_WAVES
from dynid_rs.diagnosis.candidates import Candidate, width_of
from dynid_rs.diagnosis.open_questions import Answer, OpenQuestions, Question
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.shaped import Place
from dynid_rs.diagnosis.structural import KINDS, value_of, with_value
from dynid_rs.diagnosis.structural.about import About
from dynid_rs.diagnosis.waves import UNKNOWN
from dynid_rs.identification.links import LinkDynamicsIdentifier
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.model.placed import CATALOGUE, PlacedEffect
from dynid_rs.regression.columns import Plan

FloatArray = NDArray[np.float64]

OPEN_FILE = "open.json"
FORMAT, VERSION = "dynid-open", 5
LARGEST = 2000
"""Unknowns that are read at most: ten times those of a seven-axis arm with sixteen questions."""
SAME_GRAVITY = 1e-6
"""Difference [m/s^2] that is rounding."""
NEAR, FAR = 1e-9, 1e9
"""What a window of angles, and a unit of torque, are between."""


def to_json(asked: OpenQuestions) -> dict[str, Any]:
    """Content of `open.json`."""
    names, setup, plan = list(asked.plan.robot.joint_names), asked.setup, asked.plan
    structure = [(kind, joints) for (kind, joints), _ in asked.named if kind in KINDS]
    content = {
        "format": FORMAT,
        "version": VERSION,
        "robot": plan.robot.name,
        "joints": names,
        "gravity": setup.declared.gravity.tolist(),
        "torque_unit": asked.torque_unit,
        "torque_per_newton_meter": asked.unit,
        "cutoff_hz": asked.cutoff,
        "rate_hz": asked.rate,
        "two_encoders": asked.two_encoders,
        "named": [{**_place(place, names), "log_odds": odds} for place, odds in asked.named],
        "structure": [
            {**_place(place, names), "value": [] if place[0] == "torque_gain" else value_of(setup, *place).tolist()}
            for place in structure
        ],
        "effects": [
            {**_place((e.kind, e.joints), names), "shape": {n: list(v) for n, v in e.shape}, "silent": list(e.silent)}
            for e in setup.effects
        ],
        "columns": [{"kind": e.kind, "shape": {n: np.asarray(v).tolist() for n, v in e.shape}} for e in plan.effects],
        "pivots": plan.pivots.tolist(),
        "own": plan.own.tolist(),
        "base_parameters": asked.links.phi_base_.tolist(),
        "coefficients": asked.links.own_.tolist(),
        "torque_scale": asked.links.torque_scale_.tolist(),
        "inertials": asked.about.phi.tolist(),
        "inertials_unseen": asked.about.root.tolist(),
        "weights": asked.weights.tolist(),
        "noise": asked.noise.tolist(),
        "known": _precision(asked.known),
        "precision": _precision(asked.precision),
        "candidates": [
            {
                **_place(c.place, names),
                "shape": dict(c.shape),
                "unit": c.unit.tolist(),
                "mean": c.mean.tolist(),
                "instead_of": list(c.instead_of),
            }
            for c in asked.candidates
        ],
        "questions": [
            {"first": _answer(q.first), "second": _answer(q.second), "log_odds": q.log_odds} for q in asked.questions
        ],
        "may_pass": [_place(place, names) for place in sorted(asked.may_pass)],
        "n_places": asked.n_places,
    }
    return content | {"checksum": checksum_of(content)}


def checksum_of(content: dict[str, Any]) -> str:
    """SHA-256 of what the file holds, its own checksum left out, whatever the order and the spaces of its text."""
    rest = {name: value for name, value in content.items() if name != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def _precision(precision: FloatArray) -> dict[str, Any]:
    scale, upper = packed(precision)
    return {"scale": scale, "upper": upper}


def _answer(answer: Answer) -> dict[str, Any]:
    return {"candidates": list(answer.candidates), "weights": list(answer.weights)}


def _place(place: Place, names: Sequence[str]) -> dict[str, Any]:
    return {"kind": place[0], "joints": [names[j] for j in place[1]]}


def read_open(path: Path, robot: _core.RobotModel) -> OpenQuestions:
    """Read `open.json`, or that of a result's folder.

    Parameters
    ----------
    path : Path
        The file, or the folder that `dynid diagnose -o` wrote.
    robot : RobotModel
        As the robot file has it; what was found of its geometry is put into it.

    Raises
    ------
    DataError
        It is not what `dynid diagnose` writes, or of another robot; one sentence with the place and the mend.
    OSError
        It cannot be read.
    """
    if path.is_dir():
        path = path / OPEN_FILE
        if not path.exists():
            raise FileNotFoundError(
                f"{path}: there is no such file; name the folder of `dynid diagnose -o`, or diagnose once more, "
                "without --reference, which leaves nothing open to ask"
            )
    return _Reader(path, robot).read()


class _Reader:
    """Every value is looked at before it is used."""

    def __init__(self, path: Path, robot: _core.RobotModel) -> None:
        self.path, self.robot, self.names = path, robot, list(robot.joint_names)

    def refuse(self, fault: str) -> NoReturn:
        raise DataError(
            f"{self.path}: {fault}; write it again with `dynid diagnose`", code="bad_open", file=str(self.path)
        )

    def read(self) -> OpenQuestions:
        content = read_json(self.path, self.refuse)
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            self.refuse(f'"format" must be "{FORMAT}"')
        if content.get("version") != VERSION:
            self.refuse(f'"version" must be {VERSION}, found {shown_value(content.get("version"))}')
        if content.get("joints") != self.names:
            theirs = content.get("joints")
            said = shown(", ".join(map(str, theirs)), 200) if isinstance(theirs, list) else "nobody knows"
            raise DataError(
                f"{self.path}: is of a robot with the joints {said}, and {self.robot.name} has "
                f"{', '.join(self.names)}; give the robot file that was diagnosed",
                code="other_robot",
                file=str(self.path),
            )
        if content.get("checksum") != checksum_of(content):
            self.refuse("is not as it was written (its checksum differs)")
        if "gravity" in content:  # earlier versions did not keep it
            self.check_gravity(self.array(content["gravity"], "gravity", (3,)))
        try:
            return self._content(content)
        except (KeyError, TypeError, IndexError, AttributeError, ValueError, OverflowError) as error:
            if isinstance(error, DataError):
                raise
            self.refuse(f"its content is not what it should be ({shown(str(error), 100)})")

    def check_gravity(self, theirs: FloatArray) -> None:
        """Refuse a robot that hangs or leans otherwise than the one that was diagnosed."""
        if not np.allclose(theirs, self.robot.gravity, rtol=0, atol=SAME_GRAVITY):
            said, ours = (",".join(f"{g:.{DIGITS}g}" for g in gravity) for gravity in (theirs, self.robot.gravity))
            raise DataError(
                f"{self.path}: the diagnosis was made with free fall along {said}, and here it is {ours}; give "
                f"--gravity {said}, or diagnose once more",
                code="other_robot",
                file=str(self.path),
            )

    def _content(self, content: dict[str, Any]) -> OpenQuestions:
        n = self.robot.n_joints
        named = tuple(
            (self.place(entry, "named"), self.number(entry["log_odds"], "log_odds")) for entry in content["named"]
        )
        cutoff, rate = (self.number(content[key], key, least=1e-3) for key in ("cutoff_hz", "rate_hz"))
        effects = tuple(self.effect(entry, k) for k, entry in enumerate(content["effects"]))
        setup = Setup(self.robot, effects=effects, options={"cutoff": cutoff})
        for entry in content["structure"]:
            kind, joints = self.place(entry, "structure")
            if kind not in KINDS:
                self.refuse(f"{shown(kind, 40)} is no change of the structure")
            setup = with_value(setup, kind, joints, self.array(entry["value"], "value", (None,)))
        terms = tuple(
            _core.Effect.of(str(e["kind"]), **{str(k): v for k, v in e["shape"].items()}) for e in content["columns"]
        )
        width = sum(term.n_columns for term in terms)
        own = np.array(content["own"])
        pivots = np.array(content["pivots"])
        if own.dtype != bool or own.shape != (n, width):
            self.refuse(f'"own" must be true or false, {n} joints by {width} columns')
        if pivots.dtype.kind != "i" or pivots.ndim != 1 or not ((pivots >= 0) & (pivots < 10 * n)).all():
            self.refuse(f'"pivots" must be places from 0 to {10 * n - 1}')
        plan = Plan(setup.robot, terms, pivots.astype(np.int64), own)
        links = LinkDynamicsIdentifier()
        links.phi_base_ = self.array(content["base_parameters"], "base_parameters", (plan.n_base,))
        links.own_ = self.array(content["coefficients"], "coefficients", (n, width))
        links.torque_scale_ = self.array(content["torque_scale"], "torque_scale", (n,))
        links.x_ = np.concatenate([links.phi_base_, links.own_.ravel()])
        about = About(
            ThreeLoopIdentifier(setup.robot),
            self.array(content["inertials"], "inertials", (10 * n,)),
            self.array(content["inertials_unseen"], "inertials_unseen", (10 * n, None)),
        )
        candidates = tuple(self.candidate(entry, plan.n_columns) for entry in content["candidates"])
        size = plan.n_columns + sum(width_of(c) for c in candidates)
        return OpenQuestions(
            setup,
            named,
            plan,
            links,
            about,
            cutoff,
            rate,
            self.truth(content["two_encoders"], "two_encoders"),
            str(content["torque_unit"]),
            self.number(content["torque_per_newton_meter"], "torque_per_newton_meter"),
            self.array(content["weights"], "weights", (n,)),
            self.noise(content["noise"], n),
            self.precision(content, "known", plan.n_columns),
            self.precision(content, "precision", size),
            candidates,
            tuple(self.question(entry, len(candidates)) for entry in content["questions"]),
            frozenset(self.place(entry, "may_pass") for entry in content["may_pass"]),
            int(self.number(content["n_places"], "n_places", least=1.0)),
        )

    def noise(self, value: Any, n: int) -> FloatArray:
        noise = self.array(value, "noise", (n,))
        if not (noise > 0).all():
            self.refuse('"noise" must be above zero')
        return noise

    def precision(self, content: dict[str, Any], name: str, n: int) -> FloatArray:
        if n > LARGEST:
            self.refuse(f"{n} unknowns are more than {LARGEST}")
        scale = self.array(content[name]["scale"], f"{name}.scale", (n,))
        upper = self.array(content[name]["upper"], f"{name}.upper", (n * (n + 1) // 2,))
        return unpacked(scale, upper)

    def candidate(self, entry: dict[str, Any], n_declared: int) -> Candidate:
        if entry["kind"] == UNKNOWN:
            return self.function(entry)
        kind, joints = self.place(entry, "candidates")
        shape = tuple((str(name), self.number(value, str(name))) for name, value in entry["shape"].items())
        unit = self.array(entry["unit"], "unit", (None,))
        instead_of = tuple(self.index(at, n_declared, "instead_of") for at in entry["instead_of"])
        return Candidate(kind, joints, shape, unit, self.array(entry["mean"], "mean", unit.shape), instead_of)

    def function(self, entry: dict[str, Any]) -> Candidate:
        """A function of an angle without a name."""
        (j,) = (self.names.index(name) for name in entry["joints"])
        shape = {name: self.number(entry["shape"][name], name) for name in ("low", "span", "turning")}
        unit = self.array(entry["unit"], "unit", (None,))
        sized = abs(shape["low"]) < FAR and NEAR < shape["span"] < FAR and np.all(np.abs(unit) < FAR)
        if not sized or shape["turning"] not in (0.0, 1.0) or not 0 < len(unit) <= MOST_WAVES:
            self.refuse(
                f'"candidates": a function has a window and units of usual sizes, turns or does not, and has 1 to '
                f"{MOST_WAVES} waves"
            )
        return Candidate(UNKNOWN, (j,), tuple(shape.items()), unit, self.array(entry["mean"], "mean", unit.shape))

    def question(self, entry: dict[str, Any], n_candidates: int) -> Question:
        first, second = (self.answer(entry[key], n_candidates) for key in ("first", "second"))
        if not first.candidates:
            self.refuse('"questions": the first answer must have a candidate')
        return Question(first, second, self.number(entry["log_odds"], "log_odds"))

    def answer(self, entry: dict[str, Any], n_candidates: int) -> Answer:
        numbers = tuple(self.index(k, n_candidates, "candidates") for k in entry["candidates"])
        weights = self.array(entry["weights"], "weights", (len(numbers),))
        if (weights < 0).any():
            self.refuse('"weights" of shapes must be probabilities')
        return Answer(numbers, tuple(weights.tolist()))

    def effect(self, entry: dict[str, Any], k: int) -> PlacedEffect:
        kind, joints = self.place(entry, f"effects.{k}")
        if kind not in CATALOGUE:
            self.refuse(f"{shown(kind, 40)} is no kind of effect")
        shape = tuple(
            (str(name), tuple(self.array(values, str(name), (len(joints),)).tolist()))
            for name, values in entry["shape"].items()
        )
        return PlacedEffect(
            kind, joints, shape, tuple(self.index(j, self.robot.n_joints, "silent") for j in entry["silent"])
        )

    def place(self, entry: dict[str, Any], where: str) -> Place:
        joints = tuple(self.names.index(name) for name in entry["joints"])
        kind = entry["kind"]
        if kind not in CATALOGUE and kind not in KINDS:
            self.refuse(f'"{where}": {shown_value(kind)} is no kind of effect')
        return kind, joints

    def truth(self, value: Any, where: str) -> bool:
        if not isinstance(value, bool):
            self.refuse(f'"{where}" must be true or false, found {shown_value(value)}')
        return value

    def index(self, value: Any, n: int, where: str) -> int:
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < n:
            self.refuse(f'"{where}" must be a number from 0 to {n - 1}, found {shown_value(value)}')
        return value

    def number(self, value: Any, where: str, least: float = -math.inf) -> float:
        if not isinstance(value, int | float) or isinstance(value, bool) or not least <= value < 1e300:
            self.refuse(f'"{shown(where, 40)}" must be a finite number, found {shown_value(value)}')
        return float(value)

    def array(self, value: Any, where: str, shape: tuple[int | None, ...]) -> FloatArray:
        """Finite numbers of a shape; None is any length."""
        try:
            array = np.array(value, dtype=np.float64)
        except (ValueError, TypeError, OverflowError):
            self.refuse(f'"{shown(where, 40)}" must hold numbers')
        fits = array.ndim == len(shape) and all(b is None or a == b for a, b in zip(array.shape, shape, strict=True))
        if not fits or not np.isfinite(array).all():
            sizes = " by ".join("any" if length is None else str(length) for length in shape)
            self.refuse(f'"{shown(where, 40)}" must be {sizes} finite numbers')
        return array
