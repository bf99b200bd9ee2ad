"""`dynid watch`: what has changed on runs, in lines and as JSON."""

import json
import re
from dataclasses import replace

import pytest
from helpers.run_files import write
from helpers.small_arm import dynid, refusal
from helpers.watched_arm import CHANGES, model, recorded, write_runs

from dynid_rs.commands._rates import per_day
from dynid_rs.commands._watch_files import WatchFiles


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """The model and its runs: two healthy ones, one more, one with a change at 20 s, and one with it all along."""
    folder = tmp_path_factory.mktemp("watched")
    model().save(folder / "model.json")
    change = CHANGES["friction grown"][0]
    runs = {
        "first": recorded(40.0, 1),
        "second": recorded(40.0, 2),
        "same": recorded(60.0, 3),
        "harder": recorded(60.0, 5, change=change, at=20.0),
        "worn": recorded(60.0, 7, change=change),
    }
    write_runs(folder, runs)
    return folder


def watched(arm, *runs, options=()):
    healthy = ("--healthy", arm / "first.parquet", "--healthy", arm / "second.parquet")
    return dynid("watch", arm / "model.json", *(arm / f"{run}.parquet" for run in runs), *healthy, *options)


def test_nothing_has_changed_on_another_run(arm):
    printed = watched(arm, "same")
    assert printed.exit_code == 0, printed.output
    assert printed.stdout.splitlines()[0] == "same.parquet: nothing has changed"


def test_a_change_is_said_with_its_joint_and_ends_with_1(arm):
    printed = watched(arm, "same", "harder", options=["--json"])
    assert printed.exit_code == 1, printed.output
    answer = json.loads(printed.stdout)
    assert (answer["format"], answer["version"], answer["changed"]) == ("dynid-watch", 1, True)
    same, changed = answer["runs"]
    assert same["changes"] == []
    named, settled = changed["changes"]
    assert (named["kind"], named["joint"], named["said"]) == ("friction", answer["joints"][1], "named")
    assert settled["size"] == pytest.approx(0.2, rel=0.1)
    assert all(0.5 < part <= 1.0 for part in changed["watched"])
    lines = watched(arm, "harder")
    assert lines.exit_code == 1
    assert re.search(rf"{answer['joints'][1]}: friction \+(19|20|21|22) % .* \(settled\)", lines.stdout)


def test_what_was_seen_before_a_run_that_cannot_be_read_is_said(arm, tmp_path):
    torn = recorded(10.0, 1)
    columns = {"t": torn.t}
    for j in range(torn.n_joints):
        columns |= {f"q_{j}": torn.q[:, j] + 100.0 * (torn.t > 5), f"tau_{j}": torn.tau[:, j]}
    path = write(tmp_path / "torn.parquet", columns)
    known = tmp_path / "known.json"
    printed = watched(arm, "harder", path.with_suffix(""), "same", options=["--remember", known])
    assert printed.exit_code == 2
    assert printed.stderr.startswith("error: torn.parquet")
    assert "friction +" in printed.stdout
    assert "same.parquet" not in printed.stdout
    assert not known.exists()  # the same command again begins where this one did
    answer = json.loads(watched(arm, "harder", path.with_suffix(""), options=["--json"]).stdout)
    assert answer["changed"]
    assert answer["error"]["file"] == "torn.parquet"


def test_a_run_that_cannot_be_watched_is_not_said_to_be_the_same(arm):
    still = recorded(10.0, 1)
    columns = {"t": still.t}
    for j in range(still.n_joints):
        columns |= {f"q_{j}": 0.3 + 0 * still.q[:, j], f"tau_{j}": still.tau[:, j]}
    write(arm / "still.parquet", columns)
    printed = watched(arm, "still")
    assert printed.exit_code == 0
    assert "still.parquet: could not be watched" in printed.stdout
    assert json.loads(watched(arm, "still", options=["--json"]).stdout)["changed"] is None


def test_a_frozen_channel_is_named_and_not_refused(arm):
    """As online; without healthy runs, which say how long a value lasts, it is damage."""
    run = recorded(40.0, 3)
    tau = run.tau.copy()
    tau[5000:10_000, 1] = tau[5000, 1]
    write_runs(arm, {"frozen": replace(run, tau=tau)})
    printed = watched(arm, "frozen", options=["--json"])
    assert printed.exit_code == 1, printed.output
    answer = json.loads(printed.stdout)
    (named, withdrawn) = answer["runs"][0]["changes"]
    assert (named["kind"], named["joint"], named["said"]) == ("frozen", answer["joints"][1], "named")
    assert 10.0 < named["t"] < 11.0
    assert withdrawn["said"] == "withdrawn"
    assert not [one for one in answer["findings"] if one["code"] == "stuck"]
    assert "frozen.parquet: tau_1 stays at" in refusal(dynid("watch", arm / "model.json", arm / "frozen.parquet"))


def test_an_encoder_that_slipped_is_named_and_not_refused(arm):
    run = recorded(60.0, 3)
    q = run.q.copy()
    q[run.t >= 20.0, 1] += 0.3
    write_runs(arm, {"slipped": replace(run, q=q)})
    assert "q_1 jumps by" in dynid("inspect", arm / "slipped.parquet").output
    printed = watched(arm, "slipped", options=["--json"])
    assert printed.exit_code == 1, printed.output
    answer = json.loads(printed.stdout)
    named = answer["runs"][0]["changes"][0]
    assert (named["kind"], named["joint"], named["said"]) == ("slip", answer["joints"][1], "named")
    assert 0.2 < named["size"] < 0.45
    assert not [one for one in answer["findings"] if one["code"] == "position_jump"]


def test_a_slip_of_before_does_not_excuse_another_jump(arm, tmp_path):
    """Ten samples that are off, in the run after the slip: a load and gains were told of them."""
    run, later = recorded(60.0, 3), recorded(40.0, 4)
    q, after = run.q.copy(), later.q.copy()
    q[run.t >= 20.0, 1] += 0.3
    after[:, 1] += 0.3
    after[5000:5010, 1] += 0.5
    write_runs(arm, {"slipped": replace(run, q=q), "spike": replace(later, q=after)})
    options = ("--remember", tmp_path / "state.json")
    assert watched(arm, "slipped", options=options).exit_code == 1
    kept = (tmp_path / "state.json").read_bytes()
    assert "spike.parquet: q_1 jumps by" in refusal(watched(arm, "spike", options=options))
    assert (tmp_path / "state.json").read_bytes() == kept


def test_what_is_tolerated_is_not_said(arm):
    assert watched(arm, "harder", options=["--tolerate", "friction=0.3", "--tolerate", "gain=.3"]).exit_code == 0


def test_without_healthy_runs_the_model_says_what_is_usual(arm):
    assert dynid("watch", arm / "model.json", arm / "same.parquet").exit_code == 0
    assert dynid("watch", arm / "model.json", arm / "harder.parquet").exit_code == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--false-alarms", "often"), "--false-alarms: expected a number above 0 per hour, day, week, month, year"),
        (("--false-alarms", "0/day"), "--false-alarms: expected a number above 0 per hour"),
        (("--false-alarms", "1/00days"), "--false-alarms: expected"),
        (
            ("--tolerate", "wear=1"),
            "expected KIND=X, a kind of friction, gain, offset, load, delay, slip, unknown and a",
        ),
        (("--tolerate", "gain=-1"), "--tolerate: expected"),
        (("--tolerate", "gain"), "--tolerate: expected"),
        (("--tolerate", "load=1", "--tolerate", "load=2"), "--tolerate load is given twice; give it once"),
    ],
)
def test_wrong_options_are_refused_in_a_sentence(arm, options, words):
    assert words in refusal(watched(arm, "same", options=options))


@pytest.mark.parametrize("command", ["watch", "contact"])
def test_healthy_runs_that_teach_nothing_are_said_with_their_option(arm, tmp_path, command):
    """The sentence began with `fit`, which no command line has."""
    healthy = []
    for seed in (1, 2):
        short = recorded(2.0, seed)
        columns = {"t": short.t}
        for j in range(short.n_joints):
            columns |= {f"q_{j}": 0.3 + (1e-3 * short.q[:, j]), f"tau_{j}": short.tau[:, j]}
        healthy += ["--healthy", write(tmp_path / f"short_{seed}.parquet", columns)]
    said = refusal(dynid(command, arm / "model.json", arm / "same.parquet", *healthy))
    assert said.startswith("--healthy short_1.parquet, short_2.parquet: no joint moves "), said


def test_a_healthy_run_of_another_robot_is_said_with_its_option(arm, tmp_path):
    other = recorded(2.0, 1, unit="A")
    columns = {"t": other.t}
    for j in range(other.n_joints):
        columns |= {f"q_{j}": other.q[:, j], f"current_{j}": other.tau[:, j]}
    healthy = write(tmp_path / "other.parquet", columns)
    said = refusal(dynid("watch", arm / "model.json", arm / "same.parquet", "--healthy", healthy))
    assert said == "--healthy other.parquet: holds torque in A, the model gives N*m"


@pytest.mark.parametrize(
    ("text", "times"), [("1/day", 1.0), ("2/week", 2 / 7), (" 1 / 2weeks", 1 / 14), (".5/hour", 12.0)]
)
def test_false_alarms_are_read(text, times):
    assert per_day(text, "--false-alarms") == pytest.approx(times)


def test_settings_are_saved_once_and_used_again(arm, tmp_path):
    settings = tmp_path / "watch.json"
    written = watched(arm, options=["--save", settings, "--tolerate", "friction=0.15"])
    assert written.exit_code == 0, written.output
    assert written.stdout.endswith(f"settings: {settings}\n")
    again = dynid("watch", arm / "model.json", arm / "harder.parquet", "--settings", settings)
    assert again.exit_code == 1
    learned = watched(arm, "harder", options=["--tolerate", "friction=0.15"])
    assert again.stdout.splitlines()[:3] == learned.stdout.splitlines()[:3]
    assert "(settled)" in again.stdout
    assert json.loads(settings.read_text())["tolerated"]["friction"] == 0.15
    both = watched(arm, "same", options=["--save", settings])
    assert both.stdout.splitlines()[0] == "same.parquet: nothing has changed"
    assert both.stdout.endswith(f"settings: {settings}\n")


def test_settings_and_what_they_say_do_not_go_together(arm, tmp_path):
    settings = tmp_path / "watch.json"
    watched(arm, options=["--save", settings])
    alone = refusal(dynid("watch", arm / "model.json"))
    assert "no run to watch" in alone
    assert "--settings says all" in refusal(watched(arm, "same", options=["--settings", settings]))
    assert not refusal(
        dynid("watch", arm / "model.json", arm / "same.parquet", "--settings", arm / "model.json")
    ).count("\n")


def test_what_is_read_is_never_replaced(arm):
    for name in ("model.json", "first.parquet", "same.parquet"):
        before = (arm / name).read_bytes()
        assert "is read here and would be replaced" in refusal(watched(arm, "same", options=["--save", arm / name]))
        assert (arm / name).read_bytes() == before
    assert "does not exist; create it first" in refusal(watched(arm, options=["--save", arm / "none" / "watch.json"]))


def test_runs_go_on_from_one_another_where_it_is_remembered(arm, tmp_path):
    known = tmp_path / "known.json"
    first = watched(arm, "harder", options=["--remember", known])
    assert "(settled)" in first.stdout
    assert known.exists()
    again = watched(arm, "worn", options=["--remember", known])
    assert "worn.parquet: nothing new" in again.stdout, again.stdout
    assert again.exit_code == 0
    assert "(settled)" in watched(arm, "worn").stdout
    both = watched(arm, "harder", "worn", options=["--remember", tmp_path / "other.json"])
    assert both.stdout.count("(settled)") == 1
    assert "worn.parquet: nothing new" in both.stdout
    refused = refusal(watched(arm, "same", options=["--remember", known, "--tolerate", "gain=0.2"]))
    assert str(known) in refused
    assert "of another model, or of a watch with other settings" in refused
    assert "is read here and would be replaced" in refusal(
        watched(arm, "same", options=["--remember", arm / "model.json"])
    )
    known.write_text("{}")
    assert str(known) in refusal(watched(arm, "same", options=["--remember", known]))
    assert known.read_text() == "{}"


ANEW = "name another file, or remove this one to begin anew"


@pytest.mark.parametrize("content", ["t,q_0\n0,1\n", "[1, 2]", '"text"', "null", "  \n"])
def test_what_is_no_json_object_is_said_to_be_none(arm, tmp_path, content):
    """The sentence named types of the program and a line of which nothing was wrong."""
    path = tmp_path / "known.json"
    path.write_text(content)
    said = refusal(watched(arm, "same", options=["--remember", path]))
    assert said == f"{path}: not what a watch remembers: it is no JSON object; {ANEW}"
    said = refusal(dynid("watch", arm / "model.json", arm / "same.parquet", "--settings", path))
    mend = "write it anew with `dynid watch MODEL.json --save`"
    assert said == f"{path}: not a watch's settings: it is no JSON object; {mend}"
    said = refusal(dynid("contact", arm / "model.json", arm / "same.parquet", "--settings", path))
    mend = "write it anew with `dynid contact MODEL --healthy RUN --save`"
    assert said == f"{path}: not an observer's uncertainty: it is no JSON object; {mend}"
    assert path.read_text() == content


def test_what_is_not_remembered_is_refused_with_one_mend(arm, tmp_path):
    known = tmp_path / "known.json"
    known.write_text("{}")
    said = refusal(watched(arm, "same", options=["--remember", known]))
    assert said == f"{known}: not what a watch remembers: missing field `format` at line 1 column 2; {ANEW}"
    known.unlink()
    assert watched(arm, "same", options=["--remember", known]).exit_code == 0
    said = refusal(watched(arm, "same", options=["--remember", known, "--tolerate", "gain=0.2"]))
    assert said == f"{known}: of another model, or of a watch with other settings; {ANEW}"
    whole = json.loads(known.read_text())
    known.write_text(json.dumps(whole | {"numbers": whole["numbers"][:-1]}))
    said = refusal(watched(arm, "same", options=["--remember", known]))
    assert said == f"{known}: numbers that no watch remembers; {ANEW}"


def test_what_stood_before_a_call_stands_at_its_end(arm, tmp_path):
    """Prometheus' text of a call in which nothing is said says what an earlier one has said."""
    known, prom = tmp_path / "known.json", tmp_path / "state.prom"
    joint = model().robot.joint_names[1]
    line = re.compile(rf'^dynid_watch_change_ratio{{robot="[^"]*",joint="{joint}",kind="friction"}} (\S+)$', re.M)
    watched(arm, "harder", options=["--remember", known, "--prometheus", prom])
    first = float(line.search(prom.read_text())[1])
    assert first == pytest.approx(0.2, rel=0.1)
    later = watched(arm, "worn", options=["--remember", known, "--prometheus", prom])
    assert "worn.parquet: nothing new" in later.stdout
    assert float(line.search(prom.read_text())[1]) == pytest.approx(first, rel=1e-9)


def test_what_stood_before_is_said_and_is_no_news(arm, tmp_path):
    known = tmp_path / "known.json"
    watched(arm, "harder", options=["--remember", known])
    later = watched(arm, "worn", options=["--remember", known])
    assert later.exit_code == 0
    joint = model().robot.joint_names[1]
    said = rf"^worn.parquet: nothing new\n  stood before: {joint}: friction \+(19|20|21|22) % "
    assert re.search(said, later.stdout, re.M), later.stdout
    answer = json.loads(watched(arm, "worn", options=["--remember", known, "--json"]).stdout)
    (before,) = answer["runs"][0]["before"]
    assert (before["kind"], before["joint"], before["said"]) == ("friction", joint, "settled")
    assert (answer["runs"][0]["changes"], answer["changed"]) == ([], False)


def test_what_could_not_be_said_is_not_known_yet(arm, tmp_path):
    """Where another file cannot be written, the same command says the same again."""
    known, folder = tmp_path / "known.json", tmp_path / "none"
    folder.mkdir()
    options = ["--remember", known, "--prometheus", folder / "state.prom"]
    whole = WatchFiles.write
    with pytest.MonkeyPatch.context() as patch:

        def refused(*arguments):
            whole(*arguments)
            raise OSError("no space is left")

        patch.setattr(WatchFiles, "write", refused)
        assert watched(arm, "harder", options=options).exit_code == 2
    assert not known.exists()
    assert "(settled)" in watched(arm, "harder", options=options).stdout
    assert known.exists()
