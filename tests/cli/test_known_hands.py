"""`grasp3d evaluate` for poses of four hands whose answers geometry knows.

Around a ball all normals meet in its middle; on a box, from above, they are those of opposite
faces; on a cylinder none has a part along its axis. On a cone all of them point down by its half
angle: no grasp holds it with a friction angle below that, and the sensors cannot change it much.
"""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv as pc
import pytest
import trimesh

from grasp3d import evaluate_grasps, load_mesh, read_grasps, read_hand, write_grasps
from grasp3d.formats import GraspPoses
from tests.helpers.commands import printed
from tests.helpers.hands import hand_file

RADIUS = 0.045
CONE = 0.05, 0.12
"""Radius of the base, height [m]."""

FINE = ("--sensor-resolution", "5", "--friction")


SHAPES: dict[str, Callable[[], trimesh.Trimesh]] = {
    "allegro": lambda: trimesh.creation.icosphere(4, RADIUS),
    "leap": lambda: trimesh.creation.box([0.08, 0.05, 0.1]),
    "shadow": lambda: trimesh.creation.cylinder(0.04, 0.16, sections=128),
    "barrett": lambda: trimesh.creation.cone(*CONE, sections=128),
}

POSES: dict[str, tuple[list[float], list[float]]] = {
    "allegro": (
        [0.09563, 0.01503, 0.0366, 0.0, 0.0, -0.96185, 0.27358],
        [-0.1845, 0.5213, 0.4623, 0.4966, 0.0108, 0.4487, 0.4804, 0.4595, 0.2094, 0.5667, 0.5031,
         0.498, 1.3756, 0.4605, 0.5266, 0.5388],
    ),
    "leap": (
        [-0.14217, 0.01921, 0.12462, 0.7071, -0.00367, 0.70709, 0.00367],
        [0.4181, 0.3954, 0.0363, 0.1449, -0.3568, 0.4489, 0.4204, 1.0758, 0.3062, 0.5477, 0.6122,
         0.4802, 1.7832, 0.4176, 0.7049, 0.6057],
    ),
    "shadow": (
        [-0.06544, 0.04883, -0.40126, 0.99769, 0.06798, 0.0, 0.0],
        [-0.0887, -0.0742, -0.3084, -0.019, 0.2317, 1.5679, 0.347, 0.3179, 0.2871, 0.2459, -0.3399,
         0.6604, 0.3875, 0.0383, 0.1196, -0.1863, 0.8443, 0.1101, 1.0846, 0.1784, 0.8408, -0.0461,
         0.1329, 0.36],
    ),
    "barrett": (
        [-0.00591, -0.01282, 0.20112, 0.0, 0.38456, 0.9231, 0.0],
        [-0.0001, -1.0027, -1.0269, -1.217],
    ),
}  # fmt: skip
"""Position and quaternion w x y z of the base, and values of the joints."""


def evaluated(name: str, folder: Path, *words: str) -> tuple[dict[str, Any], str]:
    """Row of the table that the command writes, and what it prints."""
    description = folder / f"{name}.json"
    if not description.exists():
        printed("hand", hand_file(name), "-o", description.name, cwd=folder)
        SHAPES[name]().export(folder / "object.stl")
        numbers, posture = POSES[name]
        pose = trimesh.transformations.quaternion_matrix(numbers[3:])
        pose[:3, 3] = numbers[:3]
        joints = read_hand(description).joint_names
        poses = GraspPoses(poses=pose, posture=np.array([posture]), joint_names=joints, unit="m")
        write_grasps(folder / "poses.csv", poses)
    text = printed(
        "evaluate", "object.stl", "poses.csv", "--hand", description.name, "--unit", "m",
        "--overwrite", *words, cwd=folder, columns=400,
    )  # fmt: skip
    (row,) = pc.read_csv(folder / "object_grasps.csv").to_pylist()
    return row, text


def normals(name: str, folder: Path) -> tuple[Any, Any]:
    """Contact points and normals into the object, of the same poses in Python."""
    poses = read_grasps(folder / "poses.csv")
    mesh = load_mesh(folder / "object.stl", unit="m")
    hand = read_hand(folder / f"{name}.json")
    return evaluate_grasps(mesh, poses, hand=hand).contacts_of(0)


@pytest.mark.slow
def test_allegro_around_a_ball(tmp_path: Path) -> None:
    row, text = evaluated("allegro", tmp_path, *FINE, "0.5")
    assert (row["label"], row["reason"]) == ("S", None)
    assert row["critical_angle"] == pytest.approx(0.0, abs=math.radians(2.0))
    assert re.search(r"■ S +surely stable +1 +100.0 %", text)
    points, inward = normals("allegro", tmp_path)
    np.testing.assert_allclose(inward, -points / RADIUS, atol=0.08)  # of facets


@pytest.mark.slow
def test_leap_on_a_box_from_above(tmp_path: Path) -> None:
    row, _ = evaluated("leap", tmp_path, *FINE, "0.8")
    assert row["label"] == "U"
    assert row["reason"].endswith("inside the object")
    assert row["margin"] > 0.0  # what the contacts are, if it could be there
    assert {"fingertip", "thumb_fingertip"} <= set(row["links"].split())
    points, inward = normals("leap", tmp_path)
    axis = np.abs(inward).argmax(axis=1)
    along = np.take_along_axis(points, axis[:, None], axis=1)[:, 0]
    half = np.array(trimesh.load_mesh(tmp_path / "object.stl").extents)[axis] / 2.0
    flat = np.abs(inward).max(axis=1) > 1.0 - 1e-6  # others are over an edge, between two faces
    sides = -half * np.sign(np.take_along_axis(inward, axis[:, None], axis=1)[:, 0])
    np.testing.assert_allclose(along[flat], sides[flat], atol=1e-6)
    assert flat.sum() >= 3
    assert ((inward * points)[np.abs(inward) > 1e-6] < 0.0).all()  # into the box
    assert {-1.0, 1.0} == set(np.sign(along[axis == 1]))
    assert (axis == 1).sum() >= 4


@pytest.mark.slow
def test_shadow_on_a_cylinder(tmp_path: Path) -> None:
    row, _ = evaluated("shadow", tmp_path, *FINE, "0.8")
    assert row["label"] == "S"
    points, inward = normals("shadow", tmp_path)
    np.testing.assert_allclose(inward[:, 2], 0.0, atol=1e-6)
    np.testing.assert_allclose(inward[:, :2], -points[:, :2] / 0.04, atol=0.08)


@pytest.mark.slow
def test_barrett_on_a_cone(tmp_path: Path) -> None:
    """No friction angle below the half angle of the cone holds it."""
    half_angle = math.atan(CONE[0] / CONE[1])
    row, _ = evaluated("barrett", tmp_path, *FINE, "1.0")
    assert row["label"] == "S"
    assert row["critical_angle"] > half_angle - math.radians(0.5)
    slippery = f"{math.tan(half_angle - math.radians(4.0)):.3f}"
    row, _ = evaluated("barrett", tmp_path, *FINE, slippery)
    assert row["label"] == "U"
