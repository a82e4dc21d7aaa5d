"""The settings in labelled files: as text, and as values again."""

import json
import math
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from grasp3d.arrays import HEADER_ERRORS, Floats, text_of
from grasp3d.errors import GraspError
from grasp3d.hand.hand_files import hand_of_line
from grasp3d.hand.scene import Scene
from grasp3d.hand.table import Approach, Table
from grasp3d.quality.loads import Load, load_from
from grasp3d.reading.sources import LONGEST_HEADER
from grasp3d.settings import AnySampling, GraspModel, MeshOptions, sampling_kind
from grasp3d.settings.lengths import Unit
from grasp3d.settings.parsing import settings_of_texts
from grasp3d.stability.label import Mode
from grasp3d.surface.label_settings import GIVEN_ANGLE, SETTING
from grasp3d.surface.vertex_grasps import SearchReport
from grasp3d.system.documents import parse_json, problem_of_file
from grasp3d.system.isolation import CallFailedError, call
from grasp3d.system.ply_files import settings_of_header
from grasp3d.system.tables import read_settings

NEEDED = (
    "mode", "friction", "sensor_resolution", "fingers", "method", "search_angle", "unit",
    "file_vertices", "surface",
)  # fmt: skip
"""Settings that every labelled file has."""


@dataclass(frozen=True)
class FileSettings:
    """Settings that a file was labelled with."""

    model: GraspModel
    sampling: AnySampling | None
    """None: a scan."""
    options: MeshOptions
    mode: Mode
    search: SearchReport
    unit: Unit | None
    file_vertices: int
    scene: Scene | None = None
    """The gripper that must reach each grasp, and the table; None: ideal points."""
    load: Load | None = None
    """What each grasp must hold; None: nothing, or its task cannot be read again."""
    has_load: bool = False
    """Whether there is a load, be its task known or not."""


def settings_from(texts: Mapping[str, str]) -> FileSettings:
    """Parse the settings of a labelled file.

    Args:
        texts: Texts by name; unknown names are ignored.

    Raises:
        ValueError: They are not valid settings; the message gives the reason.
    """
    missing = [name for name in NEEDED if name not in texts]
    if missing:
        raise ValueError(f"there is no comment {missing[0]!r}")
    mode = texts["mode"]
    if mode not in get_args(Mode):
        raise ValueError(f"its mode is {mode[:20]!r}")
    values = dict(texts, unit="None" if texts["unit"] == "unknown" else texts["unit"])
    try:
        options = settings_of_texts(MeshOptions, values)
        model = settings_of_texts(GraspModel, values)
        kind = sampling_kind(model.fingers)
        search, angle = _search(values)
        sampled = {**values, "search_angle": angle}
        return FileSettings(
            model=model,
            sampling=None if mode == "scan" else settings_of_texts(kind, sampled),
            options=options,
            mode="scan" if mode == "scan" else "label",
            search=search,
            unit=options.unit,
            file_vertices=int(values["file_vertices"]),
            scene=_scene(values),
            load=load_from(values),
            has_load="object_mass" in values,
        )
    except KeyError as error:
        raise ValueError(f"there is no comment {error.args[0]!r}") from error
    except (TypeError, OverflowError, GraspError) as error:
        raise ValueError(str(error)) from error


def _search(values: Mapping[str, str]) -> tuple[SearchReport, str]:
    """Extent of the search, and the angle that was given: where a file lacks it, the searched."""
    extent: dict[str, Any] = {
        "cone": float(values["search_angle"]),
        "rays": int(values.get("rays_traced", "0")),
        "evaluated": int(values.get("candidates_evaluated", "0")),
    }
    angle = values["search_angle"]
    if "search" in values:
        extent = dict(parse_json(values["search"]))
        angle = str(extent.pop(GIVEN_ANGLE))
    report = SearchReport(**extent)
    if not (isinstance(report.cone, float) and 0.0 < report.cone <= math.pi):
        raise ValueError(f"its search angle is {report.cone}")
    return report, angle


def _scene(values: Mapping[str, str]) -> Scene | None:
    """The gripper, the table and the approach; None: there is no gripper."""
    if values.get("gripper", "none") == "none":
        return None
    hand = hand_of_line(values["gripper"])
    table, direction = _numbers(values, "table", 4), _numbers(values, "approach_direction", 3)
    within, angles = float(values["approach_within"]), int(values["approach_angles"])
    return Scene(
        hand,
        None if table is None else Table(table[:3], float(table[3])),
        Approach(direction, within=within, angles=angles),
    )


def _numbers(values: Mapping[str, str], name: str, count: int) -> Floats | None:
    """Some numbers in one setting, shape (count,); None: it is 'none'."""
    if values[name] == "none":
        return None
    numbers = np.array([float(one) for one in values[name].split()])
    if len(numbers) != count:
        raise ValueError(f"its {name} has {len(numbers)} numbers instead of {count}")
    return numbers


FORMAT_KEYS = frozenset({"format", "version", "unit"})
"""Keys of a gripper in JSON that describe the format."""

_DAMAGE = (
    OSError, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error, struct.error, CallFailedError
)  # fmt: skip

MEMORY, SECONDS, BYTES_PER_SECOND = 4.0, 15.0, 1e6
"""Limits of the process that reads a VTP: memory [GB], time of an empty file [s], and its speed."""

_GLB_HEAD = struct.Struct("<4sIIII")


def stored_settings(path: Path) -> dict[str, str] | None:
    """Read the settings in a labelled file, or in a file of grasps.

    Args:
        path: An existing file, of any format and content.

    Returns:
        The values by name, as text; None: it was not written by grasp3d, or is damaged.
    """
    reader = _READERS.get(path.suffix.lower())
    try:
        settings = None if reader is None or problem_of_file(path) else reader(path)
    except (*_DAMAGE, *HEADER_ERRORS):
        return None
    return {str(name): str(value) for name, value in settings.items()} if settings else None


def _from_ply(path: Path) -> dict[str, str]:
    with path.open("rb") as stream:
        header = stream.read(LONGEST_HEADER).partition(b"end_header")[0]
    return settings_of_header(header)


def _from_npz(path: Path) -> dict[str, str]:
    with path.open("rb") as stream, np.load(stream) as arrays:
        names = [name for name in arrays.files if name.startswith(SETTING)]
        return {name.removeprefix(SETTING): text_of(arrays[name]) for name in names}


def _from_glb(path: Path) -> dict[str, Any]:
    with path.open("rb") as stream:
        length = _GLB_HEAD.unpack(stream.read(_GLB_HEAD.size))[3]
        tree = parse_json(stream.read(length))
    return dict(tree["asset"]["extras"]["grasp3d"])


def _from_json(path: Path) -> dict[str, Any]:
    """Settings in the first line of a file of grasps."""
    with path.open(encoding="utf-8") as stream:
        values = dict(parse_json(stream.readline().rstrip().removesuffix(",") + "}")["grasp3d"])
    if isinstance(values.get("gripper"), dict):  # as in other labelled files
        gripper = {k: v for k, v in values["gripper"].items() if k not in FORMAT_KEYS}
        values["gripper"] = json.dumps(gripper)
    return values


def _from_vtp(path: Path) -> dict[str, str]:
    with path.open("rb") as stream:
        if b"VTKFile" not in stream.read(LONGEST_HEADER):  # VTK prints its errors
            return {}
    seconds = SECONDS + path.stat().st_size / BYTES_PER_SECOND
    return call(_vtp_settings, str(path.absolute()), memory=MEMORY, seconds=seconds)


def _vtp_settings(path: str) -> dict[str, str]:
    """Settings of a VTP, in a child process: VTK crashes at damaged ones, or takes all memory."""
    import pyvista

    fields = pyvista.read(path).field_data
    names = [name for name in fields.keys() if name.startswith(SETTING)]  # noqa: SIM118
    return {name.removeprefix(SETTING): str(fields[name][0]) for name in names if len(fields[name])}


_READERS: dict[str, Callable[[Path], dict[str, Any] | None]] = {
    ".ply": _from_ply,
    ".npz": _from_npz,
    ".glb": _from_glb,
    ".vtp": _from_vtp,
    ".parquet": read_settings,
    ".json": _from_json,
}
