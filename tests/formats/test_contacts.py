import csv
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from grasp3d import GraspModel, load_mesh
from grasp3d.errors import ContactError
from grasp3d.formats import write_grasps
from grasp3d.formats.own import SUFFIXES, read_contacts
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.surface.grasp_table import GraspTable
from tests.helpers import shapes

NAMES = ["x1", "y1", "z1", "x2", "y2", "z2", "x3", "y3", "z3"]
HEAD = "x1,y1,z1,x2,y2,z2"
GRASPS = [
    [[0.5, 0.1, 0.2], [-0.5, 0.1, 0.1], [0.0, 0.5, 0.3]],
    [[0.25, 0.1, 0.5], [-0.25, 0.1, 0.5], [0.0, 0.1, -0.5]],
    [[0.5, 0.5, 0.125], [0.5, 0.5, 0.125], [0.5, 0.5, 0.125]],
]
GRASP_COLUMNS = [
    "grasp", "label", "score", "critical_angle", "critical_angle_best", "max_resolution", "margin",
    "epsilon", "epsilon_min", "epsilon_max", "rank", "opening", "separation",
]  # fmt: skip
CONTACT_COLUMNS = ["x", "y", "z", "nx", "ny", "nz", "distance", "on_crease"]


@cache
def grasps() -> GraspTable:
    """Grasps on faces and on a crease, and one with all its contacts at one point."""
    mesh = load_mesh(shapes.box(), unit="cm", max_edge="0.5cm")
    points = 0.01 * np.array(GRASPS)
    found = evaluate_grasps(mesh, points, GraspModel(0.9), max_distance="1mm")
    assert np.isinf(found.critical_angle).tolist() == [False, False, True]
    assert found.contacts.on_crease.any()
    return found


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_written_grasps_are_the_same_when_read_back(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"out{suffix}"
    write_grasps(path, grasps())
    points = read_contacts(path)
    assert np.array_equal(points, grasps().contacts.points)
    again = evaluate_grasps(grasps().mesh, points, grasps().model)
    assert np.array_equal(again.label, grasps().label)
    for name in GRASP_COLUMNS[2:]:
        found, known = getattr(again, name), getattr(grasps(), name)
        np.testing.assert_allclose(found, known, rtol=1e-9, atol=1e-12, err_msg=name)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_tables_have_a_row_for_each_grasp(tmp_path: Path) -> None:
    write_grasps(tmp_path / "out.csv", grasps())
    with (tmp_path / "out.csv").open(newline="") as stream:
        header, *rows = csv.reader(stream)
    contacts = [f"{name}{i}" for i in (1, 2, 3) for name in CONTACT_COLUMNS]
    assert header == [*GRASP_COLUMNS, *contacts, "unit"]
    table = [dict(zip(header, row, strict=True)) for row in rows]
    assert [row["grasp"] for row in table] == ["1", "2", "3"]
    assert [row["label"] for row in table] == ["UMS"[code] for code in grasps().label]
    assert table[2]["critical_angle"] == "inf"
    assert [float(row["epsilon"]) for row in table] == grasps().epsilon.tolist()
    assert [float(row["distance3"]) for row in table] == grasps().distance[:, 2].tolist()
    outward = [[float(row[f"n{axis}3"]) for axis in "xyz"] for row in table]
    np.testing.assert_allclose(outward, -grasps().contacts.normals[:, 2])
    assert table[0]["ny3"] == "1"
    assert (table[0]["on_crease1"], table[2]["on_crease1"]) == ("false", "true")
    write_grasps(tmp_path / "out.parquet", grasps())
    stored = pq.read_table(tmp_path / "out.parquet")
    assert stored.column_names == header
    settings = json.loads(stored.schema.metadata[b"grasp3d"])
    assert (settings["friction"], settings["fingers"]) == (0.9, 3)


def test_json_has_a_list_of_contacts_for_each_grasp(tmp_path: Path) -> None:
    write_grasps(tmp_path / "out.json", grasps())
    found = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"), parse_constant=int)
    assert found["grasp3d"]["unit"] == "m"
    assert [list(grasp) for grasp in found["grasps"]] == [[*GRASP_COLUMNS, "contacts"]] * 3
    assert found["grasps"][2]["critical_angle"] is None  # which is no number in JSON
    last = found["grasps"][0]["contacts"][2]
    assert list(last) == ["point", "normal", "distance", "on_crease"]
    assert last["point"] == pytest.approx([0.0, 0.005, 0.003])
    assert (str(last["normal"]), last["on_crease"]) == ("[0.0, 1.0, 0.0]", False)


def test_files_without_grasps(tmp_path: Path) -> None:
    none = grasps().contacts.take(np.empty(0, dtype=np.int64))
    empty = np.empty(0)
    nothing = GraspTable(
        contacts=none, model=grasps().model, critical_angle=empty, critical_angle_best=empty
    )
    for suffix in SUFFIXES:
        write_grasps(tmp_path / f"out{suffix}", nothing)
        with pytest.raises(ContactError, match="no grasps in it"):
            read_contacts(tmp_path / f"out{suffix}")


def table(path: Path, names: list[str] | None = None, rows: Any = None, end: str = "\n") -> Path:
    given = np.reshape(GRASPS, (3, 9)).tolist() if rows is None else rows
    lines = [",".join(names or NAMES), *(",".join(map(str, row)) for row in given)]
    path.write_text(end.join(lines) + end, encoding="utf-8")
    return path


def test_other_columns_order_spaces_and_line_ends_do_not_matter(tmp_path: Path) -> None:
    rows = np.reshape(GRASPS, (3, 9))
    order = np.random.default_rng(1).permutation(9)
    mixed = [[f"grasp {k}", *row[order].tolist(), ""] for k, row in enumerate(rows)]
    names = ["name", *[NAMES[k] for k in order], "notes"]
    path = table(tmp_path / "mixed.csv", names, mixed, end="\r\n")
    assert np.array_equal(read_contacts(path), GRASPS)
    spaced = table(tmp_path / "spaced.CSV", [f" {name} " for name in NAMES])
    assert np.array_equal(read_contacts(spaced), GRASPS)
    marked = tmp_path / "marked.csv"
    marked.write_bytes(b"\xef\xbb\xbf" + spaced.read_bytes())
    assert np.array_equal(read_contacts(marked), GRASPS)
    whole = pa.table({name: pa.array([1, 2], pa.int32()) for name in NAMES[:6]})
    pq.write_table(whole, tmp_path / "whole.parquet")
    assert read_contacts(tmp_path / "whole.parquet").tolist() == [[[k] * 3] * 2 for k in (1, 2)]
    plain = tmp_path / "plain.json"
    plain.write_text(json.dumps(GRASPS))
    assert np.array_equal(read_contacts(plain), GRASPS)


BAD: dict[str, tuple[str, str, str]] = {
    "no such columns": (
        "csv",
        "a,b,c\n1,2,3\n",
        "column x1 is missing; contacts have x1 y1 z1 x2 y2 z2 ...;",
    ),
    "gap": (
        "csv",
        "x1,y1,z1,x2,y2\n1,2,3,4,5\n",
        "column z2 is missing; contacts have x1 y1 z1 x2",
    ),
    "twice": ("csv", f"{HEAD},x1\n1,2,3,4,5,6,7\n", "two columns are called 'x1'"),
    "word": ("csv", f"{HEAD}\n1,2,3,4,5,6\n1,2,3,4,far,6\n", "y2 must be a number; got 'far'"),
    "empty cell": ("csv", f"{HEAD}\n1,2,3,4,5,6\n1,2,,4,5,6\n", "grasp 2: contact 1 is not"),
    "ragged": ("csv", f"{HEAD}\n1,2,3\n", "Expected 6 columns, got 3"),
    "no json": ("json", "[[[1, 2", "is not valid JSON"),
    "object": ("json", '{"contacts": []}', "its grasps, each a list of contacts [x, y, z], must"),
    "one grasp": (
        "json",
        "[[0, 0, 1], [0, 0, 2]]",
        "its contacts, as many as of grasp 1, must be 3",
    ),
    "text": ("json", '[[[0, 0, 1], [0, "a", 2]]]', "as many as of grasp 1, must be 2 x 3 numbers"),
    "huge": ("json", f"[[[0, 0, 1], [0, 1{'0' * 400}, 2]]]", "has 401 digits, and at most 300 are"),
    "one contact": ("json", "[[[0, 0, 1]]]", "a grasp has 2 to 32 contacts; got 1"),
    "different": ("json", json.dumps([GRASPS[0], GRASPS[1][:2]]), "grasp 2: its contacts, as many"),
    "deep": ("json", "[" * 100_000, "nested too deeply"),
}


@pytest.mark.parametrize("name", BAD)
def test_invalid_files_are_refused_in_one_line(tmp_path: Path, name: str) -> None:
    suffix, text, expected = BAD[name]
    path = tmp_path / f"contacts.{suffix}"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ContactError) as caught:
        read_contacts(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert any(part in message for part in expected.split("|")), message
    assert "\n" not in message
    assert len(message) < len(str(path)) + 250
