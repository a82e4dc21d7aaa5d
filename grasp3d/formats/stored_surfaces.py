"""Stored content of labelled files, and its checks, because files may be damaged.

Settings are stored as text, and parsed to values again.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, get_args

import numpy as np

from grasp3d.errors import GraspError, MeshError
from grasp3d.hand.hand_files import hand_of_line
from grasp3d.hand.scene import Scene
from grasp3d.hand.table import Approach, Table
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.sources import Source, check_finite
from grasp3d.quality.loads import Load, load_from
from grasp3d.settings import MAX_SEARCHED_FINGERS, GraspModel, MeshOptions, Sampling
from grasp3d.settings.parsing import settings_of_texts
from grasp3d.settings.pose_error import PoseError
from grasp3d.stability.label import Mode, label_angles
from grasp3d.surface.fields import FLOAT, Array, Arrays, Field
from grasp3d.surface.labels import GIVEN_ANGLE
from grasp3d.surface.vertex_fields import SURFACE, VERTICES, Reason, SearchReport
from grasp3d.system.documents import numbers_of, parse_json
from grasp3d.system.names import reason_of

NEEDED = (
    "mode", "friction", "sensor_resolution", "fingers", "method", "search_angle", "unit",
    "lengths", "file_vertices", "surface",
)  # fmt: skip
"""Settings that every labelled file has."""

DAMAGE = (
    GraspError, ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError,
)  # fmt: skip
"""Exceptions for settings and values that are not as they were written."""


class Stored(NamedTuple):
    """The arrays and settings of a labelled file, not checked yet."""

    source: Source
    settings: dict[str, str]
    """Texts by name."""
    values: Arrays
    """By name of the field, as files hold them: normals point outward."""


def damaged(source: Source, error: Exception) -> MeshError:
    """The error for a labelled file that cannot be read."""
    what = f"there is no {error}" if isinstance(error, KeyError) else reason_of(error)
    advice = "label the mesh again, or export it without its labels"
    return MeshError(f"{source.where}: has labels, but they are damaged: {what}; {advice}")


@dataclass(frozen=True)
class FileSettings:
    """Settings that a file was labelled with."""

    model: GraspModel
    sampling: Sampling | None
    """None: a scan."""
    options: MeshOptions
    mode: Mode
    search: SearchReport
    file_vertices: int
    scene: Scene | None
    """The gripper that must reach each grasp, and the table; None: ideal points."""
    load: Load | None
    """What each grasp must hold; None: nothing."""


def settings_from(texts: Mapping[str, str]) -> FileSettings:
    """Parse the settings of a labelled file, texts by name. Raises one of `DAMAGE`."""
    values: dict[str, str] = {**{name: texts[name] for name in NEEDED}, **texts}
    values["unit"] = "None" if values["unit"] == "unknown" else values["unit"]
    mode: Any = values["mode"]
    if mode not in get_args(Mode):
        raise ValueError(f"its mode is {mode[:20]!r}")
    extent: dict[str, Any] = dict(parse_json(values["search"]))
    sampled = {**values, "search_angle": str(extent.pop(GIVEN_ANGLE))}
    search = SearchReport(**extent)
    if not (isinstance(search.cone, float) and 0.0 < search.cone <= math.pi):
        raise ValueError(f"its search angle is {search.cone}")
    return FileSettings(
        model=settings_of_texts(GraspModel, values),
        sampling=None if mode == "scan" else settings_of_texts(Sampling, sampled),
        options=settings_of_texts(MeshOptions, values),
        mode=mode,
        search=search,
        file_vertices=int(values["file_vertices"]),
        scene=_scene(values),
        load=load_from(values),
    )


def _scene(values: Mapping[str, str]) -> Scene | None:
    """The gripper, the table and the approach; None: there is no gripper."""
    if values.get("gripper", "none") == "none":
        return None
    table, direction = (
        None if values[name] == "none" else np.array(numbers_of(values[name], count))
        for name, count in (("table", 4), ("approach_direction", 3))
    )
    return Scene(
        hand_of_line(values["gripper"]),
        None if table is None else Table(table[:3], float(table[3])),
        Approach(direction, float(values["approach_within"])),
        PoseError.of(values.get("pose_error", "0 deg")),
    )


def fingers_of(settings: Mapping[str, str]) -> int:
    """Number of fingers in the settings of a file. Raises ValueError, KeyError."""
    fingers = int(settings["fingers"])
    if not 2 <= fingers <= MAX_SEARCHED_FINGERS:
        raise ValueError(f"grasps of {fingers} fingers are not searched for")
    return fingers


FIELDS: dict[str, Field] = {field.name: field for field in (*VERTICES, *SURFACE)}
"""All fields of labelled files by name."""

OPTIONAL = (
    "payload", "label_with_force", "free_angles", "color", "area", "partner_normals",
    *(field.name for field in VERTICES if field.ply == FLOAT),
)  # fmt: skip
"""Fields that a file may lack: they follow from others, or need more than a load or a gripper."""

ROUNDING = 1e-6
"""Tolerance of angles and of the length of normals, which may be stored with 32 bits [rad, 1]."""


def check_stored(stored: Stored, settings: FileSettings) -> None:
    """Check all values of a labelled file.

    Args:
        stored: What the file holds.
        settings: Its settings.

    Raises:
        MeshError: A coordinate is not finite, or too large.
        KeyError: A field is missing.
        ValueError: A field has values that it cannot have.
    """
    values, fingers = stored.values, settings.model.fingers
    there = {"always": True, "gripper": settings.scene, "load": settings.load}
    for field in FIELDS.values():
        if there[field.when] and field.name not in OPTIONAL:
            values[field.name]
    vertices, faces = values["vertices"], values["faces"]
    sizes: dict[object, int] = {
        "F": len(faces), "C": len(values["corner_normals"]), "n": fingers, "n-1": fingers - 1,
    }  # fmt: skip
    for name, array in values.items():
        field = FIELDS[name]
        shape = tuple(sizes.get(size, size) for size in field.shape)
        expected = shape if field in SURFACE else (len(vertices), *shape)
        if array.shape != expected or array.dtype != np.dtype(field.kind):
            found = f"{array.dtype} of the shape {array.shape}"
            raise ValueError(f"its {name} is {found} instead of {field.kind} of {expected}")
        if not _may_have(field, array):
            raise ValueError(f"its {name} has values that it cannot have")
    check_finite(vertices, stored.source.where)
    limits = {"faces": len(vertices), "canonical": len(vertices), "partner_faces": len(faces),
              "corners": sizes["C"]}  # fmt: skip
    for name, limit in limits.items():
        if values[name].max(initial=-1) >= limit:
            raise ValueError(f"its {name} goes up to {values[name].max()}, above {limit - 1}")
    if not len(faces) or not (Triangles(vertices, faces).areas != 0.0).any():
        raise ValueError("its faces have no area")
    _check_labels(values, settings.model)


def _may_have(field: Field, values: Array) -> bool:
    """Whether values are allowed for a field."""
    low, high, infinite, unknown = field.allowed
    if field.texts:
        high = len(field.texts) - 1
    inside = (values >= low - ROUNDING) & (values <= high + ROUNDING) & np.isfinite(values)
    inside |= np.isnan(values) & unknown
    return bool((inside if infinite is None else inside | (values == infinite)).all())


def _check_labels(values: Arrays, model: GraspModel) -> None:
    """Check that labels, angles, contacts and reasons agree. Raises ValueError."""
    worst, best = values["critical_angle"], values["critical_angle_best"]
    near = np.abs(worst - model.sure_angle) < ROUNDING
    near |= np.abs(best - model.unstable_from) < ROUNDING
    differ = (label_angles(worst, best, model) != values["label"]) & ~near
    if (best > worst + ROUNDING).any() or (model.method == "exact" and differ.any()):
        raise ValueError("its labels do not match its critical angles")
    is_found = values["reason"] == Reason.FOUND
    wrong = np.isfinite(best) != is_found
    wrong |= ((values["partner_faces"] >= 0) != is_found[:, None]).any(axis=1)
    sums = values["partner_weights"].sum(axis=2)
    wrong |= is_found & (np.abs(sums - 1.0) >= ROUNDING).any(axis=1)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise ValueError(f"the reason of vertex {row} does not match its angles and contacts")
