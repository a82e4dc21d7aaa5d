import threading

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.arrays import computed, locked, used_indices


@given(st.lists(st.integers(0, 30)))
def test_used_indices_are_the_distinct_ones_in_order(values: list[int]) -> None:
    indices = np.array(values, dtype=np.int64)
    found = used_indices(indices)
    assert found.tolist() == sorted(set(values))
    assert found.dtype == np.int64
    if len(values) % 2 == 0:
        np.testing.assert_array_equal(used_indices(indices.reshape(-1, 2)), found)


def test_only_arrays_that_nobody_can_change_are_not_copied() -> None:
    given = np.arange(6.0).reshape(2, 3)
    one = locked(given)
    assert not one.flags.writeable
    assert locked(one) is one
    assert locked(one, np.float64) is one
    for other in (given, one.T, one[:1], np.broadcast_to(one, (2, 2, 3))):
        copy = locked(other)
        np.testing.assert_array_equal(copy, other)
        assert not np.shares_memory(copy, other)
        assert not copy.flags.writeable
        assert copy.flags.c_contiguous
    assert locked(one, np.int64).dtype == np.int64


def test_a_property_of_one_object_can_be_read_while_that_of_another_is_computed() -> None:
    """Before Python 3.12 a cached property has one lock for all instances."""
    begun, go_on = threading.Event(), threading.Event()

    class Slow:
        def __init__(self, *, waits: bool) -> None:
            self.waits = waits

        @computed
        def value(self) -> int:
            begun.set()
            assert not self.waits or go_on.wait(60.0)
            return 1

    slow = Slow(waits=True)
    worker = threading.Thread(target=lambda: slow.value)
    worker.start()
    assert begun.wait(60.0)
    assert Slow(waits=False).value == 1
    go_on.set()
    worker.join()
    assert vars(slow)["value"] == slow.value == 1
