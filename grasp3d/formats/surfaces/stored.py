"""What labelled files hold, as their formats store it, and checks of it: files may be damaged.

Their settings are read as text, and as values again.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn, get_args

import numpy as np

from grasp3d.arrays import Floats, short_repr, text_of
from grasp3d.errors import GraspError, MeshError
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
from grasp3d.surface.fields import FLOAT, Array, Arrays, Field
from grasp3d.surface.label_settings import GIVEN_ANGLE, SETTING
from grasp3d.surface.vertex_fields import SURFACE, VERTICES
from grasp3d.surface.vertex_grasps import Reason, SearchReport
from grasp3d.system.documents import parse_json

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
    """Extent of the search, and the angle that was given."""
    extent: dict[str, Any] = dict(parse_json(values["search"]))
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


def settings_in(arrays: Mapping[str, Array]) -> dict[str, str]:
    """The settings among arrays. Raises ValueError."""
    texts = {name: text for name, text in arrays.items() if name.startswith(SETTING)}
    return {name.removeprefix(SETTING): text_of(text) for name, text in texts.items()}


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
    vertices, faces = stored.field("vertices"), stored.field("faces")
    count, corners = len(vertices), len(stored.values.get("corner_normals", ()))
    check_finite(vertices, stored.source.where)
    sizes = {"F": len(faces), "C": corners}
    for name, values in stored.values.items():
        field = FIELDS[name]
        shape = tuple(sizes.get(str(size), size) for size in field.shape)
        expected = shape if field in SURFACE else (count, *field.shape_for(settings.model.fingers))
        if values.shape != expected or values.dtype != np.dtype(field.kind):
            stored.reject(
                f"its {name} is {values.dtype} of the shape {values.shape} instead of {field.kind} "
                f"of {expected}"
            )
        if not _may_have(field, values):
            stored.reject(f"its {name} has values that it cannot have")
    limits = {"faces": count, "canonical": count, "partner_faces": len(faces), "corners": corners}
    for name, limit in limits.items():
        if stored.field(name).max(initial=-1) >= limit:
            stored.reject(f"its {name} goes up to {stored.values[name].max()}, above {limit - 1}")
    if not len(faces) or not (Triangles(vertices, faces).areas != 0.0).any():
        stored.reject("its faces have no area")
    _check_labels(stored, settings.model)


def _may_have(field: Field, values: Array) -> bool:
    """Whether a field may have these values."""
    low, high, infinite, unknown = field.allowed
    if field.texts:
        high = len(field.texts) - 1
    inside = (values >= low - ROUNDING) & (values <= high + ROUNDING) & np.isfinite(values)
    inside |= np.isnan(values) & unknown
    return bool((inside if infinite is None else inside | (values == infinite)).all())


def _check_labels(stored: Stored, model: GraspModel) -> None:
    """Compare labels, angles and reasons: grasps are found where there are angles and contacts."""
    worst, best = (stored.field(f"critical_angle{end}") for end in ("", "_best"))
    near = np.abs(worst - model.sure_angle) < ROUNDING
    near |= np.abs(best - model.unstable_from) < ROUNDING
    differ = (label_angles(worst, best, model) != stored.field("label")) & ~near
    if (best > worst + ROUNDING).any() or (model.method == "exact" and differ.any()):
        stored.reject("its labels do not match its critical angles")
    is_found = stored.field("reason") == Reason.FOUND
    wrong = np.isfinite(best) != is_found
    wrong |= ((stored.field("partner_faces") >= 0) != is_found[:, None]).any(axis=1)
    sums = stored.field("partner_weights").sum(axis=2)
    wrong |= is_found & (np.abs(sums - 1.0) >= ROUNDING).any(axis=1)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        stored.reject(f"the reason of vertex {row} does not match its angles and contacts")
