"""Files of postures: the same grasps through every format, and what is wrong in files by others."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv as pc
import pytest

from grasp3d.errors import ContactError
from grasp3d.grasps.pose_files import read_poses, write_poses
from grasp3d.grasps.poses import GraspPoses
from tests.grasps.test_poses import with_joints


def equal(one: Any, other: Any, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(one, other, rtol=0.0, atol=tolerance)


def same_grasps(one: GraspPoses, other: GraspPoses, tolerance: float = 1e-9) -> None:
    """Poses and postures of all stages are the same."""
    assert one.joint_names == other.joint_names
    for name in ("poses", "posture", "pregrasp_posture", "squeeze_posture"):
        equal(getattr(one, name), getattr(other, name), tolerance)
    for name in ("pregrasp_poses", "squeeze_poses"):
        first, second = getattr(one, name), getattr(other, name)
        assert (first is None) == (second is None)
        if first is not None:
            equal(first, second, tolerance)


@pytest.mark.parametrize("suffix", [".json", ".csv", ".parquet"])
@pytest.mark.parametrize("names", [("index", "thumb"), ()])
def test_own_files_have_the_postures_of_all_stages(
    tmp_path: Path, suffix: str, names: tuple[str, ...]
) -> None:
    poses = replace(with_joints(), joint_names=names)
    write_poses(tmp_path / f"a{suffix}", poses)
    same_grasps(read_poses(tmp_path / f"a{suffix}"), poses)


def test_own_files_have_joints_by_name(tmp_path: Path) -> None:
    write_poses(tmp_path / "a.json", with_joints())
    content = json.loads((tmp_path / "a.json").read_text())
    assert content["grasps"][1]["posture"] == {"index": 2.0, "thumb": 3.0}
    assert content["grasps"][1]["pregrasp_posture"] == {"index": 0.3, "thumb": None}
    write_poses(tmp_path / "a.csv", with_joints())
    columns = pc.read_csv(tmp_path / "a.csv").column_names
    assert {"joint:index", "pregrasp_joint:thumb", "squeeze_joint:thumb"} <= {*columns}
    assert {"pregrasp_px", "pregrasp_qw"} <= {*columns}
    assert "squeeze_px" not in columns


def test_the_order_of_joints_in_a_file_does_not_matter(tmp_path: Path) -> None:
    poses = with_joints()
    write_poses(tmp_path / "a.json", poses)
    content = json.loads((tmp_path / "a.json").read_text())
    for entry in content["grasps"]:
        entry["squeeze_posture"] = dict(reversed([*entry["squeeze_posture"].items()]))
    (tmp_path / "a.json").write_text(json.dumps(content))
    same_grasps(read_poses(tmp_path / "a.json"), poses)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"posture": {"index": 1.0}}, "grasp 2: posture must have the joints of grasp 1; 'thumb'"),
        ({"posture": {"index": 1.0, "thumb": "x"}}, "grasp 2: posture must be a list of 2 numb"),
        ({"posture": {"index": 1.0, "thumb": None}}, "grasp 2: value 2 of its posture must be fin"),
        ({"posture": [1.0, 2.0]}, "grasp 2: posture must be an object of keys and values"),
        ({"squeeze_posture": None}, "grasp 2: squeeze_posture must be an object of keys"),
    ],
)
def test_postures_that_are_none_are_refused_with_their_grasp(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    write_poses(tmp_path / "a.json", with_joints())
    content = json.loads((tmp_path / "a.json").read_text())
    content["grasps"][1] |= change
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(ContactError, match=message):
        read_poses(tmp_path / "a.json")


def test_a_table_without_a_joint_of_one_stage_is_refused(tmp_path: Path) -> None:
    rows = ["px,py,pz,qx,qy,qz,qw,unit,joint:a,joint:b,squeeze_joint:a", "0,0,0,0,0,0,1,m,1,2,3"]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    with pytest.raises(ContactError, match="column squeeze_joint:b is missing"):
        read_poses(tmp_path / "a.csv")
