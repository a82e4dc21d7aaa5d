"""The tables of fields on the pages on file formats, made from their declaration.

    python -m tests.docs.field_tables

writes them anew, between the comments `<!-- fields: NAME -->` and `<!-- end of fields -->`. What a
field means, the column without a heading, is that of its row on the page.
"""

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import get_args

from grasp3d.formats.surfaces.layouts import HIDDEN
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.surface.fields import (
    CLOSING_SHARE,
    CONTACTS,
    GRASPS,
    HAND_GRASPS,
    Field,
    When,
    given_poses,
)
from grasp3d.surface.vertex_fields import SURFACE, VERTICES

DOCS = Path(__file__).parents[2] / "docs"
PAGES = (DOCS / "formats.md", DOCS / "pose_formats.md", DOCS / "guide" / "elsewhere.md")

TYPES = {
    "f8": "float64", "f4": "float", "u1": "uint8", "i1": "int8", "i8": "int64", "u8": "uint64",
    "?": "bool",
}  # fmt: skip
PLY_TYPES = {"f8": "double", "f4": "float", "u1": "uchar"}
MEANING = "MEANING"
_BLOCK = re.compile(r"(<!-- fields: (.+?) -->\n)(.*?)(<!-- end of fields -->)", re.DOTALL)


def rendered(page: str) -> str:
    """The text of a page with its tables of fields made from the declaration."""
    return _BLOCK.sub(
        lambda found: f"{found[1]}\n{_filled(TABLES[found[2]], found[3])}\n{found[4]}", page
    )


def _filled(table: str, present: str) -> str:
    """A table with what its fields mean, by the first cell of their rows of the present table."""
    rows = [line[2:-2].split(" | ") for line in present.splitlines() if line]
    column = rows[0].index("") if rows and "" in rows[0] else None
    if column is None:
        return table
    meanings = {row[0]: row[column] for row in rows[2:]}
    lines = table.splitlines(keepends=True)
    filled = lines[:2]
    for line in lines[2:]:
        name = line[2:].split(" | ")[0]
        assert meanings.get(name), f"state what {name} means, in a row of its table"
        filled.append(line.replace(MEANING, meanings[name], 1))
    return "".join(filled)


def vertex_table(when: When) -> str:
    """What labelled files have of each vertex."""
    head = ["field", "type, shape", "unit", "", "NPZ", "VTP", "Parquet", "PLY"]
    return _table(head, [_vertex_row(field) for field in VERTICES if field.when == when])


def _vertex_row(field: Field) -> list[str]:
    points, columns = (
        _named(field, names) for names in (field.point_names(2), field.column_names(2))
    )
    return [
        _names([field.name]),
        f"{TYPES[field.kind]} {_shape(('V', *field.shape))}",
        field.unit,
        MEANING,
        "yes" if field.array else "",
        points if field.array else "",
        columns + ", text" * bool(field.texts) if field.table else "",
        f"{columns}, {PLY_TYPES[field.ply]}" if field.ply else "packed" * (field in HIDDEN),
    ]


def _named(field: Field, names: list[str]) -> str:
    """Names of a field in a format."""
    return "yes" if names == [field.name] else _names(names)


def surface_table() -> str:
    """The arrays that are not of vertices."""
    rows = [
        [_names([one.name]), f"{TYPES[one.kind]} {_shape(one.shape)}", MEANING] for one in SURFACE
    ]
    return _table(["array", "type, shape", ""], rows)


def column_table(fields: Iterable[Field], when: When, head: str) -> str:
    """Columns of tables of grasps or poses."""
    chosen = [field for field in fields if field.when == when and not field.shape]
    rows = [[_names([one.name]), _type(one), one.unit, MEANING] for one in chosen]
    return _table([head, "type", "unit", ""], rows)


def contact_table() -> str:
    """Columns of the first contact of grasps, and their keys in JSON."""
    rows = [
        [
            _names([f"{name}1" for name in one.columns or (one.name,)]),
            _names([one.name]),
            _type(one),
            one.unit,
            MEANING,
        ]
        for one in CONTACTS
    ]
    return _table(["column", "JSON", "type", "unit", ""], rows)


FRAME_SOURCES = {
    "tcp": ("grasp3d", "the frame of this project's grippers"),
    "hand": (
        "isaac_grasp 1.0, moveit_msgs/Grasp",
        "base_axes and base_to_tcp of the gripper: its link in robot descriptions",
    ),
    "isaac": (
        "Isaac Sim, grasp editor",
        "Isaac Sim, documentation of the grasp editor: the frame of gripper_frame_link",
    ),
    "moveit": ("MoveIt", "moveit_msgs/Grasp: the parent link of the end effector"),
    "graspgen": (
        "GraspGen, also in its isaac_grasp files",
        "GraspGen, docs/GRIPPER_DESCRIPTION.md",
    ),
    "acronym": ("ACRONYM", "acronym_tools/acronym.py, create_gripper_marker"),
    "graspnetapi": (
        "graspnetAPI, AnyGrasp",
        "graspnetAPI/utils/utils.py, plot_gripper_pro_max; of a depth of 20 mm",
    ),
    "dexnet": ("Dex-Net", "dexnet/grasping/grasp.py, ParallelJawPtGrasp3D"),
    "gpd": (
        "GPD",
        (
            "gpd/candidate/hand.h and GraspConfig.msg: columns approach, binormal, "
            "axis; of the default hand_depth, 60 mm"
        ),
    ),
    "burg": ("burg-toolkit", "burg_toolkit/gripper/base.py"),
    "panda_hand": ("franka_description", "franka_hand.xacro"),
    "panda_hand_tcp": ("franka_description", "franka_hand.xacro"),
    "panda_link8": (
        "MoveIt with the flange of the Franka arm",
        "franka_hand.xacro: the hand is turned by -45 degrees about z",
    ),
    "robotiq_arg2f_base_link": (
        "ROS-Industrial's description of Robotiq grippers",
        "robotiq_arg2f_85_model_macro.xacro",
    ),
    "robotiq_85_base_link": (
        "PickNik's description of Robotiq grippers",
        "robotiq_2f_85_macro.urdf.xacro",
    ),
}
"""By name of a frame: programs and formats that have it, and where it is stated."""


def frame_table() -> str:
    """Frames of grippers by name."""
    rows = []
    for name, frame in FRAMES.items():
        used_by, source = FRAME_SOURCES[name]
        rows.append([f"`{name}`", used_by, *_frame(frame), source])
    return _table(["frame", "of", "approach", "closing", "TCP", "source"], rows)


def _frame(frame: GripperFrame) -> list[str]:
    """Axes of a frame, and where the TCP is."""
    words = {"tcp": "origin", "base": "base", "ends": "ends"}
    place = words[frame.origin] + (f" + {1000.0 * frame.ahead:g} mm" if frame.ahead else "")
    turned = f", turned by {math.degrees(frame.turn):g}°" if frame.turn else ""
    return [frame.approach or "its own", f"{frame.closing or 'its own'}{turned}", place]


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _names(names: Iterable[str]) -> str:
    return " ".join(f"`{name}`" for name in names)


def _shape(sizes: Iterable[int | str]) -> str:
    texts = [str(size).replace("-", " − ") for size in sizes]
    return f"({', '.join(texts)}{',' * (len(texts) == 1)})"


def _type(field: Field) -> str:
    kinds = {"f": "number", "i": "int", "?": "bool", "U": "text"}
    return "text" if field.texts else kinds[field.kind[0]]


TABLES = {
    **{f"vertices, {when}": vertex_table(when) for when in get_args(When)},
    "surface": surface_table(),
    "grasps": column_table(GRASPS, "always", "column, in JSON key of each grasp"),
    "grasps, gripper": column_table(GRASPS, "gripper", "column"),
    "forces": column_table(GRASPS, "load", "column, in JSON key of each grasp"),
    "contacts": contact_table(),
    "given poses": column_table(given_poses(), "always", "column"),
    "given poses, load": column_table(given_poses(), "load", "column"),
    "hands with joints": column_table(HAND_GRASPS, "always", "column"),
    "motors": column_table(HAND_GRASPS, "load", "column"),
    "tried poses": column_table((CLOSING_SHARE,), "pose error", "column"),
    "gripper frames": frame_table(),
}


if __name__ == "__main__":
    for path in PAGES:
        path.write_text(rendered(path.read_text(encoding="utf-8")), encoding="utf-8")
