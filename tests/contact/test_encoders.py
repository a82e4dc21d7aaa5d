import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasp3d.contact import JointEncoders
from grasp3d.errors import SettingError
from grasp3d.settings.uncertainty import Uncertainty

counts = st.floats(20.0, 1e6)
lengths = st.lists(st.floats(0.0, 100.0), min_size=1, max_size=5)


def moved(
    axes: np.ndarray, origins: np.ndarray, contact: np.ndarray, turns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Contact and a fingertip's rotation after all joints of a chain, base first, have turned.

    Joint j turns everything beyond it about its axis (3,) through its origin (3,), both given
    before any joint has turned.
    """
    total = Rotation.identity()
    point = contact
    for axis, origin, turn in reversed(list(zip(axes, origins, turns, strict=True))):
        rotation = Rotation.from_rotvec(turn * axis)
        point = origin + rotation.apply(point - origin)
        total = rotation * total
    return point, total.as_matrix()


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 4), st.floats(6.0, 500.0), st.integers(0, 10_000))
def test_no_chain_of_joints_moves_its_contact_or_normal_further(
    joints: int, count: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(joints, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    origins, contact = rng.normal(size=(joints, 3)), rng.normal(size=3)
    distances = np.linalg.norm(np.cross(contact - origins, axes), axis=1)
    encoders = JointEncoders(count, tuple(distances))
    errors = np.array(encoders.angle_errors)
    for signs in itertools.product([-1.0, 1.0], repeat=joints):
        for turns in (np.array(signs) * errors, errors * rng.uniform(-1.0, 1.0, joints)):
            point, rotation = moved(axes, origins, contact, turns)
            assert np.linalg.norm(point - contact) <= encoders.location_error * (1.0 + 1e-9)
            turned = Rotation.from_matrix(rotation).magnitude()
            assert turned <= min(math.pi, encoders.normal_error) * (1.0 + 1e-9) + 1e-12


def test_a_stretched_finger_with_parallel_axes_attains_both_bounds() -> None:
    encoders = JointEncoders(4096, (90.0, 60.0, 25.0))
    axes = np.tile([0.0, 0.0, 1.0], (3, 1))
    origins = np.array([[-90.0, 0.0, 0.0], [-60.0, 0.0, 0.0], [-25.0, 0.0, 0.0]])
    point, rotation = moved(axes, origins, np.zeros(3), np.array(encoders.angle_errors))
    assert Rotation.from_matrix(rotation).magnitude() == pytest.approx(encoders.normal_error)
    assert np.linalg.norm(point) == pytest.approx(encoders.location_error, rel=1e-5)


@settings(max_examples=60, deadline=None)
@given(counts, lengths)
def test_each_angle_is_known_to_half_a_count(count: float, given_lengths: list[float]) -> None:
    encoders = JointEncoders(count, tuple(given_lengths))
    assert encoders.joints == len(given_lengths)
    assert encoders.angle_errors == (math.pi / count,) * len(given_lengths)
    assert encoders.normal_error == pytest.approx(math.pi * len(given_lengths) / count)
    assert encoders.location_error == pytest.approx(math.pi * sum(given_lengths) / count)
    # The nearest of N counts of 2 pi / N is at most half of one away.
    angle = np.random.default_rng(0).uniform(0.0, 2.0 * math.pi, 100)
    step = 2.0 * math.pi / count
    assert np.abs(angle - step * np.round(angle / step)).max() <= encoders.angle_errors[0]


def test_joints_may_differ() -> None:
    encoders = JointEncoders((1024, 4096), (50.0, 20.0))
    assert encoders.angle_errors == (math.pi / 1024, math.pi / 4096)
    assert encoders.location_error == pytest.approx(math.pi * (50.0 / 1024 + 20.0 / 4096))
    assert encoders.uncertainty == Uncertainty(
        normal_error=encoders.normal_error, location_error=encoders.location_error
    )


def test_parallel_jaws_neither_tilt_nor_move_across_the_closing_axis() -> None:
    jaws = JointEncoders(500, (10.0,), "prismatic")
    assert (jaws.normal_error, jaws.location_error) == (0.0, 0.0)
    assert jaws.closing_error == pytest.approx(10.0 / 500 / 2.0)  # half a count of travel
    assert jaws.uncertainty == Uncertainty(location_error=jaws.closing_error)
    fingers = JointEncoders(500, (10.0,))
    assert (fingers.closing_error, fingers.contact_error) == (0.0, fingers.location_error)


def test_exact_encoders_leave_nothing_uncertain() -> None:
    for exact in (JointEncoders.exact(), JointEncoders(math.inf, (50.0, 20.0))):
        assert (exact.normal_error, exact.location_error, exact.closing_error) == (0, 0, 0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0, (1.0,)), "encoder counts must be above 0; got 0"),
        ((math.nan, (1.0,)), "encoder counts must be above 0"),
        (((100, -1), (1.0, 2.0)), "encoder counts must be above 0"),
        (((100, 200), (1.0,)), "one for all joints or one for each; got 2, but joints: 1"),
        ((100, (-1.0,)), "lengths of joints must be finite and at least 0"),
        ((100, (math.inf,)), "lengths of joints must be finite"),
        ((100, 5.0), "encoders take numbers, one for each joint; got 5.0"),
        ((100, ("5 mm",)), "encoders take numbers, one for each joint"),
        ((100, (1.0,), "spherical"), "is called 'spherical'; known: revolute, prismatic"),
    ],
)
def test_bad_encoders_are_refused(arguments: tuple[object, ...], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        JointEncoders(*arguments)  # type: ignore[arg-type]


def test_encoders_too_coarse_for_a_normal_have_no_uncertainty() -> None:
    with pytest.raises(SettingError, match="normal error must be at least 0 and below 90 degrees"):
        _ = JointEncoders(4, (10.0, 10.0)).uncertainty
