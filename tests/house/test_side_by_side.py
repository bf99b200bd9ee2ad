"""How the test files are dealt to processes, and what is said of all of them together."""

import pytest
import side_by_side

FILES = sorted(side_by_side.HERE.rglob("test_*.py"))
LONG = [side_by_side.HERE / name for name in side_by_side.LONG]


@pytest.mark.parametrize("cores", [1, 2, 3, 64])
def test_every_file_is_run_once_beside_its_neighbours(cores):
    parts = side_by_side.shared_out(FILES, LONG, cores)
    assert sorted(path for part in parts for path in part) == FILES
    assert parts[: len(LONG)] == [[path] for path in LONG]
    dealt = parts[len(LONG) :]
    assert [path for part in dealt for path in part] == [path for path in FILES if path not in LONG]
    assert [len(part) for part in dealt] == sorted((len(part) for part in dealt), reverse=True)
    assert max(map(len, dealt)) <= max(len(FILES) / (3 * cores) + 1, side_by_side.LEAST)


def test_what_is_said_of_all_is_the_sum():
    texts = ["..\n2 passed in 0.10s\n", ".F\n1 failed, 1 passed, 2 warnings in 61.00s (0:01:01)\n", "1 warning in 0.1s"]
    assert side_by_side.told(texts) == "3 passed, 1 failed, 3 warning"


def test_one_bad_part_is_the_answer_and_nothing_to_do_is_none(tmp_path, monkeypatch, capsys):
    for name, text in (("test_good", "def test_it(): pass"), ("test_bad", "def test_it(): assert 0"), ("test_no", "")):
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.setattr(side_by_side, "HERE", tmp_path)
    monkeypatch.setattr(side_by_side, "LEAST", 1)
    assert side_by_side.main(["-p", "no:cacheprovider"]) == 1
    assert set(capsys.readouterr().out.splitlines()[-1].split(", ")) == {"1 failed", "1 passed"}
    (tmp_path / "test_bad.py").unlink()
    assert side_by_side.main(["-p", "no:cacheprovider"]) == 0


def test_a_process_has_one_core(tmp_path):
    """The variables are those that numpy's and scipy's libraries read."""
    allowed = int(side_by_side.ENVIRONMENT["OPENBLAS_NUM_THREADS"])
    path = tmp_path / "test_threads.py"
    path.write_text(
        "import numpy, scipy.linalg\nfrom threadpoolctl import threadpool_info\n"
        f"def test_threads():\n    assert {{pool['num_threads'] for pool in threadpool_info()}} <= {{{allowed}}}\n"
    )
    code, said = side_by_side._run([path], ["-p", "no:cacheprovider", f"--rootdir={tmp_path}"])
    assert code == 0, said
