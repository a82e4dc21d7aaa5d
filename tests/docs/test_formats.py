"""The page on file formats has every field that is written, and no other."""

import json
import re
from collections.abc import Iterable
from dataclasses import asdict, fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
import pyvista
from format_pages import with_rows

from grasp3d import (
    GraspModel,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
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
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.jobs import ClusterSettings
from grasp3d.jobs.running import Done
from grasp3d.mesh.repair.work import RepairStep
from grasp3d.outcomes import simulate_grasps, write_validation
from grasp3d.quality.loads import Load
from grasp3d.surface.fields import CONTACTS, Field, given_poses
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.sweeps import write_sweeps
from grasp3d.surface.vertex_fields import SURFACE, VERTICES
from grasp3d.surface.vertex_grasps import Reason
from tests.docs.field_tables import PAGES, PLY_TYPES, rendered
from tests.helpers import shapes

PAGE = Path(__file__).parents[2] / "docs" / "formats.md"
Names = set[str]


def sections_of(page: str) -> dict[str, str]:
    """Text of each section of a page without its subsections, by title."""
    parts = re.split(r"^#+ (.+)$", page, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def sections() -> dict[str, str]:
    """Sections of the page on file formats."""
    return sections_of(PAGE.read_text(encoding="utf-8"))


def tables(title: str) -> list[Names]:
    """Names in the first column of each table of a section of that page."""
    return tables_of(PAGE.read_text(encoding="utf-8"), title)


def tables_of(page: str, title: str) -> list[Names]:
    """Names in the first column of each table of a section of a page."""
    rows = re.findall(r"(?:^\|.*\n)+", sections_of(page)[title], re.MULTILINE)
    return [
        {
            name
            for row in table.splitlines()[2:]
            for name in re.findall("`(.+?)`", row.split("|")[1])
        }
        for table in rows
    ]


@cache
def labels() -> SurfaceLabels:
    mesh = load_mesh(shapes.box(), unit="cm", max_edge="0.5cm")
    return label_surface(mesh, GraspModel(), sampling=Sampling(rays=8))


@cache
def grasps() -> GraspTable:
    points = [[[5e-3, 1e-3, 2e-3], [-5e-3, 1e-3, 1e-3]]]
    return evaluate_grasps(labels().mesh, points, GraspModel())


LOAD = Load(mass=0.5, grip_force=40.0)


def metadata(path: Path) -> Names:
    """Names of the settings in a Parquet file."""
    return set(json.loads(pq.read_schema(path).metadata[b"grasp3d"]))


@cache
def with_gripper() -> SurfaceLabels:
    hand = ParallelGripper.preset("franka")
    return label_surface(labels().mesh, GraspModel(), hand=hand)


@pytest.fixture(params=["points", "errors", "gripper", "load"])
def added(request: pytest.FixtureRequest) -> str:
    """What there is besides contact points: nothing, a location error, a gripper, also a load."""
    return str(request.param)


def labels_with(added: str) -> SurfaceLabels:
    if added == "points":
        return labels()
    if added == "errors":
        return label_surface(labels().mesh, GraspModel(location_error=0.01))
    return with_gripper().using(load=Load(mass=0.5)) if added == "load" else with_gripper()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.stem))
def test_tables_of_fields_are_those_of_the_declaration(page: Path) -> None:
    """They are written by `python -m tests.docs.field_tables`."""
    text = page.read_text(encoding="utf-8")
    assert text == rendered(text)


def chosen_with(added: str) -> Names:
    """What fields and settings there are with what is added."""
    return {"always", "gripper", "load"} if added == "load" else {"always", added}


def fields_with(added: str) -> list[Field]:
    """The declared fields of vertices with what is added."""
    return [field for field in VERTICES if field.when in chosen_with(added)]


def settings_with(added: str, *, complete: bool = True) -> Names:
    """Names in the tables of settings."""
    order = ("always", "complete", "gripper", "load")
    chosen = chosen_with(added) | ({"complete"} if complete else set())
    listed = zip(order, tables("Settings"), strict=True)
    return set().union(*(table for name, table in listed if name in chosen))


def test_labelled_ply(tmp_path: Path, added: str) -> None:
    write_ply(tmp_path / "out.ply", labels_with(added))
    header = (tmp_path / "out.ply").read_bytes().partition(b"end_header")[0].decode()
    properties = re.findall(r"^property (\w+) (\w+)$", header, re.MULTILINE)
    assert {(name, kind) for kind, name in properties} == {
        (name, PLY_TYPES[field.ply])
        for field in fields_with(added)
        if field.ply
        for name in field.column_names(2)
    }
    settings = set(re.findall(r"^comment grasp3d (\w+)", header, re.MULTILINE))
    assert settings == settings_with(added) | {"packed"}


def test_npz(tmp_path: Path, added: str) -> None:
    write_npz(tmp_path / "out.npz", labels_with(added))
    with np.load(tmp_path / "out.npz") as arrays:
        written = {name for name in arrays.files if not name.startswith("setting_")}
        settings = {name.removeprefix("setting_") for name in set(arrays.files) - written}
        of_vertices = [field for field in fields_with(added) if field.array]
        for field in of_vertices:
            assert arrays[field.name].dtype == field.kind
            assert arrays[field.name].shape[1:] == field.shape_for(2)
    assert written == {field.name for field in (*of_vertices, *SURFACE)}
    assert settings == settings_with(added)


def test_vtp(tmp_path: Path, added: str) -> None:
    write_vtp(tmp_path / "out.vtp", labels_with(added))
    data = pyvista.read(tmp_path / "out.vtp")
    of_points = [field for field in fields_with(added) if field.array][1:]
    assert set(data.point_data) == {name for one in of_points for name in one.point_names(2)}
    settings = {f"setting_{name}" for name in settings_with(added)}
    assert set(data.field_data) == settings


def test_glb(tmp_path: Path, added: str) -> None:
    write_glb(tmp_path / "out.glb", labels_with(added))
    content = (tmp_path / "out.glb").read_bytes()
    length = int.from_bytes(content[12:16], "little")  # of the first chunk, which is JSON
    settings = json.loads(content[20 : 20 + length])["asset"]["extras"]["grasp3d"]
    assert set(settings) == settings_with(added, complete=False)


def test_table_of_vertices(tmp_path: Path, added: str) -> None:
    path = tmp_path / "out.parquet"
    write_fields(path, labels_with(added))
    expected = [
        (name, "text" if field.texts else field.kind)
        for field in fields_with(added)
        if field.table
        for name in field.column_names(2)
    ]
    table = pq.read_table(path)
    kinds = [
        "text" if pa.types.is_dictionary(column.type) else column.to_numpy().dtype
        for column in table.columns
    ]
    assert list(zip(table.column_names, kinds, strict=True)) == expected
    assert metadata(path) == settings_with(added)


def test_reasons() -> None:
    assert {reason.name.lower() for reason in Reason} == tables("Reasons")[0]
    for reason in Reason:
        assert f"| `{reason.name.lower()}` | {reason:d} |" in sections()["Reasons"]


def first_finger(names: Iterable[str]) -> Names:
    """Columns without those of the fingers after the first."""
    return {name for name in names if not re.search(r"[2-9]$", name)}


@pytest.mark.parametrize("also", ["nothing", "load", "metrics"])
@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".json"])
def test_grasps(tmp_path: Path, suffix: str, also: str) -> None:
    path = tmp_path / f"out{suffix}"
    written_grasps = replace(grasps(), load=LOAD if also == "load" else None)
    write_grasps(path, written_grasps, metrics=grasps().metrics() if also == "metrics" else None)
    whole, of_load, of_metrics, of_contact, settings = tables("Grasps")
    in_json = {field.name for field in CONTACTS}
    whole |= {"load": of_load, "metrics": of_metrics}.get(also, set())
    if also == "load":  # whose density and torques are not given
        settings |= tables("Settings")[3] - {"density", "torque_limits"}
    if suffix == ".json":
        written = json.loads(path.read_text())
        assert set(written) == {"grasp3d", "grasps"}
        assert set(written["grasps"][0]) == {*whole, "contacts"}
        assert set(written["grasps"][0]["contacts"][0]) == in_json
        assert set(written["grasp3d"]) == settings
        return
    table = pc.read_csv(path) if suffix == ".csv" else pq.read_table(path)
    assert first_finger(table.column_names) == {*whole, *of_contact, "unit"}
    assert suffix == ".csv" or metadata(path) == settings


def test_sweeps(tmp_path: Path) -> None:
    swept = sweep(labels().angle_distribution(), friction=0.5, sensor_resolution=0.2)
    write_sweeps(tmp_path / "out.csv", [swept], fractions=[0.5, 0.9])
    written = pc.read_csv(tmp_path / "out.csv").column_names
    assert set(written) == tables("Tables of sweeps")[0]


def test_simulated_grasps(tmp_path: Path) -> None:
    mesh, hand = load_mesh(shapes.box(), unit="cm"), ParallelGripper.preset("wsg50")
    poses = GraspPoses(poses=np.diag([1.0, -1.0, -1.0, 1.0]), unit="cm")
    found = simulate_grasps(
        mesh, poses, hand=hand, cluster=ClusterSettings(workers=0),
        simulation={"pull_time": 0.02, "time_step": 2e-3, "pose_error": "1mm"},
    )  # fmt: skip
    write_grasps(tmp_path / "out.parquet", found)
    columns, added = tables("Simulated grasps")
    evaluated = evaluate_grasps(mesh, poses, hand=hand).to_poses()
    assert set(found.columns) - set(evaluated.columns) == columns
    assert columns < set(pq.read_table(tmp_path / "out.parquet").column_names)
    assert set(found.settings) - set(evaluated.settings) == added


@pytest.mark.slow
def test_validation(tmp_path: Path) -> None:
    box, hand = (
        load_mesh(shapes.box((6.0, 4.0, 2.0)), unit="cm"),
        ParallelGripper.preset("franka"),
    )
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (4, 1, 1))
    tried = GraspPoses(poses=poses, outcome=np.array([1.0, 0.0, 1.0, 0.0]))
    found = validate_grasps(tried, mesh=box, hand=hand, load=LOAD)
    write_validation(tmp_path / "out.csv", found)
    written = set(pc.read_csv(tmp_path / "out.csv").column_names)
    (listed,) = tables("Validation")
    assert written - {field.name for field in given_poses()} == listed


def test_reports_of_check(tmp_path: Path) -> None:
    mesh_file = MeshFile("box.obj", str(shapes.LIBRARY / "box.obj"))
    checked = Done(mesh_file, check_file(mesh_file, BatchSettings()))
    (keys,) = tables("Reports of check")
    write_checks(tmp_path / "out.json", [checked], BatchSettings())
    (mesh,) = json.loads((tmp_path / "out.json").read_text())["meshes"]
    assert set(mesh) == keys
    explained = sections()["Reports of check"]
    parts = {key: mesh[key] for key in ("before", "after", "guess", "cost")}
    for key, names in {**parts, "repairs": RepairStep.__annotations__}.items():
        (row,) = re.findall(rf"^\|.*`{key}`.*\|(.*)\|$", explained, re.MULTILINE)[-1:]
        assert set(re.findall("`(.+?)`", row)) == set(names)


def test_columns_of_the_rows() -> None:
    columns, best = tables_of(with_rows(PAGE.read_text(encoding="utf-8")), "Columns of the rows")
    assert set(asdict(Row("mug"))) == columns
    assert {field.name for field in fields(BestGrasp)} == best
    for outcome in Outcome:
        assert outcome in COLUMNS["outcome"].meaning
