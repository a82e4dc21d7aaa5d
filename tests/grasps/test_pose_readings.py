"""Mistakes in files of poses, which are recognised by what the jaws would do without them."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from grasp3d import ObjectMesh, load_mesh
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.grasps.pose_files import read_poses
from grasp3d.grasps.pose_readings import suspected_reading
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.parallel_gripper import preset
from tests.helpers import shapes

Floats = Any
HAND = preset("franka")
TO_TCP = np.linalg.inv(HAND.base_pose)


@pytest.fixture(scope="module")
def cone() -> ObjectMesh:
    """An object without symmetry, off the origin of its file."""
    vertices, faces = shapes.lopsided()
    return load_mesh((0.03 * vertices + [0.02, -0.01, 0.05], faces), unit="m", max_edge=1.0)


@pytest.fixture(scope="module")
def good(cone: ObjectMesh) -> Floats:
    """Poses at the middle of the object from all sides."""
    poses = np.tile(np.eye(4), (40, 1, 1))
    poses[:, :3, :3] = Rotation.random(40, random_state=0).as_matrix()
    poses[:, :3, 3] = cone.center
    return poses


def reordered(order: list[int]) -> Callable[[Floats], Floats]:
    def change(poses: Floats) -> Floats:
        changed = poses.copy()
        quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat()[:, order]
        changed[:, :3, :3] = Rotation.from_quat(quaternions).as_matrix()
        return changed

    return change


def transposed(poses: Floats) -> Floats:
    changed = poses.copy()
    changed[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
    return changed


def scaled(factor: float) -> Callable[[Floats], Floats]:
    def change(poses: Floats) -> Floats:
        changed = poses.copy()
        changed[:, :3, 3] *= factor
        return changed

    return change


def at_base(change: Callable[[Floats], Floats]) -> Callable[[Floats], Floats]:
    """A mistake in a file that has the poses of the hand's base."""
    return lambda poses: change(poses @ HAND.base_pose) @ TO_TCP


MISTAKES: dict[str, tuple[Callable[[Floats], Floats], str]] = {
    "wxyz": (at_base(reordered([3, 0, 1, 2])), "order (w x y z) instead"),
    "xyzw": (at_base(reordered([1, 2, 3, 0])), "order (x y z w) instead"),
    "zwxy": (at_base(reordered([2, 3, 0, 1])), "halves of their quaternions"),
    "scalar": (at_base(transposed), "rotations are inverted"),
    "inverse": (np.linalg.inv, "poses of the object in the gripper's frame"),
    "inverse base": (at_base(np.linalg.inv), "poses of the object in the gripper's frame"),
    "base": (lambda poses: poses @ HAND.base_pose, "those of the hand's base, 103.4 mm behind"),
    "twice": (lambda poses: poses @ TO_TCP, "103.4 mm farther back"),
    "mm": (scaled(1000.0), "lengths are millimetres instead of metres"),
    "cm": (at_base(scaled(100.0)), "lengths are centimetres instead of metres"),
    "in": (scaled(1.0 / 0.0254), "lengths are inches instead of metres"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named(cone: ObjectMesh, good: Floats, name: str) -> None:
    change, words = MISTAKES[name]
    message = suspected_reading(cone, change(good), HAND)
    assert words in message


def test_nothing_is_suspected_of_good_poses_and_of_few(cone: ObjectMesh, good: Floats) -> None:
    assert suspected_reading(cone, good, HAND) is None
    wrong = reordered([3, 0, 1, 2])(good)
    assert suspected_reading(cone, wrong[:4], HAND) is None
    assert suspected_reading(cone, good[:0], HAND) is None


def test_poses_beside_the_object_have_no_other_reading(cone: ObjectMesh, good: Floats) -> None:
    """That nothing fits is no proof of a mistake."""
    beside = good.copy()
    beside[:, :3, 3] += 0.2 * Rotation.random(40, random_state=1).apply([1.0, 0.0, 0.0])
    assert suspected_reading(cone, beside, HAND) is None


def test_evaluated_poses_are_warned_of(cone: ObjectMesh, good: Floats) -> None:
    def warnings(poses: Floats, mesh: ObjectMesh = cone) -> str:
        given = GraspPoses(poses=poses, unit="m")
        return " ".join(evaluate_grasps(mesh, given, hand=HAND).warnings)

    assert "jaws" not in warnings(good)
    assert "those of the hand's base" in warnings(good @ HAND.base_pose)
    wide = load_mesh(shapes.box((0.3, 0.3, 0.3)), unit="m", max_edge=1.0)
    inside = good.copy()
    inside[:, :3, 3] *= 0.1
    text = warnings(inside, wide)
    assert f"starts in the object in {len(good)} of {len(good)} poses" in text
    assert "narrower than the stroke" in text


@pytest.mark.slow
def test_published_poses_in_other_orders() -> None:
    """Quaternions and frames of a mug's 2,000 poses mixed up."""
    folder = shapes.shared("datasets", "acronym")
    poses = read_poses(next(folder.glob("*.h5")), hand=HAND)
    mesh = load_mesh(next(folder.glob("*.obj")), unit="m", max_edge=1e9)
    scale = poses.object_scale
    mesh = load_mesh((scale * mesh.vertices, mesh.faces), unit="m", max_edge=1e9)
    assert suspected_reading(mesh, poses.poses, HAND) is None
    for name in ("wxyz", "xyzw", "inverse", "base", "mm"):
        change, words = MISTAKES[name]
        message = suspected_reading(mesh, change(poses.poses), HAND)
        assert words in message
