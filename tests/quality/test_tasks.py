import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d._kernels.hull.support_functions import reach
from grasp3d.errors import SettingError
from grasp3d.quality import Acceleration, Task, Weight, Wrenches
from grasp3d.quality.tasks import STANDARD_GRAVITY

DOWN = (0.0, 0.0, -1.0)
TASKS: dict[str, Task] = {
    "weight": Weight(0.5),
    "weight downward": Weight(2.0, direction=DOWN),
    "weight within a cone": Weight(1.0, direction=(1.0, 0.0, -1.0), within=math.radians(30.0)),
    "acceleration": Acceleration(0.5, acceleration=5.0),
    "pushes": Wrenches([[1, 0, 0, 0, 0, 0], [0, -2, 0, 0.1, 0, 0], [0, 0, 0, 0, 0, 0.5]]),
    "sum": Weight(0.5) + Acceleration(0.5, acceleration=2.0) + Wrenches([1, 0, 0, 0, 0, 0.0]),
}

names = st.sampled_from(list(TASKS))
vectors = st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6).map(np.array)
few = settings(max_examples=40, deadline=None)


@given(names, vectors, vectors, st.floats(0.0, 5.0))
@few
def test_supports_are_convex_and_homogeneous(name: str, u: Any, v: Any, factor: float) -> None:
    task = TASKS[name]
    total = task.support(u) + task.support(v)
    assert task.support(u + v) <= total + 1e-9 * (1.0 + abs(total))
    assert task.support(factor * u) == pytest.approx(factor * task.support(u), abs=1e-9)


@given(names, vectors)
@few
def test_the_farthest_wrench_reaches_as_far_as_the_support(name: str, u: Any) -> None:
    task = TASKS[name]
    assert task.farthest(u) @ u == pytest.approx(task.support(u), abs=1e-7)  # torques of 1e-9
    # It belongs to the task: no direction is exceeded.
    others = np.random.default_rng(0).normal(size=(50, 6))
    assert (others @ task.farthest(u) <= task.support(others) + 1e-9).all()


@given(names, vectors)
@few
def test_the_kernels_reach_as_far(name: str, u: Any) -> None:
    rows, points = TASKS[name].arrays()
    assert reach(rows, points, *u) == pytest.approx(TASKS[name].support(u), abs=1e-9)


def test_weight_within_a_cone_reaches_as_far_as_its_samples() -> None:
    within = math.radians(30.0)
    task = Weight(direction=DOWN, within=within)
    rng = np.random.default_rng(2)
    force = rng.normal(size=(400_000, 3))
    force /= np.linalg.norm(force, axis=1, keepdims=True)
    force = STANDARD_GRAVITY * force[-force[:, 2] >= math.cos(within)]
    for u in rng.normal(size=(10, 6)):
        reached = (force @ u[:3]).max()
        assert reached == pytest.approx(task.support(u), rel=0.01, abs=0.02)
        assert reached <= task.support(u) + 1e-9


def test_a_right_angle_is_half_of_all_directions() -> None:
    half = Weight(direction=DOWN, within=math.pi / 2.0)
    assert half.support([0, 0, 1, 0, 0, 0]) == pytest.approx(0.0, abs=1e-12)
    assert half.support([1, 0, 0, 0, 0, 0]) == pytest.approx(STANDARD_GRAVITY)
    assert half.support([0, 0, -1, 0, 0, 0]) == pytest.approx(STANDARD_GRAVITY)


def test_sums_add_up_and_masses_scale_what_has_one() -> None:
    total, u = TASKS["sum"], np.array([0.3, -1.0, 0.2, 0.1, 0.5, -0.4])
    parts = [part.support(u) for part in total.terms()]
    assert total.support(u) == pytest.approx(sum(parts))
    doubled = total.scaled_to(1.0)
    assert doubled.support(u) == pytest.approx(2.0 * (parts[0] + parts[1]) + parts[2])
    assert total.mass == 0.5
    assert TASKS["pushes"].mass is None


def test_corners_are_all_sums_of_corners() -> None:
    task = Weight(1.0, direction=DOWN) + Wrenches([[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]])
    corners = task.corners_for(None, 2)
    assert corners is not None
    assert corners.shape == (2, 2, 6)
    assert corners[0, 1].tolist() == [0.0, 1.0, -STANDARD_GRAVITY, 0.0, 0.0, 0.0]
    heavier = task.corners_for(np.array([1.0, 3.0]), 2)
    assert heavier is not None
    assert heavier[1, 0, 2] == pytest.approx(-3.0 * STANDARD_GRAVITY)
    assert Weight().corners_for(None, 1) is None


@pytest.mark.parametrize("make", [
    lambda: Weight(-0.5), lambda: Weight(math.nan),
    lambda: Weight(1.0, direction=(0.0, 0.0, 0.0)), lambda: Weight(1.0, within=0.5),
    lambda: Weight(1.0, direction=DOWN, within=2.0), lambda: Acceleration(1.0, acceleration=-1.0),
    lambda: Wrenches([[1.0, 2.0, 3.0]]), lambda: Wrenches([[math.inf] * 6]),
    lambda: Wrenches("no numbers"), lambda: Weight().support([1.0, 2.0]),
])  # fmt: skip
def test_tasks_that_are_none(make: Any) -> None:
    with pytest.raises(SettingError):
        make()
