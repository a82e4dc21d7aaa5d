"""Labels with a gripper: laws that hold for every object."""

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import manifold3d
import numpy as np
import pytest

from grasp3d import (
    GraspModel,
    ObjectMesh,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    Table,
    best_grasps,
    label_surface,
    load_mesh,
)
from grasp3d.hand.reach import Reachability, reach_grasps
from grasp3d.hand.scene import Scene
from grasp3d.hand.table import Approach
from grasp3d.settings.units import Unit
from grasp3d.surface import reachable
from grasp3d.surface.contacts import grasps_at
from grasp3d.surface.vertex_fields import Reason
from grasp3d.system.context import running
from tests.helpers import shapes
from tests.helpers.grippers import HAND, TIPS
from tests.helpers.moving_gripper import MovingGripper

MODEL = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0))

NOWHERE = ParallelGripper(
    name="nowhere", max_opening=5.0, clearance=0.0, compliance=1e-8,
    finger_thickness=1e-9, finger_width=1e-9, finger_length=5.0, pad_width=1e-9, pad_height=1e-9,
    palm_thickness=5.0, palm_width=1e-9, palm_length=1e-9,
)  # fmt: skip
"""Fingers that are thinner than the pads yield, and a palm far away."""

NO_TIPS = replace(NOWHERE, name="no tips", tip_radius=1e-9, pad_width=0.0, pad_height=0.0)

ARRAYS = (
    "label", "critical_angle", "critical_angle_best", "partners", "partner_normals", "opening",
    "grip", "reason",
)  # fmt: skip


@cache
def solid(name: str, unit: Unit = "mm") -> ObjectMesh:
    """Objects of 30 to 80 mm, coarse."""
    (vertices, faces), size = {
        "blob": (shapes.lopsided(3), 25.0),
        "finned": (shapes.finned(), 20.0),
        "tube": (shapes.tube(sections=32), 60.0),
        "box": (shapes.box((6.0, 4.0, 2.0)), 10.0),
        "cone": (shapes.cone(0.3, 2.0, sections=24), 30.0),
    }[name]
    scale = {"mm": 1.0, "cm": 0.1, "m": 0.001}[unit] * size
    edge = {"box": 5.0, "tube": 12.0}.get(name, 12.0) / size
    return load_mesh((vertices * scale, faces), unit=unit, max_edge=f"{edge * scale}{unit}")


def beside(mesh: ObjectMesh, hand: ParallelGripper, **options: object) -> SurfaceLabels:
    """Labels of an object on a table."""
    options = {"table": Table.below(mesh), **options}
    return label_surface(mesh, MODEL, hand=hand, **options)


@cache
def held(name: str, hand: ParallelGripper = HAND) -> SurfaceLabels:
    return beside(solid(name), hand)


@pytest.mark.slow
@pytest.mark.parametrize("hand", [HAND, TIPS], ids=lambda hand: hand.name)
@pytest.mark.parametrize("name", ["blob", "finned", "box", "cone", "tube"])
def test_a_gripper_only_lowers_labels(name: str, hand: ParallelGripper) -> None:
    mesh, sampling = solid(name), Sampling()
    limited = Scene(hand).within_stroke(mesh, sampling)
    ideal = label_surface(mesh, MODEL, sampling=limited)
    real = beside(mesh, hand, sampling=sampling)
    # On creases another grasp may be reached that is worse over the worst normals, but M, not U.
    smooth = mesh.contact_normals.counts == 1
    assert (real.label <= ideal.label)[smooth].all()
    assert ((real.label == 2) <= (ideal.label == 2)).all()
    assert (real.label < ideal.label).any()
    # What is outside the search cone was not searched for by either.
    searched = real.critical_angle < ideal.search.cone
    gain = ideal.critical_angle[searched] - real.critical_angle[searched]
    assert (gain <= Sampling().tolerance).all()
    assert ((real.reason == Reason.FOUND) <= (ideal.reason == Reason.FOUND)).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["blob", "box", "finned", "tube"])
@pytest.mark.parametrize("hand", [NOWHERE, NO_TIPS], ids=lambda hand: hand.name)
def test_a_gripper_of_no_size_changes_nothing(name: str, hand: ParallelGripper) -> None:
    """Compared digit by digit with ideal fingers of the same stroke."""
    mesh, sampling = solid(name), Sampling(rays=32)
    limited = Scene(hand).within_stroke(mesh, sampling)
    ideal = label_surface(mesh, MODEL, sampling=limited)
    real = label_surface(mesh, MODEL, sampling=sampling, hand=hand)
    for array in ARRAYS:
        np.testing.assert_array_equal(getattr(real, array), getattr(ideal, array), err_msg=array)
    for array in ("faces", "weights"):
        one, other = (getattr(labels.partner_points, array) for labels in (real, ideal))
        np.testing.assert_array_equal(one, other)
    assert (real.reach.reached == (ideal.reason == Reason.FOUND)).all()


@pytest.mark.slow
@pytest.mark.parametrize("hand", [HAND, TIPS], ids=lambda hand: hand.name)
def test_every_grasp_of_a_vertex_is_reached(hand: ParallelGripper) -> None:
    """By testing it again, alone, and by moving the gripper step by step."""
    labels = held("blob", hand)
    mesh, reach = labels.mesh, labels.reach
    found = np.flatnonzero(labels.reason == Reason.FOUND)
    assert (reach.reached == (labels.reason == Reason.FOUND)).all()
    assert len(found) > 50
    contacts = grasps_at(mesh, labels.partner_points, found)
    again = reach_grasps(mesh, contacts.points, contacts.normals, hand, table=labels.scene.table)
    assert again.reached.all()
    np.testing.assert_allclose(again.poses, reach.poses[found], atol=1e-9)
    least, most = hand.limits
    assert (reach.opening[found] >= 1000.0 * least - 1e-6).all()
    assert (reach.opening[found] <= 1000.0 * most + 1e-6).all()
    assert (reach.pregrasp_opening[found] > reach.opening[found]).all()
    moving = MovingGripper(mesh, hand, labels.scene.table)
    assert {moving.collision(reach, row) for row in found[:: len(found) // 6]} == {""}


@pytest.mark.slow
def test_searching_on_makes_no_grasp_worse(monkeypatch: pytest.MonkeyPatch) -> None:
    """It finds much better ones near contacts that are not reached, and keeps what was found."""
    mesh = load_mesh(shapes.LIBRARY / "knob.ply", unit="m")
    model = GraspModel(friction=0.5, sensor_resolution=math.radians(22.6))
    before, search_on = [], reachable.ReachSearch._search_on  # noqa: SLF001

    def recorded(self, ideal, missing, reached, neighbours):  # noqa: ANN001, ANN202
        before.append(reached.worst.copy())
        search_on(self, ideal, missing, reached, neighbours)

    monkeypatch.setattr(reachable.ReachSearch, "_search_on", recorded)
    labels, again = (
        running(threads=threads)(label_surface)(mesh, model, hand=ParallelGripper.preset("franka"))
        for threads in (1, 3)
    )
    assert (labels.critical_angle <= before[0]).all()
    better = labels.critical_angle < before[0] - math.radians(1.0)
    assert better.sum() > 300
    assert better[mesh.contact_normals.counts != 1].sum() > 10  # at creases too
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(labels, name), getattr(again, name), err_msg=name)


def test_the_oracle_finds_collisions() -> None:
    """The steps of a gripper, which are the oracle of poses, do meet what is in the way."""
    labels = held("box")
    row = int(np.flatnonzero(labels.reason == Reason.FOUND)[0])
    moving = MovingGripper(labels.mesh, HAND, labels.scene.table)
    assert moving.collision(labels.reach, row) == ""
    lower = labels.reach.poses.copy()
    lower[row, :3, 3] += (0.0, 0.0, -labels.mesh.vertices[:, 2].max())
    lowered = replace(labels.reach, poses=lower)
    assert "table" in moving.collision(lowered, row) or "object" in moving.collision(lowered, row)
    narrow = replace(labels.reach, opening=labels.reach.opening - 5.0)
    assert "object at an opening" in moving.collision(narrow, row)
    narrow = replace(narrow, pregrasp_opening=narrow.opening)
    assert "before the pose" in moving.collision(narrow, row)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["blob", "finned"])
def test_what_a_larger_gripper_reaches_a_smaller_one_reaches(name: str) -> None:
    large = held(name, HAND)
    small = replace(
        HAND, name="small", finger_thickness=0.01, palm_thickness=0.1, palm_width=0.03,
        finger_width=0.01, pad_width=0.01,
    )  # fmt: skip
    found = np.flatnonzero(large.reason == Reason.FOUND)
    contacts = grasps_at(large.mesh, large.partner_points, found)
    reach = reach_grasps(
        large.mesh, contacts.points, contacts.normals, small, table=large.scene.table
    )
    assert len(found) > 50
    assert reach.reached.all()


def assert_alike(one: SurfaceLabels, other: SurfaceLabels) -> None:
    """The labels of equivalent objects: the same, but for ties and rounding at few vertices."""
    assert (one.label == other.label).mean() > 0.98
    assert (one.reason == other.reason).mean() > 0.98
    both = (one.reason == Reason.FOUND) & (other.reason == Reason.FOUND)
    gaps = np.abs(one.critical_angle[both] - other.critical_angle[both])
    assert np.median(gaps) < 1e-9
    margins = np.abs(one.reach.approach_margin - other.reach.approach_margin)[both]
    assert (margins < 1e-6).mean() > 0.95


@pytest.mark.slow
def test_turning_and_moving_everything_changes_nothing() -> None:
    still, turn, shift = held("blob"), shapes.rotation(11), np.array([0.3, -0.02, 0.077])
    mesh = still.mesh
    moved = load_mesh((mesh.vertices @ turn.T + shift, mesh.faces), unit="m", max_edge="12mm")
    up = turn @ (0.0, 0.0, 1.0)
    table = Table(up, still.scene.table.offset + shift @ up)
    turned = beside(moved, HAND, table=table)
    assert_alike(still, turned)
    both = still.reach.reached & turned.reach.reached
    gaps = np.abs(turned.reach.poses[both, :3, 2] - still.reach.poses[both, :3, 2] @ turn.T)
    assert np.median(gaps) < 1e-9


def test_narrower_approaches_reach_less() -> None:
    mesh = solid("blob")
    wide, narrow = (
        beside(mesh, HAND, approach=Approach(within=math.radians(angle))) for angle in (90.0, 20.0)
    )
    assert narrow.reach.reached.sum() < wide.reach.reached.sum()
    directions = narrow.reach.poses[narrow.reach.reached, :3, 2]
    assert len(directions) > 10
    assert (-directions[:, 2] >= math.cos(math.radians(20.0)) - 1e-9).all()


def test_vertices_that_are_not_reached_have_a_reason() -> None:
    labels = held("box")
    missing = labels.reason == Reason.NOT_REACHED
    assert missing.any()
    assert (labels.label[missing] == 0).all()
    assert np.isinf(labels.critical_angle[missing]).all()
    assert np.isnan(labels.reach.poses[missing]).all()
    known = labels.reach.state[missing]
    assert np.isin(known, [Reachability.TABLE, Reachability.BLOCKED, Reachability.WIDTH]).all()


def test_relabelling_keeps_the_poses() -> None:
    labels = held("box")
    finer = labels.relabel(sensor_resolution=math.radians(5.0))
    assert finer.reach is labels.reach
    assert finer.scene is labels.scene
    assert (finer.label >= labels.label).all()


OBJECTS = {
    "ycb_006_mustard_bottle.stl": 1e-3,
    "ycb_025_mug.ply": 4e-4,
    "ycb_042_adjustable_wrench.obj": 4e-4,
    "ode_boot.obj": 1e-3,
}
"""Scans in metres, and how far they are simplified, which saves time."""


def simplified(name: str, distance: float) -> ObjectMesh:
    mesh = load_mesh(shapes.shared("meshes", name), unit="m")
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(np.array(mesh.vertices, order="C"), mesh.faces.astype(np.uint64))
    )
    assert solid.status() == manifold3d.Error.NoError
    small = solid.simplify(distance).to_mesh64()
    points = np.asarray(small.vert_properties)[:, :3]
    return load_mesh((points, np.asarray(small.tri_verts)), unit="m", max_edge=mesh.size / 20.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", list(OBJECTS))
def test_every_pose_of_an_objects_best_grasps_is_free(name: str) -> None:
    mesh = simplified(name, OBJECTS[name])
    model = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0))
    hand = replace(ParallelGripper.preset("franka"), compliance=0.001)
    table = Table.below(mesh)
    labels = label_surface(mesh, model, hand=hand, table=table)
    best = best_grasps(labels, 20)
    assert best.label[0] == 2
    stroke = np.full(best.size, hand.max_opening)
    reach = SimpleNamespace(poses=best.poses, opening=stroke, pregrasp_opening=stroke)
    moving = MovingGripper(mesh, hand, table)
    assert [moving.collision(reach, row) for row in range(best.size)] == [""] * best.size
