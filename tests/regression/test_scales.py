"""Which gains of torque channels are estimated."""

import pytest

from dynid_rs.regression.scales import free_scales


def test_in_ampere_all_but_the_first_and_else_those_that_are_named():
    assert free_scales(3, True, ()).tolist() == [False, True, True]
    assert free_scales(3, False, ()).tolist() == [False, False, False]
    assert free_scales(3, False, (0, 2)).tolist() == [True, False, True]


@pytest.mark.parametrize("joints", [(-1,), (3,), (0, 1, 2)])
def test_a_joint_that_is_not_there_or_all_of_them_are_refused(joints):
    with pytest.raises(ValueError, match="free_gains must name joints from 0 to 2 and leave one"):
        free_scales(3, False, joints)
