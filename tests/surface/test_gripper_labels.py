"""Labels with a gripper: laws that hold for every object, and shapes whose grasps are known."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import (
    GraspModel,
    ObjectMesh,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    Table,
    label_surface,
    load_mesh,
    read_hand,
)
from grasp3d.arrays import Floats
from grasp3d.hand.reach import Reach, Reachability, reach_grasps
from grasp3d.hand.scene import Scene
from grasp3d.settings.units import Unit
from grasp3d.surface.contacts import grasps_at
from grasp3d.surface.vertex_fields import Reason
from tests.helpers import shapes
from tests.helpers.grippers import HAND, SLIM, TIPS
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
@pytest.mark.parametrize("name", ["finned", "box", "tube"])
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
@pytest.mark.parametrize("name", ["box", "finned"])
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


def test_vertices_that_are_not_reached_have_a_reason() -> None:
    labels = held("box")
    missing = labels.reason == Reason.NOT_REACHED
    assert missing.any()
    assert (labels.label[missing] == 0).all()
    assert np.isinf(labels.critical_angle[missing]).all()
    assert np.isnan(labels.reach.poses[missing]).all()
    known = labels.reach.state[missing]
    assert np.isin(known, [Reachability.TABLE, Reachability.BLOCKED, Reachability.WIDTH]).all()


SHALLOWEST = 9.0 - 0.4 * 18.0
"""Least reach of the hand's fingers beyond the contacts: the pads' half less the offsets [mm]."""


def mesh_of(body: trimesh.Trimesh, max_edge: str) -> ObjectMesh:
    return load_mesh((body.vertices, body.faces), unit="mm", max_edge=max_edge)


def in_mm(labels: SurfaceLabels) -> tuple[np.ndarray, Reach]:
    """Coordinates of the vertices, and how they are reached, in millimetres."""
    reach = labels.reach
    poses = reach.poses.copy()
    poses[:, :3, 3] *= 1e3
    lengths = {name: 1e3 * getattr(reach, name) for name in ("opening", "pregrasp_opening")}
    return labels.mesh.file_points, replace(reach, poses=poses, **lengths)


def labelled(mesh: ObjectMesh, hand: ParallelGripper = HAND, **options: object) -> SurfaceLabels:
    return label_surface(mesh, MODEL, hand=hand, **options)


def standing(mesh: ObjectMesh, hand: ParallelGripper = HAND, **options: object) -> SurfaceLabels:
    return labelled(mesh, hand, table=Table.below(mesh), **options)


def assert_free(labels: SurfaceLabels, rows: np.ndarray) -> None:
    moving = MovingGripper(labels.mesh, labels.scene.hand, labels.scene.table)
    for row in rows:
        assert moving.collision(labels.reach, row, int(labels.grip[row])) == ""


def _is(values: np.ndarray, size: float) -> np.ndarray:
    """Whether coordinates have a size, on either side."""
    return np.abs(np.abs(values) - size) < 1e-6


@cache
def block() -> SurfaceLabels:
    """A block of 60 x 40 x 20 mm on a table."""
    return standing(load_mesh(shapes.box((60.0, 40.0, 20.0)), unit="mm", max_edge="5mm"))


def test_a_block_on_a_table_is_held_by_its_sides() -> None:
    labels = block()
    mesh, (points, reach) = labels.mesh, in_mm(labels)
    x, y, z = points.T
    height = z + 10.0
    inside = (mesh.contact_normals.counts == 1) & (height > 0.0)
    deep = height > SHALLOWEST
    for sides, opening in ((_is(x, 30.0), 60.0), (_is(y, 20.0), 40.0)):
        chosen = inside & sides & deep
        assert chosen.sum() > 20
        assert (labels.label[chosen] == 2).all()
        assert labels.critical_angle[chosen] == pytest.approx(0.0, abs=1e-6)
        assert reach.opening[chosen] == pytest.approx(opening)
        assert reach.pregrasp_opening[chosen] == pytest.approx(opening + 4.0)
    # Across its height one finger would be in the table; aslant the friction does not suffice.
    flat = (mesh.contact_normals.counts == 1) & _is(z, 10.0)
    assert flat.any()
    assert (labels.label[flat] == 0).all()
    assert Reachability.TABLE in reach.state[flat]
    assert (labels.label[flat & (z < 0.0)] == 0).all()


@pytest.mark.slow
def test_a_cup_is_held_at_its_rim_and_never_through_its_bottom() -> None:
    """Of 72 mm outer diameter and 80 mm height, with walls and bottom of 4 mm."""
    outside = trimesh.creation.cylinder(36.0, 80.0, sections=48)
    inside = trimesh.creation.cylinder(32.0, 80.0, sections=48)
    inside.apply_translation((0.0, 0.0, 4.0))
    mesh = mesh_of(trimesh.boolean.difference([outside, inside], engine="manifold"), "10mm")
    labels = labelled(mesh, SLIM)
    points, reach = in_mm(labels)
    radius, z = np.linalg.norm(points[:, :2], axis=1), points[:, 2]
    below_rim = 40.0 - z
    wall = (np.abs(radius - 32.0) < 0.1) & (below_rim > SHALLOWEST) & (below_rim < 30.0)
    assert wall.sum() > 40
    assert (labels.label[wall] == 2).all()
    assert reach.opening[wall] == pytest.approx(4.0, abs=0.1)
    down = -labels.reach.poses[wall, 2, 2]
    assert (down > math.cos(math.radians(60.0))).all()
    assert_free(labels, np.flatnonzero(wall)[::30])
    bottom = (radius < 30.0) & (np.abs(z + 36.0) < 1e-6)
    assert bottom.sum() > 3
    ideal = label_surface(mesh, MODEL)
    assert (ideal.label[bottom] == 2).all()
    assert (labels.label[bottom] < 2).all()
    across = labels.reach.reached & (np.abs(labels.reach.poses[:, 2, 0]) > 0.9)
    assert not (across & (radius < 30.0)).any()


@pytest.mark.slow
def test_a_flat_plate_on_a_stand_is_held_at_its_rim() -> None:
    """As far from the rim as the fingers are long."""
    mesh = load_mesh(shapes.box((200.0, 200.0, 3.0)), unit="mm", max_edge="10mm")
    labels = labelled(mesh, table=Table(np.array([0.0, 0.0, 1.0]), -0.2))
    x, y, z = mesh.file_points.T
    from_rim = np.minimum(100.0 - np.abs(x), 100.0 - np.abs(y))
    flat = _is(z, 1.5) & (mesh.contact_normals.counts == 1)
    reach = 45.0 - SHALLOWEST
    # Ends of the fingers are beyond the contacts, and the palm behind them.
    near = flat & (from_rim < reach - 0.1)
    assert near.sum() > 100
    assert (labels.label[near] == 2).all()
    far = flat & (from_rim > reach + 0.1)
    assert far.sum() > 100
    assert (labels.label[far] == 0).all()
    assert (labels.reach.state[far & (from_rim > 80.0)] == Reachability.BLOCKED).all()


def test_a_plate_is_held_by_its_edges_if_the_fingers_go_under_the_contacts() -> None:
    for height, reached in ((2.0 * SHALLOWEST + 0.2, True), (2.0 * SHALLOWEST - 0.2, False)):
        plate = trimesh.creation.box((60.0, 60.0, height)).subdivide()
        labels = standing(mesh_of(plate, "90mm"))
        middle = np.abs(labels.mesh.vertices[:, 2]) < 1e-9
        middle &= labels.mesh.contact_normals.counts == 1
        assert middle.sum() >= 4
        assert (labels.label[middle] == 2 * reached).all()


def test_a_ball_in_the_stroke_is_held_from_everywhere() -> None:
    ball = load_mesh(shapes.sphere(2, 12.0), unit="mm", max_edge="100mm")
    labels = labelled(ball)
    assert (labels.label == 2).all()
    assert labels.reach.opening == pytest.approx(0.024, rel=0.01)
    assert labels.reach.approach_margin == pytest.approx(math.pi)


LIBRARY = Path(__file__).parents[2] / "meshes"
MISS = math.radians(1.0)
"""Angle by which a grasp of the sample must be better to count."""

ANGLES = (64, 45)
AT_ONCE = 256


def candidates(mesh: ObjectMesh, vertex: int, below: float) -> tuple[Floats, Floats, Floats]:
    """Opposing contacts of a vertex in the middles of faces, normals and angles, best first."""
    faces = mesh.contact_surface.faces[mesh.contact_faces]
    corners = mesh.corner_normals
    points = mesh.vertices[faces].mean(axis=1)
    normals = corners.normals[corners.corners[mesh.contact_faces]].mean(axis=1)
    lines = points - mesh.vertices[vertex]
    lengths = np.linalg.norm(lines, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        lines /= lengths[:, None]
        normals /= np.linalg.norm(normals, axis=1)[:, None]
    cosines = np.minimum(lines @ mesh.normals[vertex], -(lines * normals).sum(axis=1))
    kept = np.flatnonzero((cosines > math.cos(below)) & (lengths > 1e-6))
    rows = kept[np.argsort(-cosines[kept])]
    return points[rows], normals[rows], np.arccos(np.minimum(cosines[rows], 1.0))


def best_reached(labels: SurfaceLabels, vertex: int, below: float) -> float:
    """Smallest critical angle of the sample that is reached [rad], inf: none below a limit."""
    mesh, jaws = labels.mesh, labels.scene.jaws
    points, normals, angles = candidates(mesh, vertex, below)
    own = np.broadcast_to(mesh.vertices[vertex], points.shape)
    own_normals = np.broadcast_to(mesh.normals[vertex], points.shape)
    pairs, both = np.stack([own, points], axis=1), np.stack([own_normals, normals], axis=1)
    fits = np.linalg.norm(points - own, axis=1) < jaws.limits[1]
    pairs, both, angles = pairs[fits], both[fits], angles[fits]
    for first in range(0, len(pairs), AT_ONCE):
        rows = slice(first, first + AT_ONCE)
        for count in ANGLES:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr("grasp3d.hand.reach.ANGLES", count)
                reach = reach_grasps(mesh, pairs[rows], both[rows], jaws)
            if reach.reached.any():
                return float(angles[rows][reach.reached].min())
    return math.inf


@pytest.mark.slow
@pytest.mark.parametrize("name", ["knob.ply", "banana.ply"])
def test_hardly_any_reached_grasp_of_a_sample_is_better(name: str) -> None:
    """Of 700 vertices of seven meshes it is at 22."""
    mesh = load_mesh(LIBRARY / name, unit="m")
    labels = label_surface(mesh, hand=read_hand("franka"))
    smooth = np.flatnonzero((mesh.contact_normals.counts == 1) & mesh.on_surface)
    chosen = np.random.default_rng(7).choice(smooth, 15, replace=False)
    known = np.minimum(labels.critical_angle[chosen], labels.search.cone)
    found = [
        best_reached(labels, int(vertex), angle - MISS)
        for vertex, angle in zip(chosen, known, strict=True)
    ]
    assert np.count_nonzero(np.array(found) < known - MISS) <= 2
