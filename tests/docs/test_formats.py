"""The pages on files have every field that is written, and no other."""

import json
import re
from collections.abc import Iterator
from dataclasses import asdict, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
import pyvista
import yaml
from field_tables import MARKERS, MEANINGS, PLY_TYPES, pages
from generated_pages import with_markers

from grasp3d import (
    GraspModel,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    best_grasps,
    label_surface,
    load_mesh,
    sweep,
    validate_grasps,
)
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.inputs import MeshFile
from grasp3d.batch.row import COLUMNS, BestGrasp, Outcome, Row
from grasp3d.cli.check import check_file, write_checks
from grasp3d.formats import write_fields, write_glb, write_grasps, write_npz, write_ply, write_vtp
from grasp3d.formats.dictionaries import stored_objects
from grasp3d.formats.format import formats
from grasp3d.formats.poses import STAGES, GraspPoses
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.hand.closing import Closing
from grasp3d.jobs import ClusterSettings
from grasp3d.jobs.running import Done
from grasp3d.mesh.repair import RepairStep
from grasp3d.outcomes import simulate_grasps, write_validation
from grasp3d.quality.loads import Load
from grasp3d.surface.fields import CONTACTS, given_poses
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.sweeps import write_sweeps
from grasp3d.surface.vertex_fields import SURFACE, VERTICES, Reason
from tests.hand.test_articulated_hand import hand_of
from tests.helpers import shapes

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"
GRIPPER, LOAD = ParallelGripper.preset("franka"), Load(mass=0.5, grip_force=40.0)
Names = set[str]


@cache
def sections(page: str) -> dict[str, str]:
    """Text of each section of a page without its subsections, by title; generated tables too."""
    parts = re.split(r"^#+ (.+)$", with_markers(text_of(page), MARKERS), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def text_of(page: str) -> str:
    """The text of a page, which may be generated."""
    return pages().get(page) or (REFERENCE / page).read_text(encoding="utf-8")


def tables(title: str, page: str = "formats.md") -> list[Names]:
    """Names in the first column of each table of a section."""
    rows = re.findall(r"(?:^\|.*\n)+", sections(page)[title], re.MULTILINE)
    return [
        {
            name
            for row in table.splitlines()[2:]
            for name in re.findall("`(.+?)`", row.split("|")[1])
        }
        for table in rows
    ]


@cache
def labels(added: str = "points") -> SurfaceLabels:
    """Labels of contact points, with a location error, of a gripper, and with a load."""
    if added == "load":
        return labels("gripper").using(load=Load(mass=0.5))
    model = GraspModel(location_error=0.01 if added == "errors" else 0.0)
    hand = GRIPPER if added == "gripper" else None
    mesh = load_mesh(shapes.box(), unit="cm", max_edge="0.5cm")
    return label_surface(mesh, model, hand=hand, sampling=Sampling(rays=8))


@cache
def grasps() -> GraspTable:
    points = [[[5e-3, 1e-3, 2e-3], [-5e-3, 1e-3, 1e-3]]]
    return evaluate_grasps(labels().mesh, points, GraspModel())


def metadata(path: Path) -> dict[str, Any]:
    """The settings in a Parquet file."""
    return dict(json.loads(pq.read_schema(path).metadata[b"grasp3d"]))


def settings_with(added: str) -> tuple[Names, Names]:
    """Names in the tables of settings that a file has, and those of complete files."""
    always, complete, of_gripper, of_load = tables("Settings")
    of = {"gripper": of_gripper, "load": of_gripper | of_load}.get(added, set())
    return always | of, always | complete | of


@pytest.mark.parametrize("added", ["points", "errors", "gripper", "load"])
def test_labelled_files(tmp_path: Path, added: str) -> None:
    chosen = {"gripper": {"always", "gripper"}, "load": {"always", "gripper", "load"}}
    declared = [one for one in VERTICES if one.when in chosen.get(added, {"always"})]
    of_arrays = [one for one in declared if one.array]
    settings, complete = settings_with(added)

    write_ply(tmp_path / "out.ply", labels(added))
    header = (tmp_path / "out.ply").read_bytes().partition(b"end_header")[0].decode()
    assert set(re.findall(r"^property (\w+) (\w+)$", header, re.MULTILINE)) == {
        (PLY_TYPES[field.ply], name)
        for field in declared
        if field.ply
        for name in field.column_names(2)
    }
    assert set(re.findall(r"^comment grasp3d (\w+)", header, re.MULTILINE)) == complete | {"packed"}

    write_npz(tmp_path / "out.npz", labels(added))
    with np.load(tmp_path / "out.npz") as arrays:
        for field in of_arrays:
            assert arrays[field.name].dtype == field.kind
            assert arrays[field.name].shape[1:] == field.shape_for(2)
        names = {field.name for field in (*of_arrays, *SURFACE)}
        assert set(arrays.files) == names | {f"setting_{name}" for name in complete}

    write_vtp(tmp_path / "out.vtp", labels(added))
    data = pyvista.read(tmp_path / "out.vtp")
    assert set(data.point_data) == {name for one in of_arrays[1:] for name in one.point_names(2)}
    assert set(data.field_data) == {f"setting_{name}" for name in complete}

    write_glb(tmp_path / "out.glb", labels(added))
    content = (tmp_path / "out.glb").read_bytes()
    length = int.from_bytes(content[12:16], "little")  # of the first chunk, which is JSON
    assert set(json.loads(content[20 : 20 + length])["asset"]["extras"]["grasp3d"]) == settings

    write_fields(tmp_path / "out.parquet", labels(added))
    columns = pq.read_table(tmp_path / "out.parquet").schema
    assert [(one.name, "text" if pa.types.is_dictionary(one.type) else one.type.to_pandas_dtype())
            for one in columns] == [
        (name, "text" if field.texts else np.dtype(field.kind).type)
        for field in declared
        if field.table
        for name in field.column_names(2)
    ]  # fmt: skip
    assert set(metadata(tmp_path / "out.parquet")) == complete


def test_no_meaning_is_of_a_field_that_is_gone() -> None:
    shown = "".join(
        with_markers(text_of(page), MARKERS)
        for page in ("formats.md", "frames.md", "vertices.md", "rows.md")
    )
    assert [name for name, meaning in MEANINGS.items() if meaning not in shown] == []


def test_reasons() -> None:
    assert {reason.name.lower() for reason in Reason} == tables("Reasons")[0]
    for reason in Reason:
        assert f"| `{reason.name.lower()}` | {reason:d} |" in sections("formats.md")["Reasons"]


@pytest.mark.parametrize("also", ["nothing", "load", "metrics"])
@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".json"])
def test_grasps(tmp_path: Path, suffix: str, also: str) -> None:
    path = tmp_path / f"out{suffix}"
    written_grasps = replace(grasps(), load=LOAD if also == "load" else None)
    write_grasps(path, written_grasps, metrics=grasps().metrics() if also == "metrics" else None)
    whole, of_load, of_metrics, of_contact, settings = tables("Grasps")
    whole |= {"load": of_load, "metrics": of_metrics}.get(also, set())
    if also == "load":  # whose density and torques are not given
        settings |= tables("Settings")[3] - {"density", "torque_limits"}
    if suffix == ".json":
        written = json.loads(path.read_text())
        assert set(written) == {"grasp3d", "grasps"}
        assert set(written["grasps"][0]) == {*whole, "contacts"}
        assert set(written["grasps"][0]["contacts"][0]) == {field.name for field in CONTACTS}
        assert set(written["grasp3d"]) == settings
        return
    table = pc.read_csv(path) if suffix == ".csv" else pq.read_table(path)
    of_first = {name for name in table.column_names if not re.search(r"[2-9]$", name)}
    assert of_first == {*whole, *of_contact, "unit"}
    assert suffix == ".csv" or set(metadata(path)) == settings


def test_sweeps(tmp_path: Path) -> None:
    swept = sweep(labels().angle_distribution(), friction=0.5, sensor_resolution=0.2)
    write_sweeps(tmp_path / "out.csv", [swept], fractions=[0.5, 0.9])
    written = pc.read_csv(tmp_path / "out.csv").column_names
    assert set(written) == tables("Tables of sweeps")[0]


def test_simulated_grasps() -> None:
    mesh, hand = load_mesh(shapes.box(), unit="cm"), ParallelGripper.preset("wsg50")
    poses = GraspPoses(poses=np.diag([1.0, -1.0, -1.0, 1.0]), unit="cm")
    found = simulate_grasps(
        mesh, poses, hand=hand, cluster=ClusterSettings(workers=0),
        simulation={"pull_time": 0.02, "time_step": 2e-3, "pose_error": "1mm"},
    )  # fmt: skip
    columns, added = tables("Simulated grasps")
    evaluated = evaluate_grasps(mesh, poses, hand=hand).to_poses()
    assert set(found.columns) - set(evaluated.columns) == columns
    assert set(found.settings) - set(evaluated.settings) == added


@pytest.mark.slow
def test_validation(tmp_path: Path) -> None:
    box = load_mesh(shapes.box((6.0, 4.0, 2.0)), unit="cm")
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (4, 1, 1))
    tried = GraspPoses(poses=poses, outcome=np.array([1.0, 0.0, 1.0, 0.0]))
    write_validation(
        tmp_path / "out.csv", validate_grasps(tried, mesh=box, hand=GRIPPER, load=LOAD)
    )
    written = set(pc.read_csv(tmp_path / "out.csv").column_names)
    assert written - {field.name for field in given_poses()} == tables("Validation")[0]


def test_reports_of_check(tmp_path: Path) -> None:
    mesh_file = MeshFile("box.obj", str(shapes.LIBRARY / "box.obj"))
    checked = Done(mesh_file, check_file(mesh_file, BatchSettings()))
    write_checks(tmp_path / "out.json", [checked], BatchSettings())
    (mesh,) = json.loads((tmp_path / "out.json").read_text())["meshes"]
    assert set(mesh) == tables("Reports of check")[0]
    explained = sections("formats.md")["Reports of check"]
    parts = {key: mesh[key] for key in ("before", "after", "guess", "cost")}
    for key, names in {**parts, "repairs": RepairStep.__annotations__}.items():
        (row,) = re.findall(rf"^\|.*`{key}`.*\|(.*)\|$", explained, re.MULTILINE)[-1:]
        assert set(re.findall("`(.+?)`", row)) == set(names)


def test_columns_of_the_rows() -> None:
    assert tables("Columns of a batch", "rows.md") == [set(asdict(Row("mug")))]
    assert {field.name for field in fields(BestGrasp)} == tables("Columns of the rows")[0]
    assert all(outcome in COLUMNS["outcome"].meaning for outcome in Outcome)


OBJECT = {"com": [0, 0, 0], "mass": 1, "density": 1, "friction": 0.5, "volume": 1,
          "inertia": np.eye(3).tolist()}  # fmt: skip
"""What ACRONYM states of an object."""


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
    return GraspPoses(
        joint_names=("a",),
        unit="m",
        **{f"{stage}posture": np.ones((1, 1)) for stage in STAGES},  # type: ignore[arg-type]
        **{f"{stage}poses": np.eye(4) for stage in STAGES},  # type: ignore[arg-type]
    )


def paths(content: dict[str, Any], head: str = "") -> Iterator[str]:
    """Paths of the values in a file of two levels."""
    for name, value in content.items():
        yield from paths(value, f"{name}.") if isinstance(value, dict) else [f"{head}{name}"]


def of_format(name: str) -> list[Names]:
    """Names in the tables of the page of a format."""
    return tables(formats()[name].title, f"{name}.md")


def test_every_format_is_listed() -> None:
    for name, form in formats().items():
        assert f"| `{name}` | `{form.frame}`" in sections("frames.md")["Formats of poses"]
        assert text_of(f"{name}.md").startswith(f"# {form.title}\n")


def test_json(tmp_path: Path) -> None:
    write_grasps(tmp_path / "out.json", plain())
    written = json.loads((tmp_path / "out.json").read_text())
    header, grasp = of_format("json")
    assert set(written) == {"grasp3d", "grasps"}
    assert set(written["grasp3d"]) - set(OBJECT) == header
    (entry,) = written["grasps"]
    further = {"pregrasp_pose", "squeeze_pose", "squeeze_posture", "posture", "pregrasp_posture"}
    assert set(entry) == grasp - further
    assert set(entry["contacts"][0]) == {"point", "normal"}
    write_grasps(tmp_path / "hand.json", of_hand())
    (of_joints,) = json.loads((tmp_path / "hand.json").read_text())["grasps"]
    assert set(of_joints) == grasp - {"contacts"}


def test_tables_of_poses(tmp_path: Path) -> None:
    write_grasps(tmp_path / "out.csv", plain(), frame="graspgen")
    (columns,) = of_format("csv")
    write_grasps(tmp_path / "hand.csv", of_hand())
    joints = {name for name in columns if "joint:" in name or "pre" in name or "squeeze" in name}
    joints -= {"pregrasp_opening"}
    assert set(pc.read_csv(tmp_path / "out.csv").column_names) == columns - joints
    written = set(pc.read_csv(tmp_path / "hand.csv").column_names)
    assert {name.replace("NAME", "a") for name in joints} <= written
    write_grasps(tmp_path / "out.parquet", plain())
    assert set(metadata(tmp_path / "out.parquet")) - set(OBJECT) == of_format("json")[0]


def test_further_columns() -> None:
    of_poses, of_load, of_tried, *_ = tables("Further columns", "frames.md")
    vectors = {"contacts", "normals", "score"}
    mesh, found = labels().mesh, best_grasps(labels("gripper"), 2).to_poses()
    evaluated = evaluate_grasps(mesh, found, hand=GRIPPER).to_poses()
    for poses in (found, evaluated):
        assert set(poses.columns) | vectors == of_poses | vectors
    tried = evaluate_grasps(mesh, found, hand=GRIPPER, pose_error="1deg")
    assert set(tried.to_poses().columns) - set(found.columns) == of_tried
    loaded = evaluate_grasps(mesh, found, hand=GRIPPER, load=Load(mass=0.1))
    assert set(loaded.to_poses().columns) - set(found.columns) == of_load
    assert all(f"`{state.name.lower()}`" in MEANINGS["closing"] for state in Closing)


def test_formats_of_grippers(tmp_path: Path) -> None:
    write_grasps(tmp_path / "out.yaml", plain())
    written = yaml.safe_load((tmp_path / "out.yaml").read_text())
    (entry,) = written.pop("grasps").values()
    assert {*written, "grasps.NAME", *entry} == of_format("isaac_grasp")[0]

    write_grasps(tmp_path / "out.h5", plain())
    names: list[str] = []
    with h5py.File(tmp_path / "out.h5") as file:
        file.visititems(lambda name, item: names.append(name) if hasattr(item, "shape") else None)
    assert set(names) == of_format("acronym")[0]

    write_grasps(tmp_path / "graspgen.json", plain(), format="graspgen")
    content = json.loads((tmp_path / "graspgen.json").read_text())
    assert set(paths(content)) == of_format("graspgen")[0]

    write_grasps(tmp_path / "out.npy", plain(), format="graspnet")
    ranges = re.findall(r"^\| (\d+)(?:–(\d+))? ", text_of("graspnet.md"), re.MULTILINE)
    listed = [k for low, high in ranges for k in range(int(low), int(high or low) + 1)]
    assert listed == list(range(np.load(tmp_path / "out.npy").shape[1]))

    write_grasps(tmp_path / "moveit.json", plain(), format="moveit")
    (message,) = json.loads((tmp_path / "moveit.json").read_text())
    assert set(message) - {"header"} == of_format("moveit")[0]


@pytest.mark.parametrize("form", ["dexgraspbench", "dexgraspnet"])
def test_formats_of_hands(tmp_path: Path, form: str) -> None:
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
    assert written == {name.split(" ")[0] for name in of_format(form)[0]}
