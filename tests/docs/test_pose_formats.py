"""The page on formats of poses has every field that is written, and no other."""

import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
import yaml
from format_pages import rendered

from grasp3d import GraspModel, Load, ParallelGripper, best_grasps, label_surface, load_mesh
from grasp3d.formats import write_grasps
from grasp3d.formats.format import formats
from grasp3d.formats.poses import STAGES, GraspPoses
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.hand.closing import Closing
from grasp3d.surface.fields import HAND_GRASPS
from grasp3d.system.stored_arrays import stored_objects
from tests.docs.test_formats import Names, sections_of, tables_of
from tests.hand.test_articulated_hand import hand_of
from tests.helpers import shapes

PAGE = rendered((Path(__file__).parents[2] / "docs" / "pose_formats.md").read_text("utf-8"))
GRIPPER = ParallelGripper.preset("franka")
OBJECT = {"com": [0, 0, 0], "mass": 1, "density": 1, "friction": 0.5, "volume": 1,
          "inertia": np.eye(3).tolist()}  # fmt: skip
"""What ACRONYM states of an object."""


def tables(title: str) -> list[Names]:
    """Names in the first column of each table of a section."""
    return tables_of(PAGE, title)


@cache
def plain() -> GraspPoses:
    """A pose of which everything is known but further columns."""
    return GraspPoses(
        poses=np.diag([1.0, -1.0, -1.0, 1.0]),
        opening=np.array(0.05),
        pregrasp_opening=np.array(0.054),
        scores=np.array(0.5),
        outcome=np.array(1.0),
        unit="m",
        hand=GRIPPER,
        settings=OBJECT,
        columns={"contacts": np.zeros((1, 2, 3)), "normals": np.ones((1, 2, 3))},
    )


@cache
def of_hand() -> GraspPoses:
    """A pose of a hand with a joint."""
    moved = np.eye(4)
    return GraspPoses(
        joint_names=("a",),
        unit="m",
        **{f"{stage}posture": np.ones((1, 1)) for stage in STAGES},  # type: ignore[arg-type]
        **{f"{stage}poses": moved for stage in STAGES},  # type: ignore[arg-type]
    )


@cache
def found() -> GraspPoses:
    """Poses of grasps that were found."""
    mesh = load_mesh(shapes.box(), unit="cm", max_edge="0.5cm")
    labels = label_surface(mesh, GraspModel(), hand=GRIPPER)
    return best_grasps(labels, 2).to_poses()


@cache
def evaluated() -> EvaluatedPoses:
    return evaluate_grasps(load_mesh(shapes.box(), unit="cm"), found(), hand=GRIPPER)


def paths(content: dict[str, Any], head: str = "") -> Iterator[str]:
    """Paths of the values in a file of two levels."""
    for name, value in content.items():
        yield from paths(value, f"{name}.") if isinstance(value, dict) else [f"{head}{name}"]


def test_every_format_is_listed() -> None:
    for name, form in formats().items():
        assert f"| `{name}` | `{form.frame}`" in PAGE
        assert f"\n## {form.title}\n" in PAGE


def test_json(tmp_path: Path) -> None:
    write_grasps(tmp_path / "out.json", plain())
    written = json.loads((tmp_path / "out.json").read_text())
    header, grasp = tables("JSON")
    assert set(written) == {"grasp3d", "grasps"}
    assert set(written["grasp3d"]) - set(OBJECT) == header
    (entry,) = written["grasps"]
    further = {"pregrasp_pose", "squeeze_pose", "squeeze_posture", "posture", "pregrasp_posture"}
    assert set(entry) == grasp - further
    write_grasps(tmp_path / "hand.json", of_hand())
    (of_joints,) = json.loads((tmp_path / "hand.json").read_text())["grasps"]
    assert set(of_joints) == grasp - {"contacts"}
    assert set(entry["contacts"][0]) == {"point", "normal"}


def test_tables(tmp_path: Path) -> None:
    write_grasps(tmp_path / "out.csv", plain(), frame="graspgen")
    (columns,) = tables("CSV")
    write_grasps(tmp_path / "hand.csv", of_hand())
    joints = {name for name in columns if "joint:" in name or "pre" in name or "squeeze" in name}
    joints -= {"pregrasp_opening"}
    assert set(pc.read_csv(tmp_path / "out.csv").column_names) == columns - joints
    written = set(pc.read_csv(tmp_path / "hand.csv").column_names)
    assert {name.replace("NAME", "a") for name in joints} <= written
    write_grasps(tmp_path / "out.parquet", plain())
    metadata = json.loads(pq.read_schema(tmp_path / "out.parquet").metadata[b"grasp3d"])
    assert set(metadata) - set(OBJECT) == tables("JSON")[0]


def test_further_columns() -> None:
    of_poses, of_load, *of_hands, of_tried = tables("Further columns")
    assert set.union(*of_hands) == {field.name for field in HAND_GRASPS}
    vectors = {"contacts", "normals", "score"}
    for poses in (found(), evaluated().to_poses()):
        assert set(poses.columns) | vectors == of_poses | vectors
    mesh, columns = load_mesh(shapes.box(), unit="cm"), set(found().columns)
    tried = evaluate_grasps(mesh, found(), hand=GRIPPER, pose_error="1deg")
    assert set(tried.to_poses().columns) - columns == of_tried
    loaded = evaluate_grasps(mesh, found(), hand=GRIPPER, load=Load(mass=0.1))
    assert set(loaded.to_poses().columns) - columns == of_load
    named = set(re.findall("`(.+?)`", sections_of(PAGE)["Further columns"].split("`closing` |")[1]))
    assert {state.name.lower() for state in Closing} <= named


def test_isaac_grasp(tmp_path: Path) -> None:
    write_grasps(tmp_path / "out.yaml", plain())
    written = yaml.safe_load((tmp_path / "out.yaml").read_text())
    (entry,) = written.pop("grasps").values()
    assert {*written, "grasps.NAME", *entry} == tables("isaac_grasp")[0]


def test_acronym(tmp_path: Path) -> None:
    write_grasps(tmp_path / "out.h5", plain())
    names: list[str] = []
    with h5py.File(tmp_path / "out.h5") as file:
        file.visititems(lambda name, item: names.append(name) if hasattr(item, "shape") else None)
    assert set(names) == tables("ACRONYM")[0]


def test_graspgen(tmp_path: Path) -> None:
    write_grasps(tmp_path / "out.json", plain(), format="graspgen")
    written = json.loads((tmp_path / "out.json").read_text())
    assert set(paths(written)) == tables("GraspGen")[0]


def test_graspnet(tmp_path: Path) -> None:
    write_grasps(tmp_path / "out.npy", plain(), format="graspnet")
    width = np.load(tmp_path / "out.npy").shape[1]
    ranges = re.findall(r"^\| (\d+)(?:–(\d+))? ", sections_of(PAGE)["graspnetAPI"], re.MULTILINE)
    listed = [k for low, high in ranges for k in range(int(low), int(high or low) + 1)]
    assert listed == list(range(width))


def test_moveit(tmp_path: Path) -> None:
    write_grasps(tmp_path / "out.json", plain(), format="moveit")
    (message,) = json.loads((tmp_path / "out.json").read_text())
    assert set(message) - {"header"} == tables("moveit_msgs/Grasp")[0]


@pytest.mark.parametrize(
    ("form", "title"),
    [("dexgraspbench", "DexGraspBench"), ("dexgraspnet", "DexGraspNet")],
)
def test_formats_of_hands(tmp_path: Path, form: str, title: str) -> None:
    hand = hand_of("allegro")
    poses = GraspPoses(
        poses=np.eye(4),
        joint_names=hand.joint_names,
        unit="m",
        hand=hand,
        **{f"{stage}posture": np.zeros((1, 16)) for stage in STAGES},  # type: ignore[arg-type]
    )
    write_grasps(tmp_path / "out.npy", poses, format=form)
    (content,) = stored_objects(tmp_path / "out.npy") or []
    joints = {f"qpos.{name}" for name in hand.joint_names}
    written = {"qpos.NAME" if name in joints else name for name in paths(content)}
    assert written == {name.split(" ")[0] for name in tables(title)[0]}
