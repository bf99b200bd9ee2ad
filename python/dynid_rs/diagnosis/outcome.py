"""`Diagnosis`: what `diagnose` gives back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from dynid_rs.base.findings import Finding
from dynid_rs.base.notebook import html_table
from dynid_rs.diagnosis.found import FoundEffect, Unexplained
from dynid_rs.diagnosis.open_questions import OpenQuestions
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.wording import numbers_words
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.runs.recording import Recording


@dataclass(repr=False)
class Diagnosis:
    """What was found; `print` says it as the terminal does, a notebook shows a table.

    Attributes
    ----------
    setup : Setup
        The model as it is believed to be now.
    before, after : ThreeLoopIdentifier
        The declared model, and the model with what was found.
    effects : tuple of FoundEffect
        One per effect, most certain first.
    unexplained : tuple of Unexplained
        Structure that is left, joint by joint.
    findings : list of Finding
        On sensors and contacts.
    steps : list of dict
        History of the search.
    verdict : str
        One to three sentences.
    entries, left : list of dict
        `effects` and `unexplained` as they go into `result.json`.
    asked : OpenQuestions, optional
        What is open, and what is known: the next experiment is designed from it. None where nothing was searched.
    train, test : sequence of Recording
        Runs that were learned from, and runs that only reported errors see.
    against_reference : bool
        Whether `before` has the model of a reference and `after` that model with what has changed; nothing of either
        was fitted to `train`.
    """

    setup: Setup
    before: ThreeLoopIdentifier
    after: ThreeLoopIdentifier
    findings: list[Finding] = field(default_factory=list)
    entries: list[dict[str, Any]] = field(default_factory=list)
    steps: list[dict[str, Any]] = field(default_factory=list)
    left: list[dict[str, Any]] = field(default_factory=list)
    asked: OpenQuestions | None = None
    train: Sequence[Recording] = ()
    test: Sequence[Recording] = ()
    against_reference: bool = False

    @cached_property
    def result(self) -> dict[str, Any]:
        """Content of `result.json`: both models on all runs, worked out when it is first asked for."""
        from dynid_rs.diagnosis.results import evaluated, summarise_diagnosis

        if not self.test:
            raise ValueError("there is no test run, so nothing is said of errors; give one to diagnose")
        return summarise_diagnosis(self, evaluated(self, self.train, self.test), ())

    @property
    def verdict(self) -> str:
        """What it means, in one to three sentences."""
        return str(self.result["verdict"])

    @property
    def next_experiments(self) -> list[str]:
        """What to record next, the most telling first."""
        return list(self.result["next_experiment"])

    @cached_property
    def effects(self) -> tuple[FoundEffect, ...]:
        """Effects that were found, the most certain first."""
        from dynid_rs.diagnosis.results import complete

        names, unit = self.after.robot.joint_names, self.after.torque_unit_
        return tuple(FoundEffect.of(complete(entry, k + 1, names), names, unit) for k, entry in enumerate(self.entries))

    @property
    def unexplained(self) -> tuple[Unexplained, ...]:
        """What is left and is not noise, joint by joint."""
        return tuple(Unexplained.of(entry) for entry in self.left)

    def __repr__(self) -> str:
        kinds = ", ".join(f"{effect.name} on {', '.join(effect.joints)}" for effect in self.effects)
        return f"<Diagnosis of {self.after.robot.name}: {kinds or 'no effect found'}>"

    def __str__(self) -> str:
        lines = [self.verdict, *(f"{effect.rank}. {effect}" for effect in self.effects)]
        lines += [str(left) for left in self.unexplained]
        lines += [f"next: {sentence}" for sentence in self.next_experiments]
        return "\n".join(lines + [f"{f.severity}: {f.message}" for f in self.findings if f.severity != "info"])

    def _repr_html_(self) -> str:
        rows = [
            [
                str(effect.rank),
                effect.name,
                ", ".join(effect.joints),
                "; ".join(numbers_words(effect.entry, intervals=True)),
                ", ".join(map(str, effect.ties)),
            ]
            for effect in self.effects
        ]
        head = ("", "effect", "joints", "numbers (95 % interval)", "not told apart from")
        note = " ".join([*map(str, self.unexplained)])
        return html_table(head, rows, title=self.verdict, note=note)
