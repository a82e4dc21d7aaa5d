"""Outcomes in tables and in JSON: the columns `outcome` and `success`."""

import json
import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from grasp3d.errors import ContactError
from grasp3d.grasps.pose_files import read_poses, write_poses
from grasp3d.grasps.poses import GraspPoses

HEAD = "px,py,pz,qx,qy,qz,qw"


def read(folder: Path, names: str, rows: list[str]) -> list[float]:
    path = folder / "log.csv"
    path.write_text("\n".join([f"{HEAD},{names}", *(f"0,0,0,1,0,0,0,{row}" for row in rows)]))
    return [None if math.isnan(one) else one for one in read_poses(path).outcome.tolist()]


@pytest.mark.parametrize("name", ["success", "outcome"])
@pytest.mark.parametrize(
    "words",
    [("1", "0", ""), ("true", "false", ""), ("yes", "no", ""), ("True", "FALSE", " "),
     ("Yes", "0", "nan"), ("1.0", "0.0", "")],
)  # fmt: skip
def test_a_table_spells_outcomes_in_several_ways(
    tmp_path: Path, name: str, words: tuple[str, ...]
) -> None:
    assert read(tmp_path, name, [*words, words[0]]) == [1.0, 0.0, None, 1.0]


@pytest.mark.parametrize("word", ["2", "maybe", "-1", "0.5", "inf"])
@pytest.mark.parametrize("first", ["1", "yes"])
def test_what_is_no_outcome_is_refused_with_its_row(tmp_path: Path, word: str, first: str) -> None:
    message = r"log.csv: grasp 3: success must be 1, true or yes .* got '?" + word
    with pytest.raises(ContactError, match=message):
        read(tmp_path, "success", [first, "0", word])


def test_both_columns_complete_each_other_and_may_not_differ(tmp_path: Path) -> None:
    assert read(tmp_path, "outcome,success", ["1,", ",no", "0,false", ","]) == [1.0, 0.0, 0.0, None]
    message = "grasp 2: its columns outcome and success contradict each other"
    with pytest.raises(ContactError, match=message):
        read(tmp_path, "outcome,success", ["1,1", "1,0"])


def test_success_is_the_outcome_in_parquet_and_json_too(tmp_path: Path) -> None:
    given = GraspPoses(poses=np.tile(np.eye(4), (3, 1, 1)), outcome=[1.0, 0.0, np.nan])
    write_poses(tmp_path / "a.parquet", given)
    table = pq.read_table(tmp_path / "a.parquet").drop_columns("outcome")
    bools = pa.array([True, False, None])
    pq.write_table(table.append_column("success", bools), tmp_path / "a.parquet")
    found = read_poses(tmp_path / "a.parquet")
    np.testing.assert_array_equal(found.outcome, given.outcome)
    assert "success" not in found.columns
    write_poses(tmp_path / "a.json", given)
    content = json.loads((tmp_path / "a.json").read_text())
    for entry, word in zip(content["grasps"], (True, "no", None), strict=True):
        del entry["outcome"]
        entry["success"] = word
    (tmp_path / "a.json").write_text(json.dumps(content))
    found = read_poses(tmp_path / "a.json")
    np.testing.assert_array_equal(found.outcome, given.outcome)
    assert "success" not in found.columns
    content["grasps"][0]["success"] = [1]
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(ContactError, match="grasp 1: success must be 1, true or yes"):
        read_poses(tmp_path / "a.json")


def test_no_further_column_can_be_called_success() -> None:
    with pytest.raises(ContactError, match="no column of poses can be called 'success'"):
        GraspPoses(poses=np.eye(4), columns={"success": np.array([1.0])})
