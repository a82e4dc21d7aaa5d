"""Values computed once, and results that are made from their own fields."""

import gc
import pickle
import threading
import weakref
from dataclasses import replace

import numpy as np
import pytest

from grasp3d import SurfaceLabels, label_surface, load_mesh
from grasp3d.grasps import best_grasps
from grasp3d.surface.grasp_table import Deferred
from grasp3d.system.context import report_progress, running
from tests.helpers import shapes


def labels() -> SurfaceLabels:
    return label_surface(load_mesh(shapes.sphere(1), max_edge=9.0))


class Slow:
    """An attribute that takes a while."""

    def __init__(self) -> None:
        self.calls = 0

    @Deferred
    def value(self) -> int:
        """Seven."""
        self.calls += 1
        report_progress(0.5)
        threading.Event().wait(0.1)
        return 7

    @Deferred
    def failing(self) -> int:
        self.calls += 1
        raise ValueError("not yet") if self.calls < 2 else KeyError


def test_threads_compute_a_value_once() -> None:
    slow, together = Slow(), threading.Barrier(4)
    found: list[int] = []

    def read() -> None:
        together.wait()
        found.append(slow.value)

    assert "value" not in vars(slow)
    threads = [threading.Thread(target=read) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (found, slow.calls, vars(slow)["value"]) == ([7] * 4, 1, 7)
    assert Slow.value.__doc__ == "Seven."


def test_a_value_is_computed_with_progress_and_pickled() -> None:
    slow, fractions = Slow(), list[float]()
    with running(progress=fractions.append):
        assert (slow.value, slow.value) == (7, 7)
    assert fractions == [0.5]
    copy = pickle.loads(pickle.dumps(slow))  # noqa: S301
    assert (copy.value, copy.calls) == (7, 1)


def test_a_known_value_is_not_computed() -> None:
    slow = Slow()
    vars(slow)["value"] = 3
    assert (slow.value, slow.calls) == (3, 0)


def test_a_value_that_failed_is_computed_again() -> None:
    slow = Slow()
    with pytest.raises(ValueError, match="not yet"):
        _ = slow.failing
    with pytest.raises(KeyError):
        _ = slow.failing
    assert slow.calls == 2


def test_values_keep_nothing_alive() -> None:
    slow = Slow()
    assert slow.value == 7
    reference = weakref.ref(slow)
    gc.disable()
    try:
        del slow
        assert reference() is None
    finally:
        gc.enable()


def test_results_of_another_model_are_those_of_that_model() -> None:
    found = labels()
    model = replace(found.model, friction=0.05)
    assert np.isfinite(found.epsilon).all()
    changed = found.using(model=model)
    assert changed.computed("epsilon_range") is None
    np.testing.assert_array_equal(changed.label, found.relabel(friction=0.05).label)
    assert not np.array_equal(changed.epsilon, found.epsilon)
    grasps = best_grasps(found, 3)
    other = replace(grasps, model=replace(grasps.model, friction=0.05))
    assert not np.array_equal(other.epsilon, grasps.epsilon)


def test_results_are_pickled_with_what_was_computed() -> None:
    found = labels()
    assert len(found.epsilon) == len(found.label)
    copy = pickle.loads(pickle.dumps(found))  # noqa: S301
    assert copy.computed("epsilon_range") is not None
    np.testing.assert_array_equal(copy.epsilon, found.epsilon)
    assert repr(copy) == repr(found)
