"""Bounds of epsilon where friction and the centre of mass are uncertain."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp3d import Contacts, EpsilonOptions, epsilon
from grasp3d.quality import epsilon_range
from grasp3d.quality.tilting import uncertain_epsilon_range
from grasp3d.settings.grasp_model import Actuation
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
    options = EpsilonOptions(None, actuation, torque_scale=SCALE, rtol=RTOL)
    tilt = 0.05 if torsion == 0.0 else 0.0  # of soft fingers little is known of tilts
    found = uncertain_epsilon_range(contacts, tilt, (0.7, 0.9), options, center_radius=0.05)
    assert (found.minimum > 0.0).mean() > 0.2
    assert (found.minimum <= found.nominal).all()
    assert (found.nominal <= found.maximum * (1.0 + 1e-2)).all()
    for _ in range(15):
        center = 0.05 * unit(rng.normal(size=(len(contacts.points), 1, 3)))
        moved = Contacts(
            contacts.points - center,
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
    plain = epsilon_range(contacts, 0.1, options)
    found = uncertain_epsilon_range(contacts, 0.1, (0.8, 0.8), options)
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
    wide, narrow = (
        uncertain_epsilon_range(contacts, 0.1, (0.8, 0.8), options, center_radius=radius)
        for radius in (float(np.linalg.norm(c)), 0.0)
    )
    assert wide.minimum * expected == pytest.approx(narrow.minimum)
    assert wide.maximum == pytest.approx(narrow.maximum * expected)
