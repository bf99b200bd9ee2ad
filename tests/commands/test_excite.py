"""`dynid excite`: the limits file, what is written, what is printed, and what is refused."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from helpers import chromium
from helpers.small_arm import JOINTS, URDF, dynid, refusal, snapshot, write_robot
from helpers.tolerances import EXACT
from numpy.testing import assert_allclose

from dynid_rs import DataError, RobotModel
from dynid_rs.base.files import write_json
from dynid_rs.commands._excite_view import _constraint
from dynid_rs.commands.excite import Outputs
from dynid_rs.excitation import SelfCollision, WorkspaceBox
from dynid_rs.excitation.constraints import torque_bound
from dynid_rs.excitation.friction_plan import friction_plan
from dynid_rs.excitation.friction_segments import FrictionExperiment
from dynid_rs.excitation.limits_file import read_limits

QUICK = ("--duration", 8, "--restarts", 2, "--iterations", 10)
LIMITS = """
[units]
angle = "deg"
[position]
lower = [-90, -60, -100]
upper = {shoulder = 120, elbow = 50}
[velocity]
limit = {elbow = 60}
[acceleration]
limit = 150
[torque]
limit = [30, 40, 20]
[start]
position = [10, -20, 0]
"""


def robot():
    return RobotModel.from_urdf_string(URDF)


def limits_file(folder, text=LIMITS):
    path = folder / "limits.toml"
    path.write_text(text)
    return path


def read(folder, text):
    return read_limits(limits_file(folder, text), robot(), folder / "robot.urdf")


def columns(path):
    with path.open() as file:
        names = file.readline().strip().split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


@pytest.fixture(scope="module")
def design(tmp_path_factory):
    """A folder with robot.urdf, limits.toml and one design."""
    folder = tmp_path_factory.mktemp("design")
    printed = dynid("excite", write_robot(folder), "--limits", limits_file(folder), "-o", folder / "traj.csv", *QUICK)
    assert printed.exit_code == 0, printed.output
    return folder, printed


TABLE = """
angle = "rad"
gravity = [9.81, 0.0, 0.0]
[[joint]]
alpha = 0.0
a = 0.0
d = 0.2
theta = 0.0
lower = -1.0
upper = 1.0
velocity = 2.0
acceleration = 1.0
mass = 3.0
com = [0.1, 0.0, 0.0]
inertia_com = { xx = 0.01, yy = 0.02, zz = 0.02 }
"""


# The answer


def test_a_table_s_own_gravity_and_acceleration_are_kept(tmp_path):
    """On its side the only joint carries its link; upright it would not."""
    (tmp_path / "arm.toml").write_text(TABLE)
    folder = tmp_path / "out"
    folder.mkdir()
    options = (tmp_path / "arm.toml", "-o", folder / "plan.csv", *QUICK, "--force")
    result = json.loads(dynid("excite", *options, "--json").stdout)
    assert result["block_ranks"]["gravity"] == 2
    assert max(result["motion"]["acceleration"]["upper_limit"]) == 1.0
    assert max(result["motion"]["acceleration"]["highest"]) <= 1.0
    assert (
        json.loads(dynid("excite", *options, "--json", "--gravity", "0,0,-9.81").stdout)["block_ranks"]["gravity"] == 0
    )
    assert "needs the collision shapes of a URDF" in refusal(dynid("excite", *options, "--self-collision"))
    # A limits file need not repeat it, and may not go beyond.
    file = tmp_path / "limits.toml"
    file.write_text("[velocity]\nlimit = 1\n")
    assert read_limits(file, RobotModel.from_file(tmp_path / "arm.toml")).limits.acceleration.tolist() == [[-1], [1]]
    file.write_text("[acceleration]\nlimit = 3\n")
    assert "from -1 to 1 in the robot file" in refusal(dynid("excite", *options, "--limits", file))


def test_the_robot_s_own_effort_holds_where_nothing_else_is_said(tmp_path):
    text = "[acceleration]\nlimit = 5\n[torque]\nlimit = {wrist = 20}\n"
    bound = torque_bound(robot(), read(tmp_path, text).limits, np.zeros(3))
    assert bound.limits[1].tolist() == [80, 60, 20]  # of the URDF where the table names no other
    # A declared effort that does not hold the arm limits nothing, and that is said.
    (tmp_path / "weak.urdf").write_text(URDF.replace('effort="60"', 'effort="15"'))
    options = (tmp_path / "weak.urdf", "-o", tmp_path / "plan.csv", *QUICK)
    printed = " ".join(dynid("excite", *options).output.split())
    assert "note: torque is not limited at elbow (15 N*m): the declared effort does not hold the arm" in printed
    assert json.loads((tmp_path / "plan.json").read_text())["constraints"]["torque"]["upper"] == [80, None, 25]
    # Whether it does is asked where a motion starts: the friction experiment has another start than the file.
    weak = RobotModel.from_urdf(tmp_path / "weak.urdf")
    given = read_limits(limits_file(tmp_path, text + "[start]\nposition = [0, 1.5, 0]\n"), weak)
    assert torque_bound(weak, given.limits, given.start).limits[1].tolist() == [80, 15, 20]
    assert friction_plan(weak, given.limits).duration > 0


def test_the_help_says_where_searches_of_a_budget_are_kept():
    told = Outputs(Path("TRAJ.csv"), budget=60.0).states
    assert told[0].name in " ".join(dynid("excite", "--help").output.split())


def test_a_xacro_source_is_expanded_on_request(tmp_path):
    pytest.importorskip("xacro")
    source = tmp_path / "arm.xacro"
    source.write_text(URDF)
    options = (source, "-o", tmp_path / "plan.csv", *QUICK)
    assert "--xacro" in refusal(dynid("excite", *options))
    assert dynid("excite", *options, "--xacro").exit_code == 0


def test_a_controller_can_play_the_file(design):
    folder, _ = design
    table = columns(folder / "traj.csv")
    assert list(table) == ["t", *(f"{name}_{j}" for name in ("q", "dq", "ddq") for j in range(3))]
    assert table["t"].size == 8001
    assert_allclose(table["t"], np.arange(8001) / 1000, rtol=0, atol=1e-12)
    limits = read(folder, LIMITS).limits
    for j, start in enumerate(np.radians([10, -20, 0])):
        q, dq, ddq = (table[f"{name}_{j}"] for name in ("q", "dq", "ddq"))
        assert_allclose(q[[0, -1]], start, atol=1e-12)
        assert_allclose([dq[0], dq[-1], ddq[0], ddq[-1]], 0, atol=1e-12)
        for signal, (lower, upper) in ((q, limits.position), (dq, limits.velocity), (ddq, limits.acceleration)):
            assert signal.min() >= lower[j]
            assert signal.max() <= upper[j]
        assert_allclose(np.gradient(q, 1e-3)[1:-1], dq[1:-1], atol=1e-5)
        assert_allclose(np.gradient(dq, 1e-3)[1:-1], ddq[1:-1], atol=1e-4)


def test_the_figures_are_those_of_the_trajectory(design):
    folder, _ = design
    result = json.loads((folder / "traj.json").read_text())
    assert (result["format"], result["version"], result["joints"]) == ("dynid-trajectory", 1, list(JOINTS))
    table = columns(folder / "traj.csv")
    motion = [np.stack([table[f"{name}_{j}"] for j in range(3)], axis=1) for name in ("q", "dq", "ddq")]
    for name, signal in zip(("position", "velocity", "acceleration"), motion, strict=True):
        found = result["motion"][name]
        assert_allclose(found["lowest"], signal.min(axis=0), atol=1e-12)
        assert_allclose(found["highest"], signal.max(axis=0), atol=1e-12)
        assert (np.abs(signal).max(axis=0) <= found["eq17_bound"]).all()
    samples = [signal[:-1:100] for signal in motion]
    assert len(samples[0]) == 80
    arm = robot()
    base = arm.base_parameters()
    W = base.reduce(arm.joint_torque_regressor(*samples)).reshape(-1, base.n_base)
    assert_allclose(result["condition_number"], np.linalg.cond(W), rtol=1e-8)
    assert result["violations"] == 0
    assert result["whitened_condition_number"] is None
    tau = arm.inverse_dynamics(*motion)
    assert (np.abs(tau) <= [30, 40, 20]).all()
    assert_allclose(result["constraints"]["torque"]["greatest"], tau.max(axis=0), atol=1e-9)
    assert [restart["index"] for restart in result["restarts"]] == [0, 1]


def test_what_is_printed(design):
    folder, printed = design
    result = json.loads((folder / "traj.json").read_text())
    assert f"condition number of the base regressor: {result['condition_number']:.4g}" in printed.stdout
    for word in (
        "blocks: acceleration",
        "velocity",
        "gravity",
        "log det",
        "Eq. 17",
        "torque: kept",
        "traj.html",
        *JOINTS,
    ):
        assert word in printed.stdout
    assert printed.stderr == ""
    assert sorted(path.name for path in folder.iterdir()) == [
        "limits.toml",
        "robot.urdf",
        "traj.csv",
        "traj.html",
        "traj.json",
    ]


def test_the_page_stands_alone(design):
    folder, _ = design
    page = (folder / "traj.html").read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert "Content-Security-Policy" in page
    assert page.count('<div class="plot') == 9
    data = json.loads(page.split('id="report-data">')[1].split("</script>")[0])
    assert set(data["figures"]) == {
        f"{name}-{j}" for name in ("position", "velocity", "acceleration") for j in range(3)
    }
    drawn = [line for figure in data["figures"].values() for panel in figure["panels"] for line in panel["series"]]
    assert len(drawn) == 27
    assert {value for line in drawn for value in (line["x"], line["y"])} == set(data["arrays"])
    before_scripts = page.split("<script")[0]
    assert "http" not in before_scripts.replace("http-equiv", "")


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_the_page_keeps_nobody_out(design, width, scheme):
    with chromium.opened() as browser:
        sight = chromium.Sight(browser, design[0] / "traj.html", width=width, height=800, scheme=scheme)
        sight.unfold()
        assert sight.violations() == []
        assert sight.too_wide() == []
        assert sight.faults == []


def test_json_and_files_say_the_same(design, tmp_path):
    folder, _ = design
    path = tmp_path / "other.csv"
    arguments = (folder / "robot.urdf", "--limits", folder / "limits.toml", "-o", path, *QUICK, "--rate", 100)
    printed = dynid("excite", *arguments, "--jobs", 1, "--json")
    result = json.loads(printed.stdout)
    assert result == json.loads((tmp_path / "other.json").read_text())
    first = json.loads((folder / "traj.json").read_text())
    assert result["trajectory"] == first["trajectory"]  # the seed repeats it on any number of threads
    assert result["n_rows"] == len(columns(path)["t"]) == 801
    assert_allclose(columns(path)["q_1"], columns(folder / "traj.csv")["q_1"][::10], **EXACT)
    other = json.loads(dynid("excite", *arguments, "--seed", 1, "--force", "--json").stdout)
    assert other["trajectory"] != result["trajectory"]


def test_options_reach_the_design(design, tmp_path):
    folder, _ = design
    options = (
        "--criterion",
        "D",
        "--harmonics",
        3,
        "--start",
        "0.1,0.2,0.3",
        "--noise",
        "1,2,1",
        "--criterion-rate",
        20,
    )
    printed = dynid(
        "excite", folder / "robot.urdf", "-o", tmp_path / "a.csv", *QUICK, *options, "--gravity", "0,0,0", "--json"
    )
    result = json.loads(printed.stdout)
    assert (result["criterion"], result["n_harmonics"], result["rate_hz"]) == ("D", 3, 20.0)
    assert result["start"] == [0.1, 0.2, 0.3]
    assert len(result["trajectory"]["sin_coef"]) == 3
    assert result["whitened_condition_number"] is not None
    assert result["block_condition_numbers"]["gravity"] is None
    assert result["block_weights"] is None
    again = ("excite", folder / "robot.urdf", "-o", tmp_path / "a.csv", *QUICK, *options)
    before = snapshot(tmp_path)
    assert "a.csv: there is one already" in refusal(dynid(*again))
    assert snapshot(tmp_path) == before
    table = dynid(*again, "--force")
    assert "whitened" in table.stdout


def test_a_killed_design_goes_on(design, tmp_path, monkeypatch):
    folder, _ = design
    path, state = tmp_path / "traj.csv", tmp_path / "traj.restarts.json"
    arguments = ("excite", folder / "robot.urdf", "--limits", folder / "limits.toml", "-o", path, *QUICK, "--jobs", 1)

    def killed(place, obj):
        write_json(place, obj)
        raise KeyboardInterrupt

    monkeypatch.setattr("dynid_rs.excitation.search.write_json", killed)
    assert dynid(*arguments).exit_code == 130
    monkeypatch.undo()
    assert [path.name for path in tmp_path.iterdir()] == [state.name]
    kept = json.loads(state.read_text())["restarts"]
    assert len(kept) == 1

    refused = refusal(dynid(*arguments, "--resume", "--seed", 7))
    assert "belongs to another problem" in refused
    assert json.loads(state.read_text())["restarts"] == kept
    # A design that is refused, or that is killed before its first search ends, leaves them alone.
    refusal(dynid(*arguments, "--criterion", "E"))
    assert json.loads(state.read_text())["restarts"] == kept
    result = json.loads(dynid(*arguments, "--resume", "--json").stdout)
    assert result["restarts"][0]["cpu_s"] == kept[0]["cpu_s"]
    assert result["trajectory"] == json.loads((folder / "traj.json").read_text())["trajectory"]
    assert not state.exists()


def test_the_friction_experiment_keeps_the_same_limits(design, tmp_path):
    folder, _ = design
    path = tmp_path / "friction.csv"
    arguments = (folder / "robot.urdf", "--limits", folder / "limits.toml", "-o", tmp_path / "traj.csv", *QUICK)
    printed = dynid("excite", *arguments, "--friction", path, "--rate", 200)
    assert printed.exit_code == 0, printed.output
    assert str(path) in printed.stdout
    table, limits = columns(path), read(folder, LIMITS).limits
    plan = FrictionExperiment.from_json(json.loads(path.with_suffix(".json").read_text()))
    assert_allclose(table["t"][-1], plan.duration, atol=1e-9)
    motion = [np.stack([table[f"{name}_{j}"] for j in range(3)], axis=1) for name in ("q", "dq", "ddq")]
    for signal, planned, (lower, upper) in zip(
        motion, plan.evaluate(table["t"]), (limits.position, limits.velocity, limits.acceleration), strict=True
    ):
        assert_allclose(signal, planned, rtol=0, atol=1e-12)
        assert (signal >= lower - 1e-9).all()
        assert (signal <= upper + 1e-9).all()
    assert (np.abs(robot().inverse_dynamics(*motion)) <= [30, 40, 20]).all()
    # A middle that the arm cannot hold, or that is outside the box: no other start would help.
    for more, said in (
        ("[torque]\nlimit = [30, 10, 20]", "holding the start pose takes"),
        ("[torque]\nlimit = 99\n[workspace]\nlower = [-1, -1, 0.2]\nupper = [1, 1, 0.45]", "link hand is at"),
    ):
        text = LIMITS.replace("[torque]\nlimit = [30, 40, 20]", more).replace("[10, -20, 0]", "[0, -5, 0]")
        text = text.replace("[-90, -60, -100]", "[-90, -10, -100]").replace("elbow = 50", "elbow = 110")
        (tmp_path / "middle.toml").write_text(text)
        asked = (folder / "robot.urdf", "--limits", tmp_path / "middle.toml", "-o", tmp_path / "m.csv", *QUICK)
        refused = refusal(dynid("excite", *asked, "--friction", tmp_path / "mf.csv"))
        assert "starts in the middle of the position limits" in refused
        assert said in refused
        assert "--start" not in refused
    # A box that the legs leave, and names that collide.
    text = LIMITS + "[workspace]\nlower = [-1, -1, 0.2]\nupper = [1, 1, 0.45]\n"
    other = limits_file(tmp_path, text)
    arguments = ("excite", folder / "robot.urdf", "--limits", other, "-o", tmp_path / "other.csv", "--friction")
    assert "does not keep workspace" in refusal(dynid(*arguments, tmp_path / "x.csv"))
    assert "choose another name" in refusal(dynid(*arguments, tmp_path / "other.csv"))
    assert not (tmp_path / "x.csv").exists()


# The limits file


def test_limits_from_lists_numbers_and_names(tmp_path):
    found = read(tmp_path, LIMITS)
    limits = found.limits
    assert_allclose(limits.position[0], np.radians([-90, -60, -100]))
    assert_allclose(limits.position[1], [*np.radians([120, 50]), 2.0])  # not named: the robot's own
    assert_allclose(limits.velocity, [[-3, -np.radians(60), -4], [3, np.radians(60), 4]])
    assert_allclose(limits.acceleration, np.radians(150) * np.array([[-1] * 3, [1] * 3]))
    assert_allclose(limits.torque, [[-30, -40, -20], [30, 40, 20]])
    assert_allclose(found.start, np.radians([10, -20, 0]))
    assert found.constraints == ()


def test_units_and_sliding_joints(tmp_path):
    sliding = URDF.replace('name="elbow" type="revolute"', 'name="elbow" type="prismatic"')
    arm = RobotModel.from_urdf_string(sliding)
    text = '[units]\nangle = "deg"\nlength = "mm"\ntorque = "kN*m"\n[position]\nlimit = 90\n[velocity]\nlimit = 50\n'
    text += "[acceleration]\nlimit = 100\n[torque]\nlimit = {shoulder = 0.05}\n"
    limits = read_limits(limits_file(tmp_path, text), arm).limits
    assert_allclose(limits.position[1], [np.pi / 2, 0.09, np.pi / 2])
    assert_allclose(limits.velocity[1], [np.radians(50), 0.05, np.radians(50)])
    assert_allclose(limits.acceleration[1], [np.radians(100), 0.1, np.radians(100)])
    bound, still = torque_bound(arm, limits, np.zeros(3)), np.zeros((2, 3))
    assert_allclose(bound.limits[1], [50, 60, 25])
    kept = _constraint("torque", bound.report((still, still, still)))
    assert re.fullmatch(r"kept; \S+ \.\. \S+ N\*m, \S+ \.\. \S+ N, \S+ \.\. \S+ N\*m", kept), kept


def test_workspace_and_collision(tmp_path):
    text = '[units]\nlength = "mm"\n[acceleration]\nlimit = 2\n'
    text += "[workspace]\nlower = [-1000, -inf, 0]\nupper = [1000, inf, 2000]\n"
    text += 'links = ["hand"]\ntool = [0, 0, 100]\n[collision]\nmargin = 30\nignored = [["upper", "hand"]]\n'
    box, shapes = read(tmp_path, text).constraints
    assert box == WorkspaceBox((-1.0, -np.inf, 0.0), (1.0, np.inf, 2.0), ("hand",), (0.0, 0.0, 0.1))
    assert shapes == SelfCollision(tmp_path / "robot.urdf", 0.03, (("upper", "hand"),))
    (default,) = read(tmp_path, "[acceleration]\nlimit = 2\n[collision]\n").constraints
    assert default.margin == SelfCollision.margin


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[acceleration]\nlimit = 2\n[speed]\nlimit = 3", r"limits.toml, \[speed\]: this table is not known"),
        ("[aceleration]\nlimit = 2", "did you mean acceleration"),
        ("velocity = 3", "velocity: expected a table"),
        ("[acceleration]\nlimits = 2", "acceleration.limits: this key is not known; did you mean limit"),
        (
            '[units]\nangle = "grad"\n[acceleration]\nlimit = 2',
            "units.angle: the unit 'grad' is not known; choose one of rad, deg",
        ),
        ("[units]\nangle = 3\n[acceleration]\nlimit = 2", "units.angle: the unit 3 is not known"),
        ("[velocity]\nlimit = 2", r"\[acceleration\]: no limit for joint shoulder, and the robot file gives none"),
        ("[acceleration]\nlimit = {elbow = 2}", r"\[acceleration\]: no limit for joint shoulder"),
        ("[acceleration]\nlower = -2", "acceleration.upper: is missing; give lower and upper, or limit"),
        ("[acceleration]\nlimit = 2\nupper = 3", "acceleration: limit is for both directions; give it alone"),
        ("[acceleration]\nlimit = {elbo = 2}", "acceleration.limit.elbo: this joint is not known; did you mean elbow"),
        ("[acceleration]\nlimit = [1, 2]", "holds 2 numbers, and the robot has 3 joints"),
        ('[acceleration]\nlimit = "fast"', "expected numbers, got the text 'fast'"),
        ("[acceleration]\nlimit = true", "expected numbers, got True"),
        ("[acceleration]\nlimit = nan", "expected numbers, got nan"),
        ("[acceleration]\nlimit = inf", "expected numbers, got inf"),
        (
            "[acceleration]\nlimit = -6",
            "^limits.toml, acceleration.limit: expected numbers above 0, .* got -6 for joint shoulder$",
        ),
        (
            '[units]\nangle = "deg"\n[acceleration]\nlimit = [20, 0, 20]',
            "limits.toml, acceleration.limit: expected numbers above 0, for both directions, got 0 for joint elbow$",
        ),
        (
            '[units]\nangle = "deg"\n[acceleration]\nlimit = 20\n[velocity]\nlimit = {wrist = -7}',
            "limits.toml, velocity.limit: expected numbers above 0, for both directions, got -7 for joint wrist$",
        ),
        ("[acceleration]\nlimit = 2\n[torque]\nlimit = [9, -9, 9]", "torque.limit: .* got -9 for joint elbow$"),
        (
            "[acceleration]\nlimit = 2\n[position]\nlower = 1\nupper = -1",
            r"limits.toml, \[position\]: the lower limit of position of joint shoulder is 1 and the upper one -1; "
            "exchange or widen them$",
        ),
        (
            "[acceleration]\nlower = [-2, 1, -2]\nupper = 2",
            r"limits.toml, \[acceleration\]: the limits of acceleration of joint elbow are 1 and 2; zero must lie",
        ),
        (
            "[acceleration]\nlimit = 2\n[torque]\nlower = [-9, -9, 1]\nupper = 9",
            r"limits.toml, \[torque\]: the limits of torque of joint wrist are 1 and 9; zero must lie between them",
        ),
        (
            "[acceleration]\nlimit = 2\n[position]\nlimit = {elbow = 1e-4}",
            r"limits.toml, \[position\]: the position of joint elbow may only lie between -0.0001 and 0.0001",
        ),
        (
            "[acceleration]\nlimit = 2\n[start]\nposition = [0, 9, 0]",
            "limits.toml, start.position: the start of joint elbow is 9, outside its limits -2 and 2",
        ),
        ("[acceleration]\nlimit = 2\n[workspace]\nlower = [0, 0, 0]", "workspace.upper: is missing"),
        (
            "[acceleration]\nlimit = 2\n[workspace]\nlower = [0, 0]\nupper = [1, 1, 1]",
            "workspace.lower: expected three numbers",
        ),
        (
            '[acceleration]\nlimit = 2\n[workspace]\nlower = [0, 0, 0]\nupper = [1, 1, 1]\nlinks = ["hands"]',
            "this link is not known; did you mean hand",
        ),
        (
            "[acceleration]\nlimit = 2\n[workspace]\nlower = [0, 0, 0]\nupper = [1, 1, 1]\nlinks = 3",
            "expected a list of names",
        ),
        ('[acceleration]\nlimit = 2\n[collision]\nmargin = "2 cm"', "collision.margin: expected a distance"),
        ('[acceleration]\nlimit = 2\n[collision]\nignored = [["a"]]', "collision.ignored: expected pairs"),
        ("[acceleration]\nlimit = 2\n[collision]\nignored = 5", "collision.ignored: expected a list of names, got 5"),
        ("[acceleration]\nlimit = 2\n[start]\nposition = [1, 2]", "start.position: holds 2 numbers"),
        ("[acceleration\nlimit = 2", "is not valid TOML"),
    ],
)
def test_limits_files_that_make_no_sense_are_refused(tmp_path, text, words):
    with pytest.raises(DataError, match=words) as caught:
        read(tmp_path, text)
    assert caught.value.file == "limits.toml"


# Refusals of the command


def refused(folder, *arguments):
    before = snapshot(folder)
    sentence = refusal(dynid("excite", *arguments))
    assert snapshot(folder) == before, "something was written"
    return sentence


def test_refusals_are_one_sentence_and_write_nothing(tmp_path):
    urdf, limits, output = write_robot(tmp_path), limits_file(tmp_path), tmp_path / "traj.csv"

    def says(*arguments):
        return refused(tmp_path, *arguments)

    assert "give it the ending .csv" in says(urdf, "-o", tmp_path / "traj.txt")
    assert "create it first" in says(urdf, "-o", tmp_path / "nowhere" / "traj.csv")
    assert "does not exist" in says(tmp_path / "no.urdf", "-o", output)
    assert "does not exist" in says(urdf, "-o", output, "--limits", tmp_path / "no.toml")
    assert "criterion 'E' is not known" in says(urdf, "-o", output, "--criterion", "E")
    assert "--start must be 3 numbers" in says(urdf, "-o", output, "--start", "0,0")
    sentence = says(urdf, "-o", output, "--limits", limits, "--start", "9,0,0")
    assert sentence.startswith("the start of joint shoulder is 9, outside its limits")
    assert sentence.endswith("choose a --start between them")
    assert "--noise must be 3 numbers" in says(urdf, "-o", output, "--noise", "a,b,c")
    assert "--noise must be 3 positive" in says(urdf, "-o", output, "--noise", "1,0,1")
    assert "--duration must be" in says(urdf, "-o", output, "--duration", "-3")
    assert says(urdf, "-o", output, "--duration", "nan") == "--duration must be a positive number, got nan"
    assert "--rate must be" in says(urdf, "-o", output, "--rate", "0")
    assert "--jobs must be a whole number of at least 1, or -1 for one" in says(urdf, "-o", output, "--jobs", "0")
    assert "rows, expected fewer" in says(urdf, "-o", output, "--rate", "1e9")
    assert "--restarts must be" in says(urdf, "-o", output, "--restarts", 0)
    assert "no two collision shapes" in says(urdf, "-o", output, "--self-collision")
    limits.write_text("[acceleration]\nlimit = 2\n[position]\nlimit = {elbow = 1e-4}\n")
    assert "no room to move" in says(urdf, "-o", output, "--limits", limits)


def test_what_is_read_is_not_replaced(tmp_path):
    robot_csv = tmp_path / "robot.csv"
    robot_csv.write_text(URDF)
    assert "is read here and would be replaced" in refused(tmp_path, robot_csv, "-o", robot_csv)


def test_a_missing_library_is_said(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "pinocchio", None)
    sentence = refused(tmp_path, write_robot(tmp_path), "-o", tmp_path / "traj.csv", "--self-collision")
    assert sentence.endswith("pip install 'dynid-rs[collision]'")


def test_errors_reach_programs_too(tmp_path):
    printed = dynid("excite", write_robot(tmp_path), "-o", tmp_path / "traj.csv", "--criterion", "E", "--json")
    assert printed.exit_code == 2
    assert json.loads(printed.stdout)["error"]["class"] == "ValueError"


def test_limits_beyond_the_robot_file_are_refused(tmp_path):
    """Degrees without their unit would plan many turns."""
    text = LIMITS.replace('[units]\nangle = "deg"\n', "").replace("[start]\nposition = [10, -20, 0]\n", "")
    with pytest.raises(DataError, match=r"\[position\].*joint .* in the robot file.*is the unit degrees"):
        read(tmp_path, text)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--harmonics", 1), "--harmonics must be a whole number of at least 2, got 1"),
        (("--restarts", 0), "--restarts must be a whole number of at least 1, got 0"),
        (("--iterations", 0), "--iterations must be a whole number of at least 1, got 0"),
        (("--iterations", 2**63), f"--iterations must be at most 1000000, got {2**63}"),
        (("--restarts", 2**63), f"--restarts must be at most 1000000, got {2**63}"),
        (("--seed", -1), "--seed must be a whole number of at least 0, got -1"),
        (("--criterion-rate", 0), "--criterion-rate must be a positive number, got 0.0"),
        (("--rate", 0), "--rate must be a positive number of samples per second, got 0.0"),
        (("--duration", 1, "--criterion-rate", 2), "change --duration, --criterion-rate or --harmonics"),
    ],
    ids=lambda words: words[0] if isinstance(words, tuple) else "",
)
def test_what_is_refused_is_what_was_typed(tmp_path, words, said):
    refused = refusal(dynid("excite", write_robot(tmp_path), "-o", tmp_path / "t.csv", *words))
    assert refused.endswith(said)
