"""Poses of grasps on a surface, and the files that contain them."""

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from grasp3d import (
    GraspModel,
    Label,
    SurfaceLabels,
    Table,
    best_grasps,
    label_surface,
    load_mesh,
    write_grasps,
)
from grasp3d.errors import OutputError, SettingError
from grasp3d.grasps import poses_of
from grasp3d.grasps.pose_files import holds_poses, read_poses
from grasp3d.hand.parallel_gripper import ParallelGripper
from tests.helpers import shapes
from tests.helpers.grippers import TIPS

MODEL = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0))


@cache
def held(fingers: int = 2) -> SurfaceLabels:
    mesh = load_mesh(shapes.box((60.0, 40.0, 20.0)), unit="mm", max_edge=10.0 * (fingers - 1) ** 2)
    model = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0), fingers=fingers)
    hand = ParallelGripper.preset("franka") if fingers == 2 else TIPS
    table = Table.below(mesh) if fingers == 2 else None
    return label_surface(mesh, model, hand=hand, table=table)


def test_poses_have_all_that_is_known_of_the_grasps() -> None:
    best = best_grasps(held(), 4)
    poses = poses_of(best)
    assert (poses.count, poses.unit, poses.hand.name) == (4, "mm", "franka")
    np.testing.assert_array_equal(poses.poses, best.reach.poses)
    np.testing.assert_array_equal(poses.opening, best.reach.opening)
    assert poses.columns["label"].tolist() == [Label(code).name for code in best.label]
    assert poses.columns["closed_label"].tolist() == ["S"] * 4
    np.testing.assert_array_equal(poses.columns["contacts"], best.contacts.points)
    np.testing.assert_array_equal(poses.columns["critical_angle"], best.critical_angle)
    # The closing axis is along the contacts, and the contacts are at the pads.
    for pose, points in zip(poses.poses, best.contacts.points, strict=True):
        inner = (points - pose[:3, 3]) @ pose[:3, :3]
        assert inner[0, 0] == pytest.approx(-inner[1, 0])
        assert np.abs(inner[:, 1]) == pytest.approx(0.0, abs=1e-9)
        assert (np.abs(inner[:, 2]) <= 0.4 * 17.6 + 1e-9).all()


@pytest.mark.parametrize(
    ("suffix", "form"),
    [("json", None), ("csv", None), ("parquet", None), ("yaml", None), ("h5", None),
     ("npy", None), ("json", "moveit")],
)  # fmt: skip
def test_files_of_grasps_have_their_poses(tmp_path: Path, suffix: str, form: str | None) -> None:
    for name in {"yaml": ("yaml",), "h5": ("h5py",)}.get(suffix, ()):
        shapes.reader(name)
    best, path = best_grasps(held(), 3), tmp_path / f"box.{suffix}"
    write_grasps(path, best, format=form)
    assert holds_poses(path)
    again = read_poses(path, hand=held().scene.hand).in_unit("mm")
    np.testing.assert_allclose(again.poses, best.reach.poses, atol=1e-4)
    if suffix in {"json", "parquet"} and form is None:
        assert {"friction", "source"} <= set(again.settings)


def test_grasps_without_poses_are_refused(tmp_path: Path) -> None:
    mesh = held().mesh
    ideal = best_grasps(label_surface(mesh, MODEL), 2)
    with pytest.raises(SettingError, match="label the surface with a gripper"):
        poses_of(ideal)
    with pytest.raises(SettingError, match="label the surface with a gripper"):
        write_grasps(tmp_path / "a.json", ideal, format="moveit")
    with pytest.raises(OutputError):
        write_grasps(tmp_path / "a.obj", best_grasps(held(), 2))
    assert list(tmp_path.iterdir()) == []
