"""What labelled files hold, as their formats store it, and checks of it: files may be damaged.

Their settings are read as text, and as values again.
"""

import json
import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NoReturn, get_args

import numpy as np

from grasp3d.arrays import ARCHIVE_ERRORS, Floats, short_repr, text_of
from grasp3d.errors import FileUnreadError, GraspError, MeshError
from grasp3d.export.vtp_arrays import vtp_arrays
from grasp3d.hand.hand_files import hand_of_line
from grasp3d.hand.scene import Scene
from grasp3d.hand.table import Approach, Table
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.reading.sources import Source, check_finite
from grasp3d.quality.loads import Load, load_from
from grasp3d.settings import (
    MAX_SEARCHED_FINGERS,
    GraspModel,
    MeshOptions,
    Sampling,
)
from grasp3d.settings.parsing import settings_of_texts
from grasp3d.settings.pose_error import PoseError
from grasp3d.settings.units import Unit
from grasp3d.stability.label import Mode
from grasp3d.stability.thresholds import label_angles
from grasp3d.surface.fields import FLOAT, MARGIN, Array, Arrays, Field
from grasp3d.surface.label_settings import GIVEN_ANGLE, SETTING
from grasp3d.surface.vertex_fields import SURFACE, VERTICES
from grasp3d.surface.vertex_grasps import Reason, SearchReport
from grasp3d.system.documents import parse_json, problem_of_file
from grasp3d.system.limited_reading import read_file
from grasp3d.system.ply_files import settings_of_header
from grasp3d.system.tables import read_settings

NEEDED = (
    "mode", "friction", "sensor_resolution", "fingers", "method", "search_angle", "unit",
    "lengths", "file_vertices", "surface",
)  # fmt: skip
"""Settings that every labelled file has."""


@dataclass(frozen=True)
class FileSettings:
    """Settings that a file was labelled with."""

    model: GraspModel
    sampling: Sampling | None
    """None: a scan."""
    options: MeshOptions
    mode: Mode
    search: SearchReport
    unit: Unit | None
    file_vertices: int
    scene: Scene | None = None
    """The gripper that must reach each grasp, and the table; None: ideal points."""
    load: Load | None = None
    """What each grasp must hold; None: nothing."""


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
        search, angle = _search(values)
        sampled = {**values, "search_angle": angle}
        return FileSettings(
            model=model,
            sampling=None if mode == "scan" else settings_of_texts(Sampling, sampled),
            options=options,
            mode="scan" if mode == "scan" else "label",
            search=search,
            unit=options.unit,
            file_vertices=int(values["file_vertices"]),
            scene=_scene(values),
            load=load_from(values),
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
    known = {field.name for field in fields(SearchReport)}  # files of older versions have others
    report = SearchReport(**{name: value for name, value in extent.items() if name in known})
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
        PoseError.of(values.get("pose_error", "0 deg")),
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

LONGEST_HEADER = 65_536
"""Bytes in which a header must end."""

_GLB_HEAD = struct.Struct("<4sIIII")


def settings_in(arrays: Mapping[str, Array]) -> dict[str, str]:
    """The settings among arrays. Raises ValueError."""
    texts = {name: text for name, text in arrays.items() if name.startswith(SETTING)}
    return {name.removeprefix(SETTING): text_of(text) for name, text in texts.items()}


def stored_settings(path: Path) -> dict[str, str] | None:
    """Read the settings in a labelled file, or in a file of grasps.

    Args:
        path: An existing file, of any format and content.

    Returns:
        The values by name, as text; None: it was not written by grasp3d, or is damaged.
    """
    reader = _READERS.get(path.suffix.lower())
    try:
        settings = None if reader is None or problem_of_file(path) else read_file(reader, path)
    except (*ARCHIVE_ERRORS, struct.error, FileUnreadError):
        return None
    return {str(name): str(value) for name, value in settings.items()} if settings else None


def _from_ply(path: Path) -> dict[str, str]:
    with path.open("rb") as stream:
        header = stream.read(LONGEST_HEADER).partition(b"end_header")[0]
    return settings_of_header(header)


def _from_npz(path: Path) -> dict[str, str]:
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        return settings_in({n: archive[n] for n in archive.files if n.startswith(SETTING)})


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
    return settings_in(vtp_arrays(path).get("fields", {}))


_READERS: dict[str, Callable[[Path], dict[str, Any] | None]] = {
    ".ply": _from_ply,
    ".npz": _from_npz,
    ".glb": _from_glb,
    ".vtp": _from_vtp,
    ".parquet": read_settings,
    ".json": _from_json,
}


ADVICE = "label the mesh again, or export it without its labels"


@dataclass(frozen=True, eq=False)
class Stored:
    """The arrays and settings of a labelled file, not checked yet."""

    source: Source
    settings: dict[str, str]
    """Texts by name."""
    values: Arrays
    """By name of the field, as files hold them: normals point outward."""

    __repr__ = short_repr

    def field(self, name: str) -> Array:
        """Values of a field; raises MeshError if the file has none."""
        if name not in self.values:
            raise damaged(self.source, f"it has no {name}")
        return self.values[name]

    def reject(self, what: str) -> NoReturn:
        """Refuse the file.

        Args:
            what: What is wrong with it.
        """
        raise damaged(self.source, what)


def damaged(source: Source, what: str) -> MeshError:
    """The error for a labelled file that cannot be read."""
    return MeshError(f"{source.where}: has labels, but {what}; {ADVICE}")


def fingers_of(settings: dict[str, str]) -> int:
    """Number of fingers in the settings of a file. Raises ValueError."""
    fingers = int(settings.get("fingers", ""))
    if not 2 <= fingers <= MAX_SEARCHED_FINGERS:
        raise ValueError(f"grasps of {fingers} fingers are not searched for")
    return fingers


FIELDS: dict[str, Field] = {field.name: field for field in (*VERTICES, *SURFACE)}
"""All fields of labelled files by name."""

OPTIONAL = (
    "payload", "label_with_force", "free_angles", "color", "area", "partner_normals",
    *(field.name for field in VERTICES if field.ply == FLOAT),
)  # fmt: skip
"""Fields that follow from others, or depend on more than whether there is a load or a gripper."""


ROUNDING = 1e-6
"""Tolerance of angles and of the length of normals, which may be stored with 32 bits [rad, 1]."""


def check_stored(stored: Stored, settings: FileSettings) -> None:
    """Check all values of a labelled file.

    Args:
        stored: What the file holds.
        settings: Its settings.

    Raises:
        MeshError: A field is missing, or has values that it cannot have.
    """
    present = {
        "always": True,
        "gripper": settings.scene is not None,
        "load": settings.load is not None,
    }
    for field in FIELDS.values():
        if present[field.when] and field.name not in OPTIONAL:
            stored.field(field.name)
    count, fingers = len(stored.field("vertices")), settings.model.fingers
    sizes = {
        "F": len(stored.field("faces")), "C": len(stored.values.get("corner_normals", ())),
    }  # fmt: skip
    for name, values in stored.values.items():
        field = FIELDS[name]
        shape = tuple(sizes.get(str(size), size) for size in field.shape)
        expected = shape if field in SURFACE else (count, *field.shape_for(fingers))
        if values.shape != expected:
            stored.reject(f"its {name} has the shape {values.shape} instead of {expected}")
        _check_values(stored, field, values)
    _check_surface(stored)
    _check_labels(stored, settings.model)
    _check_found(stored)


def _check_values(stored: Stored, field: Field, values: Array) -> None:
    name = field.name
    if values.dtype != np.dtype(field.kind):
        stored.reject(f"its {name} is of the type {values.dtype} instead of {field.kind}")
    if field.texts:
        if (values >= len(field.texts)).any():
            stored.reject(f"its {name} goes up to {values.max()}, above {len(field.texts) - 1}")
        return
    inside = (values >= field.allowed.low - ROUNDING) & (values <= field.allowed.high + ROUNDING)
    if values.dtype.kind == "f":
        inside &= np.isfinite(values)
        if field.allowed.infinite is not None:
            inside |= values == field.allowed.infinite
        if field.allowed.unknown:
            inside |= np.isnan(values)
    if not inside.all() and name != "vertices":  # whose error says which
        stored.reject(f"its {name} is not always {_allowed(field)}")


def _allowed(field: Field) -> str:
    """The values that a field may have, in words."""
    low, high, infinite, unknown = field.allowed
    text = (
        f"from {_text(low)} to {_text(high)}" if math.isfinite(high) else f"at least {_text(low)}"
    )
    if not math.isfinite(low):
        text = "a finite number"
    if infinite is not None:
        text += f", or {infinite}"
    return f"{text}, or nan" if unknown else text


def _text(bound: float) -> str:
    return "pi" if bound == math.pi else f"{bound:g}"


def _check_surface(stored: Stored) -> None:
    vertices, faces = stored.field("vertices"), stored.field("faces")
    check_finite(vertices, stored.source.where)
    if not len(faces):
        stored.reject("it contains no faces")
    rows = {
        **dict.fromkeys(("faces", "canonical"), len(vertices)),
        "partner_faces": len(faces),
        "corners": len(stored.values.get("corner_normals", ())),
    }
    for name, limit in rows.items():
        if name in stored.values and (stored.values[name] >= limit).any():
            stored.reject(f"its {name} goes up to {stored.values[name].max()}, above {limit - 1}")
    if not (Triangles(vertices, faces).areas != 0.0).any():
        stored.reject("its faces have no area")
    for name in ("normal", "corner_normals"):
        with np.errstate(over="ignore"):
            lengths = np.linalg.norm(stored.values.get(name, np.zeros((0, 3))), axis=1)
        if not ((np.abs(lengths - 1.0) < 2.0 * ROUNDING) | (lengths == 0.0)).all():
            stored.reject("its normals are not of length 1")


def _check_labels(stored: Stored, model: GraspModel) -> None:
    """Compare angles, margins and labels."""
    worst, best = (stored.field(f"critical_angle{end}") for end in ("", "_best"))
    if not (best <= worst + ROUNDING).all():
        stored.reject("its critical_angle_best is above its critical_angle")
    expected, label = model.sure_angle - worst, stored.field("label")
    margin = stored.values.get(MARGIN.name, expected)
    with np.errstate(invalid="ignore"):  # inf - inf
        if not ((np.abs(margin - expected) < ROUNDING) | (margin == expected)).all():
            stored.reject(f"its {MARGIN.name} does not match its angles")
        near = np.abs(worst - model.sure_angle) < ROUNDING
        near |= np.abs(best - model.unstable_from) < ROUNDING
    if model.method == "exact" and ((label_angles(worst, best, model) != label) & ~near).any():
        stored.reject("its labels do not match its critical angles")


def _check_found(stored: Stored) -> None:
    """Compare the reasons with the angles and contacts: grasps are found where there are these."""
    has_grasp = stored.field("reason") == Reason.FOUND
    matches = np.isfinite(stored.field("critical_angle_best")) == has_grasp
    matches &= np.isinf(stored.field("critical_angle")) | has_grasp
    faces, weights = stored.field("partner_faces"), stored.field("partner_weights")
    matches &= ((faces >= 0) == has_grasp[:, None]).all(axis=1)
    whole = np.abs(weights.sum(axis=2) - 1.0) < ROUNDING
    matches &= whole.all(axis=1) | ~has_grasp
    if not matches.all():
        row = int(np.flatnonzero(~matches)[0])
        stored.reject(f"the reason of vertex {row} does not match its angles and contacts")
