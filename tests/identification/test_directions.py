"""By which parameters a model may be off: what counts as known makes the others no less known."""

from types import SimpleNamespace

import numpy as np
from numpy.testing import assert_allclose

from dynid_rs import _core
from dynid_rs.identification.directions import _given, _unseen


def test_the_others_are_as_well_known_as_beside_what_is_known():
    """A block of the precision's inverse, not of the covariance."""
    rng = np.random.default_rng(0)
    root = rng.standard_normal((9, 9))
    precision = root @ root.T + np.eye(9)
    known, others = np.array([2, 5, 8]), np.array([0, 1, 3, 4, 6, 7])
    given = _given(np.linalg.inv(precision), known)
    assert_allclose(given[np.ix_(others, others)], np.linalg.inv(precision[np.ix_(others, others)]), rtol=1e-9)
    assert not given[known].any()
    assert not given[:, known].any()


def test_two_that_are_nearly_one_leave_the_other_known():
    """Friction that remembers beside Coulomb's: their sum is known within a hundredth, and alone each within 1."""
    sum_, difference = np.array([1.0, 1.0]) / np.sqrt(2), np.array([1.0, -1.0]) / np.sqrt(2)
    covariance = 1e-4 * np.outer(sum_, sum_) + np.outer(difference, difference)
    assert_allclose(_given(covariance, np.array([1]))[0, 0], 2e-4, rtol=1e-3)


def test_nothing_known_changes_nothing():
    covariance = np.diag([1.0, 4.0])
    assert_allclose(_given(covariance, np.array([], dtype=int)), covariance)


def test_effects_with_memory_or_of_the_load_count_as_known_on_every_joint():
    n = 2
    coulomb = _core.Effect.of("smooth_friction", transition_width=[0.01] * n, sharpness=[2.0] * n)
    remembers = _core.Effect.of("friction_hysteresis", presliding_distance=[1e-3] * n)
    plan = SimpleNamespace(
        robot=SimpleNamespace(n_joints=n),
        effects=[coulomb, remembers],
        n_base=5,
        n_own=coulomb.n_columns + remembers.n_columns,
    )
    first = 5 + coulomb.n_columns
    assert _unseen(plan).tolist() == [first, first + plan.n_own]
