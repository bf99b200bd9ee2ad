"""Logs as other programs write them: thirty variants of the same runs of a small arm, by other libraries than ours."""

from __future__ import annotations

import bz2
import csv
import gzip
import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from helpers.small_arm import JOINTS, run

EPOCH = 1_700_000_000_123_456_789
DEGREE = 180.0 / np.pi


def columns_of(k: int, *, rate: float = 100.0, duration: float = 8.0):
    """Time (n,), q, dq and tau (n, 3) of run `k`."""
    columns = run(k, rate=rate, duration=duration, velocity=True)
    matrices = [np.stack([columns[f"{signal}_{j}"] for j in range(3)], axis=1) for signal in ("q", "dq", "tau")]
    return columns["t"], *matrices


def table(k, t="t", q="q_{i}", tau="tau_{i}", dq=None, *, time=1.0, angle=1.0, start=0, joints=JOINTS):
    """Columns by name, in the order that most programs write: time, then signal by signal."""
    stamps, position, velocity, torque = columns_of(k)
    ticks = stamps * time if start == 0 else start + np.round(stamps * time).astype(np.int64)
    found = {t: ticks}
    for name, values in ((q, position * angle), (dq, velocity * angle), (tau, torque)):
        for i, joint in enumerate(joints if name else ()):
            found[name.format(i=i, n=i + 1, joint=joint)] = values[:, i]
    return found


def text(columns, delimiter=",", *, comma=False, units=None, before="", end="\n", decimals=None):
    """Text by the csv module of Python."""
    stream = io.StringIO()
    writer = csv.writer(stream, delimiter=delimiter, lineterminator=end)
    writer.writerow(columns)
    if units:
        writer.writerow(units)

    def shown(value):
        word = (
            str(value) if isinstance(value, str | int) else repr(value) if decimals is None else f"{value:.{decimals}f}"
        )
        return word.replace(".", ",") if comma else word

    lists = [values if isinstance(values, list) else values.tolist() for values in columns.values()]
    writer.writerows([shown(value) for value in row] for row in zip(*lists, strict=True))
    return before + stream.getvalue()


def _text_file(suffix, make, encoding="utf-8", pack=None):
    def write(folder, k):
        path = folder / f"run_{k}{suffix}"
        data = make(k).encode(encoding)
        path.write_bytes(pack(data) if pack else data)
        return path

    return write


def _zstd(data):
    import pyarrow as pa

    return pa.Codec("zstd").compress(data, asbytes=True)


def _iso(k):
    columns = table(k)
    stamps = np.datetime64("2024-05-01T12:00:00") + np.round(columns["t"] * 1e6).astype("timedelta64[us]")
    return text({"timestamp": [f"{stamp}Z" for stamp in stamps]} | {n: v for n, v in columns.items() if n != "t"})


def _rtde(k):
    t, q, dq, tau = columns_of(k)
    columns = {"timestamp": 1234.5 + t}
    for name, values in (("actual_q", q), ("actual_qd", dq), ("actual_current", tau / 10), ("target_moment", tau)):
        columns |= {f"{name}_{i}": values[:, i] for i in range(3)}
    return text(columns, " ")


def _franka(k):
    t, q, dq, tau = columns_of(k)
    columns = {"time": [int(stamp) for stamp in np.round(t * 1e3)], "success_rate": np.ones(len(t))}
    for name, values in (
        ("state.q", q),
        ("state.dq", dq),
        ("state.tau_J", tau),
        ("state.tau_ext_hat_filtered", 0 * tau),
    ):
        columns |= {f"{name}[{i}]": values[:, i] for i in range(3)}
    return text(columns)


def _lines(k):
    t, q, _, tau = columns_of(k)
    rows = ({"t": a, "q": b, "tau": c} for a, b, c in zip(t.tolist(), q.tolist(), tau.tolist(), strict=True))
    return "".join(json.dumps(row) + "\n" for row in rows)


def _parquet(folder, k):
    import pyarrow as pa
    import pyarrow.parquet as pq

    t, q, _, tau = columns_of(k)
    stamps = pa.array(EPOCH + np.round(t * 1e9).astype(np.int64), type=pa.timestamp("ns", tz="UTC"))
    path = folder / f"run_{k}.parquet"
    pq.write_table(pa.table({"timestamp": stamps, "q": pa.array(q.tolist()), "effort": pa.array(tau.tolist())}), path)
    return path


def _feather(folder, k):
    import pyarrow as pa
    import pyarrow.feather as feather

    path = folder / f"run_{k}.feather"
    feather.write_feather(pa.table(table(k)), path, compression="zstd")
    return path


def _xlsx(folder, k):
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["made on a Tuesday"])
    sheet = book.create_sheet("Run")
    columns = table(k, "Time (ms)", "Axis {n} [deg]", "Torque {n} [Nm]", time=1e3, angle=DEGREE)
    sheet.append(list(columns))
    for row in zip(*(values.tolist() for values in columns.values()), strict=True):
        sheet.append(row)
    path = folder / f"run_{k}.xlsx"
    book.save(path)
    return path


def _hdf5(folder, k):
    import h5py

    t, q, dq, tau = columns_of(k)
    path = folder / f"run_{k}.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("arm/joints")
        for name, values in (("t", t), ("q", q), ("dq", dq), ("tau", tau)):
            group.create_dataset(name, data=values, compression="gzip")
        file["elsewhere"] = h5py.ExternalLink("/etc/passwd", "/")
    return path


def _mat5(folder, k):
    from scipy.io import savemat

    t, q, _, tau = columns_of(k)
    path = folder / f"run_{k}.mat"
    savemat(path, {"log": {"time": t[:, None], "q": q, "tau": tau, "name": "small arm"}}, do_compression=True)
    return path


def _mat73(folder, k):
    import hdf5storage

    t, q, _, tau = columns_of(k)
    path = folder / f"run_{k}.mat"
    hdf5storage.savemat(str(path), {"t": t, "q": q, "tau": tau}, format="7.3", store_python_metadata=False)
    return path


def _npz(folder, k):
    t, q, _, tau = columns_of(k)
    path = folder / f"run_{k}.npz"
    np.savez_compressed(path, t=t, q=q, tau=tau)
    return path


def joint_states(k, shuffle=True):
    """Messages of run `k`: stamp [ns], names, position, velocity, effort; the order of the joints changes."""
    t, q, dq, tau = columns_of(k)
    rng = np.random.default_rng(k)
    for row, stamp in enumerate(t):
        order = rng.permutation(3) if shuffle else np.arange(3)
        names = [JOINTS[j] for j in order]
        yield EPOCH + round(stamp * 1e9), names, q[row, order], dq[row, order], tau[row, order]


def _bag1(folder, k):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    state, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    time = store.types["builtin_interfaces/msg/Time"]
    path = folder / f"run_{k}.bag"
    with Writer(path) as bag:
        connection = bag.add_connection("/joint_states", state.__msgtype__, typestore=store)
        gripper = bag.add_connection("/gripper/joint_states", state.__msgtype__, typestore=store)
        for number, (stamp, names, *values) in enumerate(joint_states(k)):
            head = header(number, time(*divmod(stamp, 10**9)), "")
            message = state(head, names, *values)
            bag.write(connection, stamp + 2_000_000, store.serialize_ros1(message, state.__msgtype__))
            other = state(head, ["finger"], np.ones(1), np.zeros(0), np.zeros(0))
            bag.write(gripper, stamp + 3_000_000, store.serialize_ros1(other, state.__msgtype__))
    return path


def _bag2(folder, k):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    time = store.types["builtin_interfaces/msg/Time"]
    path = folder / f"bag_{k}"
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        connection = bag.add_connection("/joint_states", state.__msgtype__, typestore=store)
        for stamp, names, *values in joint_states(k):
            message = state(header(time(*divmod(stamp, 10**9)), ""), names, *values)
            bag.write(connection, stamp, store.serialize_cdr(message, state.__msgtype__))
    return path


JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def write_mcap(path, publishers, *, in_order=False, packed=True):
    """MCAP by Foxglove's library: topic -> messages; `in_order`: of arrival, as they stand."""
    from mcap.writer import CompressionType
    from mcap_ros2.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(
            stream, compression=CompressionType.ZSTD if packed else CompressionType.NONE, enable_crcs=packed
        )
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for topic, messages in publishers.items():
            for number, (stamp, names, position, velocity, effort) in enumerate(messages):
                seconds, rest = divmod(stamp, 10**9)
                message = {
                    "header": {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": ""},
                    "name": list(names),
                    **{n: v.tolist() for n, v in (("position", position), ("velocity", velocity), ("effort", effort))},
                }
                writer.write_message(
                    topic, schema, message, log_time=EPOCH + number if in_order else stamp, publish_time=stamp
                )
        writer.finish()
    return path


def _mcap(folder, k):
    return write_mcap(folder / f"run_{k}.mcap", {"/joint_states": joint_states(k)})


def _lerobot(folder, k):
    import pyarrow as pa
    import pyarrow.parquet as pq

    root = folder / f"set_{k}"
    (root / "meta").mkdir(parents=True)
    (root / "data" / "chunk-000").mkdir(parents=True)
    motors = [f"{joint}.pos" for joint in JOINTS]
    features = {
        "observation.state": {"dtype": "float32", "shape": [3], "names": motors},
        "observation.effort": {"dtype": "float32", "shape": [3], "names": list(JOINTS)},
        "action": {"dtype": "float32", "shape": [3], "names": motors},
    }
    (root / "meta" / "info.json").write_text(json.dumps({"codebase_version": "v3.0", "fps": 100, "features": features}))
    t, q, _, tau = columns_of(k)
    episode = (np.arange(len(t)) >= len(t) // 2).astype(np.int64)
    frame = np.concatenate([np.arange(np.sum(episode == e)) for e in (0, 1)])

    def fixed(values):
        return pa.FixedSizeListArray.from_arrays(pa.array(values.astype(np.float32).ravel()), 3)

    columns = {"observation.state": fixed(q), "observation.effort": fixed(tau), "action": fixed(q)}
    columns |= {"timestamp": (frame / 100).astype(np.float32), "frame_index": frame, "episode_index": episode}
    pq.write_table(pa.table(columns), root / "data" / "chunk-000" / "file-000.parquet")
    return root


def _diadem(folder, k):
    t, q, _, tau = columns_of(k)
    n, channels = len(t), []
    data = np.concatenate([(q * DEGREE).T.ravel(), tau.T.ravel()])
    names = [("AxisAct", "Grad", i) for i in range(3)] + [("TorqueAxisAct", "Nm", i) for i in range(3)]
    data.astype("<f8").tofile(folder / f"TRACE_{k}.R64")
    head = f"#BEGINCHANNELHEADER\n200,Zeit\n202,s\n210,IMPLIZIT\n220,{n}\n240,0\n241,0.01\n#ENDCHANNELHEADER\n"
    for place, (name, unit, i) in enumerate(names):
        fields = f"200,{name}_A{i + 1}\n202,{unit}\n210,EXPLIZIT\n211,trace_{k}.r64\n213,CHANNEL\n214,REAL64\n"
        channels.append(f"#BEGINCHANNELHEADER\n{fields}220,{n}\n221,{place * n + 1}\n240,0\n241,1\n#ENDCHANNELHEADER\n")
    path = folder / f"TRACE_{k}.dat"
    path.write_bytes(("DIAEXTENDED  {@:ENGLISH\n" + head + "".join(channels)).encode("cp1252"))
    return path


def _bz2(data):
    return bz2.compress(data)


@dataclass(frozen=True)
class Variant:
    """One kind of log: how it is `written`, which `way` it takes (plain, init, refused), and what is `said`."""

    write: Callable[[Path, int], Path]
    way: str = "plain"
    said: str = ""


VARIANTS = {
    "ur rtde, spaces, currents": Variant(_text_file(".txt", _rtde), said="target_moment is the controller's own model"),
    "libfranka, ms": Variant(_text_file(".csv", _franka), said="libfranka counts time in ms"),
    "kuka rsi, degrees": Variant(
        _text_file(
            ".csv", lambda k: text(table(k, "IPOC", "AIPos.A{n}", "GearTorque.A{n}", time=1e3, angle=DEGREE), ";")
        ),
        said="RSI sends angles in degrees",
    ),
    "kuka trace, .dat and .r64": Variant(_diadem, "init", "angle in deg"),
    "abb, signal logger": Variant(
        _text_file(
            ".log",
            lambda k: text(
                table(k, "Time [s]", "ROB_1 Axis {n} Position [deg]", "ROB_1 Axis {n} Torque [Nm]", angle=DEGREE), "\t"
            ),
        ),
        "init",
        "angle in deg",
    ),
    "fanuc, percent of what": Variant(
        _text_file(
            ".csv", lambda k: text(table(k, "Time (s)", "J{n} Position (deg)", "J{n} Torque (%)", angle=DEGREE))
        ),
        "refused",
        "is in percent of a rated torque or current that the file does not hold",
    ),
    "yaskawa, letters": Variant(
        _text_file(
            ".csv",
            lambda k: text(
                table(k, "time_ms", "{joint}_ACT_POS_deg", "{joint}_TORQUE_NM", time=1e3, angle=DEGREE, joints="SLU")
            ),
        ),
        "init",
        "angle in deg",
    ),
    "ros 1 bag, two publishers": Variant(_bag1, said="read from /joint_states; other joint states are left out"),
    "ros 2 bag, sqlite3, shuffled": Variant(_bag2),
    "ros 2 mcap, shuffled": Variant(_mcap),
    "lerobot v3, episodes": Variant(_lerobot, said="2 parts"),
    "parquet, lists and timestamps": Variant(_parquet),
    "feather": Variant(_feather),
    "csv, semicolons and decimal commas": Variant(
        _text_file(".csv", lambda k: text(table(k), ";", comma=True)), said="decimal commas"
    ),
    "tsv, comments, units in a row": Variant(
        _text_file(
            ".tsv",
            lambda k: text(
                table(k, time=1e3, angle=DEGREE),
                "\t",
                units=["ms", *["deg"] * 3, *["Nm"] * 3],
                before="# a comment\n\n",
            ),
        ),
        said="time in ms, angle in deg",
    ),
    "aligned by spaces, preamble": Variant(
        _text_file(
            ".txt",
            lambda k: "Controller XYZ\nDate: 1 May\n\n" + text(table(k), " ", decimals=9).replace(" ", "   "),
        )
    ),
    "csv, BOM and CRLF, sep= line": Variant(
        _text_file(".csv", lambda k: text(table(k), ";", before="sep=;\r\n", end="\r\n"), "utf-8-sig")
    ),
    "csv.gz, epoch in ns": Variant(
        _text_file(".csv.gz", lambda k: text(table(k, "timestamp_ns", start=EPOCH, time=1e9)), pack=gzip.compress)
    ),
    "csv.zst, ISO 8601": Variant(_text_file(".csv.zst", _iso, pack=_zstd)),
    "json lines": Variant(_text_file(".jsonl", _lines)),
    "workbook, second sheet": Variant(_xlsx, "init", "read from sheet Run of 2"),
    "hdf5, groups": Variant(_hdf5),
    "matlab 5, structure": Variant(_mat5),
    "matlab 7.3": Variant(_mat73),
    "npz": Variant(_npz),
    "time in us, nobody says so": Variant(_text_file(".csv", lambda k: text(table(k, time=1e6))), "init", "it seems"),
    "degrees, nobody says so": Variant(
        _text_file(".csv", lambda k: text(table(k, angle=DEGREE, dq="dq_{i}"))), "init", "looks like degrees"
    ),
    "joints from one, other names": Variant(
        _text_file(".csv", lambda k: text(table(k, "Zeit", "Istposition_A{n}", "Istmoment_A{n}"), ";", comma=True)),
        "init",
    ),
    "plotjuggler": Variant(
        _text_file(
            ".csv",
            lambda k: text(
                table(
                    k,
                    "__time",
                    "/joint_states/{joint}/position",
                    "/joint_states/{joint}/effort",
                    "/joint_states/{joint}/velocity",
                )
            ),
        ),
        said="read as PlotJuggler writes it",
    ),
    "csv.bz2": Variant(
        _text_file(".csv.bz2", lambda k: text(table(k)), pack=_bz2), "refused", "the suffix .bz2 is not known"
    ),
}
"""Thirty kinds of log; two cannot be read, and say what to do."""
