"""Steps of the search that have nothing to do leave what is believed as it is, and fit nothing anew."""

from helpers.diagnosed import ROBOT, measured

from dynid_rs.diagnosis.belief import Belief
from dynid_rs.diagnosis.search import merge
from dynid_rs.diagnosis.setup import Setup


def test_where_nothing_is_named_nothing_is_put_in_its_place():
    belief = Belief.in_declared(Setup(ROBOT), measured(duration=8.0, n_runs=2))
    fit = belief.fit
    assert merge(belief) is False
    assert belief.fit is fit
