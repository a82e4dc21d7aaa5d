"""Errors of poses: texts, and the poses that are tried."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasp3d.errors import SettingError
from grasp3d.settings.pose_error import PoseError

LENGTHS = st.floats(0.0, 0.05)
ANGLES = st.floats(0.0, math.radians(25.0))


@pytest.mark.parametrize(
    ("text", "position", "degrees"),
    [
        ("5mm,3deg", "5 mm", 3.0),
        ("5mm, 3", "5 mm", 3.0),
        ("0.002,0", 0.002, 0.0),
        ("0", 0.0, 0.0),
        ("3deg", 0.0, 3.0),
        ("0.1rad", 0.0, math.degrees(0.1)),
        ("1cm,0", "1 cm", 0.0),
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
    poses, weights, radius = PoseError(position, a).offsets("m")
    shifts = np.linalg.norm(poses[:, :3, 3], axis=1)
    turns = Rotation.from_matrix(poses[:, :3, :3]).magnitude()
    assert (shifts <= position * (1.0 + 1e-6)).all()
    assert (turns <= a * (1.0 + 1e-6) + 1e-12).all()
    np.testing.assert_array_equal(poses[0], np.eye(4))
    assert (weights >= 0.0).all()
    assert weights.sum() == pytest.approx(1.0)
    assert radius == position


@given(LENGTHS, ANGLES, st.floats(1.0, 3.0), st.floats(1.0, 3.0))
def test_larger_errors_try_what_smaller_ones_try(
    position: float, angle: float, farther: float, wider: float
) -> None:
    few = PoseError(position, angle).offsets("m").poses
    many = PoseError(position * farther, angle * wider).offsets("m").poses
    known = {pose.tobytes() for pose in many}
    assert all(pose.tobytes() in known for pose in few)


def test_tried_poses_are_spread_in_all_directions_up_to_the_error() -> None:
    error = PoseError.of("5mm,3deg")
    poses = error.offsets("m").poses
    assert len(poses) == 32
    shifts = poses[:, :3, 3]
    lengths = np.linalg.norm(shifts, axis=1)
    assert lengths.max() == pytest.approx(5e-3, rel=1e-6)
    directions = shifts[lengths > 0.0] / lengths[lengths > 0.0, None]
    octants = {tuple(one) for one in np.sign(directions).astype(int).tolist()}
    assert len(octants) == 8
    assert np.linalg.norm(directions.mean(axis=0)) < 0.3


def test_units_are_those_of_the_poses() -> None:
    in_metres, in_millimetres = (PoseError.of("5mm,3deg").offsets(unit) for unit in ("m", "mm"))
    np.testing.assert_allclose(
        1e3 * in_metres.poses[:, :3, 3], in_millimetres.poses[:, :3, 3], rtol=1e-12
    )
    assert (in_metres.position, in_millimetres.position) == (0.005, 5.0)


def test_drawn_errors_have_half_the_error_as_deviation() -> None:
    drawn = PoseError.of("4mm,2deg").draw(40_000, "m", np.random.default_rng(0))
    turns = Rotation.from_matrix(drawn[:, :3, :3]).as_rotvec()
    np.testing.assert_allclose(drawn[:, :3, 3].std(axis=0), 2e-3, rtol=0.02)
    np.testing.assert_allclose(turns.std(axis=0), math.radians(1.0), rtol=0.02)
