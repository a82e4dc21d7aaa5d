"""The camera at a grasp: across the closing axis, from above, not behind the palm."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.pictures.camera import (
    LEVEL,
    MOST_BESIDE,
    UPRIGHT,
    View,
    extents,
    frame_of,
    grasp_view,
    middle_of,
    view_axes,
)
from tests.helpers import shapes

AXES = np.eye(3)
ALONG_X = np.array([[0.02, 0.0, 0.0], [-0.02, 0.0, 0.0]])


def held(turn: np.ndarray, **options: np.ndarray) -> GripperPose:
    """A gripper whose closing axis is the first column of a rotation, its approach the third."""
    pose = np.eye(4)
    pose[:3, :3] = turn
    return GripperPose(pose, 0.04, math.nan, math.nan, math.nan, **options)


@given(st.integers(0, 10_000), st.integers(0, 10_000))
def test_the_camera_looks_across_the_closing_axis_from_above(seed: int, other: int) -> None:
    turn, up = shapes.rotation(seed), shapes.rotation(other)[0]
    closing, approach = turn[:, 0], turn[:, 2]
    toward = view_axes(grasp_view(ALONG_X, up, held(turn)), up)[2]
    assert toward @ up == pytest.approx(math.sin(View.elevation))
    level = toward - (toward @ up) * up
    if np.linalg.norm(np.cross(closing, up)) > LEVEL:
        assert level @ closing == pytest.approx(0.0, abs=1e-9)
    assert level @ approach > -0.25  # nearly the usual view where the palm is above


def test_the_closing_axis_of_contacts_is_that_along_which_they_spread() -> None:
    sides = [view_axes(grasp_view(points, UPRIGHT), UPRIGHT)[2] for points in (
        ALONG_X, np.concatenate([ALONG_X, [[0.0, 0.01, 0.0]]])
    )]  # fmt: skip
    for toward in sides:
        assert toward[0] == pytest.approx(0.0, abs=1e-9)
        assert toward[1] > 0.5  # the side of the usual view


def test_across_an_upright_closing_axis_the_approach_is_seen_from_the_side() -> None:
    turn = np.array([[0.0, 0, 1], [0, -1, 0], [1, 0, 0]])  # closes along z, approaches along x
    toward = view_axes(grasp_view(ALONG_X[:, ::-1], UPRIGHT, held(turn)), UPRIGHT)[2]
    assert toward[0] == pytest.approx(0.0, abs=1e-9)


def test_where_nothing_is_level_the_view_is_the_usual_one() -> None:
    assert grasp_view(np.zeros((0, 3)), UPRIGHT) == View()
    assert grasp_view(ALONG_X[:, ::-1], UPRIGHT) == View()


numbers = st.floats(-1.0, 1.0, width=32)


@given(arrays(float, (6, 3), elements=numbers), arrays(float, (5, 3), elements=numbers))
def test_the_object_stays_in_the_frame_and_does_not_become_tiny(points: Any, beside: Any) -> None:
    points = np.concatenate([points, np.eye(3), -np.eye(3)])
    beside = 40.0 * beside
    frame = frame_of(points, beside, AXES)
    own = np.array(extents(points, middle_of(points, AXES), AXES))
    assert max(frame.reach) <= MOST_BESIDE * own.max() + 1e-9
    inside = np.abs((points - frame.middle)[:, :2]) <= np.array(frame.reach) + 1e-9
    assert inside.all()
    near = frame_of(points, 0.9 * points, AXES)
    assert near.reach == pytest.approx(tuple(own))
    assert frame_of(points, np.empty((0, 3)), AXES).reach == pytest.approx(tuple(own))


@given(arrays(float, 3, elements=numbers))
@example(np.array([1.5e-5, 0.0, -1.0]))
@example(np.array([0.0, 1e-12, -1.0]))
def test_the_picture_is_turned_so_that_a_direction_points_up(up: Any) -> None:
    length = np.linalg.norm(up)
    up = up / length if length > 0.1 else -AXES[2]
    axes = view_axes(View(0.4, 0.5), up)
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert axes @ up == pytest.approx(View(0.4, 0.5).axes @ AXES[2], abs=1e-6)
