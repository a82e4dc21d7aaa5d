"""Mistakes planted into files of every format of grippers on shipped meshes are warned of."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import grasp3d
from grasp3d import ObjectMesh, load_mesh
from grasp3d.formats import Format, GraspPoses, read_poses, write_grasps
from grasp3d.formats.format import formats
from grasp3d.grasps.audit import audit_poses
from grasp3d.hand.frames import FRAMES
from grasp3d.hand.parallel_gripper import ParallelGripper

Floats = Any
HAND: Any = ParallelGripper.preset("franka")
MESHES = Path(__file__).parents[2] / "meshes"
OF_GRIPPERS = [one for one in formats().values() if one.hands != ("articulated",)]

ONE_OF_EACH_FRAME = [*{one.frame: one for one in OF_GRIPPERS}.values()]

FEW = 0.5
"""Share of the poses that must close, of those that do in the right file, for no warning."""


@cache
def found_on(file: str) -> tuple[ObjectMesh, Floats]:
    """A mesh, and 30 poses on it of which most close."""
    mesh = load_mesh(MESHES / file, unit="m")
    poses = grasp3d.label_surface(mesh, hand=HAND).reach.poses
    poses = poses[np.isfinite(poses).all(axis=(1, 2))]
    return mesh, poses[np.random.default_rng(0).permutation(len(poses))[:30]]


def quarter_turn(poses: Floats, to_tcp: Floats) -> Floats:
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    return poses @ to_tcp @ turn @ np.linalg.inv(to_tcp)


def other_origin(poses: Floats, to_tcp: Floats) -> Floats:
    """Those of the TCP where the file has the base, and the other way round."""
    other = to_tcp.copy()
    at_tcp = np.allclose(to_tcp[:3, 3], 0.0)
    other[:3, 3] = HAND.base_to_tcp * to_tcp[:3, 2] if at_tcp else 0.0
    return poses @ to_tcp @ np.linalg.inv(other)


def wxyz(poses: Floats, to_tcp: Floats) -> Floats:
    del to_tcp
    poses, turned = poses.copy(), Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    poses[:, :3, :3] = Rotation.from_quat(turned[:, [3, 0, 1, 2]]).as_matrix()
    return poses


def millimetres(poses: Floats, to_tcp: Floats) -> Floats:
    del to_tcp
    return poses * np.where(np.arange(4) == 3, [[1000.0]] * 3 + [[1.0]], 1.0)


MISTAKES: tuple[Callable[[Floats, Floats], Floats], ...] = (
    quarter_turn, other_origin, wxyz, millimetres,
)  # fmt: skip


def closing(mesh: ObjectMesh, poses: Floats) -> int:
    return int(HAND.close(mesh, poses).closed.sum())


@pytest.mark.slow
@pytest.mark.parametrize(
    "file", ["mug.glb", "banana.ply", "hammer.ply", "spray.glb", "screwdriver.ply"]
)
def test_planted_mistakes_are_warned_of_and_right_files_are_not(tmp_path: Path, file: str) -> None:
    mesh, right = found_on(file)
    known = GraspPoses(poses=right, unit="m", hand=HAND, outcome=np.array(1.0), scores=0.5)
    warned = 0

    def read_again(form: Format, poses: Floats) -> GraspPoses:
        path = tmp_path / f"a{form.suffixes[0]}"
        write_grasps(path, replace(known, poses=poses), format=form.name)
        return read_poses(path, hand=HAND, unit="m")

    expected = closing(mesh, right)
    for form in OF_GRIPPERS:
        to_tcp = FRAMES[form.frame].to_tcp(HAND)
        in_file = right @ np.linalg.inv(to_tcp)
        assert audit_poses(mesh, read_again(form, right), HAND) is None, form.name
        for mistake in MISTAKES if form in ONE_OF_EACH_FRAME else ():
            read = read_again(form, mistake(in_file, to_tcp) @ to_tcp)
            reading = audit_poses(mesh, read, HAND)
            warned += reading is not None
            if closing(mesh, read.on(mesh).poses) < FEW * expected:
                assert reading is not None, (form.name, mistake.__name__)
    assert warned >= 2 * len(ONE_OF_EACH_FRAME)
