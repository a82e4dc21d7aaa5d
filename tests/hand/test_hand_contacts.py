"""Contacts of hands with joints: distances, depths and contacts of shapes against slow oracles."""

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasp3d import read_hand
from grasp3d._kernels.hands.touching import FACING, Touches, make_touch_scratch, touch
from grasp3d.arrays import Floats, unit_rows
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.link_bodies import link_bodies
from grasp3d.hand.link_contacts import HandContacts, hand_contacts
from grasp3d.hand.link_tree import LinkShape
from grasp3d.hand.table import Table
from grasp3d.mesh import ObjectMesh
from tests.helpers import shapes as known
from tests.helpers.hands import hand_file
from tests.helpers.link_depths import Depths, depth_of_link, depth_of_surface
from tests.helpers.link_scenes import at, core, hand_of, shape, solid

TIP = trimesh.creation.icosphere(2, radius=0.012).apply_scale([1.0, 0.8, 1.6])

SHAPES = {
    "box": shape("box", 0.01, 0.0135, 0.027),
    "cylinder": shape("cylinder", 0.007, 0.02),
    "capsule": shape("capsule", 0.007, 0.02),
    "sphere": shape("sphere", 0.011),
    "mesh": LinkShape("mesh", np.eye(4), surface=np.asarray(TIP.triangles)),
}


@cache
def ring() -> trimesh.Trimesh:
    return trimesh.creation.annulus(0.03, 0.04, 0.1, sections=48)


def gaps(some: list[LinkShape], mesh: ObjectMesh, frames: Floats, search: float = 1.0) -> Touches:
    """Gaps of shapes, each of a link of its own, at frames (k, L, 3, 4)."""
    bodies = link_bodies([[one] for one in some])
    count, links = frames.shape[:2]
    touches = Touches(
        np.zeros((count, links)), np.zeros((count, links, 3)), np.zeros((count, 0, 7))
    )
    scratch, surface = make_touch_scratch(bodies), mesh.touched_surface
    touch(frames, 0.005, search, 0, count, bodies, surface, touches, scratch)
    return touches


def random_frames(count: int, links: int, extent: float) -> Floats:
    rng = np.random.default_rng(3)
    frames = np.zeros((count, links, 3, 4))
    turns = Rotation.random(count * links, random_state=4).as_matrix()
    frames[..., :3] = turns.reshape(count, links, 3, 3)
    frames[..., 3] = rng.uniform(-extent, extent, (count, links, 3))
    return frames


def _fcl_mesh(fcl: Any, vertices: Any, faces: Any) -> Any:
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(vertices, faces)
    model.endModel()
    return model


@pytest.mark.slow
@pytest.mark.parametrize("kind", SHAPES)
def test_gaps_are_those_of_fcl(kind: str) -> None:
    """FCL's own answers for shapes that are no meshes are off by up to 0.1 mm: it gets meshes."""
    fcl, count = known.reader("fcl"), 1000
    one, mesh = SHAPES[kind], solid(ring())
    frames = random_frames(count, 1, 0.09)
    found = gaps([one], mesh, frames).gaps[:, 0]
    vertices, faces, radius = core(one)
    body = fcl.CollisionObject(_fcl_mesh(fcl, vertices, faces))
    other = fcl.CollisionObject(_fcl_mesh(fcl, mesh.vertices, mesh.faces))
    apart = np.zeros(count, dtype=bool)
    for row, frame in enumerate(frames[:, 0]):
        body.setTransform(fcl.Transform(frame[:, :3], frame[:, 3]))
        distance = fcl.distance(body, other, fcl.DistanceRequest(), fcl.DistanceResult()) - radius
        inside = found[row] < 0.0 < distance  # within the wall as a whole
        apart[row] = distance > 1e-6 and not inside
        if apart[row]:
            assert found[row] == pytest.approx(distance, abs=6e-8)
    assert apart.mean() > 0.3
    assert np.median(np.abs(found[~apart])) > 1e-3


@cache
def block() -> ObjectMesh:
    return solid(trimesh.creation.box([0.06, 0.06, 0.04], at(0.0, 0.0, -0.02)))


def gap_of(one: LinkShape, pose: Floats, mesh: ObjectMesh) -> float:
    return float(gaps([one], mesh, pose[None, None, :3]).gaps[0, 0])


@pytest.mark.parametrize(
    ("kind", "below"), [("box", 0.027), ("cylinder", 0.02), ("capsule", 0.027), ("sphere", 0.011)]
)
@pytest.mark.parametrize("depth", [0.014, 0.0021, 1e-5, -1e-5, -0.003])
def test_depth_of_a_shape_in_a_block(kind: str, below: float, depth: float) -> None:
    found = gap_of(SHAPES[kind], at(0.001, 0.002, below - depth), block())
    assert found == pytest.approx(-depth, abs=2e-9)


def test_what_is_wholly_inside_is_as_deep_as_its_deepest_point() -> None:
    """The middle of the block is 20 mm deep, and inside both; the block has no deeper point."""
    assert gap_of(SHAPES["sphere"], at(z=-0.012), block()) == pytest.approx(-0.020, abs=1e-4)
    assert gap_of(SHAPES["box"], at(z=-0.02), block()) == pytest.approx(-0.02, abs=1e-4)
    assert gap_of(SHAPES["sphere"], at(z=-0.007), block()) == pytest.approx(-0.018, abs=1e-9)


def test_an_open_surface_has_no_inside() -> None:
    box = trimesh.creation.box([0.06, 0.06, 0.04])
    box.update_faces(box.triangles_center[:, 2] < 0.019)
    mesh = solid(box)
    assert not mesh.report.closed
    assert gap_of(SHAPES["sphere"], at(), mesh) == pytest.approx(0.009, abs=1e-9)
    assert gap_of(SHAPES["sphere"], at(z=-0.02), mesh) == pytest.approx(-0.011, abs=1e-9)


def contacts_of(mesh: ObjectMesh, *links: LinkShape, pose: Any = None, **more: Any) -> HandContacts:
    hand = hand_of({f"link {i}": [one] for i, one in enumerate(links)})
    poses = np.eye(4)[None] if pose is None else pose[None]
    return hand_contacts(mesh, hand, poses, np.zeros((1, 0)), **more)


PLATE = solid(trimesh.creation.box([0.1, 0.1, 0.003]))
ONE_SIDE: dict[str, tuple[ObjectMesh, LinkShape]] = {
    # The normals of both sides of a rim cancel, and those of the rim itself are few.
    "a thin rim": (
        solid(trimesh.creation.box([0.1, 0.1, 0.0005])),
        shape("box", 0.01, 0.01, 0.01, pose=at(0.05, 0, 0.0106)),
    ),
    "beyond an edge": (block(), shape("box", 0.01, 0.0135, 0.005, pose=at(0.03, 0, 0.006))),
    "on a wall": (PLATE, shape("sphere", 0.01, pose=at(z=0.0105))),
    "through a wall": (PLATE, shape("box", 0.01, 0.01, 0.01, pose=at(z=0.0085))),
    "deep inside": (block(), shape("box", 0.01, 0.0135, 0.027, pose=at(z=0.013))),
}


@pytest.mark.parametrize("case", ONE_SIDE)
def test_a_link_touches_the_near_side_only(case: str) -> None:
    mesh, link = ONE_SIDE[case]
    found = contacts_of(mesh, link)
    np.testing.assert_allclose(found.normals, [[[0, 0, -1]]], atol=1e-9)
    far = contacts_of(block(), shape("sphere", 0.01, pose=at(z=0.03)))
    assert (far.touching.tolist(), far.gaps.tolist()) == ([[False]], [[math.inf]])


def test_a_link_in_a_corner_has_a_contact_between_both_walls() -> None:
    walls = [
        trimesh.creation.box([0.1, 0.1, 0.01], at(0, 0, -0.005)),
        trimesh.creation.box([0.01, 0.1, 0.1], at(-0.055, 0, 0.04)),
    ]
    link = shape("box", 0.01, 0.01, 0.01, pose=at(-0.038, 0, 0.0105))
    (normal,) = contacts_of(solid(trimesh.util.concatenate(walls)), link).normals[0]
    assert (normal[[0, 2]] < -0.5).all()
    assert normal[1] == pytest.approx(0.0, abs=1e-9)


def test_depth_in_the_table() -> None:
    pose = at(rotation=Rotation.from_euler("xyz", [0.3, 0.4, 0.5]).as_matrix())
    for kind, one in SHAPES.items():
        if kind == "sphere":
            lowest = -0.011
        else:
            points = one.triangles().reshape(-1, 3) @ pose[:3, :3].T
            lowest = float(points[:, 2].min())
        found = contacts_of(block(), one, pose=pose, table=Table(np.array([0, 0, 1.0]), -0.001))
        assert found.table_depth[0] == pytest.approx(-0.001 - lowest, abs=3e-4)


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.sampled_from(["m", "mm", "cm"]))
def test_motions_units_and_the_order_of_links_change_nothing(seed: int, scale: str) -> None:
    rng = np.random.default_rng(seed)
    some = list(SHAPES.values())
    poses = [
        at(*rng.uniform(-0.05, 0.05, 3), Rotation.random(random_state=rng).as_matrix())
        for _ in some
    ]
    links = [LinkShape(s.kind, p, s.size, s.surface) for s, p in zip(some, poses, strict=True)]
    motion = at(*rng.normal(0, 0.3, 3), Rotation.random(random_state=rng).as_matrix())
    factor = {"m": 1.0, "cm": 100.0, "mm": 1000.0}[scale]
    one = contacts_of(solid(ring()), *links)
    moved = ring().copy().apply_transform(motion).apply_scale(factor)
    order = rng.permutation(len(links))
    two = contacts_of(solid(moved, scale), *(links[i] for i in order), pose=motion)
    before, after = one.gaps[0, order], two.gaps[0]
    apart = before >= 0.0
    np.testing.assert_allclose(after[apart], before[apart], atol=1e-7)
    np.testing.assert_allclose(after, before, rtol=0.01, atol=2e-5)  # climbs to depths end near
    assert (two.touching[0] == one.touching[0, order]).all()
    known = one.touching[0, order] & (before > -0.004)  # else as near to the wall's other side
    back = (two.points[0, known] - motion[:3, 3]) @ motion[:3, :3]
    assert np.abs(back - one.points[0, order][known]).max(initial=0.0) < 2e-3


def test_depths_of_a_shape_do_not_depend_on_others_of_its_link() -> None:
    """Of one that others cover nothing is said: these are deeper, or nearer."""
    block = solid(trimesh.creation.box((0.1, 0.1, 0.1)))
    plate, covered = shape("box", 0.03, 0.02, 0.005), shape("box", 0.01, 0.01, 0.002)
    hull = LinkShape("mesh", at(0.0, 0.0, 0.03), surface=np.asarray(TIP.triangles))
    frames = np.array([at(), at(0.01, 0.0, 0.01), at(0.0, 0.0, 0.04)])[:, None, :3]
    found = []
    for link in ([hull], [plate, covered, hull]):
        bodies = link_bodies([link])
        own = Touches(
            np.zeros((3, len(link))), np.zeros((3, len(link), 3)), np.zeros((3, 0, 7))
        )  # fmt: skip
        scratch = make_touch_scratch(bodies)
        touch(frames, 0.005, 0.01, 0, 3, bodies, block.touched_surface, own, scratch)
        found.append(own.gaps)
    np.testing.assert_allclose(found[1][:, 2], found[0][:, 0], atol=1e-9)
    assert np.isposinf(found[1][:, 1]).all()
    assert found[1][0, 0] == pytest.approx(-0.05, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["allegro", "barrett", "shadow"])
def test_contacts_of_hands_are_means_over_what_is_near(name: str) -> None:
    """Around a ball, by a slow version in closed form for each point of the links."""
    radius, near, count = 0.035, 0.005, 300
    mesh = solid(trimesh.creation.icosphere(5, radius=radius))
    hand = read_hand(hand_file(name))
    assert isinstance(hand, ArticulatedHand)
    rng = np.random.default_rng(0)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, random_state=rng).as_matrix()
    low, high = np.clip(hand.limits_of_joints, -1.5, 1.5).T
    postures = rng.uniform(low, high, (count, len(low)))
    bodies, moved = hand.bodies, hand.link_poses(postures)[..., :3, :]
    beside = moved[np.arange(count), rng.choice(bodies.links, count), :, 3]  # some link
    away = (radius + 0.01) * unit_rows(rng.normal(size=(count, 3)))
    poses[:, :3, 3] = away - (poses[:, :3, :3] @ beside[..., None])[..., 0]
    found = hand_contacts(mesh, hand, poses, postures, contact_distance=near)
    gaps = []
    for row, link in np.ndindex(found.touching.shape):
        frame = poses[row] @ np.vstack([moved[row, link], [0.0, 0.0, 0.0, 1.0]])
        points = [np.zeros((0, 6))]
        for body in np.flatnonzero(bodies.links == link):
            own = frame[:3] @ np.vstack([bodies.poses[body], [0.0, 0.0, 0.0, 1.0]])
            rows = bodies.samples[bodies.first_sample[body] : bodies.first_sample[body + 1]]
            turned = rows.reshape(-1, 2, 3) @ own[:, :3].T
            turned[:, 0] += own[:, 3]
            points.append(turned.reshape(-1, 6))
        at, outward = np.split(np.concatenate(points), 2, axis=1)
        distance = np.linalg.norm(at, axis=1)
        inward = -at / distance[:, None]
        away, facing = np.abs(distance - radius), (outward * inward).sum(axis=1)
        # Of points on the verge of counting the facets of the ball decide.
        verge = (np.abs(away - near) < 1e-5) | (np.abs(facing - FACING) < 0.004)
        chosen = inward[(away <= near) & (facing >= FACING)]
        mean = chosen.mean(axis=0) if len(chosen) else np.zeros(3)
        if verge.any() or np.linalg.norm(mean) < 0.55:  # else the nearest side
            continue
        mean /= np.linalg.norm(mean)
        gaps.append([
            np.linalg.norm(found.points[row, link] + radius * mean),
            np.linalg.norm(found.normals[row, link] - mean),
        ])  # fmt: skip
    assert len(gaps) > 100
    assert (np.quantile(gaps, 0.95, axis=0) < [1e-4, 0.004]).all()
    assert (np.max(gaps, axis=0) < [1e-3, 0.03]).all()


FINEST = 5e-5
"""Width of the bounds [m]."""


@cache
def surface(name: str) -> trimesh.Trimesh:
    if name == "block":
        return trimesh.creation.box([0.06, 0.06, 0.04])
    if name == "ball":
        return trimesh.creation.icosphere(5, radius=0.035)
    if name == "torus":
        return trimesh.creation.torus(0.03, 0.012, major_sections=64, minor_sections=32)
    rim, wall, high, floor = 0.04, 0.004, 0.05, 0.005
    around = [[0, -high], [rim, -high], [rim, high], [rim - wall, high]]
    inner = [[rim - wall, floor - high], [0, floor - high]]
    return trimesh.creation.revolve(np.array([*around, *inner]), sections=64)


@cache
def mesh_of(name: str) -> ObjectMesh:
    return solid(surface(name))


def depths_below(name: str) -> Depths:
    """Depths of points by Embree, in single precision, compared with all triangles below."""
    o3d = pytest.importorskip("open3d")
    scene = o3d.t.geometry.RaycastingScene()
    below = surface(name)
    scene.add_triangles(below.vertices.astype(np.float32), below.faces.astype(np.uint32))

    def depth(points: Floats) -> Floats:
        return -scene.compute_signed_distance(points.astype(np.float32)).numpy().astype(float)

    return depth


def poses(name: str, one: LinkShape, count: int, seed: int) -> Floats:
    """Poses at which a corner of the shape is 0 to 30 mm below a point of the surface."""
    rng = np.random.default_rng(seed)
    points, faces = trimesh.sample.sample_surface(surface(name), count, seed=seed)
    inward = -surface(name).face_normals[faces]
    corners = one.triangles().reshape(-1, 3)
    found = np.tile(np.eye(4), (count, 1, 1))
    found[:, :3, :3] = Rotation.random(count, random_state=seed).as_matrix()
    for pose, point, way in zip(found, points, inward, strict=True):
        placed = corners @ pose[:3, :3].T
        depth = rng.uniform(0.0, rng.choice([0.001, 0.004, 0.03]))
        pose[:3, 3] = point + depth * way - placed[(placed @ way).argmax()]
    return found


def compare(name: str, kind: str, count: int, seed: int) -> Any:
    """How far depths are outside their bounds, in shares of 0.1 mm or of 2 %, if larger."""
    one, triangles = SHAPES[kind], np.asarray(surface(name).triangles)
    placed = poses(name, one, count, seed)
    found = -gaps([one], mesh_of(name), np.ascontiguousarray(placed[:, None, :3])).gaps[:, 0]
    bounds = np.array(
        [
            np.maximum(
                depth_of_link(one, pose, depths_below(name), FINEST),
                depth_of_surface(one, pose, triangles, FINEST),
            )
            for pose in placed
        ]
    )
    off = found - np.clip(found, bounds[:, 0], bounds[:, 1])
    assert np.ptp(bounds[bounds[:, 0] > 0.0], axis=1).max(initial=0.0) < 4.0 * FINEST
    return off / np.maximum(1e-4, 0.02 * bounds[:, 1])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind"), [("block", "mesh"), ("ball", "sphere"), ("mug", "box"), ("torus", "cylinder")]
)
def test_depths_are_those_of_dense_division(name: str, kind: str) -> None:
    """At one pose in fifty a climb may end elsewhere, too early."""
    off = compare(name, kind, 25, 5)
    assert off.max() < 1.0
    assert (off < -1.0).mean() <= 0.02
