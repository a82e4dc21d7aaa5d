"""Forces and payloads of a gripper's pads, whose torsion radius is proportional to friction."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import (
    GraspModel,
    ObjectMesh,
    ParallelGripper,
    SurfaceLabels,
    evaluate_grasps,
    label_surface,
    load_mesh,
)
from grasp3d.arrays import Floats
from grasp3d.formats.poses import GraspPoses
from grasp3d.quality.loads import Load
from grasp3d.quality.tasks import STANDARD_GRAVITY
from grasp3d.stability.label import Label
from grasp3d.surface.grasp_numbers import surface_load_result
from grasp3d.surface.load_case import FORCE_RTOL, LoadCase, LoadResult
from tests.helpers import shapes
from tests.helpers.closing_jaws import pads, pose

MASS, FORCE = 0.5, 40.0
FRANKA = ParallelGripper.preset("franka")
DOWN = Load(mass=MASS, grip_force=FORCE, task="weight within 0 of -z")
PUSHED = replace(DOWN, task="weight within 0 of -z + wrench 0,0,-1,0,0,0")
INTERVAL, LOW, NOMINAL, HIGH = (0.3, 0.7), 0.3, 0.5, 0.7
OFFSETS = (0.0, 0.004, 0.02)


@cache
def block() -> ObjectMesh:
    """A box of 80 x 50 x 30 mm about its centre of mass."""
    return load_mesh(shapes.box((80.0, 50.0, 30.0)), unit="mm", max_edge="30mm")


def held(load: Load = DOWN, *, tilt: float = 0.0, **changed: Any) -> LoadResult:
    """LoadResult of two fingers opposite to each other, at `OFFSETS` from the centre of mass."""
    model = GraspModel(sensor_resolution=2.0 * tilt, **changed)
    points = [[[x, side, 0.0] for side in (0.025, -0.025)] for x in OFFSETS]
    contacts = evaluate_grasps(block(), points, model).contacts
    case = LoadCase.of(load, block(), model, FRANKA)
    return surface_load_result(contacts, model, case)


def forces_at(friction: float, torsion_friction: float | None = None) -> Floats:
    """Forces of these grasps, with gravity across their line (closed form)."""
    torsion = FRANKA.torsion_radius(torsion_friction or friction)
    levers = np.array(OFFSETS) / torsion
    return np.asarray(0.5 * MASS * STANDARD_GRAVITY * np.hypot(1.0 / friction, levers))


def assert_forces(found: Floats, expected: Floats) -> None:
    """That upper bounds of forces are as close as is asked for."""
    assert (found >= expected * (1.0 - 1e-9)).all()
    assert (found <= expected / (1.0 - FORCE_RTOL)).all()


def test_each_friction_has_its_own_torsion_radius() -> None:
    found = held(friction=INTERVAL)
    assert found.grip_force_least == pytest.approx(forces_at(HIGH), rel=FORCE_RTOL)
    assert_forces(found.grip_force, forces_at(NOMINAL))
    assert_forces(found.grip_force_largest, forces_at(LOW))
    assert found.payload == pytest.approx(FORCE * MASS / found.grip_force_largest)
    stored = FRANKA.torsion_radius(NOMINAL)
    assert found.settings()["force_torsion_radius"] == pytest.approx(stored)


def test_a_given_torsion_radius_is_that_at_any_friction() -> None:
    given_radius = FRANKA.torsion_radius(NOMINAL)
    found = held(friction=INTERVAL, torsion_radius=given_radius)
    assert found.grip_force_least == pytest.approx(forces_at(HIGH, NOMINAL), rel=FORCE_RTOL)
    assert_forces(found.grip_force, forces_at(NOMINAL))
    assert_forces(found.grip_force_largest, forces_at(LOW, NOMINAL))
    assert found.settings()["force_torsion_radius"] == given_radius


def test_payloads_beside_a_push_have_the_least_torsion() -> None:
    """The push takes its part of the force; the payload is searched for."""
    interval, low = (held(PUSHED, friction=friction) for friction in (INTERVAL, LOW))
    assert interval.payload == pytest.approx(low.payload)
    nominal = held(PUSHED, friction=NOMINAL).payload
    assert (interval.payload < nominal * (1.0 - FORCE_RTOL)).all()


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(low=st.floats(0.15, 0.9), width=st.floats(0.02, 0.6), part=st.floats(0.0, 1.0))
def test_an_interval_contains_the_forces_of_its_frictions(
    low: float, width: float, part: float
) -> None:
    tilt = 0.25 * math.atan(low)
    interval = held(friction=(low, low + width), tilt=tilt)
    one = held(friction=low + part * width, tilt=tilt)
    slack = 1.0 + 2.0 * FORCE_RTOL
    assert (interval.grip_force_largest * slack >= one.grip_force_largest).all()
    assert (interval.grip_force_least <= one.grip_force_least * slack).all()
    assert (interval.payload <= one.payload * slack).all()


@cache
def labels(friction: Any = NOMINAL) -> SurfaceLabels:
    model = GraspModel(friction=friction, sensor_resolution=0.05)
    load = Load(mass=1.0)
    return label_surface(block(), model, hand=FRANKA, load=load)


@pytest.mark.slow
def test_grasps_that_surely_hold_do_so_at_the_smallest_friction() -> None:
    found, low = labels(INTERVAL).load_result, labels(LOW).load_result
    assert found is not None
    assert low is not None
    assert found.label is not None
    assert low.label is not None
    surely = found.label == Label.S
    assert 0 < surely.sum() < surely.size
    assert (low.label[surely] == Label.S).all()
    known = np.isfinite(low.grip_force_largest)
    expected = low.grip_force_largest[known] * (1.0 - FORCE_RTOL)
    assert (found.grip_force_largest[known] >= expected).all()


@pytest.mark.slow
def test_given_poses_have_the_pads_torsion_at_each_friction() -> None:
    poses = GraspPoses(poses=np.array([pose((0.0, y, 0.0)) for y in (0.0, 0.004, 0.01)]), unit="m")
    mesh = load_mesh(shapes.box((0.06, 0.04, 0.02)), unit="m")

    def largest(friction: Any) -> Floats:
        model = GraspModel(friction=friction, sensor_resolution=0.05)
        return evaluate_grasps(mesh, poses, model, hand=pads(), load=DOWN).grip_force

    interval, low = largest(INTERVAL), largest(LOW)
    assert np.isfinite(low).all()
    np.testing.assert_allclose(interval, low, rtol=FORCE_RTOL)
    assert (low > largest(NOMINAL) * (1.0 + FORCE_RTOL)).all()
