"""Bounds of epsilon where friction and the centre of mass are uncertain."""

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp3d import Contacts, EpsilonOptions, epsilon
from grasp3d.quality import epsilon_range
from grasp3d.quality.force_ranges import uncertain_epsilon_range
from grasp3d.quality.wrenches import Actuation
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
    found = uncertain_epsilon_range(contacts, tilt, (0.7, 0.9), options)
    assert (found.minimum > 0.0).mean() > 0.2
    assert (found.minimum <= found.nominal).all()
    assert (found.nominal <= found.maximum * (1.0 + 1e-2)).all()
    for _ in range(15):
        moved = Contacts(
            contacts.points,
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
