"""`dynid diagnose`: what it writes, says and refuses; the search itself is made up here (`made_diagnosis.py`)."""

import functools
import json
import sys
import types
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers import made_diagnosis
from helpers.result_files import FILES, validator
from helpers.run_files import write
from helpers.small_arm import JOINTS, as_current, dynid, refusal, run, snapshot, study, write_robot, write_runs
from helpers.tolerances import ALGEBRAIC

from dynid_rs import LinkDynamicsIdentifier, RobotModel, TorqueModel, read_recording
from dynid_rs.base.findings import Finding
from dynid_rs.base.numbers import significant
from dynid_rs.base.wording import NO_INTERVAL
from dynid_rs.commands._diagnose_view import show
from dynid_rs.diagnosis.availability import missing_signals
from dynid_rs.diagnosis.loop import diagnose
from dynid_rs.diagnosis.plausibility import implausible
from dynid_rs.diagnosis.results import _with_consequences
from dynid_rs.diagnosis.setup import Setup
from dynid_rs.diagnosis.wording import explained_share, next_experiments, not_worse, verdict
from dynid_rs.identification.three_loops import ThreeLoopIdentifier
from dynid_rs.regression.evaluation import Comparison
from dynid_rs.report import diagnosis as report_diagnosis
from dynid_rs.runs.recording import Recording


@pytest.fixture
def search(monkeypatch):
    """Put a made-up search in the place of the real one; returns what it was asked."""
    asked = {}

    def use(found):
        def diagnose(setup, train, test, **more):
            asked.update(setup=setup, train=[r.name for r in train], test=[r.name for r in test], **more)
            return found(setup, train, test)

        module = types.ModuleType("dynid_rs.diagnosis.loop")
        module.diagnose = diagnose
        monkeypatch.setitem(sys.modules, "dynid_rs.diagnosis.loop", module)
        return asked

    return use


def diagnosed(folder, *arguments):
    """Diagnose into `folder`/out; the printed answer and result.json."""
    printed = dynid("diagnose", *arguments, "-o", folder / "out")
    path = folder / "out" / "result.json"
    return printed, json.loads(path.read_text()) if path.is_file() else None


def test_four_files_and_the_answer(tmp_path, search):
    asked = search(made_diagnosis.with_effects)
    done = study()
    printed, result = diagnosed(tmp_path, done.robot, *done.runs[:2], "--test", done.runs[2])
    assert printed.exit_code == 0, printed.output
    assert asked["train"] == ["run_0.parquet", "run_1.parquet"]
    assert asked["test"] == ["run_2.parquet"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == FILES
    validator().validate(result)
    for text in (result["verdict"][:40], "before", "after", "floor", "1. stribeck on elbow", "next: ", "--separate"):
        assert text in printed.stdout
    assert printed.stdout.endswith(f"report: {tmp_path / 'out' / 'report.html'}\n")
    assert [entry["kind"] for entry in result["effects"]] == ["stribeck"]
    assert "stribeck" in TorqueModel.load(tmp_path / "out" / "model.json").term_names
    assert result["nothing_to_add"] is False


def test_before_is_identifys_and_after_is_the_saved_models(tmp_path, search):
    """Errors by two roads: `before` from `dynid identify`, `after` from the residuals in the table."""
    search(made_diagnosis.with_effects)
    done = study()
    _, result = diagnosed(tmp_path, done.robot, *done.runs[:2], "--test", done.runs[2])
    plain = tmp_path / "plain"
    same = ("--residual", "none", "--friction-law", "smooth")
    dynid("identify", done.robot, *done.runs[:2], "--test", done.runs[2], "-o", plain, *same)
    identified = json.loads((plain / "result.json").read_text())["rmse"]["test"]
    test = result["rmse"]["test"]
    for mine, theirs in (("before", "after"), ("before_interval", "after_interval"), ("wls", "wls")):
        found, expected = (np.array(part, dtype=float) for part in (test[mine], identified[theirs]))  # None is NaN
        np.testing.assert_allclose(found, expected, **ALGEBRAIC)
    table = pq.read_table(tmp_path / "out" / "residuals.parquet").to_pydict()
    unseen = np.array(table["set"]) == "test"
    for name, key in (("residual", "after"), ("residual_before", "before")):
        for j, told in enumerate(test[key]):
            errors = np.array(table[f"{name}_{j}"])[unseen & np.array(table[f"moves_{j}"])]
            np.testing.assert_allclose(np.sqrt(np.mean(errors**2)), told, **ALGEBRAIC)
    assert test["after"] != test["before"]
    assert any(test["change_interval"])
    for pair, after, before in zip(test["change_interval"], test["after"], test["before"], strict=True):
        assert pair is None or pair[0] <= after / before - 1 <= pair[1]


def test_a_change_has_its_interval_and_what_cannot_be_said_is_a_dash(tmp_path, search, capsys):
    search(made_diagnosis.with_effects)
    done = study()
    _, result = diagnosed(tmp_path, done.robot, *done.runs[:2], "--test", done.runs[2])
    test = result["rmse"]["test"]
    test |= {"after_interval": [[1.0, 2.0], [3.0, 4.0], None], "change_interval": [[-0.2, 0.1], [-0.5, -0.4], None]}
    validator().validate(result)
    show(result, tmp_path)
    rows = [
        line for line in capsys.readouterr().out.splitlines() if any(f"\u2502 {joint} " in line for joint in JOINTS)
    ]
    cells = [[cell.strip() for cell in row.strip("\u2502").split("\u2502")] for row in rows]
    assert [row[4] for row in cells] == ["1.00 to 2.00", "3.00 to 4.00", "-"]
    assert [row[6] for row in cells] == ["-20 to +10 %", "-50 to -40 %", "-"]
    show(result, tmp_path)
    assert f"-: {NO_INTERVAL[:60]}" in capsys.readouterr().out
    test |= {"after_interval": [[1.0, 2.0]] * 3, "change_interval": [[-0.2, 0.1]] * 3}
    show(result, tmp_path)
    assert "no interval can be said" not in capsys.readouterr().out


def test_least_squares_stand_beside_both_models_and_what_is_worse_is_said(tmp_path, search, capsys):
    search(made_diagnosis.with_effects)
    done = study()
    _, result = diagnosed(tmp_path, done.robot, *done.runs[:2], "--test", done.runs[2])
    test = result["rmse"]["test"]
    test |= {"wls": [0.111, 2.22, 0.333], "before": [0.0444, 3.33, 0.334], "after": [0.0555, 2.666, 0.335]}
    show(result, tmp_path)
    out = capsys.readouterr().out
    for j, joint in enumerate(JOINTS):
        (row,) = (line for line in out.splitlines() if f"\u2502 {joint} " in line)
        cells = [cell.strip() for cell in row.strip("\u2502").split("\u2502")]
        assert cells[1:4] == [significant(test[key][j]) for key in ("wls", "before", "after")]
    assert "WLS" in out
    assert "before" in out
    sentence = (
        "Worse than the simplest model: the declared model leaves more than weighted least squares on elbow (+50 %); "
        "the model with effects leaves more than weighted least squares on elbow (+20 %)."
    )
    assert sentence in " ".join(out.split())
    assert sentence in report_diagnosis.errors(result)
    test |= {"before": [0.1, 2.0, 0.3], "after": [0.05, 1.0, 0.33]}
    show(result, tmp_path)
    assert "Worse than the simplest" not in capsys.readouterr().out
    assert "Worse than the simplest" not in report_diagnosis.errors(result)
    page = report_diagnosis.errors(result)
    assert page.index("Weighted least squares") < page.index("Declared <") < page.index("With the effects found <")


def test_clean_data_is_a_good_answer(tmp_path, search):
    search(made_diagnosis.clean)
    done = study()
    printed, result = diagnosed(tmp_path, done.robot, *done.runs)
    assert printed.exit_code == 0
    validator().validate(result)
    assert result["nothing_to_add"] is True
    assert result["verdict"].startswith("Nothing to add: ")
    assert result["rmse"]["test"]["before"] == result["rmse"]["test"]["after"]
    codes = [f["code"] for f in result["data"]["findings"]]
    assert "test_run_chosen" in codes


def test_one_run_keeps_its_last_third_aside(tmp_path, search):
    asked = search(made_diagnosis.clean)
    (path,) = write_runs(tmp_path, n_runs=1, duration=12.0)
    printed, result = diagnosed(tmp_path, write_robot(tmp_path), path)
    assert printed.exit_code in (0, 1)
    assert asked["train"] == ["run_0.parquet (first 8 s)"]
    assert asked["test"] == ["run_0.parquet (after 8 s)"]
    assert any("second run" in sentence for sentence in result["next_experiment"])


def test_json_prints_the_same_object_and_options_reach_the_search(tmp_path, search):
    asked = search(made_diagnosis.clean)
    done = study()
    options = ("--cutoff", 6, "--prior", "robot", "--json")
    printed, result = diagnosed(tmp_path, done.robot, *done.runs, "--reference", done.model, *options)
    assert json.loads(printed.stdout) == result
    assert printed.stderr == ""
    chosen = asked["setup"].options
    assert (chosen["cutoff"], chosen["links"].prior, chosen["friction_law"]) == (6.0, "robot", "smooth")
    assert asked["reference"].robot.joint_names == list(JOINTS)


def test_evidence_is_weighed_beside_a_prior_and_the_smooth_law(tmp_path):
    """Other laws, and no prior, ended in a traceback as soon as something was found."""
    done = study()
    refused = dynid("diagnose", done.robot, *done.runs, "--prior", "none", "-o", tmp_path / "out")
    assert "--prior must be auto or robot, found 'none'" in refusal(refused)
    robot = RobotModel.from_urdf(done.robot)
    recordings = [read_recording(path, robot) for path in done.runs]
    for options, said in (
        ({"friction_law": "coulomb_viscous"}, "leave friction_law out of the setup's options"),
        ({"links": LinkDynamicsIdentifier(None, prior=None)}, "friction_law smooth needs a prior and weights"),
    ):
        with pytest.raises(ValueError, match=said):
            diagnose(Setup(robot, options=options), recordings[:2], recordings[2:])
    refused = dynid(
        "identify", done.robot, *done.runs, "--prior", "none", "--friction-law", "smooth", "-o", tmp_path / "x"
    )
    assert "friction_law smooth needs a prior" in refusal(refused)


def test_excluded_windows_are_scored_by_neither_model(tmp_path, search):
    def with_contact(setup, train, test):
        made = made_diagnosis.clean(setup, train, test)
        return replace(made, setup=replace(made.setup, excluded={test[0].name: ((2.0, 5.0),)}))

    search(with_contact)
    done = study()
    _, result = diagnosed(tmp_path, done.robot, *done.runs[:2], "--test", done.runs[2])
    table = pq.read_table(tmp_path / "out" / "residuals.parquet").to_pydict()
    t = np.array(table["t"])[np.array(table["set"]) == "test"]
    assert not np.any((t >= 2.0) & (t <= 5.0))
    assert np.any(t > 5.0)
    assert result["rmse"]["test"]["before"] == result["rmse"]["test"]["after"]


def test_worse_after_than_before_ends_in_one(tmp_path, search):
    def spoiled(setup, train, test):
        made = made_diagnosis.clean(setup, train, test)
        worse = replace(setup, options={**setup.options, "friction_law": "coulomb_viscous"}).identifier(residual=None)
        wrong = [replace(r, tau=1.2 * r.tau) for r in train]
        return replace(made, after=worse.fit(wrong))

    search(spoiled)
    done = study()
    printed, result = diagnosed(tmp_path, done.robot, *done.runs)
    assert printed.exit_code == 1
    assert not not_worse(result)


# The search itself


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """Two encoders, gears that yield, ripple, friction that turns round over a way, a base that is not level."""
    from helpers.diagnosed import recorded, with_effects

    from dynid_rs import RobotModel
    from dynid_rs.simulation import typical_arm
    from dynid_rs.simulation.folder import run_columns

    folder = tmp_path_factory.mktemp("real")
    robot = write_robot(folder)
    arm = replace(typical_arm(RobotModel.from_urdf(robot)).rigid(), delay=0.0028)
    arm = with_effects(arm, "joint_elasticity:elbow", "friction_hysteresis:wrist:2", "gravity_tilt::3")
    ripple = 2 * arm.noise_std[0]
    runs = [
        replace(r, tau=r.tau + ripple * np.cos(90 * r.q_motor[:, :1]) * np.array([1.0, 0.0, 0.0]))
        for r in recorded(arm, encoders=2)
    ]
    paths = [write(folder / f"run_{k}.parquet", run_columns(r)) for k, r in enumerate(runs)]
    printed, result = diagnosed(folder, robot, *paths[:2], "--test", paths[2])
    return folder, printed, result


def test_what_a_diagnosis_writes_is_of_the_documented_form(real):
    folder, printed, result = real
    assert printed.exit_code == 0, printed.output
    assert sorted(path.name for path in (folder / "out").iterdir()) == sorted([*FILES, "open.json"])
    validator().validate(result)
    named = {(entry["kind"], tuple(entry["joints"])) for entry in result["effects"]}
    assert named >= {
        ("encoder_delay", JOINTS),
        ("joint_elasticity", ("elbow",)),
        ("friction_hysteresis", ("wrist",)),
        ("gravity_tilt", JOINTS),
        ("torque_ripple", ("shoulder",)),
    }
    assert [entry["rank"] for entry in result["effects"]] == list(range(1, len(result["effects"]) + 1))
    assert all(entry["name"] for entry in result["parameters"]["base"])
    assert all(entry["sharpness"] > 0 for entry in result["parameters"]["friction_shape"])


def test_everything_that_was_found_is_printed_and_in_the_report(real):
    folder, printed, result = real
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert "Traceback" not in printed.output
    for entry in result["effects"]:
        assert f"{entry['rank']}. " in printed.stdout
        assert entry["kind"].replace("_dependent_", "-dependent ").replace("_", " ") in printed.stdout
        assert entry["kind"].replace("_dependent_", "-dependent ").replace("_", " ").capitalize() in page


@pytest.mark.parametrize("change", ["torque", "clock, rate and motion too"])
def test_a_changed_test_run_changes_no_bit_of_the_model(real, change):
    folder, _, result = real
    robot, runs = folder / "robot.urdf", [folder / f"run_{k}.parquet" for k in range(3)]
    table = pq.read_table(runs[2]).to_pydict()
    spoiled = {name: np.array(values) for name, values in table.items()}
    changes = {f"tau_{j}": 2 * spoiled[f"tau_{j}"][::-1] for j in range(3)}
    if change == "clock, rate and motion too":
        # Half the rate, another clock, and slower: whatever is made of all runs together would show here.
        positions = [name for name in spoiled if name.startswith("q_")]
        changes |= {name: 0.8 * spoiled[name] + 0.1 for name in positions} | {"t": 3.0 + 1.1 * spoiled["t"]}
        changes = {name: values[::2] for name, values in (spoiled | changes).items()}
    spoiled |= changes
    other = folder / change
    other.mkdir()
    _, again = diagnosed(other, robot, *runs[:2], "--test", write(other / "test.parquet", spoiled))
    assert (other / "out" / "model.json").read_bytes() == (folder / "out" / "model.json").read_bytes()
    assert again["rmse"]["train"] == result["rmse"]["train"]
    assert again["steps"] == result["steps"]
    for one, two in zip(again["effects"], result["effects"], strict=True):
        assert {k: v for k, v in one.items() if "test" not in k} == {k: v for k, v in two.items() if "test" not in k}
    assert again["rmse"]["test"]["after"] != result["rmse"]["test"]["after"]


def test_a_reference_names_the_payload(tmp_path):
    from helpers.diagnosed import recorded, rigid, with_effects

    from dynid_rs.simulation.folder import run_columns

    robot = write_robot(tmp_path)
    before, after = (
        [write(tmp_path / f"{name}_{k}.parquet", run_columns(r)) for k, r in enumerate(recorded(arm, seed=seed))]
        for name, arm, seed in (("empty", rigid(), 0), ("loaded", with_effects(rigid(), "payload::1"), 7))
    )
    model = tmp_path / "trusted"
    trained = dynid("identify", robot, *before[:2], "--test", before[2], "-o", model, "--friction-law", "smooth")
    assert trained.exit_code == 0, trained.output
    printed, result = diagnosed(tmp_path, robot, *after[:2], "--test", after[2], "--reference", model / "model.json")
    validator().validate(result)
    assert [entry["kind"] for entry in result["effects"]] == ["payload"]
    assert "before: the reference as it is, after: with what has changed" in " ".join(printed.output.split())
    assert result["loops"]["test"]["residual"] == result["loops"]["test"]["links"]  # it is no loop of this fit
    assert result["rmse"]["test"]["before"] != result["loops"]["test"]["residual"]
    assert not (tmp_path / "out" / "open.json").exists()
    mass = result["effects"][0]["parameters"][0]
    assert mass["interval"][0] < mass["value"] < mass["interval"][1]
    # Of the runs that it was learned from its own fit tells the same parameters, and yet it is the reference.
    same = ("--test", before[2], "--reference", model / "model.json", "--force")
    printed, result = diagnosed(tmp_path, robot, *before[:2], *same)
    assert "what the reference leaves" in " ".join(printed.output.split())
    assert "before: the reference as it is" in " ".join(printed.output.split())
    assert result["covariance"] is None


# Bad input


@pytest.mark.parametrize(
    ("factor", "expected"),
    [
        (-8.0, {"residual_exceeds_torque", "run_unlike_others"}),
        (-1e3, {"torque_beyond_effort"}),  # the cause is known: no consequence is told
    ],
)
def test_torque_in_another_unit_on_the_test_run_is_an_error(tmp_path, search, factor, expected):
    search(made_diagnosis.clean)
    robot, runs = write_robot(tmp_path), write_runs(tmp_path)
    columns = run(2)
    columns |= {f"tau_{j}": factor * columns[f"tau_{j}"] for j in range(3)}
    printed, result = diagnosed(tmp_path, robot, *runs[:2], "--test", write(tmp_path / "odd.parquet", columns))
    assert printed.exit_code == 1
    codes = {f["code"] for f in result["data"]["findings"] if f["severity"] != "info"}
    assert codes == expected
    assert result["verdict"].startswith("Look at the data first: ")
    validator().validate(result)


def test_a_known_error_in_the_data_is_the_verdict_and_nothing_is_concluded():
    cause = Finding("torque_swapped", "error", "torque columns are swapped: tau_1 moves a", column="tau_1")
    after = Finding("residual_exceeds_torque", "error", "robot file and runs do not belong together", column="tau_0")
    result = outcome([1.0, 1.0], [1.0, 1.0], [1.0, 1.0], data={"findings": [f.to_json() for f in (after, cause)]})
    assert verdict(result) == f"Look at the data first: {cause.message}. Nothing is concluded before that is mended."
    assert "no physics can be read" in report_diagnosis.left(None, result)
    assert "no physics can be read" in report_diagnosis.effects(None, result)


def test_another_load_or_mounting_is_the_error_and_not_what_follows_from_it():
    load = Finding("payload_change", "warning", "run_1 carries about 2 kg more", "run_1", value=2.0, unit="kg")
    lost = Finding("residual_exceeds_torque", "error", "check the robot file", column="tau_0")
    odd, other = (Finding("run_unlike_others", "warning", "ten times", name) for name in ("run_1", "run_2"))
    assert _with_consequences([load], [lost, odd, other]) == [replace(load, severity="error"), other]
    assert _with_consequences([load], [odd]) == [load]
    assert _with_consequences([], [lost, odd]) == [lost, odd]
    base = Finding("mounting", "warning", "gravity pulls elsewhere", "run_0", value=58.0, unit="deg")
    assert _with_consequences([base], [lost, odd]) == [replace(base, severity="error"), odd]


@pytest.mark.parametrize("verb", ["identify", "diagnose"])
def test_what_is_wrong_with_a_run_is_the_error_where_it_lets_no_model_be_fitted(tmp_path, monkeypatch, verb):
    """A position of 65,535 rad made coefficients that no model holds: "a coefficient ... is beyond 1e9"."""
    robot, paths, columns = write_robot(tmp_path), write_runs(tmp_path, n_runs=1), run(1)
    columns["q_1"][700] = 65535.0
    odd = write(tmp_path / "odd.parquet", columns)

    def fit(*_, **__):
        raise ValueError("a coefficient of the model is beyond 1e9, more than any arm holds")

    monkeypatch.setattr(ThreeLoopIdentifier, "fit", fit)
    sentence = refusal(dynid(verb, robot, odd, "--test", *paths, "-o", tmp_path / "out"))
    assert sentence.startswith("odd.parquet: q_1 jumps by 6.55e+04 rad at row 701")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("verb", ["identify", "diagnose"])
def test_a_part_with_hardly_any_motion_is_left_out_and_said(tmp_path, search, verb):
    search(made_diagnosis.clean)
    robot, paths, columns = write_robot(tmp_path), write_runs(tmp_path, n_runs=2), run(2)
    gap = columns["t"] > columns["t"][300]  # a second and a half, then eight
    columns["t"] = columns["t"] + 3.0 * gap
    split = write(tmp_path / "split.parquet", columns)
    printed = dynid(verb, robot, paths[0], split, "--test", paths[1], "-o", tmp_path / "out")
    assert printed.exit_code == 0, printed.output
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    said = [f for f in result["data"]["findings"] if "left out" in f["message"]]
    assert [f["file"] for f in said] == ["split.parquet (part 1 of 2)"]
    assert result["data"]["train"] == ["run_0.parquet", "split.parquet (part 2 of 2)"]


def test_a_run_of_another_robot_is_refused(tmp_path, search):
    search(made_diagnosis.clean)
    robot, runs = write_robot(tmp_path), write_runs(tmp_path, n_runs=1)
    columns = run(1)
    columns |= {"q_3": columns["q_0"], "tau_3": columns["tau_0"]}
    sentence = refusal(
        dynid("diagnose", robot, *runs, write(tmp_path / "other.parquet", columns), "-o", tmp_path / "o")
    )
    assert "other.parquet" in sentence
    assert not (tmp_path / "o").exists()


def test_a_reference_of_another_robot_or_unit_is_refused(tmp_path, search):
    search(made_diagnosis.clean)
    done = study()
    renamed = tmp_path / "other.urdf"
    renamed.write_text(done.robot.read_text().replace("elbow", "knee"))
    arguments = ("--reference", done.model, "-o", tmp_path / "out")
    assert "is a model of small_arm with the joints" in refusal(dynid("diagnose", renamed, *done.runs, *arguments))
    paths = [write(tmp_path / f"run_{k}.parquet", as_current(run(k))) for k in range(2)]
    assert "is a model in N*m" in refusal(dynid("diagnose", done.robot, *paths, *arguments))


def test_nothing_is_written_where_the_search_fails(tmp_path, search):
    def fails(setup, train, test):
        raise ValueError("the search found a fault of the data")

    search(fails)
    done = study()
    before = snapshot(tmp_path)
    printed = dynid("diagnose", done.robot, *done.runs, "-o", tmp_path / "out")
    assert refusal(printed) == "the search found a fault of the data"
    assert snapshot(tmp_path) == before


def test_results_never_replace_what_is_read(tmp_path, search):
    search(made_diagnosis.clean)
    done = study()
    model = tmp_path / "model.json"
    model.write_bytes(done.model.read_bytes())
    printed = dynid("diagnose", done.robot, *done.runs, "--reference", model, "-o", tmp_path)
    assert "is read here and would be replaced" in refusal(printed)


def recording(duration=10.0, **changes):
    t = np.arange(0.0, duration, 0.01)
    q = np.sin(t)[:, None]
    return Recording(**({"t": t, "q": q, "tau": np.cos(t)[:, None]} | changes))


def test_signals_that_lack_are_said_with_the_effects_that_need_them():
    found = {f.column: f.message for f in missing_signals([recording()])}
    assert set(found) == {"q_motor", "temperature"}
    assert "backlash" in found["q_motor"]
    assert "joint_elasticity" in found["q_motor"]
    assert "thermal_friction" in found["temperature"]
    (short,) = (f.message for f in missing_signals([recording(6.0)]) if f.column == "temperature")
    assert "the longest run of 6 s shows only the beginning" in short
    assert "beginning" not in {f.column: f.message for f in missing_signals([recording(100.0)])}["temperature"]
    whole = recording()
    whole = replace(whole, q_motor=whole.q, temperature=whole.q)
    assert missing_signals([whole]) == []
    assert [f.column for f in missing_signals([replace(whole, torque_unit="A")])] == ["tau"]


@functools.cache
def states():
    """States of one run, for comparisons whose torques are made up."""
    from dynid_rs.runs.preprocessing import Band, prepare

    t = np.arange(0.0, 10.0, 0.01)
    q = np.stack([np.sin(t), np.cos(t), np.sin(2 * t)], axis=1)
    return prepare(Recording(t=t, q=q, tau=q), Band(5.0), 100.0)


def comparison(name, share, seed):
    """Torque of unit size of which the model leaves `share`."""
    rng = np.random.default_rng(seed)
    measured, left = rng.normal(size=(2, *states().counted.shape))
    left = share * left
    return Comparison(replace(states(), name=name), measured, measured - left, left)


def codes_of(robot, shares):
    runs = [comparison(name, share, k) for k, (name, share) in enumerate(shares.items())]
    return [(f.code, f.file) for f in implausible(robot, runs)]


def test_errors_that_no_effect_explains():
    from dynid_rs import RobotModel

    robot = RobotModel.from_urdf(study().robot)
    assert codes_of(robot, {"a": 0.1, "b": 0.12, "c": 0.3}) == []
    assert codes_of(robot, {"a": 0.05, "b": 0.05, "c": 0.5}) == [("run_unlike_others", "c")]
    assert codes_of(robot, {"a": 0.001, "b": 0.001, "c": 0.01}) == []  # all of them small
    assert codes_of(robot, {"a": 1.2, "b": 1.2})[0] == ("residual_exceeds_torque", None)
    assert codes_of(robot, {"a": 0.1}) == []


@pytest.mark.parametrize(("lifted", "lost"), [(2.0, False), (6.0, True)])
def test_the_weight_of_a_load_is_held_against_all_of_the_torque(lifted, lost):
    """A slide that lifts 5 N of its own: a load of 2 N is twice what the torque varies by, and no wrong unit."""
    from dynid_rs import RobotModel

    run = comparison("a", 0.1, 0)
    with_load = replace(run, measured=run.measured + 5.0, predicted=run.predicted + 5.0 - lifted)
    found = implausible(RobotModel.from_urdf(study().robot), [with_load])
    assert [f.code for f in found] == (["residual_exceeds_torque"] if lost else [])


# Words


def outcome(before, after, floor, **more):
    test = {"torque_std": [10.0] * len(before), "wls": before, "before": before, "after": after, "floor": floor}
    test["after_interval"] = [[0.9 * x, 1.1 * x] for x in after]
    return {
        "joints": ["a", "b"],
        "data": {"findings": []},
        "rmse": {"test": test},
        "effects": [],
        "unexplained": [],
        "nothing_to_add": False,
    } | more


def test_share_of_what_could_be_explained():
    assert explained_share(outcome([2.0, 1.0], [1.0, 1.0], [1.0, 1.0])) == pytest.approx(1)
    assert explained_share(outcome([2.0, 1.0], [2.0, 1.0], [1.0, 0.5])) == 0
    half = np.sqrt((4 + 1) / 2)
    assert explained_share(outcome([2.0, 1.0], [half, 1.0], [1.0, 1.0])) == pytest.approx(0.5)
    assert explained_share(outcome([2.0, 1.0], [half, 1.0], [1.0, None])) == pytest.approx(0.5)
    assert explained_share(outcome([2.0, 1.0], [1.0, 1.0], [1.0, 1.5])) == pytest.approx(1)
    assert explained_share(outcome([2.0, 1.0], [1.0, 1.0], [None, None])) is None
    assert explained_share(outcome([2.0, 1.0], [1.0, 1.0], [2.0, 1.5])) is None


def test_without_an_interval_the_error_itself_stands_against_the_floor():
    clean = outcome([2.0, 1.0], [2.0, 1.0], [1.0, 1.0], nothing_to_add=True)
    clean["rmse"]["test"]["after_interval"] = [None, None]
    assert "leaves on a is above the floor" in verdict(clean)


def test_verdicts():
    found = made_diagnosis.entry("load_dependent_friction", ["a"], [2.0, 1.0], [1.0, 1.0])
    text = verdict(outcome([2.0, 1.0], [1.0, 1.0], [1.0, 1.0], effects=[found]))
    assert text.startswith("One effect explains 100 % of what could be explained: load-dependent friction on a. ")
    assert "changes by -50 % to 0 %" in text
    small = made_diagnosis.entry("stribeck", ["b"], [2.0, 1.0], [2.0, 0.99]) | {
        "rmse_test_change_interval": [None, [-0.03, 0.01]]
    }
    text = verdict(outcome([2.0, 1.0], [1.0, 0.99], [1.0, 1.0], effects=[found, small]))
    assert text.startswith("One effect explains 100 % of what could be explained: load-dependent friction on a. ")
    assert " One more effect lowers no error by more than the noise: stribeck on b. On unseen runs" in text
    text = verdict(outcome([2.0, 1.0], [2.0, 0.99], [1.0, 1.0], effects=[small]))
    assert text.startswith("One effect lowers no error by more than the noise: stribeck on b. On unseen runs")
    text = verdict(outcome([2.0, 1.0], [2.0, 1.0], [1.0, 1.0], unexplained=[made_diagnosis.leftover("b", 0.3)]))
    assert text.startswith("Nothing in the catalogue of effects explains what the declared model leaves.")
    assert "Unknown: 30 % of the error's power on b is not noise, depending on q_b." in text
    clean = outcome([1.0, 1.0], [1.0, 1.0], [1.0, 1.0], nothing_to_add=True)
    assert verdict(clean).startswith("Nothing to add: on runs that it has not seen")


def test_experiments_follow_ties_and_leftovers():
    tied = made_diagnosis.entry(
        "stribeck", ["a"], [2.0], [1.0], ties=[made_diagnosis.tie("friction_hysteresis", "a", [1.0])]
    )
    result = outcome([2.0, 1.0], [1.0, 1.0], [1.0, 1.0], effects=[tied], unexplained=[made_diagnosis.leftover("b")])
    first, second = next_experiments(result)
    assert "`dynid excite ROBOT -o separate.csv --separate stribeck:a friction_hysteresis:a`" in first
    assert second == (
        "What is left on b depends on q_b: move b slowly and steadily through its whole range, there and back."
    )
    unknown = made_diagnosis.leftover("b", depends_on=[{"signal": "tau_link_a", "strength": 1.0, "direct": True}])
    (sentence,) = next_experiments(outcome([2.0, 1.0], [1.0, 1.0], [1.0, 1.0], unexplained=[unknown]))
    assert "known payload" in sentence
