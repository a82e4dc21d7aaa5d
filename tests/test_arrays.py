import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.arrays import used_indices


@given(st.lists(st.integers(0, 30)))
def test_used_indices_are_the_distinct_ones_in_order(values: list[int]) -> None:
    indices = np.array(values, dtype=np.int64)
    found = used_indices(indices)
    assert found.tolist() == sorted(set(values))
    assert found.dtype == np.int64
    if len(values) % 2 == 0:
        np.testing.assert_array_equal(used_indices(indices.reshape(-1, 2)), found)
