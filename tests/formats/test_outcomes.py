"""Outcomes of grasps: the columns `outcome` and `success`, and any other values of a file."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
import yaml

from grasp3d import ParallelGripper, read_grasps
from grasp3d.errors import ContactError, SettingError
from grasp3d.formats import read_poses, write_grasps
from grasp3d.formats.poses import GraspPoses

HEAD = "px,py,pz,qx,qy,qz,qw"


def read(folder: Path, names: str, rows: list[str]) -> list[float]:
    path = folder / "log.csv"
    path.write_text("\n".join([f"{HEAD},{names}", *(f"0,0,0,1,0,0,0,{row}" for row in rows)]))
    return [None if math.isnan(one) else one for one in read_poses(path).outcome.tolist()]


@pytest.mark.parametrize("name", ["success", "outcome"])
@pytest.mark.parametrize(
    "words",
    [("1", "0", ""), ("true", "false", ""), ("True", "FALSE", " "), ("TRUE", "0", "nan"),
     ("1.0", "0.0", "")],
)  # fmt: skip
def test_a_table_spells_outcomes_in_several_ways(
    tmp_path: Path, name: str, words: tuple[str, ...]
) -> None:
    assert read(tmp_path, name, [*words, words[0]]) == [1.0, 0.0, None, 1.0]


@pytest.mark.parametrize("word", ["2", "maybe", "-1", "0.5", "inf", "yes", "3 of 5"])
@pytest.mark.parametrize("first", ["1", "true"])
def test_what_is_no_outcome_is_refused_with_its_row(tmp_path: Path, word: str, first: str) -> None:
    message = rf"log.csv: grasp 3: success must be 1 or true \(it held\), .* got '?{word}"
    with pytest.raises(ContactError, match=message):
        read(tmp_path, "success", [first, "0", word])


EXPECTED = [0.0, 1.0, None, 0.0, 1.0]
VALUES: dict[str, list[Any]] = {
    "flag": [False, True, None, False, True],
    "held": [0, 1, None, 0, 1],
    "stayed": [0.0, 1.0, math.nan, 0.0, 1.0],
    "result": ["false", "True", "", "0", "1"],
}
"""Values that mean the outcomes above."""

COUNT = len(EXPECTED)
FRANKA = ParallelGripper.preset("franka")


def plain() -> GraspPoses:
    known = np.zeros(COUNT)  # replaced by what is stated
    return GraspPoses(
        poses=np.tile(np.eye(4), (COUNT, 1, 1)), unit="m", hand=FRANKA, outcome=known, scores=known
    )


def with_values(path: Path, values: dict[str, list[Any]]) -> Path:
    """A file of poses that has these values of each grasp, as its format has them."""
    suffix = path.suffix
    if suffix in {".csv", ".parquet"}:
        write_grasps(path, plain())
        table = (pc.read_csv if suffix == ".csv" else pq.read_table)(path).drop_columns("outcome")
        for name, column in values.items():
            table = table.append_column(name, pa.array(column))
        (pc.write_csv if suffix == ".csv" else pq.write_table)(table, path)
    elif suffix == ".h5":
        write_grasps(path, plain())
        with h5py.File(path, "a") as file:
            for name, column in values.items():
                texts = any(isinstance(one, str) for one in column)
                floats = [np.nan if one is None else one for one in column]
                file[f"grasps/sim/{name}"] = column if texts else floats
    else:
        is_yaml = suffix == ".yaml"
        write_grasps(path, plain(), format=None if is_yaml else path.stem)
        content = (yaml.safe_load if is_yaml else json.loads)(path.read_text())
        grasps = content if path.stem == "moveit" else content["grasps"]
        if path.stem == "graspgen":
            grasps.update(values)
        else:
            for number, entry in enumerate(grasps.values() if is_yaml else grasps):
                entry.update({name: column[number] for name, column in values.items()})
        path.write_text((yaml.safe_dump if is_yaml else json.dumps)(content))
    return path


FILES = ("a.csv", "a.parquet", "a.h5", "a.yaml", "json.json", "graspgen.json", "moveit.json")


def known(outcomes: np.ndarray) -> list[float | None]:
    return [None if math.isnan(one) else one for one in outcomes.tolist()]


@pytest.mark.parametrize("name", FILES)
def test_outcomes_under_any_name_are_read_from_every_format(tmp_path: Path, name: str) -> None:
    path = with_values(tmp_path / name, VALUES if name.endswith((".csv", ".h5")) else json_values())
    for value in VALUES:
        assert known(read_grasps(path, hand=FRANKA, outcome=value).outcome) == EXPECTED, value


def json_values() -> dict[str, list[Any]]:
    """The same values where nan is null."""
    return VALUES | {"stayed": [0.0, 1.0, None, 0.0, 1.0]}


def test_names_of_data_sets_are_paths_or_their_ends(tmp_path: Path) -> None:
    path = with_values(tmp_path / "a.h5", VALUES)
    for name in ("held", "sim/held", "grasps/sim/held"):
        assert known(read_poses(path, hand=FRANKA, outcome=name).outcome) == EXPECTED
    own = read_poses(path, outcome="object_in_gripper").outcome
    np.testing.assert_array_equal(own, plain().outcome)
    with h5py.File(path, "a") as file:
        file["grasps/again/held"] = np.ones(COUNT)
        file["grasps/linked"] = h5py.ExternalLink("other.h5", "held")
        file["grasps/loop"] = file["grasps"]
        file["grasps/pairs"] = np.zeros((COUNT, 2))
    with pytest.raises(
        ContactError, match="it has both grasps/again/held and grasps/sim/held: give"
    ):
        read_poses(path, outcome="held")
    with pytest.raises(ContactError, match=r"called 'pairs': .*grasps/sim/flag") as error:
        read_poses(path, outcome="pairs")
    assert "linked" not in str(error.value)


def test_graspnet_rows_and_poses_in_memory_have_outcomes_too(tmp_path: Path) -> None:
    scores = np.array(VALUES["stayed"])
    poses = replace(plain(), scores=scores, columns={"slip": np.arange(5.0)})
    write_grasps(tmp_path / "a.npy", poses)
    assert known(read_poses(tmp_path / "a.npy", hand=FRANKA, outcome="score").outcome) == EXPECTED
    assert known(poses.with_outcomes("score").outcome) == EXPECTED
    with pytest.raises(ContactError, match=r"grasp 3: slip must be 1 or true .* got 2"):
        poses.with_outcomes("slip")
    with pytest.raises(ContactError, match="no outcome is called 'fall': its grasps have score, s"):
        poses.with_outcomes("fall")


def test_a_stated_outcome_replaces_those_of_the_format(tmp_path: Path) -> None:
    path = with_values(tmp_path / "a.csv", {"success": ["odd", "?", "-", "", "x"], **VALUES})
    with pytest.raises(ContactError, match="grasp 1: success must be 1 or true"):
        read_poses(path)
    assert known(read_poses(path, outcome="result").outcome) == EXPECTED
    both = with_values(tmp_path / "b.csv", {"success": [0, 1, 1, 1, 1], "outcome": [1] * 5})
    with pytest.raises(ContactError, match="both outcome and success: give"):
        read_poses(both)
    assert known(read_poses(both, outcome="success").outcome) == [0, 1, 1, 1, 1]
    assert "result" in read_poses(path, outcome="result").columns


def test_outcomes_are_for_poses(tmp_path: Path) -> None:
    path = tmp_path / "contacts.csv"
    path.write_text("x1,y1,z1,x2,y2,z2\n0,0,0,1,0,0\n")
    with pytest.raises(SettingError, match="contains no poses; outcome applies to poses"):
        read_grasps(path, outcome="success")
