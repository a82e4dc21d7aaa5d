"""Reading labelled PLY files.

A PLY counts as labelled if its vertices have any property of `LABELLED`, such as `label` or
`critical_angle`. It must then have all of them, with the types, values and comments that
`export.write_ply` writes; otherwise it is refused, as its numbers could mean anything. Other
properties (colours, confidence, texture coordinates) are allowed. A PLY with none of `LABELLED` is
an ordinary mesh.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bytes, Floats, Ints
from grasp3d.errors import MeshError
from grasp3d.export.ply_table import read_tables
from grasp3d.export.stored import ADVICE, damaged
from grasp3d.mesh.given_mesh import LARGEST
from grasp3d.reading.declared_sizes import LONGEST_HEADER, check_declared_size
from grasp3d.reading.ply import PlyHeader, read_ply_header
from grasp3d.reading.sources import Source, check_finite, find_source
from grasp3d.settings import MeshOptions
from grasp3d.stability.label import Label
from grasp3d.stability.thresholds import label_angles
from grasp3d.viewer.subjects.file_settings import FileSettings, comments_of, settings_from

_ANGLES = ("critical_angle", "critical_angle_best")
_EPSILONS = ("epsilon", "epsilon_min", "epsilon_max")
_POSITIONS, _NORMALS = ("x", "y", "z"), ("nx", "ny", "nz")

LABELLED = ("label", *_ANGLES, "max_resolution", *_EPSILONS)
"""Vertex properties that only a labelled file has."""

APPROACH_MARGIN = "approach_margin"
"""Vertex property of labels with a gripper."""

FORCES = ("grip_force", "grip_force_least", "grip_force_largest")
"""Vertex properties of labels with a load."""

PAYLOAD = "payload"
"""Vertex property of labels with a force at hand."""

MARGIN = "margin"
"""Vertex property of every labelled file since labels have margins."""

LOCATED = ("located_angle", "located_angle_best")
"""Vertex properties of labels with uncertain contact locations or different fingers."""

ROUNDING = 1e-6
"""Tolerance of angles and of the length of normals, stored with 32 bits [rad, 1]."""


@dataclass(frozen=True, eq=False)
class LabelledFile:
    """Checked contents of a labelled PLY."""

    settings: FileSettings
    vertices: Floats
    """Shape (V, 3)."""
    faces: Ints
    """Shape (F, 3)."""
    normals: Floats
    """Inward unit normals; 0 where the file has none, (V, 3)."""
    label: Bytes
    """Label codes as stored, (V,)."""
    critical_angle: Floats
    """Over the worst normals [rad]; inf: no grasp, (V,)."""
    critical_angle_best: Floats
    """Over the best normals [rad], (V,)."""
    epsilons: Floats
    """Nominal, smallest and largest, (3, V); nan: no grasp."""
    approach_margin: Floats
    """Half-width of the free approach angles [rad]; nan: not reached, or no gripper. (V,)"""
    forces: Floats
    """Nominal, least and largest grip force [N], payload [kg], (4, V); nan: no grasp, no load."""
    located: tuple[Floats, Floats] | None = None
    """Critical angles with uncertain contact locations and different fingers, over the worst and
    over the best normals [rad], (V,) each; None: contact locations are exact and fingers alike."""

    @property
    def deciding_angles(self) -> tuple[Floats, Floats]:
        """The critical angles that decide the labels, over the worst and the best normals."""
        return self.located or (self.critical_angle, self.critical_angle_best)


def settings_of_file(path: Path, max_memory: float = MeshOptions.max_memory) -> FileSettings | None:
    """Settings of a labelled PLY, from its header alone.

    Args:
        path: Any file.
        max_memory: Memory limit for reading [GB].

    Returns:
        The settings; None: the file is not a PLY, or has no labels.

    Raises:
        MeshError: The file has some properties of a labelled file, but is not a valid one.
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
        path: A file for which `settings_of_file` returns settings.
        max_memory: Memory limit for reading [GB].

    Raises:
        MeshError: The file is not labelled, or damaged.
    """
    settings = settings_of_file(path, max_memory)
    source = find_source(path, max_memory)
    if settings is None:
        raise MeshError(f"{source.where}: is not a PLY labelled by grasp3d; label it first")
    try:
        check_declared_size(source)
        columns, faces = read_tables(source, read_ply_header(source))
    except (OSError, MemoryError) as error:
        reason = getattr(error, "strerror", None) or "memory is too small"
        raise MeshError(f"{source.where}: cannot be read ({reason})") from error
    found = LabelledFile(
        settings=settings,
        vertices=_stacked(columns, _POSITIONS).T.copy(),
        faces=faces,
        normals=-_stacked(columns, _NORMALS).T,
        label=columns["label"],
        critical_angle=columns["critical_angle"].astype(np.float64),
        critical_angle_best=columns["critical_angle_best"].astype(np.float64),
        epsilons=_stacked(columns, _EPSILONS),
        approach_margin=_margins(settings, columns),
        forces=_forces(settings, columns),
        located=_located(settings, columns),
    )
    _check_surface(source, found)
    _check_labels(source, found, columns["max_resolution"])
    _check_margins(source, found, columns)
    return found


def _checked_header(source: Source, header: PlyHeader, kinds: dict[str, str]) -> FileSettings:
    for name in LABELLED:
        if name not in kinds:
            present = next(one for one in LABELLED if one in kinds)
            raise MeshError(
                f"{source.where}: its vertices have a property {present!r} but no {name!r}, so it "
                f"was not written by this version of grasp3d; {ADVICE}"
            )
    expected = dict.fromkeys((*_POSITIONS, *_NORMALS, *LABELLED), "a float") | {"label": "a uchar"}
    for name, kind in expected.items():
        allowed = ("u1",) if name == "label" else ("f4", "f8")
        if kinds.get(name) not in allowed:
            raise damaged(source, f"its property {name!r} is not {kind}")
    try:
        found = settings_from(comments_of(source.head(LONGEST_HEADER)[: header.start]))
    except ValueError as error:
        raise damaged(source, f"its grasp3d comments are not valid: {error}") from error
    if found.scene is not None and kinds.get(APPROACH_MARGIN) not in {"f4", "f8"}:
        raise damaged(source, f"its property {APPROACH_MARGIN!r} is not a float")
    for name in (*_located_names(found), *_force_names(found)):
        if kinds.get(name) not in {"f4", "f8"}:
            raise damaged(source, f"its property {name!r} is not a float")
    load = found.load_numbers
    if load is not None and load.available is not None and PAYLOAD not in kinds:
        # A task made in Python cannot be read again, but it does not depend on the mass.
        return replace(found, load_numbers=replace(load, by_mass=False))
    return found


def _margins(settings: FileSettings, columns: dict[str, npt.NDArray[Any]]) -> Floats:
    if settings.scene is None:
        return np.full(len(columns["label"]), math.nan)
    return columns[APPROACH_MARGIN].astype(np.float64)


def _force_names(settings: FileSettings) -> tuple[str, ...]:
    """Vertex properties that a file with such a load has."""
    load = settings.load_numbers
    if load is None:
        return ()
    has_payload = load.available is not None and load.by_mass and settings.load is not None
    return (*FORCES, PAYLOAD) if has_payload else FORCES


def _forces(settings: FileSettings, columns: dict[str, npt.NDArray[Any]]) -> Floats:
    found = np.full((len(FORCES) + 1, len(columns["label"])), math.nan)
    if settings.load_numbers is not None:
        for row, name in zip(found, (*FORCES, PAYLOAD), strict=True):
            row[:] = columns.get(name, math.nan)
    return found


def _located_names(settings: FileSettings) -> tuple[str, ...]:
    """Vertex properties of a file whose labels are no thresholds on its critical angles."""
    return () if settings.model.is_uniform else LOCATED


def _located(
    settings: FileSettings, columns: dict[str, npt.NDArray[Any]]
) -> tuple[Floats, Floats] | None:
    names = _located_names(settings)
    if not names:
        return None
    worst, best = (columns[name].astype(np.float64) for name in names)
    return worst, best


def _stacked(columns: dict[str, npt.NDArray[Any]], names: tuple[str, ...]) -> Floats:
    return np.stack([columns[name] for name in names]).astype(np.float64)


def _check_surface(source: Source, found: LabelledFile) -> None:
    check_finite(found.vertices, source.where)
    if not len(found.faces):
        raise damaged(source, "it contains no faces")
    if np.abs(found.vertices).max() > LARGEST:
        raise damaged(source, f"its coordinates exceed {LARGEST:g}")
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
    # Of fingers that differ, the grasp with the best margin may be another one.
    if not model.per_finger and not (best <= worst + ROUNDING).all():
        raise damaged(source, "its critical_angle_best is above its critical_angle")
    if not ((max_resolution >= 0.0) & (max_resolution <= math.pi + ROUNDING)).all():
        raise damaged(source, "its max_resolution is not always from 0 to pi")
    margins = found.approach_margin
    if not (((margins >= 0.0) & (margins <= math.pi + ROUNDING)) | np.isnan(margins)).all():
        raise damaged(source, "its approach_margin is not always from 0 to pi, or nan")
    if (found.forces < 0.0).any():
        raise damaged(source, "a grip force or a payload is below 0")
    if (found.epsilons < 0.0).any() or np.isinf(found.epsilons).any():
        raise damaged(source, "an epsilon is below 0, or infinite")
    if (found.label > max(Label)).any():
        raise damaged(source, f"its label goes up to {found.label.max()}, above S = {max(Label)}")
    if model.method == "exact" and (_count_wrong_labels(found) > 0):
        raise damaged(source, "its labels do not match its critical angles")


def _check_margins(
    source: Source, found: LabelledFile, columns: dict[str, npt.NDArray[Any]]
) -> None:
    """Check the margins and the angles that they follow from.

    Located angles have no order of their own: each is compared with another threshold.
    """
    worst, best = found.deciding_angles
    if np.isnan(worst).any() or np.isnan(best).any():
        raise damaged(source, f"its {' or '.join(LOCATED)} is not always a number")
    expected = found.settings.model.effective_friction_angle - worst
    stored = columns.get(MARGIN, expected).astype(np.float64)
    with np.errstate(invalid="ignore"):  # inf - inf
        if not ((np.abs(stored - expected) < ROUNDING) | (stored == expected)).all():
            raise damaged(source, f"its {MARGIN} does not match its angles")


def _count_wrong_labels(found: LabelledFile) -> int:
    """Number of vertices whose label does not follow from their angles, apart from rounding."""
    (worst, best), model = found.deciding_angles, found.settings.model
    limit, stable = model.unstable_from, model.effective_friction_angle
    with np.errstate(invalid="ignore"):  # inf - inf
        near = (np.abs(worst - stable) < ROUNDING) | (np.abs(best - limit) < ROUNDING)
    return int(((label_angles(worst, best, model) != found.label) & ~near).sum())
