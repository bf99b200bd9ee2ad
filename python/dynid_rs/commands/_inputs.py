"""What commands are given: robot, settings and runs, refused before any work is done."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from dynid_rs.base import interrupt
from dynid_rs.base.quoting import as_text, file_name

if TYPE_CHECKING:
    from dynid_rs import _core
    from dynid_rs.archive.runs import RunFile
    from dynid_rs.base.findings import Finding
    from dynid_rs.runs.readers import Config
    from dynid_rs.runs.recording import Recording
    from dynid_rs.runs.splitting import Split

ROUNDING = 1e-6
"""Rates from time stamps are not exact."""


def read_robot(
    path: Path,
    base: str | None = None,
    tip: str | None = None,
    gravity: str | None = None,
    rules: Config | None = None,
    *,
    xacro: bool = False,
) -> Any:
    """Read a robot in its own gravity or in the given one, "X,Y,Z" [m/s^2]; say on standard error which chain it is.

    What is not given here, `rules` may say. The chain is said only where the file leaves a choice.
    """
    from dynid_rs.base.files import check_readable
    from dynid_rs.model import robot_file
    from dynid_rs.runs.readers.config_file import STRONGEST_GRAVITY
    from dynid_rs.runs.readers.formats import SUFFIXES

    interrupt.check()  # the command's imports are done
    said = None if rules is None else rules.gravity
    vector = said if gravity is None else numbers("--gravity", gravity, 3)
    base, tip = chain_ends(base, tip, rules)
    if vector is not None and sum(g * g for g in vector) > STRONGEST_GRAVITY**2:
        raise ValueError(f"--gravity must be in m/s^2, at most {STRONGEST_GRAVITY:g}, found {gravity}")
    place = check_readable(path)
    if place.suffix.lower() in SUFFIXES:
        raise ValueError(
            f"{path}: this is a run, and a robot (URDF or robot.toml) is expected here; the robot comes before the runs"
        )
    robot = robot_file.read_robot(place, base=base, tip=tip, gravity=vector, xacro=xacro)
    if robot.choice is not None:
        typer.echo(f"{file_name(path)}: {robot.choice}", err=True)
    return robot


def model_files(path: Path) -> tuple[Path, ...]:
    """What is read where a model is named: a file, or a result's folder and what it holds of the model."""
    from dynid_rs.commands._identifier import MODEL_FILE, OPEN_FILE

    return path, path / MODEL_FILE, path / OPEN_FILE


def load_model(path: Path) -> _core.TorqueModel:
    """The model of a file, or of the folder of a result."""
    from dynid_rs import _core
    from dynid_rs.base.files import check_readable
    from dynid_rs.commands._identifier import MODEL_FILE

    interrupt.check()  # the command's imports are done
    inside = path / MODEL_FILE
    if path.is_dir() and not inside.is_file():
        raise FileNotFoundError(f"{path}: this folder holds no {MODEL_FILE}; name what `dynid identify` has written")
    return _core.TorqueModel.load(check_readable(inside if inside.is_file() else path))


def read_rules(config: Path | None) -> Config:
    """What `dynid.toml` says; nothing where there is none."""
    from dynid_rs.runs.readers import Config, read_config

    return Config() if config is None else read_config(config)


def chain_ends(base: str | None, tip: str | None, rules: Config | None) -> tuple[str | None, str | None]:
    """First and last link of the chain: as given, else as `rules` say."""
    return base or (rules.base if rules else None), tip or (rules.tip if rules else None)


def with_rotors(
    robot: Any, settings: Config, path: Path, base: str | None, tip: str | None, *, xacro: bool = False
) -> Any:
    """Return the robot with the rotor inertias of `dynid.toml`; the same one where it gives none."""
    from dynid_rs.base.errors import DataError
    from dynid_rs.model import robot_file

    inertia, n = settings.rotor_inertia, robot.n_joints
    if inertia is None:
        return robot
    if len(inertia) not in (1, n):
        raise DataError(
            f"{settings.source}, [motor] rotor_inertia: must be one number or {n}, one per joint of "
            f"{robot.name}, found {len(inertia)}",
            code="bad_config",
            file=settings.source,
            column="[motor] rotor_inertia",
        )
    rotors = list(inertia) * (n // len(inertia))
    base, tip = chain_ends(base, tip, settings)
    gravity = robot.gravity.tolist()
    return robot_file.read_robot(path, base=base, tip=tip, gravity=gravity, rotor_inertia=rotors, xacro=xacro)


def read_settings(config: Path | None, drive_gain: str | None, n_joints: int) -> Config:
    """Read `dynid.toml`; drive gains from the command line replace its own."""
    rules = read_rules(config)
    if drive_gain is None:
        return rules
    gains = numbers("--drive-gain", drive_gain, n_joints, or_one=True)
    if min(gains) <= 0:
        raise ValueError(f"--drive-gain must be positive, found {min(gains):g}; a direction belongs in [signs] tau")
    return replace(rules, drive_gain=gains)


def read_split(
    runs: list[Path],
    test: list[Path],
    test_from: float | None,
    robot: Any,
    settings: Config,
    cutoff: float | None,
) -> tuple[Split, list[Finding]]:
    """Read, check and split; findings on all runs."""
    train, tested = parted_sources(runs, test, robot, settings)
    recordings, findings = _read([*train, *tested])
    split, said = split_read(recordings[: len(train)], recordings[len(train) :], test_from, cutoff)
    return split, findings + said


def split_read(
    runs: Sequence[Recording], test: Sequence[Recording], test_from: float | None, cutoff: float | None
) -> tuple[Split, list[Finding]]:
    """Split runs that were read, less the parts of runs in which too little moves in the band below `cutoff` [Hz]."""
    from dynid_rs.identification.training import parts_in_motion
    from dynid_rs.runs.splitting import split_runs

    split = split_runs(runs, test, test_from)
    check_cutoff(cutoff, [*split.train, *split.test])
    train, tested, said = parts_in_motion(split.train, split.test, cutoff)
    return replace(split, train=train, test=tested), said + ([split.finding] if split.finding else [])


def read_friction(paths: list[Path], robot: Any, settings: Config, memory: int) -> list[Recording]:
    """Runs of the friction experiment; hints about slow or one-way motion are no news there.

    Raises
    ------
    ValueError
        They need more than `memory` [bytes] of work space: the search for pairs sees all of them at once.
    """
    from dynid_rs.archive.archive import fits

    recordings: list[Recording] = []
    for source in run_sources(paths, robot, settings):
        recordings.append(source.read()[0])
        if not fits(recordings, memory):
            raise ValueError(
                f"--friction: up to {source.name} these runs need more work space than --memory allows, and they are "
                "not streamed; give fewer of them, or raise --memory"
            )
    return recordings


def read_runs(paths: list[Path], robot: Any, settings: Config) -> tuple[list[Recording], list[Finding]]:
    """Read runs, in parts where they have gaps, without the signals that contradict their positions; with findings.

    Raises
    ------
    DataError
        A run is there twice: it would count twice in every interval. Or it is damaged: whatever is held against it
        tells of the damage.
    """
    from dynid_rs.runs.splitting import refuse_repeats

    recordings, findings = _read(parted_sources(paths, [], robot, settings)[0])
    refuse_damage(findings)
    refuse_repeats([], recordings)
    return recordings, findings


def read_undamaged(
    source: RunFile, but: Callable[[Finding], bool] = lambda finding: False
) -> tuple[Recording, list[Finding]]:
    """Read a run, as `read_runs` does; with its findings.

    Raises
    ------
    DataError, OSError
        It cannot be read, or is damaged otherwise than by a finding that is `but`.
    """
    recording, findings = source.read()
    refuse_damage(finding for finding in findings if not but(finding))
    return recording, findings


def refuse_damage(findings: Iterable[Finding]) -> None:
    """Raise the first that is damage, as `DataError`."""
    from dynid_rs.runs.checks import is_damage

    for finding in filter(is_damage, findings):
        raise finding.as_error()


def _read(sources: Sequence[RunFile]) -> tuple[list[Recording], list[Finding]]:
    """Read runs without the signals that contradict their positions; with all findings."""
    recordings: list[Recording] = []
    findings: list[Finding] = []
    for source in sources:
        recording, found = source.read()
        recordings.append(recording)
        findings += found
    return recordings, findings


def run_sources(paths: Sequence[Path], robot: Any, settings: Config) -> list[RunFile]:
    """Return the runs, to be read when they are needed; several of a file that gaps or jumps of time split."""
    return parted_sources(paths, (), robot, settings)[0]


def parted_sources(
    runs: Sequence[Path], test: Sequence[Path], robot: Any, settings: Config
) -> tuple[list[RunFile], list[RunFile]]:
    """`run_sources` of the runs to learn from and of those to test on, by names that tell all of them apart."""
    from dynid_rs.archive.runs import RunFile
    from dynid_rs.runs.parts import part_name
    from dynid_rs.runs.readers import count_parts

    sources: tuple[list[RunFile], list[RunFile]] = ([], [])
    paths = [*runs, *test]
    for place, (path, name) in enumerate(zip(paths, run_names(paths), strict=True)):
        n = count_parts(path, robot, settings)
        names = [name] if n == 1 else [part_name(name, k, n) for k in range(n)]
        sources[place >= len(runs)].extend(RunFile(path, of, robot, settings, k, n) for k, of in enumerate(names))
    return sources


def run_names(paths: Sequence[Path]) -> list[str]:
    """File names, with as many folders before them as it takes to tell runs apart."""
    parts = [path.absolute().parts for path in paths]
    depths = range(1, max(map(len, parts)) + 1)
    depth = next(d for d in depths if len({whole[-d:] for whole in parts}) == len(set(parts)))
    return [as_text("/".join(whole[-depth:])) for whole in parts]


def check_cutoff(cutoff: float | None, recordings: Sequence[Recording]) -> None:
    """Refuse a band that is none, or wider than what the slowest run can hold."""
    if cutoff is None:
        return
    if not cutoff > 0:
        raise ValueError(f"--cutoff must be a positive frequency in Hz, found {cutoff:g}")
    slowest = min(recordings, key=lambda recording: recording.rate)
    if cutoff >= slowest.rate / 2 * (1 - ROUNDING):
        raise ValueError(
            f"--cutoff must lie below half the sampling rate, {slowest.rate / 2:.4g} Hz for {slowest.name}, "
            f"found {cutoff:g}"
        )


def size_in_bytes(option: str, text: str) -> int:
    """Return a size such as 500MB, 4GB or 2e9 in bytes."""
    found = re.fullmatch(r"\s*([0-9.]+(?:e[0-9]+)?)\s*([kmgt]?)b?\s*", text.lower())
    try:
        size = float(found[1]) * 1000 ** ("", *"kmgt").index(found[2]) if found else 0.0
    except (ValueError, OverflowError):
        size = 0.0
    if not 0 < size < math.inf:
        raise ValueError(f"{option} must be a size such as 500MB or 4GB, found {text!r}")
    return int(size)


def numbers(option: str, text: str, count: int, *, or_one: bool = False) -> tuple[float, ...]:
    """Return the `count` finite numbers of an option, "1,2,3"; one number for all is enough with `or_one`."""
    wanted = f"one number or {count}" if or_one else f"{count} numbers"
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"{option} must be {wanted} with commas between, found {text!r}") from None
    if len(found) != count and not (or_one and len(found) == 1):
        raise ValueError(f"{option} must be {wanted}, found {len(found)}: {text!r}")
    if not all(math.isfinite(number) for number in found):
        raise ValueError(f"{option} must be {wanted.replace('number', 'finite number')}, found {text!r}")
    return found
