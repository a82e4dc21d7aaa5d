"""Two tips on two facets hold and slip at the critical friction angle."""

import math

import numpy as np
import pytest

from grasp3d import Contacts, Label, classify, critical_friction_angle
from grasp3d.errors import SettingError
from grasp3d.physics import FacetPress, facet_slip, random_facets, slip_friction, slip_tilt
from grasp3d.physics.drawing import tilt_at_random
from grasp3d.physics.facets import SLIPPED

POINTS = [[-0.025, 0.0, 0.0], [0.025, 0.0, 0.0]]
NEAR = math.radians(0.3)


def facets(*degrees: float) -> list[list[float]]:
    """Normals tilted by two angles toward y."""
    one, two = map(math.radians, degrees)
    return [[math.cos(one), math.sin(one), 0.0], [-math.cos(two), math.sin(two), 0.0]]


@pytest.mark.parametrize(("friction", "holds"), [(0.45, True), (0.28, False)])
def test_a_known_wedge(friction: float, holds: bool) -> None:
    """Facets at 20 degrees need a friction of tan 20 = 0.364, whatever the other one is."""
    assert (facet_slip(facets(20.0, 5.0), friction) < SLIPPED) == holds


def test_friction_is_not_what_moves_parallel_facets() -> None:
    assert facet_slip(facets(0.0, 0.0), 0.05) < SLIPPED


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_they_begin_to_slip_at_the_critical_friction_angle(seed: int) -> None:
    normals = random_facets(np.random.default_rng(seed), 1.2)
    computed = float(critical_friction_angle(Contacts(POINTS, normals, 0.5)))
    assert slip_friction(normals) == pytest.approx(computed, abs=NEAR)
    assert slip_tilt(normals, 0.8) == pytest.approx(math.atan(0.8), abs=NEAR)


@pytest.mark.slow
@pytest.mark.parametrize("label", [Label.S, Label.U])
def test_s_never_slips_and_u_never_holds(label: Label) -> None:
    random, alpha, tried = np.random.default_rng(7), math.radians(22.6), 0
    while tried < 20:
        seen = random_facets(random, 0.9)
        if classify(Contacts(POINTS, seen, 0.5), alpha).label != label:
            continue
        true = tilt_at_random(seen, np.full(2, 0.5 * alpha), random)
        assert (facet_slip(true, 0.5) < SLIPPED) == (label == Label.S)
        tried += 1


def test_with_the_defaults_of_mujoco_even_a_safe_grasp_creeps() -> None:
    press = FacetPress(seconds=2.0, most_shift=1.0)
    assert facet_slip(facets(20.0, 0.0), 0.5, press) < 1e-5
    soft = FacetPress(seconds=2.0, most_shift=1.0, dry_friction=False)
    assert facet_slip(facets(20.0, 0.0), 0.5, soft) > 1e-2


def test_facets_that_face_away_are_refused() -> None:
    with pytest.raises(SettingError, match="facets must face their tips"):
        facet_slip([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], 0.5)
    with pytest.raises(SettingError, match="shape \\(2, 3\\)"):
        facet_slip([[1.0, 0.0, 0.0]], 0.5)
