"""How deep links are in objects, and objects in links, against bounds from dense division."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from grasp3d.arrays import Floats
from grasp3d.hand.link_tree import LinkShape
from grasp3d.mesh import ObjectMesh
from tests.hand.test_hand_contacts import SHAPES, gaps
from tests.helpers.link_depths import Depths, depth_of_link, depth_of_surface, signed_depth
from tests.helpers.link_scenes import solid

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


@pytest.mark.parametrize("kind", ["box", "cylinder", "sphere"])
@pytest.mark.parametrize("name", ["block", "mug", "torus"])
def test_depths_are_those_of_dense_division(name: str, kind: str) -> None:
    """Of one box deep in a block a climb ends 6 % too early."""
    off = compare(name, kind, 4, 3)
    assert off.max() < 1.0
    assert off.min() > -4.0
    assert np.median(np.abs(off)) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind"), [("block", "mesh"), ("ball", "sphere"), ("mug", "box"), ("torus", "cylinder")]
)
def test_many_depths_are_those_of_dense_division(name: str, kind: str) -> None:
    """At one pose in fifty a climb may end elsewhere, too early."""
    off = compare(name, kind, 50 if kind == "mesh" else 100, 5)
    assert off.max() < 1.0
    assert (off < -1.0).mean() <= 0.02


def test_depths_of_points_are_those_of_all_triangles() -> None:
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (25, 3))
    expected = signed_depth(surface("mug"))(points)
    np.testing.assert_allclose(depths_below("mug")(points), expected, atol=1e-7)
