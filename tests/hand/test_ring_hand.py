"""A second kind of hand goes through labels, reach, best grasps and pose files."""

import math
from functools import cache
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import trimesh

import grasp3d
from grasp3d import (
    GraspModel,
    Table,
    best_grasps,
    evaluate_grasps,
    label_surface,
    load_mesh,
    read_grasps,
    write_grasps,
)
from grasp3d.arrays import Floats
from grasp3d.errors import OutputError, SettingError
from grasp3d.grasps import poses_of
from grasp3d.grasps.pose_files.files import OWN_FORMATS, check_hand, suffixes_of, write_poses
from grasp3d.grasps.pose_files.frames import JOINTED
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.closed_jaws import Closing
from grasp3d.hand.hand import Hand
from grasp3d.hand.hand_files import write_hand
from grasp3d.hand.reach import Reachability
from grasp3d.hand.scene import Scene, scene_settings
from grasp3d.hand.shapes import hand_triangles
from grasp3d.hand.table import Approach
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import MultifingerSampling, PoseFormat
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason
from tests.helpers.ring_hand import RING, SMALL_RING, RingHand, distance

MODEL = GraspModel(fingers=3)
READ_ONLY = {"graspnet_labels", "contact_graspnet"}
SEARCH = MultifingerSampling(candidates=64)
BALL, TUBE = 20.0, 15.0
"""Radii of the shapes [mm]."""

SLACK, FACET = 0.3, 0.32
"""Farthest that facets are from the curved shapes [mm]: closer decisions are not compared; largest
angle between normals of a facet and of its corners [rad]."""


@cache
def ball() -> ObjectMesh:
    shape = trimesh.creation.icosphere(subdivisions=2, radius=BALL)
    return load_mesh(shape, unit="mm", max_edge=99.0)


@cache
def tube() -> ObjectMesh:
    """A vertical cylinder from z = 0 to 50."""
    shape = trimesh.creation.cylinder(TUBE, 50.0, sections=96)
    shape.apply_translation([0.0, 0.0, 25.0])
    return load_mesh(shape, unit="mm", max_edge=99.0)


@cache
def labelled(hand: RingHand = RING, height: float = -30.0) -> SurfaceLabels:
    """A ball above a table."""
    table = Table(np.array([0.0, 0.0, 1.0]), height)
    return label_surface(ball(), MODEL, sampling=SEARCH, hand=hand, table=table)


@cache
def ideal() -> SurfaceLabels:
    return label_surface(ball(), MODEL, sampling=SEARCH)


def around(heights: Any, azimuths: Any, radius: float = TUBE) -> tuple[Floats, Floats]:
    """Contacts on a vertical cylinder and normals into it, shape (1, 3, 3) each."""
    inward = -np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(3)], axis=1)
    points = -radius * inward
    points[:, 2] = heights
    return points[None], inward[None]


def test_it_is_a_hand() -> None:
    assert isinstance(RING, Hand)
    with pytest.raises(SettingError, match="three fingers, not 2"):
        label_surface(ball(), GraspModel(), hand=RING)


# The pose, in closed form


@pytest.mark.parametrize("turn", [0.3, 2.0])
@pytest.mark.parametrize("second", [1.9, 2.6])
def test_the_pose_on_a_cylinder_is_its_axis_at_the_height_of_the_contacts(
    turn: float, second: float
) -> None:
    azimuths = turn + np.array([0.0, second, second + 2.0])
    table = Table.below(tube())
    points, normals = around(30.0, azimuths)
    reach = Scene(RING, table).reach(tube(), points, normals)
    assert Reachability(reach.state[0]) == Reachability.REACHED
    assert reach.poses[0][:3, 3] == pytest.approx([0.0, 0.0, 30.0])
    assert reach.poses[0][:3, 2] == pytest.approx([0.0, 0.0, -1.0])  # from above
    assert reach.poses[0][:3, 0] == pytest.approx([math.cos(turn), math.sin(turn), 0.0])
    assert reach.opening[0] == pytest.approx(2.0 * TUBE)
    assert reach.pregrasp_opening[0] == pytest.approx(2.0 * TUBE + 4.0)
    expected = -np.array([second, second + 2.0])  # seen from above, the other way around
    assert np.exp(1j * reach.posture[0]) == pytest.approx(np.exp(1j * expected))


@pytest.mark.parametrize(
    ("hand", "height", "azimuths", "expected"),
    [
        (RING, 30.0, (0.0, 2.0, 4.0), Reachability.REACHED),
        (RING, 4.5, (0.0, 2.0, 4.0), Reachability.REACHED),
        (RING, 2.0, (0.0, 2.0, 4.0), Reachability.TABLE),  # fingers have a radius of 4 mm
        (SMALL_RING, 30.0, (0.0, 2.0, 4.0), Reachability.REACHED),
        (RingHand(max_opening=0.033), 30.0, (0.0, 2.0, 4.0), Reachability.WIDTH),
        (RingHand(finger_length=0.015), 30.0, (0.0, 2.0, 4.0), Reachability.BLOCKED),
        (RingHand(finger_length=0.022), 30.0, (0.0, 2.0, 4.0), Reachability.REACHED),
        (RING, 30.0, (0.0, 0.2, 3.0), Reachability.TIP),
    ],
)
def test_a_cylinder_is_reached_within_the_lengths_of_the_hand(
    hand: RingHand, height: float, azimuths: Any, expected: Reachability
) -> None:
    above = Approach(within=0.5)
    points, normals = around(height, np.array(azimuths))
    reach = Scene(hand, Table.below(tube()), above).reach(tube(), points, normals)
    assert Reachability(reach.state[0]) == expected


def test_directions_are_limited() -> None:
    points, normals = around([20.0, 20.0, 34.0], np.array([0.0, 2.0, 4.0]))
    for within, expected in ((0.1, Reachability.DIRECTION), (1.0, Reachability.BLOCKED)):
        scene = Scene(RING, Table.below(tube()), Approach(within=within))
        assert scene.reach(tube(), points, normals).state[0] == expected


# Labels


def expected_on_ball(contacts: Floats, hand: RingHand, height: float) -> tuple[bool, float]:
    """Whether a grasp of a ball (3, 3) is reached, and by which length that is decided [mm].

    The ends of the fingers are on the ball that is larger by their radius. Straight fingers pass
    its middle only from the side where their ends are not beyond it, or where they give way.
    """
    finger, length = 1e3 * hand.finger_radius, 1e3 * hand.finger_length
    larger, soft = BALL + finger, 1e3 * hand.compliance
    ends = contacts * (larger / BALL)
    normal = np.cross(ends[1] - ends[0], ends[2] - ends[0])
    normal /= np.linalg.norm(normal)
    middle = (ends[0] @ normal) * normal
    radius = float(np.linalg.norm(ends[0] - middle))
    stroke = 0.5e3 * hand.limits[1] - (radius - finger)
    gap = float(np.linalg.norm(ends - np.roll(ends, 1, axis=0), axis=1).min()) - 2.0 * finger
    by = []
    for z in (normal, -normal):
        palm = middle - length * z
        rim = palm[2] - (0.5e3 * hand.max_opening + 2.0 * finger) * math.hypot(z[0], z[1])
        tips = np.concatenate([ends, ends - length * z])[:, 2].min() - finger
        past = max(-float(middle @ z), radius - (larger - soft))
        before_palm = -float(palm @ z) - BALL
        by.append(min(min(tips, rim) + soft - height, past, before_palm))
    decided = min(max(by), stroke, gap)
    return decided > 0.0, abs(decided)


@pytest.mark.slow
@pytest.mark.parametrize(("hand", "height"), [(RING, -30.0), (RING, -45.0), (SMALL_RING, -30.0)])
def test_reached_vertices_of_a_ball_are_those_of_the_formula(hand: RingHand, height: float) -> None:
    labels, compared = labelled(hand, height), 0
    with_grasp = np.flatnonzero(ideal().reason == Reason.FOUND)
    assert len(with_grasp) > 150
    for vertex in with_grasp:
        contacts = np.concatenate([ball().vertices[vertex][None], ideal().partners[vertex]])
        reached, by = expected_on_ball(contacts, hand, height)
        if by > SLACK:
            compared += 1
            assert (labels.reason[vertex] == Reason.FOUND) == reached
            assert labels.reachable[vertex] == reached
    assert compared > 100
    assert labels.reach.reached.any()


@pytest.mark.slow
def test_labels_are_those_of_ideal_points_where_the_hand_reaches() -> None:
    labels, reached = labelled(), labelled().reachable
    assert 0 < reached.sum() < len(reached)
    assert (labels.label[reached] == ideal().label[reached]).all()
    assert (labels.critical_angle[reached] == ideal().critical_angle[reached]).all()
    assert (labels.label[~reached] == 0).all()
    assert np.isnan(labels.partners[~reached]).all()
    assert (labels.reason[~reached & (ideal().reason == Reason.FOUND)] == Reason.NOT_REACHED).all()


@pytest.mark.slow
def test_what_is_reached_does_not_collide() -> None:
    """By another test: points of the drawn hand are not deep in the object."""
    labels = labelled()
    solid = trimesh.Trimesh(ball().vertices, ball().faces)
    for vertex in np.flatnonzero(labels.reach.reached)[::10]:
        reach = labels.reach
        shape = hand_triangles(
            RING,
            float(reach.opening[vertex]),
            posture=reach.posture[vertex],
            pose=reach.poses[vertex],
            unit="mm",
        )
        depths = trimesh.proximity.signed_distance(solid, shape.vertices)
        assert depths.max() < 1e3 * RING.compliance
        assert shape.vertices[:, 2].min() > -30.0 - 1e3 * RING.compliance
        assert abs(depths[np.abs(depths).argmin()]) < 1e3 * RING.compliance + SLACK  # it touches


# Best grasps, closing and files


def best() -> Any:
    return best_grasps(labelled(), 4)


@pytest.mark.slow
def test_best_grasps_have_poses_and_labels_after_closing() -> None:
    grasps = best()
    assert grasps.size == 4
    assert np.isfinite(grasps.poses).all()
    assert set(grasps.closed.label.tolist()) <= {0, 1, 2}
    poses, mesh = poses_of(grasps), labelled().mesh
    found = evaluate_grasps(mesh, poses, MODEL, scene=labelled().scene)
    assert (grasps.closed.jaws.state == Closing.CLOSED).all()
    turned = (found.jaws.normals * grasps.contacts.normals).sum(axis=2)
    assert (turned > math.cos(FACET)).all()  # on facets, nearby
    assert found.opening == pytest.approx(grasps.reach.opening, abs=2.0 * SLACK)
    assert (found.reachable == ~found.collides).all()  # wide open it may touch the table
    without = evaluate_grasps(mesh, poses, MODEL, hand=RING)
    assert without.label.tolist() == grasps.closed.label.tolist()
    assert not without.collides.any()
    assert without.reachable.all()


def test_closing_touches_where_the_radius_shrinks_to_the_surface() -> None:
    """On a cylinder each finger touches at its own azimuth, wherever the axis is."""
    azimuths = np.array([0.0, 2.0, 4.0])
    pose = np.diag([1.0, 1.0, 1.0, 1.0])
    pose[:3, 3] = [3.0, 0.0, 25.0]
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])  # from above
    found = RING.close(tube(), [pose], posture=[-azimuths[1:]])
    assert Closing(found.state[0]) == Closing.CLOSED
    for point, normal, azimuth in zip(found.points[0], found.normals[0], azimuths, strict=True):
        along = np.array([math.cos(azimuth), math.sin(azimuth)])
        # The axis of the finger is where its radius meets the cylinder that is 4 mm larger.
        b = 3.0 * along[0]
        radius = -b + math.sqrt(b**2 - 9.0 + (TUBE + 4.0) ** 2)
        middle = np.array([3.0, 0.0]) + radius * along
        outward = middle / np.linalg.norm(middle)
        assert point[:2] == pytest.approx(TUBE * outward, abs=0.05)
        assert normal[:2] == pytest.approx(-outward, abs=0.05)


def test_closing_on_nothing_and_from_inside() -> None:
    pose = np.eye(4)
    pose[:3, 3] = [0.0, 0.0, 200.0]
    above = RING.close(tube(), [pose], posture=[[2.0, 4.0]])
    assert above.state.tolist() == [Closing.NOTHING]
    pose[:3, 3] = [45.0, 0.0, 40.0]
    inside = RING.close(tube(), [pose], posture=[[2.0, math.pi]])
    assert inside.state.tolist() == [Closing.STARTS_INSIDE]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["json", "csv", "parquet"])
def test_poses_are_written_and_read_back(tmp_path: Path, suffix: str) -> None:
    grasps = best()
    write_grasps(tmp_path / f"g.{suffix}", grasps)
    found = read_grasps(tmp_path / f"g.{suffix}", hand=RING if suffix == "csv" else None)
    assert found.hand == RING
    assert found.poses == pytest.approx(grasps.reach.poses, abs=1e-9)
    assert found.posture == pytest.approx(grasps.reach.posture)
    assert found.columns["contacts"] == pytest.approx(grasps.contacts.points)
    again = evaluate_grasps(
        labelled().mesh, found, MODEL, hand=found.hand, table=labelled().scene.table
    )
    assert again.label.tolist() == grasps.closed.label.tolist()
    assert again.margin == pytest.approx(grasps.closed.margin, abs=1e-6)
    assert {"area3", "touch3", "x3", "nz3"} <= set(again.to_table().column_names)


@pytest.mark.parametrize("name", sorted({*get_args(PoseFormat)} - READ_ONLY))
def test_formats_of_another_kind_of_hand_are_refused_before_the_work(
    name: PoseFormat, tmp_path: Path
) -> None:
    if name in OWN_FORMATS:
        check_hand(name, RING)
        return
    franka = grasp3d.ParallelGripper.preset("franka")
    if name in JOINTED:
        message = "have postures of a hand with joints; '.*' is none"
        with pytest.raises(SettingError, match="hand with joints; 'franka' is none"):
            check_hand(name, franka)
    else:
        message = "need the lengths of the gripper"
        check_hand(name, franka)
    with pytest.raises(SettingError, match=message) as early:
        check_hand(name, RING)
    path = tmp_path / f"poses{suffixes_of(name)[0]}"
    with pytest.raises(OutputError, match=message) as late:
        write_poses(path, GraspPoses(poses=np.eye(4), unit="m", hand=RING), format=name)
    assert str(early.value).partition(" files")[2] == str(late.value).partition(" files")[2]


def test_a_hand_is_read_by_the_reader_of_all_hands(tmp_path: Path) -> None:
    write_hand(tmp_path / "ring.json", SMALL_RING)
    assert grasp3d.read_hand(tmp_path / "ring.json") == SMALL_RING
    settings = scene_settings(labelled().scene)
    assert '"format": "test ring"' in str(settings["gripper"])


@pytest.mark.slow
def test_distances_are_those_of_many_samples() -> None:
    random = np.random.default_rng(5)
    for _ in range(30):
        triangles, ends = random.normal(size=(20, 3, 3)), 2.0 * random.normal(size=(2, 3))
        along = ends[0] + np.linspace(0.0, 1.0, 400)[:, None] * (ends[1] - ends[0])
        sampled = min(
            np.linalg.norm(
                trimesh.triangles.closest_point(triangles, np.tile(p, (20, 1))) - p, axis=1
            ).min()
            for p in along
        )
        gap, one, other = distance(ends, triangles)
        assert gap == pytest.approx(sampled, abs=0.02)
        assert gap <= sampled + 1e-12
        assert np.linalg.norm(one - other) == pytest.approx(gap)


@pytest.mark.parametrize("suffix", ["npz", "vtp", "parquet"])
def test_labelled_files_keep_hand_pose_and_posture(tmp_path: Path, suffix: str) -> None:
    labels, path = labelled(), tmp_path / f"ball.{suffix}"
    write = {"npz": grasp3d.write_npz, "vtp": grasp3d.write_vtp, "parquet": grasp3d.write_fields}
    write[suffix](path, labels)
    found = grasp3d.read_labels(path)
    assert found.scene.hand == RING
    assert (found.label == labels.label).all()
    for name in ("state", "poses", "opening", "posture"):
        expected = getattr(labels.reach, name)
        np.testing.assert_array_equal(getattr(found.reach, name), expected)
