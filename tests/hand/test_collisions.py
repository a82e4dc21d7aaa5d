"""Grippers at given poses: against python-fcl, and where surfaces alone cannot decide."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from grasp3d import ObjectMesh, load_mesh
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.reach import collides
from grasp3d.hand.table import Table
from tests.helpers import shapes
from tests.helpers.collisions import Oracle, swept_parts
from tests.helpers.grippers import GRIPPERS, HAND, TIPS, normalized_poses, random_poses


def ball(radius: float = 100.0) -> ObjectMesh:
    return load_mesh(shapes.sphere(3, radius), unit="mm", max_edge="500mm")


@cache
def object_of(name: str) -> ObjectMesh:
    """A shipped mesh, or a scan that is not part of the project."""
    if "." in name:
        return load_mesh(shapes.LIBRARY / name)
    return load_mesh(shapes.shared("meshes", f"{name}.stl"), unit="m")


@pytest.mark.slow
@pytest.mark.parametrize("grip", [1, -1])
@pytest.mark.parametrize("hand", GRIPPERS, ids=lambda hand: hand.name)
@pytest.mark.parametrize("name", ["mug.glb", "torus.glb", "spray.glb", "ycb_006_mustard_bottle"])
def test_verdicts_are_those_of_fcl(name: str, hand: ParallelGripper, grip: int) -> None:
    mesh = object_of(name)
    scale = 1.0 / mesh.size
    poses, openings = random_poses(mesh, 150, seed=len(name))
    found = collides(mesh, poses, openings, hand, grip=grip)
    surface = mesh.contact_surface
    oracle = Oracle(surface.points, surface.faces)
    right = [
        oracle.collides(pose, opening * scale, hand, scale, grip=grip)
        for pose, opening in zip(normalized_poses(mesh, poses), openings, strict=True)
    ]
    touching = [one is None for one in right]
    assert sum(touching) < 5
    assert all(a is None or a == b for a, b in zip(right, found, strict=True))
    assert 0.1 < found.mean() < 0.9


@pytest.mark.slow
@pytest.mark.parametrize("hand", [HAND, TIPS], ids=lambda hand: hand.name)
def test_a_swept_gripper_collides_somewhere_on_its_way(hand: ParallelGripper) -> None:
    """The approach in 200 steps with open fingers; what the steps hit, the swept parts do."""
    mesh = load_mesh(shapes.LIBRARY / "mug.glb")
    scale = 1.0 / mesh.size
    poses, openings = random_poses(mesh, 25, seed=4)
    found = collides(mesh, poses, openings, hand)
    surface = mesh.contact_surface
    oracle = Oracle(surface.points, surface.faces)
    way = 1.6  # from the centre of the object out of the ball about it, for the poses used here
    missed = 0
    for pose, opening, verdict in zip(
        normalized_poses(mesh, poses), openings * scale, found, strict=True
    ):
        steps = np.tile(pose, (200, 1, 1))
        steps[:, :3, 3] -= np.linspace(way, 0.0, 200)[:, None] * pose[:3, 2]
        length = (hand.finger_length + hand.palm_length) * scale
        on_the_way = any(
            oracle.meets(step, swept_parts(hand, opening, scale, far=length, grow=-1e-6))
            for step in steps
        )
        assert verdict or not on_the_way
        missed += verdict and not on_the_way
    # The long boxes of the oracle reach no farther back than those that moved, so few differ:
    # only what lies between two steps.
    assert missed <= 1
    assert 3 < found.sum() < 22


def test_a_gripper_wholly_inside_a_solid_collides() -> None:
    small = replace(HAND, palm_length=0.02)
    for swept in (True, False):
        assert collides(ball(150.0), [np.eye(4)], 40.0, small, swept=swept).all()
    surface = ball(150.0).contact_surface
    parts = swept_parts(small, 40.0 / 300.0, 1.0 / 0.3, far=0.065 / 0.3)
    assert not Oracle(surface.points, surface.faces).meets(np.eye(4), parts)


def test_a_gripper_in_a_cavity_is_free_there_but_cannot_get_there() -> None:
    outer, inner = (trimesh.creation.icosphere(3, radius) for radius in (160.0, 150.0))
    inner.invert()
    shell = trimesh.util.concatenate([outer, inner])
    mesh = load_mesh((shell.vertices, shell.faces), unit="mm", max_edge="500mm")
    assert not collides(mesh, [np.eye(4)], 40.0, HAND, swept=False).any()
    assert collides(mesh, [np.eye(4)], 40.0, HAND).all()


def corners_below(pose: np.ndarray, opening: float, table: Table) -> bool:
    """Whether a corner of the hand, in metres, is below a table, not swept."""
    g = HAND
    inner = opening / 2 + g.compliance
    outer = opening / 2 + g.finger_thickness
    back = g.end - g.finger_length
    xs, ys, zs = [inner, outer, -inner, -outer], [g.finger_width / 2], [g.end, back]
    points = [(x, s * y, z) for x in xs for y in ys for z in zs for s in (1, -1)]
    points += [
        (a * g.palm_thickness / 2, b * g.palm_width / 2, z)
        for a in (1, -1)
        for b in (1, -1)
        for z in (back, back - g.palm_length)
    ]
    heights = (np.array(points) @ pose[:3, :3].T + pose[:3, 3]) @ table.normal
    return bool(heights.min() < table.offset)


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_a_table_is_avoided_from_every_side(up: str) -> None:
    mesh = load_mesh(shapes.sphere(2, 0.001), unit="m", max_edge=1.0)
    table = Table.below(mesh, up)  # type: ignore[arg-type]
    rng = np.random.default_rng(3)
    poses = np.tile(np.eye(4), (200, 1, 1))
    poses[:, :3, :3] = Rotation.random(200, rng=rng).as_matrix()
    poses[:, :3, 3] = rng.uniform(-0.15, 0.15, (200, 3))
    alone = collides(mesh, poses, 0.03, HAND, swept=False)
    found = collides(mesh, poses, 0.03, HAND, table=table, swept=False)
    expected = [corners_below(pose, 0.03, table) for pose in poses]
    assert (found == (alone | expected)).all()
    assert 0.1 < np.mean(expected) < 0.9
