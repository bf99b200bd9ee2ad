"""What a diagnosis found, as small objects: effects with their numbers, and what is left without a name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

from dynid_rs.base.notebook import html_table
from dynid_rs.base.units import unit_text
from dynid_rs.base.wording import kinds_said
from dynid_rs.diagnosis.wording import (
    effect_words,
    kinds_words,
    named,
    number_words,
    numbers_told,
    tie_words,
    unexplained_words,
)

Entry = Mapping[str, Any]
Interval = tuple[float, float]


@dataclass(frozen=True)
class Number:
    """One number of an effect: value in `unit`, 95 % `interval` (None where it is not known), the joint it belongs to.

    `joint` is None where it is one number of the whole effect, or the effect has one place only.
    """

    name: str
    value: float
    unit: str
    interval: Interval | None = None
    joint: str | None = None

    def __str__(self) -> str:
        return number_words(self.to_dict(), interval=True)

    def to_dict(self) -> dict[str, Any]:
        """As in `result.json`."""
        said = {"name": self.name, "value": self.value, "unit": self.unit}
        own = {} if self.joint is None else {"joint": self.joint}
        return {**said, "interval": None if self.interval is None else list(self.interval), **own}


@dataclass(frozen=True)
class Rival:
    """Another cause of the same torque: a kind, on joints.

    `separate` is the command that designs a deciding run; `same_torque` that no motion would decide.
    """

    kind: str
    joints: tuple[str, ...]
    separate: str = ""
    same_torque: bool = False
    robot_joints: tuple[str, ...] = field(default=(), repr=False, compare=False)

    @property
    def name(self) -> str:
        """Kind in words."""
        return kinds_words({"kind": self.kind})

    def __str__(self) -> str:
        return named({"kind": self.kind, "joints": self.joints}, self.robot_joints or self.joints)


@dataclass(frozen=True)
class Dependence:
    """A signal that something depends on, ``q_elbow``, and how strongly, 0 to 1."""

    signal: str
    strength: float

    def __str__(self) -> str:
        return f"{self.signal} ({self.strength:.2f})"


@dataclass(frozen=True, eq=False, repr=False)
class FoundEffect:
    """An effect that the declared model lacks; `str` says it in one sentence, as the terminal does.

    Parameters
    ----------
    rank : int
        From 1, the most certain first.
    kind : str
        In the words of the catalogue, ``"friction_hysteresis"``; ``"unknown"`` where no name holds, or one of several.
    kinds : tuple of str
        What it may be: its kind alone; several, where the data do not decide ("A or B"); none, where it has no name.
    joints : tuple of str
        Where it acts.
    parameters : tuple of Number
        Its numbers, with units and 95 % intervals.
    ties : tuple of Rival
        Other names that explain the data as well; `another_function_of_the_position` has neither name nor command.
    told_apart_from : tuple of Rival
        Other names that were asked for and refuted.
    depends_on : tuple of Dependence
        Signals that an effect without a name depends on.
    p_value : float or None
        Probability that it is not there after all.
    rmse_test_before, rmse_test_after : tuple of float
        Error on the test runs without it and with it, one per joint of the robot [torque unit]; empty where its share
        is not told by itself.
    note : str
        Where it was seen, if not in the torque.
    torque_unit : str
        Of the errors.
    """

    rank: int
    kind: str
    kinds: tuple[str, ...]
    joints: tuple[str, ...]
    parameters: tuple[Number, ...]
    ties: tuple[Rival, ...]
    told_apart_from: tuple[Rival, ...]
    depends_on: tuple[Dependence, ...]
    p_value: float | None
    rmse_test_before: tuple[float, ...]
    rmse_test_after: tuple[float, ...]
    note: str
    torque_unit: str
    robot_joints: tuple[str, ...] = field(repr=False)
    entry: Entry = field(repr=False)

    @staticmethod
    def of(entry: Entry, robot_joints: Sequence[str], torque_unit: str = "N*m") -> FoundEffect:
        """Object of an entry of `result.json`, whose `joints` and `torque_unit` are the robot's."""
        joints = tuple(robot_joints)
        return FoundEffect(
            rank=int(entry["rank"]),
            kind=entry["kind"],
            kinds=tuple(kinds_said(entry)),
            joints=tuple(entry["joints"]),
            parameters=tuple(_number(own) for own in entry.get("parameters") or ()),
            ties=tuple(_rival(own, joints) for own in entry.get("ties") or ()),
            told_apart_from=tuple(_rival(own, joints) for own in entry.get("told_apart_from") or ()),
            depends_on=tuple(_dependence(own) for own in entry.get("depends_on") or ()),
            p_value=entry.get("p_value"),
            rmse_test_before=tuple(entry.get("rmse_test_before") or ()),
            rmse_test_after=tuple(entry.get("rmse_test_after") or ()),
            note=entry.get("note") or "",
            torque_unit=torque_unit,
            robot_joints=joints,
            entry=entry,
        )

    @property
    def name(self) -> str:
        """What it is, in words: ``friction hysteresis``, ``stribeck or friction hysteresis``, ``unknown``."""
        return kinds_words(self.entry)

    @property
    def is_unknown(self) -> bool:
        """Whether it is there, but no name of the catalogue holds."""
        return not self.kinds

    @property
    def is_tied(self) -> bool:
        """Whether the data do not tell it from something else."""
        return bool(self.ties)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as the entry of `result.json`."""
        return deepcopy(dict(self.entry))

    def plot(self, ax: Any = None) -> Any:
        """Draw its torque over the signal that it follows, and what the model without it leaves.

        Returns
        -------
        matplotlib Axes

        Raises
        ------
        ValueError
            It is no curve (a change of the geometry or of a channel).
        MissingLibraryError
            matplotlib, which the extra `plot` brings, is not installed.
        """
        from dynid_rs.diagnosis.effect_plot import plot_effect

        return plot_effect(self, ax)

    def __repr__(self) -> str:
        return f"<FoundEffect {self}>"

    def _repr_html_(self) -> str:
        told = [_number(own) for own in numbers_told(self.entry)]
        rows = [[f"{n.name} of {n.joint}" if n.joint else n.name, *cells_of(n)] for n in told]
        note = " ".join(f"Not told apart from {tie}." for tie in self.ties)
        title = f"{self.rank}. {effect_words({**self.entry, 'parameters': ()}, self.robot_joints)}"
        return html_table(("number", "value", "95 % interval"), rows, title=title, note=note)

    def __str__(self) -> str:
        sentence = effect_words(self.entry, self.robot_joints, intervals=True)
        return sentence + "".join(f"; {tie_words(tie, self.robot_joints)}" for tie in self.entry.get("ties") or ())


@dataclass(frozen=True, eq=False, repr=False)
class Unexplained:
    """What stays of a joint's error and is not noise: `share` of its power, and the signals that it depends on."""

    joint: str
    share: float
    depends_on: tuple[Dependence, ...]
    p_value: float | None
    entry: Entry = field(repr=False)

    @staticmethod
    def of(entry: Entry) -> Unexplained:
        """Object of an entry of `result.json`."""
        depends = tuple(_dependence(own) for own in entry.get("depends_on") or ())
        return Unexplained(entry["joint"], float(entry["share"]), depends, entry.get("p_value"), entry)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as the entry of `result.json`."""
        return deepcopy(dict(self.entry))

    def __repr__(self) -> str:
        return f"<Unexplained {self}>"

    def __str__(self) -> str:
        return unexplained_words(self.entry)


def cells_of(number: Number) -> tuple[str, str]:
    """Value with its unit, and interval, as cells of a table."""
    value = f"{number.value:.4g} {unit_text(number.unit)}".rstrip()
    return value, "" if number.interval is None else f"{number.interval[0]:.4g} to {number.interval[1]:.4g}"


def _number(entry: Entry) -> Number:
    pair = entry.get("interval")
    interval = None if pair is None else (float(pair[0]), float(pair[1]))
    return Number(entry["name"], float(entry["value"]), entry.get("unit", "1"), interval, entry.get("joint"))


def _rival(entry: Entry, robot_joints: tuple[str, ...]) -> Rival:
    same = bool(entry.get("same_torque"))
    return Rival(entry["kind"], tuple(entry.get("joints") or ()), entry.get("separate") or "", same, robot_joints)


def _dependence(entry: Entry) -> Dependence:
    return Dependence(entry["signal"], float(entry["strength"]))
