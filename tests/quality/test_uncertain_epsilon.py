"""Bounds of epsilon where friction, contact locations and the centre of mass are uncertain."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp3d import Contacts, EpsilonOptions, epsilon
from grasp3d.quality import epsilon_range, location_tolerance
from grasp3d.quality.tilting import WrenchErrors, uncertain_epsilon_range
from grasp3d.settings.grasp_model import Actuation
from tests.helpers.grasps import regular_on_ball
from tests.helpers.tilts import random_tilts

Floats = NDArray[np.float64]
SCALE = 1.3
RTOL = 1e-4


def unit(vectors: Floats) -> Floats:
    """Vectors (..., 3) scaled to length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def grasps(count: int, fingers: int, seed: int, torsion: float = 0.0) -> Contacts:
    """Grasps of the unit ball, most of them force-closed."""
    rng = np.random.default_rng(seed)
    if fingers == 2:
        first = unit(rng.normal(size=(count, 1, 3)))
        points = np.concatenate([first, unit(-first + 0.3 * rng.normal(size=first.shape))], axis=1)
    else:
        points = unit(rng.normal(size=(count, fingers, 3)))
    normals = unit(-points + 0.1 * rng.normal(size=points.shape))
    return Contacts(points, normals, 0.8, torsion)


@pytest.mark.slow
@pytest.mark.parametrize("actuation", ["total", "per_finger"])
@pytest.mark.parametrize(("fingers", "torsion"), [(2, 0.0), (2, 0.1), (3, 0.0), (4, 0.0)])
def test_epsilon_of_perturbed_grasps_stays_between_the_bounds(
    fingers: int, torsion: float, actuation: Actuation
) -> None:
    contacts, rng = grasps(40, fingers, fingers, torsion), np.random.default_rng(0)
    location = tuple(np.linspace(0.01, 0.03, fingers))
    errors = WrenchErrors((0.7, 0.9), location, center_radius=0.05)
    options = EpsilonOptions(None, actuation, torque_scale=SCALE, rtol=RTOL)
    tilt = 0.05 if torsion == 0.0 else 0.0  # of soft fingers little is known of tilts
    found = uncertain_epsilon_range(contacts, tilt, errors, options)
    assert (found.minimum > 0.0).mean() > 0.2
    assert (found.minimum <= found.nominal).all()
    assert (found.nominal <= found.maximum * (1.0 + 1e-2)).all()
    for _ in range(15):
        shift = unit(rng.normal(size=contacts.points.shape)) * np.array(location)[:, None]
        center = 0.05 * unit(rng.normal(size=(len(shift), 1, 3)))
        moved = Contacts(
            contacts.points + shift - center,
            random_tilts(contacts.normals, tilt, rng),
            rng.uniform(0.7, 0.9, size=contacts.friction.shape),
            torsion,
        )
        true = epsilon(moved, actuation=actuation, torque_scale=SCALE, rtol=RTOL)
        assert (true.upper >= found.minimum - 1e-12).all()
        assert (true.lower <= found.maximum + 1e-12).all()


def test_known_contacts_have_the_bounds_of_tilts_alone() -> None:
    contacts = grasps(10, 3, 1)
    options = EpsilonOptions(torque_scale=SCALE)
    errors = WrenchErrors((0.8, 0.8), (0.0, 0.0, 0.0))
    plain = epsilon_range(contacts, 0.1, options)
    found = uncertain_epsilon_range(contacts, 0.1, errors, options)
    for name in ("nominal", "minimum", "maximum"):
        assert getattr(found, name).tolist() == getattr(plain, name).tolist()


def test_the_factor_of_the_centre_of_mass_is_the_largest_singular_value() -> None:
    """A shift c maps the wrench (f, t) to (f, t - c x f / rho)."""
    c, rho = np.array([0.2, -0.1, 0.3]), 0.9
    shift = np.eye(6)
    shift[3:, :3] = -np.cross(np.eye(3), c / rho).T
    k = float(np.linalg.norm(c)) / rho
    expected = 0.5 * (k + math.sqrt(k * k + 4.0))
    assert np.linalg.svd(shift)[1][0] == pytest.approx(expected)
    contacts, options = grasps(5, 3, 2), EpsilonOptions(torque_scale=rho)
    radius = WrenchErrors((0.8, 0.8), (0.0,) * 3, float(np.linalg.norm(c)))
    known = WrenchErrors((0.8, 0.8), (0.0,) * 3)
    wide, narrow = (
        uncertain_epsilon_range(contacts, 0.1, errors, options) for errors in (radius, known)
    )
    assert wide.minimum * expected == pytest.approx(narrow.minimum)
    assert wide.maximum == pytest.approx(narrow.maximum * expected)


class TestLocationTolerance:
    def test_opposed_fingers(self) -> None:
        """The line of two opposed fingers may turn by beta: 2 d = opening x sin(beta)."""
        contacts = Contacts([[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [[1, 0, 0], [-1, 0, 0]], 0.5)
        expected = 4.0 * math.sin(math.atan(0.5)) / 2.0
        assert location_tolerance(contacts) == pytest.approx(expected)
        one = location_tolerance(contacts, relative_errors=[0.0, 1.0])
        assert one == pytest.approx(2.0 * expected)

    def test_it_is_at_least_what_epsilon_proves(self) -> None:
        """Epsilon's ball of wrenches contains the ball of torques of the same radius."""
        contacts = grasps(30, 3, 4)
        value = location_tolerance(contacts, rtol=1e-6)
        for scale in (0.2, 1.0, 5.0):
            proven = epsilon(contacts, torque_scale=scale, rtol=1e-6).lower * scale
            assert (value >= proven * (1.0 - 1e-5)).all()
            if scale < 1.0:  # epsilon is that of a force, and proves less
                assert (value > 1.2 * proven)[proven > 0.0].mean() > 0.5

    def test_a_regular_grasp(self) -> None:
        """Six fingers on the axes resist a torque about each axis with four of them."""
        contacts = regular_on_ball("octahedron", friction=0.5)
        beta = math.atan(0.5)
        value = float(location_tolerance(contacts, rtol=1e-8))
        # The total force is 1: about an axis, forces on the rim of the cones of the four fingers
        # beside it. The weakest torques are at most as strong as these.
        assert 0.0 < value <= math.sin(beta) * (1.0 + 1e-6)

    def test_open_grasps_tolerate_nothing(self) -> None:
        contacts = Contacts(np.eye(3), np.eye(3), 0.2)
        assert location_tolerance(contacts) == 0.0


def test_three_contacts_on_a_line_may_get_a_weak_torque_about_it() -> None:
    points = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    normals = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    options = EpsilonOptions(torque_scale=SCALE)
    errors = WrenchErrors((0.5, 0.5), (0.05,) * 3)
    contacts = Contacts(points[None], [normals], 0.5)
    found = uncertain_epsilon_range(contacts, 0.0, errors, options)
    moved = Contacts(points + [[0.0] * 3, [0.0] * 3, [0.0, 0.001, 0.0]], normals, 0.5)
    weak = epsilon(moved, torque_scale=SCALE)
    assert found.nominal[0] > 0.1
    assert weak.rank == 6
    assert found.minimum[0] == 0.0 < weak.lower < 0.01
    assert weak.upper < found.maximum[0]
