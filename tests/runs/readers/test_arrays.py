"""Columns of arrays: which side is time, told by a vector of it or by what most of them share."""

from dynid_rs.runs.readers.arrays import columns_of


def test_without_a_time_vector_samples_are_what_most_arrays_share():
    columns, n = columns_of({"q": (40, 3), "tau": (40, 3)}, "run.npz")
    assert n == 40
    assert sorted(columns) == ["q_0", "q_1", "q_2", "tau_0", "tau_1", "tau_2"]


def test_a_time_vector_says_it_whatever_others_share():
    columns, n = columns_of({"t": (40,), "q": (3, 40), "a": (3, 3), "b": (3, 3)}, "run.npz")
    assert n == 40
    assert sorted(columns) == ["q_0", "q_1", "q_2", "t"]
    assert columns["q_1"].across
