"""A PLY that grasp3d has labelled: told from other files, and read with all its numbers.

A PLY is taken for labelled as soon as its vertices have a property that only labels have: `label`,
`critical_angle` and the others of `LABELLED`. Then it must have all of them, with the types, the
values and the comments that `export.write_ply` gives them; a file that has not is refused, as its
numbers might mean anything. Other properties (colours, confidence, texture coordinates) may stand
beside them, and a PLY with none but such is a mesh like any other.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bytes, Floats, Ints
from grasp3d.errors import MeshError
from grasp3d.mesh.preparing import LARGEST
from grasp3d.reading.ply import PlyHeader, read_ply_header
from grasp3d.reading.promises import LONGEST_HEADER, check_promises
from grasp3d.reading.sources import Source, check_finite, find_source
from grasp3d.settings import MeshOptions
from grasp3d.stability.label import Label
from grasp3d.stability.thresholds import label_angles, unstable_from
from grasp3d.viewer.subjects.file_settings import FileSettings, comments_of, settings_from
from grasp3d.viewer.subjects.ply_table import CURE, damaged, read_tables

_ANGLES = ("critical_angle", "critical_angle_best")
_EPSILONS = ("epsilon", "epsilon_min", "epsilon_max")
_PLACES, _NORMALS = ("x", "y", "z"), ("nx", "ny", "nz")

LABELLED = ("label", *_ANGLES, "max_resolution", *_EPSILONS)
"""Properties of vertices that only a labelled file has."""

ROUNDING = 1e-6
"""How far 32 bits may move an angle, or the length of a normal [rad, 1]."""


@dataclass(frozen=True, eq=False)
class LabelledFile:
    """What a labelled PLY holds, checked."""

    settings: FileSettings
    vertices: Floats
    """Shape (V, 3)."""
    faces: Ints
    """Shape (F, 3)."""
    normals: Floats
    """Inward unit normals; 0 where the file has none, (V, 3)."""
    label: Bytes
    """Codes as the file has them, (V,)."""
    critical_angle: Floats
    """Shape (V,); inf: no grasp."""
    critical_angle_best: Floats
    epsilons: Floats
    """Nominal, smallest and largest, (3, V); nan: no grasp."""


def settings_of_file(path: Path, max_memory: float = MeshOptions.max_memory) -> FileSettings | None:
    """Tell a labelled PLY from a mesh, by its header alone.

    Args:
        path: Any file.
        max_memory: What reading it may take [GB].

    Returns:
        What it was labelled with; None: it is a mesh that has no labels, or no PLY.

    Raises:
        MeshError: It has some of the properties of a labelled file, but is none.
    """
    if path.suffix.lower() != ".ply":
        return None
    source = find_source(path, max_memory)
    header = read_ply_header(source)
    kinds = {
        entry.name: "list" if entry.length else entry.type
        for element in header.elements
        if element.name == "vertex"
        for entry in element.properties
    }
    if not set(LABELLED) & set(kinds):
        return None
    return _checked_header(source, header, kinds)


def read_labelled(path: Path, max_memory: float = MeshOptions.max_memory) -> LabelledFile:
    """Read a labelled PLY.

    Args:
        path: A file of which `settings_of_file` says so.
        max_memory: What reading it may take [GB].

    Raises:
        MeshError: It is none, or damaged.
    """
    settings = settings_of_file(path, max_memory)
    source = find_source(path, max_memory)
    if settings is None:
        raise MeshError(f"{source.where}: is no PLY that grasp3d has labelled; label it first")
    try:
        check_promises(source)
        columns, faces = read_tables(source, read_ply_header(source))
    except (OSError, MemoryError) as error:
        told = getattr(error, "strerror", None) or "memory is too small"
        raise MeshError(f"{source.where}: cannot be read ({told})") from error
    found = LabelledFile(
        settings=settings,
        vertices=_stacked(columns, _PLACES).T.copy(),
        faces=faces,
        normals=-_stacked(columns, _NORMALS).T,
        label=columns["label"],
        critical_angle=columns["critical_angle"].astype(np.float64),
        critical_angle_best=columns["critical_angle_best"].astype(np.float64),
        epsilons=_stacked(columns, _EPSILONS),
    )
    _check_surface(source, found)
    _check_labels(source, found, columns["max_resolution"])
    return found


def _checked_header(source: Source, header: PlyHeader, kinds: dict[str, str]) -> FileSettings:
    for name in LABELLED:
        if name not in kinds:
            there = next(one for one in LABELLED if one in kinds)
            raise MeshError(
                f"{source.where}: its vertices have a property {there!r} but no {name!r}, so that "
                f"it is not of grasp3d, or of another version; {CURE}"
            )
    wanted = dict.fromkeys((*_PLACES, *_NORMALS, *LABELLED), "a float") | {"label": "a uchar"}
    for name, kind in wanted.items():
        right = ("u1",) if name == "label" else ("f4", "f8")
        if kinds.get(name) not in right:
            raise damaged(source, f"its property {name!r} is not {kind}")
    try:
        return settings_from(comments_of(source.head(LONGEST_HEADER)[: header.start]))
    except ValueError as error:
        raise damaged(source, f"its comments are not those of grasp3d: {error}") from error


def _stacked(columns: dict[str, npt.NDArray[Any]], names: tuple[str, ...]) -> Floats:
    return np.stack([columns[name] for name in names]).astype(np.float64)


def _check_surface(source: Source, found: LabelledFile) -> None:
    check_finite(found.vertices, source.where)
    if not len(found.faces):
        raise damaged(source, "it holds no faces")
    if np.abs(found.vertices).max() > LARGEST:
        raise damaged(source, f"its coordinates reach beyond {LARGEST:g}")
    corners = found.vertices[found.faces]
    if not (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) != 0.0).any():
        raise damaged(source, "its faces have no area")
    lengths = np.linalg.norm(found.normals, axis=1)
    if not ((np.abs(lengths - 1.0) < 2.0 * ROUNDING) | (lengths == 0.0)).all():
        raise damaged(source, "its normals are not of length 1")


def _check_labels(source: Source, found: LabelledFile, max_resolution: npt.NDArray[Any]) -> None:
    worst, best, model = found.critical_angle, found.critical_angle_best, found.settings.model
    for name, angles in (("critical_angle", worst), ("critical_angle_best", best)):
        if not ((angles >= 0.0) & ((angles <= math.pi + ROUNDING) | np.isinf(angles))).all():
            raise damaged(source, f"its {name} is not always from 0 to pi, or inf")
    if not (best <= worst + ROUNDING).all():
        raise damaged(source, "its critical_angle_best is above its critical_angle")
    if not ((max_resolution >= 0.0) & (max_resolution <= math.pi + ROUNDING)).all():
        raise damaged(source, "its max_resolution is not always from 0 to pi")
    if (found.epsilons < 0.0).any() or np.isinf(found.epsilons).any():
        raise damaged(source, "an epsilon is below 0, or infinite")
    if (found.label > max(Label)).any():
        raise damaged(source, f"its label goes up to {found.label.max()}, and {max(Label)} is S")
    if model.method == "exact" and (_differs(found) > 0):
        raise damaged(source, "its labels are not those of its critical angles")


def _differs(found: LabelledFile) -> int:
    """Vertices whose label is not that of their angles, but for rounding."""
    worst, best, model = found.critical_angle, found.critical_angle_best, found.settings.model
    limit = unstable_from(model.friction_angle, model.tilt, model.fingers)
    stable = model.friction_angle - model.tilt
    with np.errstate(invalid="ignore"):  # inf - inf
        near = (np.abs(worst - stable) < ROUNDING) | (np.abs(best - limit) < ROUNDING)
    return int(((label_angles(worst, best, model) != found.label) & ~near).sum())
