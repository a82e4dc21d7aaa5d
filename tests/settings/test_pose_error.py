"""Errors of poses: texts, and the poses that are tried."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasp3d.errors import SettingError
from grasp3d.settings.pose_error import PoseError

LENGTHS = st.just(0.0) | st.floats(1e-9, 0.05)
ANGLES = st.floats(0.0, math.radians(25.0))


@pytest.mark.parametrize(
    ("text", "position", "degrees"),
    [
        ("5mm,3deg", "5 mm", 3.0),
        ("0.002,0", 0.002, 0.0),
        ("0", 0.0, 0.0),
        ("3deg", 0.0, 3.0),
        ("0.1rad", 0.0, math.degrees(0.1)),
    ],
)
def test_texts(text: str, position: object, degrees: float) -> None:
    error = PoseError.of(text)
    assert (str(error.position) if isinstance(position, str) else error.position) == position
    assert math.degrees(error.angle) == pytest.approx(degrees)
    assert PoseError.of(str(error)) == error


@pytest.mark.parametrize("text", ["", "5", "mm", "5mm,3mm", "5mm,3deg,1", "-1mm", "91deg", "nan"])
def test_what_is_no_error_is_refused(text: str) -> None:
    with pytest.raises(SettingError, match="pose error"):
        PoseError.of(text)


@given(LENGTHS, ANGLES)
def test_poses_are_within_the_error_and_the_stated_one_is_first(position: float, a: float) -> None:
    poses = PoseError(position, a).offsets()
    shifts = np.linalg.norm(poses[:, :3, 3], axis=1)
    turns = Rotation.from_matrix(poses[:, :3, :3]).magnitude()
    assert (shifts <= position * (1.0 + 1e-6)).all()
    assert (turns <= a * (1.0 + 1e-6) + 1e-12).all()
    np.testing.assert_array_equal(poses[0], np.eye(4))
    assert len(poses) == (3 if position or a else 1)
    assert shifts.max() == pytest.approx(position)
    assert turns.max() == pytest.approx(a)


def test_tried_poses_are_opposite_and_along_the_pads() -> None:
    one, other = PoseError.of("5mm,3deg").offsets()[1:]
    np.testing.assert_allclose(one[:3, 3], -other[:3, 3])
    np.testing.assert_allclose(one[:3, :3] @ other[:3, :3], np.eye(3), atol=1e-12)
    assert one[0, 3] == 0.0


def test_drawn_errors_have_half_the_error_as_deviation() -> None:
    drawn = PoseError.of("4mm,2deg").draw(40_000, np.random.default_rng(0))
    turns = Rotation.from_matrix(drawn[:, :3, :3]).as_rotvec()
    np.testing.assert_allclose(drawn[:, :3, 3].std(axis=0), 2e-3, rtol=0.02)
    np.testing.assert_allclose(turns.std(axis=0), math.radians(1.0), rtol=0.02)
