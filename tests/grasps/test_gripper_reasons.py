"""Why poses of a gripper do not hold: the part that is named is in the object."""

import re
from functools import cache

import numpy as np
import pytest
import trimesh

from grasp3d import ObjectMesh, ParallelGripper, Table, evaluate_grasps, load_mesh
from grasp3d.grasps import EvaluatedPoses
from grasp3d.grasps.best import candidate_poses
from grasp3d.hand.scene import Scene
from tests.helpers.closing_jaws import Floats

FRANKA = ParallelGripper.preset("franka")
IN_OBJECT = re.compile(r"(finger 1|finger 2|palm) is ([\d.]+) mm inside the object")


@cache
def object_of(name: str) -> ObjectMesh:
    return load_mesh(f"meshes/{name}", unit="m")


@cache
def moved_into(name: str) -> EvaluatedPoses:
    """Free poses that are moved along the approach or aside by up to 4 cm."""
    mesh, rng = object_of(name), np.random.default_rng(2)
    scene = Scene(FRANKA)
    assert scene is not None
    poses = candidate_poses(mesh, scene)
    poses = poses[rng.permutation(len(poses))[:40]]
    poses[:, :3, 3] += rng.uniform(-0.04, 0.04, (len(poses), 1)) * poses[:, :3, 0]
    poses[:, :3, 3] += rng.uniform(0.0, 0.04, (len(poses), 1)) * poses[:, :3, 2]
    return evaluate_grasps(mesh, poses, hand=FRANKA)


def box_of(part: str) -> tuple[Floats, Floats]:
    """Lowest and highest corner of a part of the open gripper, by its lengths."""
    bottom = 0.5 * FRANKA.pad_height - FRANKA.finger_length
    if part == "palm":
        half = 0.5 * np.array([FRANKA.palm_thickness, FRANKA.palm_width])
        return np.array([*-half, bottom - FRANKA.palm_length]), np.array([*half, bottom])
    wide = 0.5 * FRANKA.max_opening - FRANKA.clearance
    x = (wide + FRANKA.compliance, wide + FRANKA.finger_thickness)
    low, high = sorted(x) if part == "finger 2" else sorted((-x[0], -x[1]))
    width = 0.5 * FRANKA.finger_width
    return np.array([low, -width, bottom]), np.array([high, width, 0.5 * FRANKA.pad_height])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hammer.ply", "bowl.ply", "banana.ply"])
def test_the_part_that_is_named_is_so_deep_in_the_object(name: str) -> None:
    mesh, found = object_of(name), moved_into(name)
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    named = [(row, IN_OBJECT.fullmatch(text)) for row, text in enumerate(found.reason.tolist())]
    named = [(row, match) for row, match in named if match]
    assert len(named) > 3
    for row, match in named:
        assert match is not None
        low, high = box_of(match[1])
        steps = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 17)] * 3), axis=-1).reshape(-1, 3)
        points = (low + steps * (high - low)) @ found.poses[row, :3, :3].T + found.poses[row, :3, 3]
        inside = points[surface.contains(points)]
        assert len(inside)
        _, depths, _ = trimesh.proximity.closest_point(surface, inside)
        assert depths.max() >= 0.9e-3 * float(match[2])


def test_every_pose_that_is_not_sure_has_a_reason() -> None:
    mesh = object_of("banana.ply")
    poses = np.concatenate([moved_into("banana.ply").poses[:10], [np.eye(4)]])
    found = evaluate_grasps(mesh, poses, hand=FRANKA, table=Table.below(mesh))
    assert [bool(text) for text in found.reason] == [letter < 2 for letter in found.letter]
    assert sum(kind != "" for kind in found.reasons.kinds) == (found.letter < 2).sum()


@pytest.mark.parametrize(("width", "reason"), [
    (0.079, ""), (0.0805, "finger 1 is 0.25 mm inside the object"),
    (0.09, "wider than the stroke by 10 mm"),
])  # fmt: skip
def test_a_wide_object_is_compared_with_the_stroke(width: float, reason: str) -> None:
    box = load_mesh(trimesh.creation.box([width, 0.04, 0.04]), unit="m")
    assert evaluate_grasps(box, np.eye(4)[None], hand=FRANKA).reason.tolist() == [reason]
