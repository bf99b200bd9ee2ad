"""The search for friction's threshold: what is tried beside the usual values."""

from types import SimpleNamespace

import numpy as np
import pytest

from dynid_rs.identification.friction import FrictionIdentifier

WIDTH, SPAN = 0.01, float(np.log(2.0))


class Valley(SimpleNamespace):
    """Power that is left, least at one threshold and hardly less a little off."""

    of_pairs, clean, top_speed, worth, threshold_worth = False, False, 2.0, 1e-3, 1e-2

    def __call__(self, threshold, width):
        return 1.0 - np.exp(-((np.log(threshold / self.at) / 0.05) ** 2)) if threshold > 0 else 1.0

    def best_threshold(self, best, width, least, span):
        return best, least


@pytest.mark.parametrize("off", [np.exp(0.2 * SPAN), np.exp(-0.6 * SPAN)])
def test_a_threshold_is_sought_again_about_the_one_that_there_is(off):
    """A valley between the usual values is seen from a threshold that stands near it, and only from there."""
    search = FrictionIdentifier()
    usual = search._thresholds(Valley(), WIDTH)
    valley = Valley(at=float(np.sqrt(usual[2] * usual[3])))
    near, at_best = search._threshold(valley, valley.at * off, WIDTH, 0.9, SPAN)
    assert near == pytest.approx(valley.at, rel=1e-9)
    assert at_best < 1e-9
    assert search._threshold(valley, 0.0, WIDTH, 1.0, SPAN) == (0.0, 1.0)
