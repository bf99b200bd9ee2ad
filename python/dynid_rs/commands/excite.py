"""`dynid excite`: an exciting trajectory for a robot, as a file that a controller can play."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dynid_rs.commands import _options
from dynid_rs.commands._run import goes_on, print_json, run_command
from dynid_rs.commands._steps import Step

if TYPE_CHECKING:
    from dynid_rs.excitation import FourierExcitation, Restart
    from dynid_rs.excitation.friction_segments import FrictionExperiment
    from dynid_rs.excitation.named import NamedEffect
    from dynid_rs.excitation.separating import Separated


LENGTH = 20.0
"""Of a motion [s]."""


@dataclass(frozen=True)
class Outputs:
    """Files of one design, side by side."""

    csv: Path
    friction: Path | None = None
    budget: float | None = None

    @property
    def json(self) -> Path:
        """Figures of merit."""
        return self.csv.with_suffix(".json")

    @property
    def page(self) -> Path:
        """Plots."""
        return self.csv.with_suffix(".html")

    @property
    def states(self) -> list[Path]:
        """Finished searches, while the command runs: of the one length, or of all that a budget may take."""
        from dynid_rs.experiment.next import SHARES

        lengths = (None,) if self.budget is None else (share * self.budget for share in SHARES)
        return [self.state(length) for length in lengths]

    def state(self, seconds: float | None) -> Path:
        """Of a length [s] of the budget."""
        from dynid_rs.experiment.next import state_of

        whole = self.csv.with_suffix(".restarts.json")
        return whole if self.budget is None or seconds is None else state_of(whole, seconds)

    @property
    def friction_json(self) -> Path | None:
        """Segments of the friction experiment."""
        return None if self.friction is None else self.friction.with_suffix(".json")

    def check(self, inputs: Sequence[Path], *, force: bool) -> None:
        """Refuse what cannot be written before any work is done; a finished design is replaced with `force` only."""
        from dynid_rs.commands._output import check_absent, check_file, check_not_read, check_suffix

        for path in (self.csv, self.friction):
            if path is not None:
                check_suffix(path, ".csv", "CSV")
        places = [self.csv, self.json, self.page, *self.states, self.friction, self.friction_json]
        outputs = [path for path in places if path is not None]
        if len({path.absolute() for path in outputs}) < len(outputs):
            raise ValueError(f"{self.friction}: is written for the exciting trajectory too; choose another name")
        for path in outputs:
            check_file(path)
        check_not_read(outputs, inputs)
        if not force:
            check_absent(path for path in outputs if path not in self.states)

    def after_interrupt(self) -> Callable[[], str]:
        """What is left of a search, and how to go on."""
        from dynid_rs.commands._output import after_interrupt

        said = after_interrupt(self.json)

        def after() -> str:
            kept = next((path for path in self.states if path.exists()), None)
            again = f"the same command with --resume goes on from the finished searches that {kept} keeps"
            return said() if kept is None else f"no trajectory was written; {again}"

        return after


@run_command
def excite(
    robot: _options.Robot,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="TRAJ.csv", help="Trajectory; .json and .html beside it", show_default=False
        ),
    ],
    limits: Annotated[
        Path | None,
        typer.Option(metavar="L.toml", help="Limits of the motion; the robot's own and plausible ones if left out"),
    ] = None,
    duration: Annotated[float | None, typer.Option(help=f"Length in s, one period; {LENGTH:g} if left out")] = None,
    harmonics: Annotated[int, typer.Option(help="Terms of the Fourier series per joint")] = 5,
    criterion: Annotated[str, typer.Option(help="block (Eq. 14), condition, D or A")] = "block",
    samples_rate: Annotated[
        float, typer.Option("--criterion-rate", metavar="HZ", help="Samples per second that the criterion uses")
    ] = 10.0,
    rate: Annotated[float, typer.Option(help="Samples per second of the CSV")] = 1000.0,
    friction: Annotated[
        Path | None,
        typer.Option(metavar="FRICTION.csv", help="Plan the friction experiment too; .json beside it"),
    ] = None,
    separate: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="A B",
            help="Tell these effects apart instead: KIND:JOINT[:SHAPE=VALUE...], e.g. stribeck:1 friction_hysteresis:1",
            show_default=False,
        ),
    ] = None,
    after: Annotated[
        Path | None,
        typer.Option(
            metavar="RESULT", help="Decide what the diagnosis in this folder left open: the next experiment after it"
        ),
    ] = None,
    budget: Annotated[
        float | None,
        typer.Option(metavar="S", help="With --after: the shortest motion that settles enough, of at most so many s"),
    ] = None,
    load: Annotated[
        float | None,
        typer.Option(metavar="KG", help="With --after: the motion carries this known mass at the last link"),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(metavar="Q,Q,...", help="Where it starts and ends [rad, m]; zero, or the middle of the limits"),
    ] = None,
    noise: Annotated[
        str | None, typer.Option(metavar="S,S,...", help="Torque noise per joint, for the whitening of Eq. 13")
    ] = None,
    self_collision: Annotated[
        bool, typer.Option("--self-collision", help="Keep links apart, by the URDF's collision shapes")
    ] = False,
    restarts: Annotated[int, typer.Option(help="Searches, each from a random motion")] = 12,
    iterations: Annotated[int, typer.Option(help="Most steps of one search")] = 100,
    time_limit: Annotated[
        float | None,
        typer.Option(
            help="Stop a search after this many seconds; --separate, --after and each length of --budget are one more"
        ),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs", metavar="N", help="Threads, one per core if left out or -1; the answer does not depend on it"
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Repeats the design, number for number")] = 0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on where a killed design of the same problem stopped")
    ] = False,
    gravity: _options.Gravity = None,
    base: _options.Base = None,
    tip: _options.Tip = None,
    xacro: _options.Xacro = False,
    force: Annotated[bool, typer.Option("--force", help="Replace a finished design of these names")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Answer as JSON on standard output")] = False,
) -> None:
    """Design an exciting trajectory within the limits of an arm.

    TRAJ.csv holds t, q_i, dq_i, ddq_i; TRAJ.json the figures of merit and the exact extremes beside the limits;
    TRAJ.html the plots. While it runs, TRAJ.restarts.json keeps the finished searches, TRAJ.restarts_15s.json those of
    15 s of a --budget. FRICTION.csv holds legs of constant speed in both directions and motions with their reversals,
    within the same limits. With --separate the trajectory is the one that tells two effects apart best, with --after
    the one that decides most of what a diagnosis left open; the exciting one is what it is compared with.
    """
    from dynid_rs.commands._console import progress
    from dynid_rs.commands._excite_after import check_aims, decide, read_after
    from dynid_rs.commands._excite_words import options_named
    from dynid_rs.commands._inputs import read_robot
    from dynid_rs.excitation.output import n_steps_of
    from dynid_rs.experiment.answer import to_json

    check_aims(separate is not None, after is not None, load, budget, duration)
    duration = LENGTH if duration is None else duration
    files = Outputs(output, friction, budget)
    files.check([robot, *(path for path in (limits, after) if path)], force=force)
    with options_named():
        n_steps_of(budget or duration, rate)  # refused before the search, not after it
    with options_named(), goes_on(files.after_interrupt()), progress(*_plan(separate, after)) as say:
        say("reading")
        model = read_robot(robot, base, tip, gravity, xacro=xacro)
        settings = _settings(model, robot, limits, start, noise, self_collision)
        plan = None if friction is None else _friction_plan(model, settings, rate)
        effects = None if separate is None else _effects(separate, model, duration)
        asked = None if after is None else read_after(after, model)

        def made(seconds: float) -> FourierExcitation:
            return _design(
                settings,
                say,
                n_harmonics=harmonics,
                duration=seconds,
                rate=samples_rate,
                criterion=criterion,
                n_restarts=restarts,
                max_iter=iterations,
                time_limit=time_limit,
                n_jobs=jobs,
                state_file=files.state(seconds),
                resume=resume,
                random_state=seed,
            ).fit(model, settings["limits"])

        more: dict[str, Any] = {}
        if asked is not None:
            decided = decide(made, duration, budget, asked, iterations, time_limit, load or 0.0, say)
            design, more["next"] = decided.design, to_json(decided)
        else:
            design = made(duration)
        if effects is not None:
            design, separated = _separate(design, effects, iterations, time_limit, say)
            more["separation"] = separated.to_json()
        say("writing")
        result = _write(design, plan, model, files, rate, more)
    if json_output:
        print_json(result)
    else:
        from dynid_rs.commands._excite_view import show

        show(result)


def _plan(separate: object, after: object) -> list[Step]:
    """Steps and their usual shares of the time."""
    aims = [("separating", separate), ("deciding", after)]
    searched = [Step(90, "search"), *(Step(60, name) for name, aim in aims if aim is not None)]
    return [Step(1, "reading"), *searched, Step(3, "writing")]


def _settings(
    model: Any, urdf: Path, limits: Path | None, start: str | None, noise: str | None, self_collision: bool
) -> dict[str, Any]:
    """Limits, start, constraints and noise, from the file and from options, which win."""
    from dynid_rs.commands._inputs import numbers
    from dynid_rs.excitation import SelfCollision
    from dynid_rs.excitation.limits_file import read_limits

    found = None if limits is None else read_limits(limits, model, urdf)
    constraints = () if found is None else found.constraints
    if self_collision and not any(isinstance(constraint, SelfCollision) for constraint in constraints):
        constraints = (*constraints, SelfCollision(urdf))
    given = None if found is None else found.start
    return {
        "limits": None if found is None else found.limits,
        "start": given if start is None else numbers("--start", start, model.n_joints),
        "noise_std": None if noise is None else numbers("--noise", noise, model.n_joints),
        "constraints": constraints,
    }


def _design(settings: dict[str, Any], say: Callable[[str], None], **options: Any) -> FourierExcitation:
    from dynid_rs.excitation import FourierExcitation

    def told(restarts: Sequence[Restart]) -> None:
        best = min((r.objective for r in restarts if r.objective is not None), default=None)
        found = "no motion yet" if best is None else f"best objective {best:.4g}"
        say(f"search {len(restarts)} of {options['n_restarts']} finished, {found}")

    say(f"searching, {options['n_restarts']} restarts")
    given = {name: value for name, value in settings.items() if name != "limits"}
    return FourierExcitation(**given, callback=told, **options)


def _effects(texts: tuple[str, str], model: Any, duration: float) -> tuple[NamedEffect, NamedEffect]:
    """Read both effects; what cannot be designed for is refused before the search, not after it."""
    from dynid_rs.excitation.named import parse_effect
    from dynid_rs.excitation.separation import Separation
    from dynid_rs.excitation.shapes import ShapedEffect

    a, b = (parse_effect(text, model) for text in texts)
    shaped = ShapedEffect.of(a, model), ShapedEffect.of(b, model)
    if Separation(model, model.base_parameters(), *shaped, duration).is_hopeless:
        raise ValueError(f"--separate: beside the declared model no motion tells {texts[0]} from {texts[1]}")
    return a, b


def _separate(
    design: FourierExcitation,
    effects: tuple[NamedEffect, NamedEffect],
    iterations: int,
    time_limit: float | None,
    say: Callable[[str], None],
) -> tuple[FourierExcitation, Separated]:
    from dynid_rs.excitation.separating import separate

    return separate(design, *effects, max_iter=iterations, time_limit=time_limit, on_progress=say)


def _friction_plan(model: Any, settings: dict[str, Any], rate: float) -> FrictionExperiment:
    from dynid_rs.excitation.friction_plan import friction_plan
    from dynid_rs.excitation.output import n_steps_of

    plan = friction_plan(model, settings["limits"], settings["constraints"])
    n_steps_of(plan.duration, rate)
    return plan


def _write(
    design: FourierExcitation,
    plan: FrictionExperiment | None,
    model: Any,
    files: Outputs,
    rate: float,
    more: dict[str, Any],
) -> dict[str, Any]:
    """Write the files of the trajectory together, `more` among its figures; then forget the finished searches."""
    from dynid_rs.base.files import filled_together, write_json, write_text
    from dynid_rs.excitation.output import answer, write_csv
    from dynid_rs.excitation.plots import page
    from dynid_rs.experiment.answer import html

    result = answer(design, model) | more
    decided = html(result["next"], result["joints"]) if "next" in result else ""
    with ExitStack() as folders:
        stage = folders.enter_context(filled_together(files.csv.parent))
        if plan is not None and files.friction is not None and files.friction_json is not None:
            beside = files.friction.parent == files.csv.parent
            own = stage if beside else folders.enter_context(filled_together(files.friction.parent))
            n_rows = write_csv(own / files.friction.name, plan, rate)
            write_json(own / files.friction_json.name, plan.to_json())
            result["friction"] = {"file": str(files.friction), "duration_s": plan.duration, "n_rows": n_rows}
        result["n_rows"] = write_csv(stage / files.csv.name, design.trajectory_, rate)
        result["files"] = {"trajectory": str(files.csv), "figures": str(files.json), "plots": str(files.page)}
        write_json(stage / files.json.name, result)
        write_text(stage / files.page.name, page(result, design.trajectory_, decided))
    for state in files.states:
        state.unlink(missing_ok=True)
    return result
