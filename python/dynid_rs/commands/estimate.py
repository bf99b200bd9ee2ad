"""`dynid estimate`: the torque of every term for every sample of a run, by the code that runs online."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dynid_rs.base.guide import page
from dynid_rs.base.numbers import significant
from dynid_rs.base.quoting import file_name
from dynid_rs.commands import _options
from dynid_rs.commands._run import EXIT_NO, print_json, run_command

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    from numpy.typing import NDArray

    from dynid_rs._core import TorqueModel
    from dynid_rs.regression.evaluation import Comparison
    from dynid_rs.runs.recording import FloatArray, Recording

SAME_STEP = 1e-6
"""Steps that differ by this part of themselves are one step, told by rounded stamps."""
SETTLING, BEYOND_LIMITS = 512, 4096


@run_command
def estimate(
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="What `dynid identify` wrote")],
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run file, or the folder of a bag")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="OUT.parquet", help="Torques per sample, joint and term; kind2 was added to kind"
        ),
    ] = None,
    states: Annotated[
        Path | None,
        typer.Option(
            metavar="STATES.csv",
            help="Also write the states, with the measured torque where the run holds one, ready for "
            "`dynid-estimator MODEL < STATES.csv`",
        ),
    ] = None,
    config: Annotated[Path | None, typer.Option(help="dynid.toml: column names, units, gears, signs")] = None,
    drive_gain: _options.DriveGain = None,
    cutoff: Annotated[
        float | None,
        typer.Option(help="Band [Hz] for differentiating positions, where dq and ddq are not recorded"),
    ] = None,
    exclude: Annotated[
        list[str] | None,
        typer.Option(metavar="START:END", help="Times [s] not to score in the band (data.excluded of result.json)"),
    ] = None,
    test_from: Annotated[
        float | None,
        typer.Option(help="Score in the band what comes after this many seconds, as `dynid identify` does"),
    ] = None,
    adapt: Annotated[
        str | None,
        typer.Option(
            metavar="friction[,payload]",
            help="Also let friction of every joint, and a load, follow the run slowly, as `dynid-estimator --adapt` "
            "does, and say what becomes of the error; the estimates stay the model's",
        ),
    ] = None,
    adapt_mass: Annotated[
        float | None,
        typer.Option(
            metavar="KG",
            help="What the arm may carry: the limit of --adapt payload (of a model in ampere in kg times what the "
            "channel shows per N m)",
        ),
    ] = None,
    save_adapted: Annotated[
        Path | None,
        typer.Option(metavar="NEW.json", help="Write the model with what has followed by the end of the run"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Answer as JSON on standard output")] = False,
) -> int:
    """Estimate torques along a run.

    A run with recorded dq and ddq is taken as it is, sample by sample, as `dynid-estimator` takes it.
    Otherwise positions are filtered without phase and differentiated, as in `dynid identify`. A run without
    torque is fine; there is then no error to report. Else there are two: as recorded, and in the band of the
    model's own result, which on a test run of that result is the error that result.json says. Ends with 1 if the
    run is damaged (q in degrees, say), or if on a joint the error in the band is as large as the torque itself: the
    estimates are of what the file holds.
    """
    from dynid_rs.archive.runs import refuse_gain
    from dynid_rs.base.files import write_table
    from dynid_rs.commands import _adapt_view
    from dynid_rs.commands._inputs import check_cutoff, load_model, model_files, read_settings
    from dynid_rs.commands._states import states_of, write_states
    from dynid_rs.diagnosis.plausibility import lost_joints
    from dynid_rs.regression.evaluation import band_rmse, rmse
    from dynid_rs.runs.checks import check_recording, is_damage
    from dynid_rs.runs.readers import read_run

    _check_outputs(output, states, save_adapted, inputs=(*model_files(model), run), force=force)
    windows = [_window(text) for text in exclude or []]
    torque_model = load_model(model)
    settings = read_settings(config, drive_gain, torque_model.robot.n_joints)
    source = read_run(run, torque_model.robot, settings, require_torque=False)
    recording = source.recording
    if source.split is not None:
        typer.echo(f"{file_name(run)}: {source.split.text}; the longest part is estimated", err=True)
    refuse_gain(source, settings, file_name(run))
    check_cutoff(cutoff, [recording])
    _check_windows(windows, recording)
    if source.has_torque and recording.torque_unit != torque_model.torque_unit:
        raise _other_unit(recording, torque_model.torque_unit)
    _check_temperature(torque_model, recording)
    found = [finding for finding in check_recording(recording, torque_model.robot) if is_damage(finding)]
    if not source.has_torque:
        found = [finding for finding in found if not (finding.column or "").startswith("tau")]
    for option, given in (("--adapt", adapt), ("--exclude", exclude), ("--test-from", test_from)):
        if given not in (None, []) and not source.has_torque:
            purpose = "that anything could follow" if option == "--adapt" else "to score"
            raise ValueError(f"{option}: {file_name(run)} holds no torque {purpose}; leave it out")
    followed = _adapt_view.adapted(torque_model, recording, adapt, adapt_mass, save_adapted)
    t, signals, tau, temperature = states_of(recording, cutoff, torque_model.encoder_delay)
    total, terms, status = torque_model.evaluate(*signals, step=_step(t, torque_model), temperature=temperature)
    errors = rmse([tau - total]) if source.has_torque else None
    in_band, untold = _in_band(torque_model, recording, windows, test_from) if source.has_torque else ([], "")
    told = band_rmse(in_band) if in_band else None
    if in_band:
        found += lost_joints(torque_model.robot, in_band)
    columns: dict[str, Any] = {"t": t, **_by_joint("tau", total)}
    for k, name in enumerate(torque_model.term_names):
        columns |= _by_joint(name, terms[:, k])
    if source.has_torque:
        columns |= _by_joint("measured", tau)
    columns["status"] = status
    if output is not None:
        write_table(output, columns)
    if states is not None:
        measured = {"A": "current"}.get(recording.torque_unit, "tau")
        torque = {measured: tau} if source.has_torque else {}
        write_states(states, t, signals, temperature, torque)
    unusual, beyond = int((status != 0).sum()), int((status & BEYOND_LIMITS != 0).sum())
    if json_output:
        print_json(
            {
                "n_samples": len(t),
                "joints": list(torque_model.robot.joint_names),
                "terms": torque_model.term_names,
                "torque_unit": torque_model.torque_unit,
                "torque_delay": torque_model.torque_delay.tolist(),
                "rmse": None if errors is None else errors.tolist(),
                "rmse_in_band": None if told is None else told.tolist(),
                "cutoff_hz": None if torque_model.band is None else torque_model.band[0],
                "n_unusual": unusual,
                "n_beyond_limits": beyond,
                "output": None if output is None else str(output),
                "states": None if states is None else str(states),
                "adaptation": None if followed is None else _adapt_view.answer(followed, save_adapted),
                "findings": [finding.to_json() for finding in found],
            }
        )
        return EXIT_NO if found else 0
    if errors is None:
        typer.echo(f"{file_name(run)} holds no torque; there is nothing to compare the estimate with")
    else:
        for line in _lines(torque_model, errors, told):
            typer.echo(line)
        if untold:
            typer.echo(f"no error in the band of result.json: {untold}")
    if followed is not None:
        for line in _adapt_view.lines(followed, torque_model, str(adapt), save_adapted):
            typer.echo(line)
    if unusual:
        typer.echo(f"{unusual} of {len(t)} samples {_why_unusual(status)}")
    if beyond:
        typer.echo(
            f"{beyond} of {len(t)} samples lie beyond the model's limits, and were estimated at them "
            f"({page('how_to/online')})"
        )
    if output is not None:
        typer.echo(f"torques: {output}")
    if states is not None:
        typer.echo(f"states: {states}")
    for finding in found:
        typer.echo(f"error: {finding.message}", err=True)
    return EXIT_NO if found else 0


def _window(text: str) -> tuple[float, float]:
    """Start and end of `--exclude` [s]."""
    try:
        start, end = (float(part) for part in text.split(":"))
        good = start < end and math.isfinite(start) and math.isfinite(end)
    except ValueError:
        good = False
    if not good:
        raise ValueError(f"--exclude must be START:END in seconds, START before END, found {text!r}")
    return start, end


def _check_windows(windows: list[tuple[float, float]], recording: Recording) -> None:
    """Refuse times that leave nothing out, as those of another clock do."""
    first, last = recording.t[0], recording.t[-1]
    for start, end in windows:
        if end < first or start > last:
            raise ValueError(
                f"--exclude {start:g}:{end:g} lies outside of {recording.name} ({first:.10g} to {last:.10g} s)"
            )


def _step(t: FloatArray, model: TorqueModel) -> float:
    """Time between samples [s]; the model's own where it is the same but for rounding, for the same bits as online."""
    import numpy as np

    step = float(np.median(np.diff(t)))
    return model.step if model.step is not None and abs(step - model.step) < SAME_STEP * step else step


def _in_band(
    model: TorqueModel, recording: Recording, excluded: list[tuple[float, float]], test_from: float | None
) -> tuple[list[Comparison], str]:
    """Measured and estimated torque in the band that the model's result was told in, or why there is none."""
    from dynid_rs.identification.told_again import compared_in_band
    from dynid_rs.runs.splitting import split_runs

    if test_from is not None:
        (recording,) = split_runs([recording], [], test_from).test
    try:
        return [compared_in_band(model, recording, excluded)], ""
    except ValueError as error:  # the run is good for an estimate all the same
        if excluded and _in_band(model, recording, [], None)[0]:
            return [], "--exclude leaves hardly any motion of the run; leave less out"
        return [], str(error)


def _lines(model: TorqueModel, errors: FloatArray, told: FloatArray | None) -> Iterator[str]:
    """One per joint: the error as recorded, and in the band."""
    from dynid_rs.model.units import torque_units

    for j, (joint, unit) in enumerate(zip(model.robot.joint_names, torque_units(model), strict=True)):
        line = f"{joint}: RMSE {significant(errors[j])} {unit} (as recorded, all samples)"
        if told is not None and model.band is not None:
            line += f", {significant(told[j])} {unit} (in motion, below {model.band[0]:.3g} Hz, as in result.json)"
        yield line


def _why_unusual(status: NDArray[np.uint32]) -> str:
    if (status[status != 0] == SETTLING).all():
        return "have no state in the run that their torque belongs to (the torque channel's delay)"
    return "lie outside of what the model was trained on"


def _by_joint(name: str, values: FloatArray) -> dict[str, FloatArray]:
    return {f"{name}_{j}": values[:, j] for j in range(values.shape[1])}


def _check_outputs(
    output: Path | None, states: Path | None, adapted: Path | None, inputs: tuple[Path, ...], *, force: bool
) -> None:
    """Refuse before any work what cannot be written, or would replace what is read or, without `force`, is there."""
    from dynid_rs.commands._output import check_absent, check_file, check_not_read, check_suffix

    given = [path for path in (output, states, adapted) if path is not None]
    check_not_read(given, inputs)
    for path in given:
        check_file(path)
    if len({path.absolute() for path in given}) < len(given):
        what = "torques and states" if adapted is None else "torques, states and a model"
        raise ValueError(f"{given[0]}: {what} cannot go to the same file; name {'two' if adapted is None else 'more'}")
    kinds = ((output, ".parquet", "Parquet"), (states, ".csv", "CSV"), (adapted, ".json", "JSON"))
    for target, suffix, kind in kinds:
        if target is not None:
            check_suffix(target, suffix, kind)
    if not force:
        check_absent(given)


def _check_temperature(model: TorqueModel, recording: Recording) -> None:
    """Refuse a run that lacks the temperature which the model's friction follows."""
    from dynid_rs.base.errors import DataError

    follows = any("temperature" in effect.signals and values.any() for effect, values in model.effects)
    if follows and recording.temperature is None:
        raise DataError(
            f"{recording.name}: the model's friction follows the joints' temperature, which the run does not hold; add "
            'the columns temperature_0, ..., or name them in dynid.toml: [columns] temperature = "..."',
            code="missing_column",
            file=recording.name,
            column="temperature_0",
        )


def _other_unit(recording: Recording, unit: str) -> ValueError:
    from dynid_rs.base.errors import DataError
    from dynid_rs.base.quoting import shown

    mend = "give [drive] gain in dynid.toml, or leave the currents out: [columns] current = false"
    if recording.torque_unit == "N*m":
        mend = "give the currents of the run, or leave its torques out in dynid.toml: [columns] tau = false"
    return DataError(
        f"{recording.name}: holds torque in {recording.torque_unit}, the model gives {shown(unit)}; {mend}",
        code="other_unit",
        file=recording.name,
    )
