"""What labelled files hold, as their formats store it, and checks of it: files may be damaged."""

import math
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from grasp3d.arrays import short_repr
from grasp3d.errors import MeshError
from grasp3d.export.read_settings import FileSettings
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.mesh_sources import LARGEST
from grasp3d.reading.sources import Source, check_finite
from grasp3d.settings import MAX_SEARCHED_FINGERS, GraspModel
from grasp3d.stability.thresholds import label_angles
from grasp3d.surface.fields import FLOAT, MARGIN, Array, Arrays, Field
from grasp3d.surface.vertex_fields import LOCATED, SURFACE, VERTICES
from grasp3d.surface.vertex_grasps import Reason

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

ANY = -1
"""Number of parts of a value that may have any number."""


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
        "errors": not settings.model.is_uniform,
        "gripper": settings.scene is not None,
        "joints": False,
        "load": settings.has_load,
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
        if expected[-1] == ANY:
            expected = (*expected[:-1], *values.shape[-1:])
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
    if np.abs(vertices).max() > LARGEST:
        stored.reject(f"its coordinates exceed {LARGEST:g}")
    rows = {
        **dict.fromkeys(("faces", "canonical"), len(vertices)),
        **dict.fromkeys(("partner_faces", "best_partner_faces"), len(faces)),
        "corners": len(stored.values.get("corner_normals", ())),
    }
    for name, limit in rows.items():
        if name in stored.values and (stored.values[name] >= limit).any():
            stored.reject(f"its {name} goes up to {stored.values[name].max()}, above {limit - 1}")
    if not (Triangles(vertices, faces).areas != 0.0).any():
        stored.reject("its faces have no area")
    for name in ("normal", "corner_normals"):
        lengths = np.linalg.norm(stored.values.get(name, np.zeros((0, 3))), axis=1)
        if not ((np.abs(lengths - 1.0) < 2.0 * ROUNDING) | (lengths == 0.0)).all():
            stored.reject("its normals are not of length 1")


def _check_labels(stored: Stored, model: GraspModel) -> None:
    """Compare angles, margins and labels.

    Located angles have no order of their own: each is compared with another threshold.
    """
    worst, best = (stored.field(f"critical_angle{end}") for end in ("", "_best"))
    # Of fingers that differ, the grasp with the best margin may be another grasp.
    if not model.per_finger and not (best <= worst + ROUNDING).all():
        stored.reject("its critical_angle_best is above its critical_angle")
    if not model.is_uniform:
        worst, best = (stored.field(field.name) for field in LOCATED)
    expected, label = model.effective_friction_angle - worst, stored.field("label")
    margin = stored.values.get(MARGIN.name, expected)
    with np.errstate(invalid="ignore"):  # inf - inf
        if not ((np.abs(margin - expected) < ROUNDING) | (margin == expected)).all():
            stored.reject(f"its {MARGIN.name} does not match its angles")
        near = np.abs(worst - model.effective_friction_angle) < ROUNDING
        near |= np.abs(best - model.unstable_from) < ROUNDING
    if model.method == "exact" and ((label_angles(worst, best, model) != label) & ~near).any():
        stored.reject("its labels do not match its critical angles")


def _check_found(stored: Stored) -> None:
    """Compare the reasons with the angles and contacts: grasps are found where there are these."""
    has_grasp = stored.field("reason") == Reason.FOUND
    matches = np.isfinite(stored.field("critical_angle_best")) == has_grasp
    matches &= np.isinf(stored.field("critical_angle")) | has_grasp
    for head in ("", "best_"):
        faces, weights = (stored.field(f"{head}partner_{name}") for name in ("faces", "weights"))
        matches &= ((faces >= 0) == has_grasp[:, None]).all(axis=1)
        whole = np.abs(weights.sum(axis=2) - 1.0) < ROUNDING
        matches &= whole.all(axis=1) | ~has_grasp
    if not matches.all():
        row = int(np.flatnonzero(~matches)[0])
        stored.reject(f"the reason of vertex {row} does not match its angles and contacts")
