"""`dynid compare`: two models, or two results, side by side on the same runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from dynid_rs.commands import _options
from dynid_rs.commands._run import print_json, run_command

INTERVALS = ("a_interval", "b_interval", "change_interval")


@run_command
def compare(
    a: Annotated[Path, typer.Argument(metavar="A", help="model.json, or the folder of a result")],
    b: Annotated[Path, typer.Argument(metavar="B", help="The same, to be held against it")],
    runs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[RUN...]", help="Runs; left out: the test runs of both results, if they are the same"),
    ] = None,
    config: _options.Config = None,
    drive_gain: _options.DriveGain = None,
    cutoff: Annotated[float | None, typer.Option(help="Band [Hz]; the narrower one of both models if left out")] = None,
    json_output: _options.Json = False,
) -> None:
    """Hold two models of one arm against each other: errors per joint, and how sure the change is.

    With runs both models are evaluated on them at the same samples, in the same band. Without, the errors are those of
    both results on their test runs.

    Exit code 0: compared, whichever is better; 2: a file cannot be read, or the two cannot be compared.
    """
    from dynid_rs.commands._inputs import check_cutoff, load_model, read_runs, read_settings
    from dynid_rs.identification.two_models import check_alike, compare_models
    from dynid_rs.model.units import torque_units

    one, two = load_model(a), load_model(b)
    check_alike(one, two)
    findings: list[Any] = []
    if runs:
        settings = read_settings(config, drive_gain, one.robot.n_joints)
        recordings, findings = read_runs(runs, one.robot, settings)
        check_cutoff(cutoff, recordings)
        errors = {"runs": [run.name for run in recordings], **compare_models(one, two, recordings, cutoff=cutoff)}
    else:
        if config is not None or drive_gain is not None or cutoff is not None:
            raise ValueError("--config, --drive-gain and --cutoff are about runs, and none is given; name runs")
        errors = _of_results(a, b)
    terms = [set(one.term_names), set(two.term_names)]
    answer = {
        "format": "dynid-comparison",
        "version": 1,
        "a": str(a),
        "b": str(b),
        "joints": list(one.robot.joint_names),
        "torque_unit": one.torque_unit,
        "torque_units": torque_units(one),
        **{"rmse": errors},
        "terms": {
            "both": [name for name in one.term_names if name in terms[1]],
            "a": [name for name in one.term_names if name not in terms[1]],
            "b": [name for name in two.term_names if name not in terms[0]],
        },
        "findings": [finding.to_json() for finding in findings],
    }
    if json_output:
        print_json(answer)
    else:
        _show(answer)


def _of_results(a: Path, b: Path) -> dict[str, Any]:
    """Errors that two results tell of the same test runs."""
    from dynid_rs.base.files import check_readable
    from dynid_rs.report.source import RESULT_FILE, read_result

    results = []
    for path in (a, b):
        if not path.is_dir():
            raise ValueError(f"{path}: a model alone tells no errors; name runs to compare on, or the result's folder")
        place = check_readable(path / RESULT_FILE)
        try:
            result = read_result(place)
            facts = result["data"]["test"], result["rmse"]["test"]["torque_std"]
            result["rmse"]["test"]["after"]
        except (ValueError, KeyError, TypeError):
            raise ValueError(f"{place}: is no result of dynid identify or diagnose; name runs to compare on") from None
        results.append((result, facts))
    (first, (runs, std)), (second, (others, other_std)) = results
    if runs != others or std != other_std:
        raise ValueError(
            f"{b}: was tested on {', '.join(others)}, in its own band, and {a} on {', '.join(runs)}; these errors "
            "are of different samples, name runs to compare both models on"
        )
    after = [result["rmse"]["test"] for result in (first, second)]
    nothing = [None] * len(std)
    return {
        "runs": runs,
        "cutoff": None,
        "torque_std": std,
        "a": after[0]["after"],
        "b": after[1]["after"],
        "a_interval": after[0].get("after_interval") or nothing,
        "b_interval": after[1].get("after_interval") or nothing,
        "change_interval": nothing,
    }


def _show(answer: dict[str, Any]) -> None:
    from rich.table import Table
    from rich.text import Text

    from dynid_rs.base.numbers import change, interval, percent_interval, significant
    from dynid_rs.base.quoting import shown
    from dynid_rs.base.units import torques_said
    from dynid_rs.base.wording import NO_INTERVAL
    from dynid_rs.commands._console import console

    rmse, out = answer["rmse"], console()
    band = "" if rmse["cutoff"] is None else f", in motion, below {rmse['cutoff']:.3g} Hz"
    title = f"RMSE on {', '.join(map(shown, rmse['runs']))} [{torques_said(answer['torque_units'])}]{band}"
    table = Table(title=Text(title), title_justify="left")
    table.add_column("joint")
    for heading in ("A", "95 % interval", "B", "95 % interval", "change", "95 % interval"):
        table.add_column(heading, justify="right")
    for j, joint in enumerate(answer["joints"]):
        one, two, sure = rmse["a"][j], rmse["b"][j], rmse["change_interval"][j]
        left, right = interval(rmse["a_interval"][j]), interval(rmse["b_interval"][j])
        moved = change(two, one), percent_interval(sure)
        table.add_row(Text(shown(joint)), significant(one), left, significant(two), right, *moved)
    out.print(Text(f"A: {answer['a']}\nB: {answer['b']}"), soft_wrap=True)
    out.print(table)
    if rmse["cutoff"] is not None and any(None in rmse[key] for key in INTERVALS):
        out.print(Text(f"-: {NO_INTERVAL}"))
    if rmse["cutoff"] is None:
        out.print("The change has no interval: results tell their errors, not both at each sample; name runs for one.")
    for place, words in (("a", "only A has"), ("b", "only B has")):
        if answer["terms"][place]:
            out.print(Text(f"{words}: {', '.join(map(shown, answer['terms'][place]))}"), soft_wrap=True)
    for finding in answer["findings"]:
        if finding["severity"] != "info":
            out.print(Text(f"{finding['severity']}: {finding['message']}"), soft_wrap=True)
