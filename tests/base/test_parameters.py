"""Parameters by name: the protocol of scikit-learn's estimators, without importing it."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import sklearn.base
from sklearn.exceptions import NotFittedError

from dynid_rs.base.estimator import Estimator, clone
from dynid_rs.regression.is_fitted import check_is_fitted


class Inner(Estimator):
    def __init__(self, size: int = 3, *, start: object = None) -> None:
        self.size = size
        self.start = start


class Outer(Estimator):
    def __init__(self, inner: Inner | None = None, ridge: float = 0.1) -> None:
        self.inner = inner
        self.ridge = ridge


def test_parameters_are_read_and_set_through_estimators_inside() -> None:
    outer = Outer(Inner(size=5), ridge=2.0)
    assert outer.get_params() == {
        "inner": outer.inner,
        "inner__size": 5,
        "inner__start": None,
        "ridge": 2.0,
    }
    assert set(outer.get_params(deep=False)) == {"inner", "ridge"}
    assert outer.set_params(inner__size=7, ridge=1.0) is outer
    assert outer.inner is not None
    assert (outer.inner.size, outer.ridge) == (7, 1.0)
    with pytest.raises(ValueError, match="Outer has no parameter 'rigde', only inner, ridge"):
        outer.set_params(rigde=1.0)
    assert repr(outer) == "Outer(inner=Inner(size=7, start=None), ridge=1.0)"


@pytest.mark.parametrize("copy_of", [clone, sklearn.base.clone])
def test_a_clone_has_learned_nothing_and_shares_nothing(copy_of: object) -> None:
    outer = Outer(Inner(start=np.arange(3.0)))
    outer.learned_ = 1.0  # type: ignore[attr-defined]
    copy = copy_of(outer)  # type: ignore[operator]
    assert type(copy) is Outer
    assert not hasattr(copy, "learned_")
    assert copy.inner is not outer.inner
    copy.inner.start[0] = 9.0
    assert outer.inner is not None
    assert list(outer.inner.start) == [0.0, 1.0, 2.0]


def test_what_is_not_fitted_says_so() -> None:
    with pytest.raises(NotFittedError, match="This Inner instance is not fitted yet; call fit"):
        check_is_fitted(Inner(), "learned_")


def test_nothing_slow_is_imported_for_a_diagnosis() -> None:
    """scikit-learn and scipy's statistics take a second and fifty megabytes, and a diagnosis needs neither."""
    code = (
        "import sys; import dynid_rs.diagnosis.loop, dynid_rs.commands.diagnose, dynid_rs.commands._identifier; "
        "print(*{'sklearn', 'scipy.stats', 'pyarrow'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
