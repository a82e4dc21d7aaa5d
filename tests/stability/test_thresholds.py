import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d import GraspModel, Label
from grasp3d.stability.label import label_angles, max_resolution, unstable_from
from tests.helpers import oracles

angles = st.floats(-0.5, 2.0)
frictions = st.floats(0.05, 3.0)
resolutions = st.floats(0.0, 2.0)


def label_of(worst: float, friction: float, resolution: float) -> int:
    model = GraspModel(friction=friction, sensor_resolution=resolution)
    return int(label_angles(np.array([worst]), np.array([worst]), model)[0])


@given(angles, frictions, resolutions)
def test_labels_are_thresholds_on_the_critical_angle(
    worst: float, friction: float, resolution: float
) -> None:
    beta, tilt = math.atan(friction), resolution / 2.0
    expected = Label.S if worst < beta - tilt else Label.U if worst >= beta + tilt else Label.M
    assert label_of(worst, friction, resolution) == expected


@given(angles, frictions, st.floats(0.0, 1.0))
def test_a_grasp_is_stable_below_its_coarsest_resolution_and_not_above(
    worst: float, friction: float, fraction: float
) -> None:
    model = GraspModel(friction=friction, sensor_resolution=0.0)
    coarsest = float(max_resolution(np.array([worst]), model)[0])
    if not 0.0 < coarsest < 3.1:  # resolutions are below pi
        return
    assert label_of(worst, friction, fraction * coarsest * (1.0 - 1e-9)) == Label.S
    assert label_of(worst, friction, coarsest * (1.0 + 1e-9)) != Label.S


def test_labels_exactly_at_a_threshold() -> None:
    beta = math.atan(0.5)
    assert label_of(beta, 0.5, 0.0) == Label.U
    assert label_of(np.nextafter(beta, 0.0), 0.5, 0.0) == Label.S
    assert label_of(0.0, 0.5, 2.0 * beta) == Label.M


def test_at_a_crease_the_worst_normals_decide_s_and_the_best_decide_u() -> None:
    model = GraspModel(friction=1.0, sensor_resolution=0.2)
    worst, best = np.array([1.5, 1.5, 0.1]), np.array([0.0, 1.2, 0.1])
    assert label_angles(worst, best, model).tolist() == [Label.M, Label.U, Label.S]


def test_no_grasp_is_u_and_has_no_resolution() -> None:
    model = GraspModel()
    no_grasp = np.array([math.inf])
    assert label_angles(no_grasp, no_grasp, model).tolist() == [Label.U]
    assert max_resolution(no_grasp, model).tolist() == [0.0]


def test_grasps_are_force_closed_above_the_critical_angle() -> None:
    """Compared with a linear program instead of the closed form."""
    rng = np.random.default_rng(1)
    for _ in range(40):
        p1, p2 = rng.normal(size=3), rng.normal(size=3)
        d = (p2 - p1) / np.linalg.norm(p2 - p1)
        n1, n2 = oracles.tilted(d, 1.0, rng), oracles.tilted(-d, 1.0, rng)
        beta = oracles.critical_angle(p1, n1, p2, n2)
        if beta > 0.05:
            assert not oracles.force_closed(p1, n1, p2, n2, beta - 0.02)
        assert oracles.force_closed(p1, n1, p2, n2, beta + 0.02)


@pytest.mark.parametrize("fingers", [2, 3])
def test_thresholds_of_a_model_are_those_of_arrays(fingers: int) -> None:
    for friction in (0.2, 0.5, 2.0):
        for resolution in (0.0, 0.4, 1.2):
            model = GraspModel(friction, resolution, fingers)
            limit = unstable_from(math.atan(friction), resolution / 2.0, fingers)
            assert model.unstable_from == limit
            assert model.sure_angle == math.atan(friction) - resolution / 2.0
