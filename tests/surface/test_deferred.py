"""Values computed once, and results that are made from their own fields."""

import pickle
import threading
from dataclasses import replace

import numpy as np

from grasp3d import SurfaceLabels, label_surface, load_mesh
from grasp3d.grasps import best_grasps
from grasp3d.surface.deferred import Deferred
from grasp3d.system.progress import Progress
from tests.helpers import shapes


def labels() -> SurfaceLabels:
    return label_surface(load_mesh(shapes.sphere(1), max_edge=9.0))


def test_threads_compute_a_value_once() -> None:
    calls: list[int] = []
    together = threading.Barrier(4)

    def function(_: Progress) -> int:
        calls.append(1)
        threading.Event().wait(0.1)
        return 7

    deferred, found = Deferred(function), []

    def read() -> None:
        together.wait()
        found.append(deferred.value)

    assert deferred.computed is None
    threads = [threading.Thread(target=read) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (found, len(calls), deferred.computed) == ([7] * 4, 1, 7)


def test_results_of_another_model_are_those_of_that_model() -> None:
    found = labels()
    model = replace(found.model, friction=0.05)
    assert np.isfinite(found.epsilon).all()
    changed = replace(found, model=model)
    assert changed.deferred_epsilon.computed is None
    np.testing.assert_array_equal(changed.label, found.relabel(friction=0.05).label)
    assert not np.array_equal(changed.epsilon, found.epsilon)
    grasps = best_grasps(found, 3)
    other = replace(grasps, model=replace(grasps.model, friction=0.05))
    assert not np.array_equal(other.epsilon, grasps.epsilon)


def test_results_are_pickled_with_what_was_computed() -> None:
    found = labels()
    assert len(found.epsilon) == len(found.label)
    copy = pickle.loads(pickle.dumps(found))  # noqa: S301
    assert copy.deferred_epsilon.computed is not None
    np.testing.assert_array_equal(copy.epsilon, found.epsilon)
    assert repr(copy) == repr(found)


def test_results_are_printed_in_three_lines() -> None:
    found = labels()
    for result in (found, found.grasps, found.mesh, best_grasps(found, 3), found.epsilon_range):
        assert repr(result).count("\n") < 3
