"""`--object-pose`: files with poses in the frame of a robot, written and read by the commands."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pytest
from scipy.spatial.transform import Rotation

from tests.helpers import shapes
from tests.helpers.commands import export, printed

TURN = Rotation.from_euler("xz", [20.0, 90.0], degrees=True).as_quat().tolist()
POSE = ",".join(map(str, [0.4, -0.05, 0.1, *TURN, "base_link"]))


@pytest.mark.slow
def test_grasps_in_the_robots_frame_are_the_same_grasps(tmp_path: Path) -> None:
    export(tmp_path / "box.stl", shapes.box((80.0, 50.0, 30.0)))
    label = ("label", "box.stl", "--unit", "mm", "--max-edge", "20mm", "--hand", "franka",
             "--table", "as-is", "--best", "2", "--overwrite")  # fmt: skip
    beside = printed(*label, "--grasps", "beside.csv", cwd=tmp_path)
    robots = printed(*label, "--grasps", "robot.csv", "--object-pose", POSE, cwd=tmp_path)
    assert "poses in the file: in the mesh's frame\n" in beside
    assert "poses in the file: in the robot's frame 'base_link'\n" in robots
    assert robots.count("warning: the table's up is 20° from z of the robot's frame") == 1
    level = printed(*label, "--grasps", "up.csv", "--object-pose", "-1,0,0,172", cwd=tmp_path)
    assert "z of the robot" not in level
    table = pc.read_csv(tmp_path / "robot.csv")
    pc.write_csv(table.drop_columns(["object_pose"]), tmp_path / "silent.csv")
    matrix = [[0.0, -1.0, 0.0, 0.4], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0] * 3 + [1.0]]
    (tmp_path / "other.json").write_text(json.dumps(matrix), encoding="utf-8")
    found: dict[str, pa.Table] = {}
    for name, given in {
        "beside": (), "robot": (), "silent": ("--object-pose", POSE),
        "other": ("--object-pose", "other.json"),
    }.items():  # fmt: skip
        poses = "silent.csv" if name == "other" else f"{name}.csv"
        printed("evaluate", "box.stl", poses, "--unit", "mm", "--hand", "franka", "-o",
                f"{name}_out.csv", *given, cwd=tmp_path)  # fmt: skip
        found[name] = pc.read_csv(tmp_path / f"{name}_out.csv")
    angles = {name: one["critical_angle"].to_numpy() for name, one in found.items()}
    np.testing.assert_allclose(angles["robot"], angles["beside"], atol=1e-9)
    np.testing.assert_allclose(angles["silent"], angles["beside"], atol=1e-9)
    assert found["beside"]["label"].to_pylist() == found["robot"]["label"].to_pylist() == ["S"] * 2
    assert found["other"]["closing"].to_pylist() != ["closed"] * 2  # it stands elsewhere
    # Results are in the frame that their poses were read in.
    for axis in ("px", "py", "pz", "x1", "ny2"):
        kept = found["robot"][axis].to_numpy()
        np.testing.assert_allclose(kept, found["silent"][axis].to_numpy(), atol=1e-9)
        if axis.startswith("p"):
            np.testing.assert_allclose(kept, table[axis].to_numpy(), atol=1e-9)
