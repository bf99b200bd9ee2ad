"""The face of the package: what `dir` shows, and what importing it does not import."""

import subprocess
import sys

import numpy as np
import pytest

import dynid_rs

HEAVY = {"scipy", "sklearn", "pyarrow", "plotly", "typer", "rich", "pandas", "polars", "matplotlib", "threadpoolctl"}
"""Nothing of these with the package itself: numpy and the compiled module, no more."""


def imported_by(code: str) -> set[str]:
    """Top names of all modules of a fresh interpreter that ran `code`."""
    asked = f"import sys\n{code}\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_dir_shows_what_there_is():
    assert dir(dynid_rs) == sorted(dynid_rs.__all__)
    assert len(set(dynid_rs.__all__)) == len(dynid_rs.__all__)


@pytest.mark.parametrize("name", dynid_rs.__all__)
def test_every_name_is_there_and_says_what_it_is(name):
    value = getattr(dynid_rs, name)
    assert getattr(dynid_rs, name) is value
    assert isinstance(value, str) or value.__doc__


def test_a_name_that_is_not_there():
    with pytest.raises(AttributeError, match="no attribute 'Recordng'"):
        _ = dynid_rs.Recordng


def test_importing_it_imports_numpy_and_little_else():
    assert not imported_by("import dynid_rs") & HEAVY
    modules = imported_by("import dynid_rs; dynid_rs.rmse([1.0], [2.0])")
    assert "numpy" in modules
    assert not modules & HEAVY


WITHOUT_PANDAS = """
class Hidden:
    def find_spec(name, path=None, target=None):
        if name in ("pandas", "polars"):
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Hidden)
import numpy as np, pyarrow as pa, dynid_rs
t = np.arange(100) / 100
frame = pa.table({"t": t, "q_0": np.sin(t), "tau_0": np.cos(t)})
run = dynid_rs.Recording.from_dataframe(frame)
run.to_dataframe("pyarrow"), run[0.2:0.8], repr(run), run._repr_html_()
"""


def test_data_frames_need_no_library_of_data_frames():
    """pyarrow itself looks for pandas, so that is hidden here instead of looked for."""
    assert not imported_by(WITHOUT_PANDAS) & (HEAVY - {"pyarrow"})


def test_rmse_is_one_number_per_joint():
    np.testing.assert_allclose(dynid_rs.rmse([[1.0, 2.0], [3.0, 2.0]], np.zeros((2, 2))), [5**0.5, 2.0])
