"""`dynid excite --after`: the motion that decides most of what a diagnosis left open."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from dynid_rs.diagnosis.open_questions import OpenQuestions
    from dynid_rs.excitation.fourier import FourierExcitation
    from dynid_rs.experiment.designing import NextExperiment

HEAVIEST = 1e4
"""No arm carries more [kg]."""
LONGEST = 1e4
"""No motion is longer [s]."""


def check_aims(
    separates: bool, goes_on: bool, load: float | None, budget: float | None, duration: float | None
) -> None:
    """Refuse two aims for one motion, and a load without the aim that it belongs to.

    Raises
    ------
    ValueError
        One sentence.
    """
    if separates and goes_on:
        raise ValueError("--separate and --after are two aims for one motion; design one for each")
    if load is not None and not goes_on:
        raise ValueError("--load belongs to --after: what a known mass would decide; leave it out")
    if budget is not None and not goes_on:
        raise ValueError("--budget belongs to --after: how long its motion may be; give --duration")
    if budget is not None and duration is not None:
        raise ValueError("--budget and --duration both say how long the motion is; leave one out")
    if budget is not None and not 0 < budget < LONGEST:
        raise ValueError(f"--budget must be a time in s, above 0 and below {LONGEST:g}, got {budget:g}")
    if load is not None and not 0 < load < HEAVIEST:
        raise ValueError(f"--load must be a mass in kg, above 0 and below {HEAVIEST:g}, got {load:g}")


def read_after(path: Path, robot: Any) -> OpenQuestions:
    """Read what the diagnosis in a folder left open."""
    from dynid_rs.diagnosis.open_file import read_open

    return read_open(path, robot)


def decide(
    made: Callable[[float], FourierExcitation],
    duration: float,
    budget: float | None,
    asked: OpenQuestions,
    iterations: int,
    time_limit: float | None,
    load: float,
    say: Callable[[str], None],
) -> NextExperiment:
    """Design the motion beside the exciting one that is `made` of a length: the shortest that is enough, if asked."""
    from dynid_rs.experiment.designing import check_length, design_next, least_duration
    from dynid_rs.experiment.next import shortest

    check_length(asked, budget or duration, "duration" if budget is None else "--budget")

    def designed(seconds: float) -> NextExperiment:
        return design_next(
            asked,
            made(seconds),
            load=load,
            max_iter=iterations,
            time_limit=time_limit,
            on_progress=lambda text: say(f"deciding, {text}"),
        )

    return designed(duration) if budget is None else shortest(designed, budget, least_duration(asked))


def show_next(section: dict[str, Any], joints: list[str], out: Any) -> None:
    """Print the questions with their chances, and what else it takes."""
    from dynid_rs.experiment.answer import HEAD, left_sentences, rows, sentences

    if rows(section, joints):
        table = Table(title=Text("what is open"), title_justify="left")
        table.add_column(HEAD[0], overflow="fold")
        for heading in HEAD[1:]:
            table.add_column(heading, justify="right")
        for question, *values in rows(section, joints):
            table.add_row(Text(question), *values)
        out.print(table)
    for sentence in (*sentences(section, joints), *left_sentences(section, joints)):
        out.print(Text(sentence), soft_wrap=True)
