"""One identification in the words of the command line: what `dynid identify` does, and `dynid fleet` many times."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid_rs.commands._run import EXIT_NO
from dynid_rs.commands._steps import Step

if TYPE_CHECKING:
    from collections.abc import Callable

    from dynid_rs.archive.work import Work
    from dynid_rs.base.findings import Finding
    from dynid_rs.commands._given import Given
    from dynid_rs.identification.results import LearnedFrom
    from dynid_rs.identification.three_loops import ThreeLoopIdentifier
    from dynid_rs.runs.recording import Recording


STEPS = (
    Step(3, "reading"),
    Step(4, "channels", "comparing laws of friction"),
    Step(5, "filtering the runs", "weighted least squares", "round ", "sample", "reducing"),
    Step(1, "contacts"),
    Step(1, "physically consistent parameters"),
    Step(2, "testing"),
)
"""With their usual shares of the time, measured on a run of `dynid demo`."""


@dataclass(frozen=True)
class Job:
    """Arguments and options of `dynid identify`, by the same names."""

    robot: Path
    runs: tuple[Path, ...]
    output: Path
    test: tuple[Path, ...] = ()
    test_from: float | None = None
    config: Path | None = None
    gravity: str | None = None
    base: str | None = None
    tip: str | None = None
    xacro: bool = False
    drive_gain: str | None = None
    weighting: str = "joint_variance"
    prior: str = "auto"
    known: Path | None = None
    friction: tuple[Path, ...] = ()
    friction_law: str | None = None
    residual: str = "auto"
    compensator: str = "mixture"
    cutoff: float | None = None
    physical: bool = False
    memory: str = "4GB"
    force: bool = False

    @property
    def inputs(self) -> list[Path]:
        """Every file that is read."""
        optional = [path for path in (self.config, self.known) if path is not None]
        return [self.robot, *self.runs, *self.test, *self.friction, *optional]

    def run(self, make_work: Callable[[], Work], say: Callable[[str], None]) -> dict[str, Any]:
        """Identify, fill the folder, and return the content of `result.json`; raises as `identified`."""
        return self.identified(make_work, say)[1]

    def identified(
        self, make_work: Callable[[], Work], say: Callable[[str], None]
    ) -> tuple[ThreeLoopIdentifier, dict[str, Any]]:
        """Identify, fill the folder, and return what was fitted and the content of `result.json`.

        Raises
        ------
        ValueError, OSError
            Wrong use or unusable input; the text is a sentence.
        """
        from dynid_rs.base.findings import blaming
        from dynid_rs.commands._given import read_given
        from dynid_rs.commands._identifier import check_places, chosen_laws, known_terms
        from dynid_rs.commands._inputs import (
            read_friction,
            read_robot,
            read_rules,
            read_settings,
            size_in_bytes,
            with_rotors,
        )
        from dynid_rs.model.inertials import inertial_findings
        from dynid_rs.runs.checks import is_damage
        from dynid_rs.sensors import channels_of, contacts_beside

        if self.physical:
            _check_physical()
        limit = size_in_bytes("--memory", self.memory)
        check_places(self.output, [*self.inputs], force=self.force)
        work = make_work()
        say("reading")
        model = read_robot(self.robot, self.base, self.tip, self.gravity, read_rules(self.config), xacro=self.xacro)
        settings = read_settings(self.config, self.drive_gain, model.n_joints)
        model = with_rotors(model, settings, self.robot, self.base, self.tip, xacro=self.xacro)
        identifier = _identifier(
            model, self.weighting, self.prior, self.residual, self.compensator, self.cutoff, self.friction_law
        )
        identifier.known = known_terms(self.known, model)
        # Before the runs: many of them take hours, and what is wrong here is wrong at once.
        slow = read_friction(list(self.friction), model, settings, limit) if self.friction else None
        runs, test = list(self.runs), list(self.test)
        given = read_given(
            runs, test, self.test_from, model, settings, memory=limit, cutoff=self.cutoff, say=say, work=work
        )
        sound = not any(is_damage(finding) for finding in given.findings)
        if sound:
            say("channels")
            wrong = channels_of(model, [*given.train, *given.test])
            # Of a sample's pieces the rows would not be the run's.
            given.findings += wrong if given.archive is None else [replace(one, rows=None, line=None) for one in wrong]
            sound = not wrong
        if self.friction_law == "auto":
            say("comparing laws of friction")
            identifier.friction_law = chosen_laws(identifier, given.train, slow)
        with blaming(given.findings):
            identifier, learned_from, findings = _fit(identifier, given, slow, say)
        if sound and given.archive is None:
            say("contacts")
            given.findings += contacts_beside(identifier, given.train, given.test)
        bodies = _physical(identifier, say) if self.physical else None
        say("testing")
        said = [*inertial_findings(model, self.robot.name), *given.findings, *findings]
        return identifier, _write(identifier, given, said, self.output, bodies, learned_from, force=self.force)


def _identifier(
    model: Any,
    weighting: str,
    prior: str,
    residual: str,
    compensator: str,
    cutoff: float | None,
    friction_law: str | None,
) -> Any:
    from dynid_rs.commands._identifier import identifier_options
    from dynid_rs.identification.residual import METHODS, ResidualCompensator
    from dynid_rs.identification.three_loops import ThreeLoopIdentifier

    options = identifier_options(weighting, prior, cutoff, friction_law)
    inputs = ("auto", "load_free_deflection", "deflection", "joint_state")
    if residual not in (*inputs, "none"):
        raise ValueError(f"--residual must be {', '.join(inputs)} or none, found {residual!r}")
    if compensator not in METHODS:
        raise ValueError(f"--compensator must be {' or '.join(METHODS)}, found {compensator!r}")
    third = None if residual == "none" else ResidualCompensator(method=compensator, inputs=residual)  # type: ignore[arg-type]
    return ThreeLoopIdentifier(model, residual=third, **options)


def _fit(
    identifier: Any, given: Given, slow: list[Recording] | None, say: Callable[[str], None]
) -> tuple[Any, LearnedFrom | None, list[Finding]]:
    from dynid_rs.commands._identifier import convergence_findings

    with convergence_findings() as findings:
        fitted, learned_from = given.fit(identifier, slow, say)
    return fitted, learned_from, findings()


def _check_physical() -> None:
    """Refuse before any work is done where the solver is not installed."""
    from dynid_rs.model.bodies import import_cvxpy

    import_cvxpy()


def _physical(identifier: Any, say: Callable[[str], None]) -> Any:
    from dynid_rs.model.physical import PhysicalIdentifier

    say("physically consistent parameters")
    return PhysicalIdentifier().fit(identifier.observations_, identifier.links_, torque_unit=identifier.torque_unit_)


def _write(
    identifier: Any,
    given: Given,
    findings: list[Finding],
    output: Path,
    physical: Any = None,
    learned_from: LearnedFrom | None = None,
    *,
    force: bool,
) -> dict[str, Any]:
    from dynid_rs.commands._identifier import scored_states, write_results
    from dynid_rs.identification.results import evaluate_runs, residual_table, summarise
    from dynid_rs.runs.encoders import with_fitted_delay

    model = identifier.model_
    tested = evaluate_runs(model, given.test, scored_states(identifier, given.test))
    trained = evaluate_runs(model, given.train, identifier.raw_runs_)
    findings = with_fitted_delay(findings, identifier.encoder_delay_)
    result = summarise(identifier, trained, tested, findings, physical, learned_from)
    if physical is not None:
        model = model.with_physical(physical.physical_set(model))
    table = residual_table(model, trained, tested)
    write_results(output, model, result, table, force=force)
    return result


def exit_code(result: dict[str, Any]) -> int:
    """1 where the data has an error in it or the model is no better than weighted least squares."""
    from dynid_rs.base.wording import is_better

    errors = any(finding["severity"] == "error" for finding in result["data"]["findings"])
    return EXIT_NO if errors or not is_better(result) else 0
