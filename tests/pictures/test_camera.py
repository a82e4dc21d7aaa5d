"""The camera at a grasp: across the closing axis, from above, not behind the palm."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.pictures.camera import LEVEL, UPRIGHT, View, grasp_view, view_axes
from tests.helpers import shapes

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
