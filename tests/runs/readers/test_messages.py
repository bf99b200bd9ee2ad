"""Messages of ROS as rows: the joints' names and the two halves of a stamp stand beside the numbers."""

import json

import numpy as np
import pytest
from helpers.log_files import columns_of, joint_states, text
from helpers.small_arm import JOINTS, dynid, write_robot

from dynid_rs import RobotModel
from dynid_rs.base.errors import DataError
from dynid_rs.runs.readers import Config, read_config, read_recording, read_run

FIELDS = ("name", "position", "velocity", "effort")


def rostopic(messages, form="field.{field}{k}", time="%time"):
    """Columns as `rostopic echo -p` writes them."""
    columns = {time: [stamp for stamp, *_ in messages]}
    for field, values in zip(FIELDS, zip(*(message[1:] for message in messages), strict=True), strict=True):
        for k in range(len(values[0])):
            columns[form.format(field=field, k=k)] = [row[k] if field == "name" else float(row[k]) for row in values]
    return columns


def write_rostopic(folder, messages=None, **form):
    path = folder / "run.csv"
    path.write_text(text(rostopic(list(joint_states(0)) if messages is None else messages, **form)))
    return path


def write_json(folder, messages, stamp):
    path = folder / "run.jsonl"
    rows = ({"header": {"stamp": stamp(t)}} | dict(zip(FIELDS, map(list, rest), strict=True)) for t, *rest in messages)
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


def write_frame(folder, messages, suffix):
    import pyarrow as pa
    import pyarrow.feather as feather
    import pyarrow.parquet as pq

    path = folder / f"run{suffix}"
    columns = dict(zip(("t", *FIELDS), zip(*messages, strict=True), strict=True))
    frame = pa.table({name: pa.array([c if name == "t" else list(c) for c in v]) for name, v in columns.items()})
    (pq.write_table if suffix == ".parquet" else feather.write_feather)(frame, path)
    return path


WRITTEN = {
    "rostopic": write_rostopic,
    "brackets": lambda folder: write_rostopic(folder, form="/joint_states/{field}[{k}]"),
    "json lines": lambda folder: write_json(folder, joint_states(0), lambda stamp: stamp),
    "parquet": lambda folder: write_frame(folder, joint_states(0), ".parquet"),
    "feather": lambda folder: write_frame(folder, joint_states(0), ".feather"),
}


@pytest.mark.parametrize("write", WRITTEN.values(), ids=WRITTEN)
def test_joints_are_those_that_every_row_names(write, tmp_path):
    """Their order changes from message to message; the rules of `dynid init` hold for any order."""
    path, robot = write(tmp_path), write_robot(tmp_path)
    written = dynid("init", robot, path, "--yes", "-o", tmp_path / "dynid.toml")
    assert written.exit_code == 0, written.output
    assert "name in the same row" in written.output
    assert "{joint}" in (tmp_path / "dynid.toml").read_text()
    run = read_run(path, RobotModel.from_urdf(robot), read_config(tmp_path / "dynid.toml"))
    _, q, dq, tau = columns_of(0)
    np.testing.assert_array_equal(run.recording.q, q)
    np.testing.assert_array_equal(run.recording.dq, dq)
    np.testing.assert_array_equal(run.recording.tau, tau)


def test_a_frame_is_read_by_the_joints_that_it_names():
    import pyarrow as pa

    frame = pa.table({name: pa.array(values) for name, values in rostopic(list(joint_states(0)), time="t").items()})
    rules = Config(columns={"q": "field.position_{joint}", "tau": "field.effort_{joint}"}, units={"time": "ns"})
    np.testing.assert_array_equal(read_recording(frame, JOINTS, rules).q, columns_of(0)[1])


@pytest.mark.parametrize(
    ("names", "match"),
    [(["a", "b", "c"], "row 8 .line 9.: names the joints a, b, c; expected those of the first row, "), (None, "once")],
)
def test_rows_that_name_other_joints_are_refused(names, match, tmp_path):
    messages = list(joint_states(0, shuffle=False))
    for row in range(len(messages)) if names is None else (7,):
        messages[row] = (messages[row][0], names or ["elbow", "elbow", "wrist"], *messages[row][2:])
    with pytest.raises(DataError, match=match):
        read_recording(write_rostopic(tmp_path, messages), JOINTS)


def test_rules_by_number_are_told_the_rule_by_name(tmp_path):
    """They were right for one order of the message only."""
    rules = Config(columns={"q": "field.position{i}", "tau": "field.effort_{joint}"}, units={"time": "ns"})
    with pytest.raises(DataError, match=r'write in dynid.toml: \[columns\] q = "field.position_\{joint\}"'):
        read_recording(write_rostopic(tmp_path), JOINTS, rules)


def test_names_that_a_format_does_not_give_are_a_question(tmp_path):
    """A workbook's cells are read as numbers."""
    import openpyxl

    columns, book = rostopic(list(joint_states(0)), time="time"), openpyxl.Workbook()
    columns["time"] = columns_of(0)[0].tolist()
    book.active.append(list(columns))
    for row in zip(*columns.values(), strict=True):
        book.active.append(row)
    book.save(tmp_path / "run.xlsx")
    written = dynid("init", write_robot(tmp_path), tmp_path / "run.xlsx", "--yes", "-o", tmp_path / "dynid.toml")
    assert written.exit_code == 1, written.output
    assert "error: run.xlsx: field.name- names the joints of each column" in written.output
