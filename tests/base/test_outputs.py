"""What is written replaces files and nothing else, leaves nothing behind, and says so when nobody can take it."""

import errno
import os
import shutil
import signal
import socket
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.processes import DYNID, ENVIRONMENT, process
from helpers.small_arm import dynid, refusal, study

import dynid_rs.base.files as files
import dynid_rs.base.held as held
from dynid_rs import TorqueModel
from dynid_rs.base.files import atomic_path, filled_together, write_bytes, write_json, write_table, write_text
from dynid_rs.base.held import clear_leftovers, held_file

FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="no /dev/full on this system")


def make_device(place: Path) -> None:
    """The null device under another name: a write that went through would do no harm."""
    try:
        os.mknod(place, stat.S_IFCHR | 0o600, os.makedev(1, 3))
    except (PermissionError, AttributeError) as error:
        pytest.skip(f"device nodes cannot be made here: {error}")


def make_socket(place: Path) -> None:
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(place))


def make_link(place: Path) -> None:
    aim = place.with_name("precious")
    aim.write_text("not yours")
    place.symlink_to(aim)


IN_THE_WAY = {
    "device": (make_device, "this is a device"),
    "pipe": (os.mkfifo, "this is a pipe"),
    "socket": (make_socket, "this is a socket"),
    "link": (make_link, "precious; name the file it points to, or remove the link"),
    "link_to_nowhere": (lambda place: place.symlink_to("nowhere"), "this is a symbolic link to nowhere; "),
    "folder": (Path.mkdir, "this is a folder, where a file is to be written; "),
}


def nodes(folder: Path) -> dict[str, tuple[int, int, int]]:
    """Everything in `folder`: which node, of what kind, since when; pipes are not opened."""
    return {
        path.name: (path.lstat().st_ino, path.lstat().st_mode, path.lstat().st_mtime_ns) for path in folder.iterdir()
    }


@pytest.fixture(params=IN_THE_WAY)
def in_the_way(request, tmp_path):
    """Something that is no file and may not be replaced: makes it at a place, then checks a sentence about it."""
    make, words = IN_THE_WAY[request.param]
    made = []

    def put(name: str) -> Path:
        place = tmp_path / name
        make(place)
        made.append((place, nodes(tmp_path)))
        return place

    yield put, words
    for place, before in made:
        assert nodes(place.parent) == before
        aim = place.with_name("precious")
        assert not aim.exists() or aim.read_text() == "not yours"


def save_model(place: Path) -> None:
    TorqueModel.load(study().output / "model.json").save(place)


WRITERS = {
    "model": save_model,
    "text": lambda place: write_text(place, "x"),
    "bytes": lambda place: write_bytes(place, b"x"),
    "json": lambda place: write_json(place, {}),
    "table": lambda place: write_table(place, {}),
}


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_only_files_are_replaced(in_the_way, write):
    put, words = in_the_way
    place = put("out.parquet")
    with pytest.raises(OSError, match=r"out\.parquet: this is ") as refused:
        write(place)
    assert words in str(refused.value)


@pytest.mark.parametrize(("make", "words"), IN_THE_WAY.values(), ids=IN_THE_WAY)
def test_what_comes_in_the_way_while_it_is_written(make, words, tmp_path):
    place = tmp_path / "late"

    def write():
        with atomic_path(place) as temporary:
            temporary.write_text("x")
            make(place)

    with pytest.raises(OSError, match="late: this is ") as refused:
        write()
    assert words in str(refused.value)
    assert not stat.S_ISREG(place.lstat().st_mode)
    assert set(os.listdir(tmp_path)) <= {"late", "precious"}


def test_a_folder_is_filled_with_all_files_or_none(in_the_way, tmp_path):
    put, words = in_the_way
    (tmp_path / "a").write_text("old")
    put("b")

    def fill():
        with filled_together(tmp_path) as stage:
            for name in "abc":
                (stage / name).write_text("new")

    with pytest.raises(OSError, match=r"/b: ") as refused:
        fill()
    assert words in str(refused.value)
    assert (tmp_path / "a").read_text() == "old"


def test_a_full_disk_is_said_of_the_file_that_was_asked_for(tmp_path, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    def fill():
        with filled_together(tmp_path) as stage:
            write_text(stage / "result.json", "new")

    monkeypatch.setattr(files, "_sync", full)
    with pytest.raises(OSError, match="no space") as refused:
        fill()
    assert str(refused.value) == f"{tmp_path}/result.json: cannot write this file: no space left on device"
    assert refused.value.errno == errno.ENOSPC


COMMANDS = {
    "estimate": (
        "out.parquet",
        lambda place: ("estimate", study().output / "model.json", study().runs[0], "-o", place),
    ),
    "states": (
        "out.csv",
        lambda place: ("estimate", study().output / "model.json", study().runs[0], "--states", place),
    ),
    "c_header": ("out.h", lambda place: ("export", "--c-header", study().output / "model.json", "-o", place)),
    "urdf": ("out.urdf", lambda place: ("export", study().output / "model.json", "--urdf", place)),
    "excite": ("plan.csv", lambda place: ("excite", study().robot, "-o", place)),
    "excite_page": ("plan.html", lambda place: ("excite", study().robot, "-o", place.with_suffix(".csv"))),
    "friction": ("f.csv", lambda p: ("excite", study().robot, "-o", p.with_name("plan.csv"), "--friction", p)),
    "identify": ("model.json", lambda place: ("identify", study().robot, *study().runs, "-o", place.parent)),
    "diagnose": ("report.html", lambda place: ("diagnose", study().robot, *study().runs, "-o", place.parent)),
    "simulate": ("truth.json", lambda place: ("simulate", "-o", place.parent, "--duration", "5", "--runs", "1")),
    "simulated_robot": ("robot.urdf", lambda p: ("simulate", "-o", p.parent, "--duration", "5", "--runs", "1")),
}


@pytest.mark.parametrize(("name", "arguments"), COMMANDS.values(), ids=COMMANDS)
@pytest.mark.parametrize("kind", ["device", "pipe", "link"])
def test_commands_refuse_what_is_no_file(kind, name, arguments, tmp_path):
    make, words = IN_THE_WAY[kind]
    place = tmp_path / name
    make(place)
    before = nodes(tmp_path)
    sentence = refusal(dynid(*arguments(place)))
    assert sentence.startswith(f"{place}: this is ")
    assert words in sentence
    assert nodes(tmp_path) == before


def test_the_report_is_no_link(tmp_path):
    for name in ("result.json", "residuals.parquet"):
        shutil.copy(study().output / name, tmp_path / name)
    make_link(tmp_path / "report.html")
    assert "precious; name the file it points to" in refusal(dynid("report", tmp_path))
    assert (tmp_path / "precious").read_text() == "not yours"


def test_a_folder_may_be_reached_by_a_link(tmp_path):
    """Where results go is the user's own choice; on some systems all temporary folders are behind one."""
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    write_text(tmp_path / "link" / "a", "x")
    assert (tmp_path / "real" / "a").read_text() == "x"


ANSWERS = {
    "json": lambda: ("estimate", study().output / "model.json", study().runs[0], "--json"),
    "text": lambda: ("estimate", study().output / "model.json", study().runs[0]),
    "table": lambda: ("inspect", study().runs[0]),
    "version": lambda: ("--version",),
    "help": lambda: ("estimate", "--help"),
}


def into(stream: object, *arguments: object, stderr: object = subprocess.PIPE) -> subprocess.CompletedProcess[str]:
    """`dynid` with its standard output at `stream`."""
    command = [*DYNID, *map(str, arguments)]
    return subprocess.run(command, env=ENVIRONMENT, stdout=stream, stderr=stderr, text=True, timeout=240, check=False)


@needs_full
@pytest.mark.parametrize("answer", ANSWERS.values(), ids=ANSWERS)
def test_an_answer_into_a_full_disk(answer):
    """Exit code 1 would say that the answer is no."""
    with FULL.open("w") as full:
        done = into(full, *answer())
    assert done.stderr == (
        "error: standard output cannot be written (no space left on device), the answer is lost; "
        "send it to another place\n"
    )
    assert done.returncode == 2


@needs_full
def test_a_refusal_into_a_full_disk(tmp_path):
    with FULL.open("w") as full:
        done = into(full, "inspect", tmp_path / "none.csv", "--robot", tmp_path / "none", "--json")
        assert done.stderr == f"error: {tmp_path}/none: cannot read this file: it does not exist; check the path\n"
        assert done.returncode == 2
        assert into(full, "inspect", tmp_path / "none.csv", "--robot", tmp_path / "none", stderr=full).returncode == 2


def test_an_answer_for_a_closed_output():
    code = f"import os; os.close(1); os.execv({sys.executable!r}, [{sys.executable!r}, *__import__('sys').argv[1:]])"
    done = process("-m", "dynid_rs", "inspect", study().runs[0], "--json", code=code)
    assert done.stderr.startswith("error: standard output cannot be written (bad file descriptor)")
    assert done.returncode == 2


@pytest.mark.parametrize("answer", ANSWERS.values(), ids=ANSWERS)
def test_a_reader_that_left_says_nothing_about_the_answer(answer):
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = into(writing, *answer())
    finally:
        os.close(writing)
    assert (done.returncode, done.stderr) == (141, "")


def test_a_full_disk_elsewhere_is_not_blamed_on_the_output(tmp_path):
    """A nameless error of a library is not standard output's."""
    code = """if True:
        import errno, tempfile
        import dynid_rs.base.files as files
        def full(*args):
            tempfile.nameless()
        def nameless():
            raise OSError(errno.ENOSPC, "No space left on device")
        nameless = type(nameless)(nameless.__code__, {**globals(), "__name__": "multiprocessing.synchronize"})
        tempfile.nameless = nameless
        files.check_readable = full
        from dynid_rs.cli import main
        main()
    """
    done = process("estimate", tmp_path / "model.json", tmp_path / "run.csv", code=code)
    assert done.returncode == 2
    assert "standard output" not in done.stderr
    assert "No space left on device" in done.stderr


WRITING = """
import sys
from pathlib import Path
from dynid_rs.base.files import atomic_path, filled_together
folder = Path(sys.argv[1])
with filled_together(folder) as stage, atomic_path(stage / "a.json") as inner, atomic_path(folder / "b.csv") as outer:
    inner.write_text("half")
    outer.write_text("half")
    print("writing", flush=True)
    sys.stdin.read()
"""


def writer_in(folder: Path) -> subprocess.Popen[str]:
    """A process in the middle of writing into `folder`."""
    child = subprocess.Popen(
        [sys.executable, "-c", WRITING, str(folder)],
        env=ENVIRONMENT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout.readline() == "writing\n"
    return child


def test_the_next_run_clears_what_a_killed_one_left_and_nothing_else(tmp_path):
    for name in (".dynid-notes", ".dynid-0123456789", "dynid-0123456789ab", ".dynid-0123456789abc.json"):
        (tmp_path / name).write_text("somebody's own")
    (tmp_path / ".dynid-0123456789ab").symlink_to(tmp_path / ".dynid-notes")
    foreign = sorted(os.listdir(tmp_path))
    with writer_in(tmp_path) as killed, writer_in(tmp_path) as alive:
        killed.send_signal(signal.SIGKILL)
        killed.wait()
        left = set(os.listdir(tmp_path)) - set(foreign)
        assert len(left) == 4  # a folder and a file of each
        write_json(tmp_path / "result.json", {})
        kept = set(os.listdir(tmp_path)) - set(foreign) - {"result.json"}
        assert len(kept) == 2
        assert kept < left
        assert sorted(path.name.count(".") for path in map(Path, kept)) == [1, 2]
        alive.communicate("go on")
        assert alive.returncode == 0
    assert sorted(os.listdir(tmp_path)) == sorted([*foreign, "result.json", "a.json", "b.csv"])
    assert (tmp_path / ".dynid-notes").read_text() == "somebody's own"


def test_a_killed_identification_leaves_nothing_for_the_next(tmp_path):
    code = """if True:
        import os, signal
        import dynid_rs.base.files as files
        def write_table(*args):
            os.kill(os.getpid(), signal.SIGKILL)
        files.write_table = write_table
        from dynid_rs.cli import main
        main()
    """
    arguments = ("identify", study().robot, *study().runs, "-o", tmp_path / "out", "--residual", "none")
    assert process(*arguments, code=code).returncode == -signal.SIGKILL
    (left,) = os.listdir(tmp_path / "out")
    assert left.startswith(".dynid-")
    dynid(*arguments)
    assert sorted(os.listdir(tmp_path / "out")) == ["model.json", "report.html", "residuals.parquet", "result.json"]


def test_a_name_that_is_taken_for_a_leftover_is_given_up(tmp_path, monkeypatch):
    """Another process clears between the making of a file and its lock: the file is gone, and another one is made."""
    opened, taken = held._opened, []

    def opened_late(path):
        if not taken and path.exists():
            taken.append(path)
            path.unlink()
        return opened(path)

    monkeypatch.setattr(held, "_opened", opened_late)
    with held_file(tmp_path, ".json") as path:
        assert path != taken[0]
        assert path.exists()
    assert os.listdir(tmp_path) == []


def test_what_another_process_is_clearing_is_given_up(tmp_path, monkeypatch):
    """Here the other process has the lock already, and removes the file in a moment."""
    lock, tried = held._lock, []

    def taken_at_first(descriptor):
        tried.append(descriptor)
        if len(tried) == 1:
            raise BlockingIOError
        lock(descriptor)

    monkeypatch.setattr(held, "_lock", taken_at_first)
    with held_file(tmp_path, ".json") as path:
        (lost,) = set(tmp_path.iterdir()) - {path}
    assert len(tried) == 2
    assert os.listdir(tmp_path) == [lost.name]


def test_without_locks_nothing_is_cleared(tmp_path, monkeypatch):
    def no_locks(descriptor):
        raise OSError("not supported")

    left = tmp_path / ".dynid-0123456789ab.json"
    left.write_text("")
    monkeypatch.setattr(held, "_lock", no_locks)
    write_text(tmp_path / "a", "x")
    assert sorted(os.listdir(tmp_path)) == [left.name, "a"]
    monkeypatch.undo()
    clear_leftovers(tmp_path)
    assert os.listdir(tmp_path) == ["a"]


def test_writers_in_python_and_rust_clear_after_each_other(tmp_path):
    """A model is written by the Rust side, under the same names and locks."""
    with writer_in(tmp_path) as killed, writer_in(tmp_path) as alive:
        killed.send_signal(signal.SIGKILL)
        killed.wait()
        assert len(os.listdir(tmp_path)) == 4
        save_model(tmp_path / "model.json")
        left = [path for path in tmp_path.iterdir() if path.name.startswith(".dynid-")]
        assert sum(path.is_file() for path in left) == 1  # folders are left to the Python side
        alive.communicate("go on")
        assert alive.returncode == 0
    write_text(tmp_path / "a.json", "x")
    assert sorted(os.listdir(tmp_path)) == ["a.json", "b.csv", "model.json"]
