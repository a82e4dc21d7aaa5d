"""Result of labelling noisy copies of a scan, and the errors to enter for it."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Bools, Floats, short_repr
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.settings import GraspModel
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import Label
from grasp3d.surface.label_settings import chosen_settings
from grasp3d.surface.labelling import label_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.files import check_suffix
from grasp3d.system.ply_files import write_ply_columns
from grasp3d.system.tables import SUFFIXES as TABLES
from grasp3d.system.tables import write_columns
from grasp3d.system.versions import package_version
from grasp3d.validating.perturbing.noise_settings import NoiseSettings

MOST_UNCONFIRMED = 0.01
"""Largest fraction of the area that is S with the advised errors where fewer copies than required
are S: single vertices with triangles of unusual shape must not decide for all."""

MUCH_LESS = 0.5
"""Part of the area that is S with the measured turn which the check may at most cost."""


@dataclass(frozen=True)
class Advice:
    """What to enter for a scan, so that what is S is S in most noisy copies.

    The normal error of the model that was given is contained in that to enter.
    """

    normal_error: float
    """To enter as `normal_error` [rad]: the larger of the measured turn of the normals and the
    least error that passes the check. Where that leaves too little S, the measured turn."""
    location_error: float
    """To enter as `location_error`, in the mesh's unit."""
    measured_turn: float
    """Angle within which the normals turned, at the level of the settings, over area and copies
    [rad]."""
    least_normal_error: float
    """The smallest normal error that passes the check, with that location error [rad]; inf: none
    does."""
    stable_fraction: float
    """Area fraction that is S with the errors to enter."""
    unconfirmed_fraction: float
    """Fraction of that area where fewer copies than required are S."""

    @property
    def passed(self) -> bool:
        """Whether the check is passed: with these errors nearly all of S is S in enough copies."""
        return self.stable_fraction > 0.0 and self.unconfirmed_fraction <= MOST_UNCONFIRMED


@dataclass(frozen=True, eq=False)
class Perturbation:
    """Labels of noisy copies of a surface, vertex by vertex, and the errors to enter for it.

    Arrays have one row for each vertex of `labels.mesh`, (V,). S, M and U of a copy are those of
    the best grasp that is found there, not of one grasp in all copies; `kept` is about one grasp.
    """

    labels: SurfaceLabels
    """The labels of the surface itself, without further errors."""
    settings: NoiseSettings
    """How the copies were made; `noise` is a number here, in the mesh's unit."""
    estimated: bool
    """Whether the noise was estimated from the surface's roughness."""
    stable: Floats
    """Fraction of the copies that are S."""
    ambiguous: Floats
    """Fraction of the copies that are M."""
    unstable: Floats
    """Fraction of the copies in which no grasp was found, U."""
    kept: Floats
    """Fraction of the copies in which the surface's own best grasp, with contacts at the same
    surface points, is S; nan where it has none."""
    critical_angle_low: Floats
    """Critical friction angle of the copies [rad]: the value that a fraction 1 - `settings.level`
    of them does not exceed; inf: no grasp."""
    critical_angle_high: Floats
    """The value that a fraction `settings.level` of the copies does not exceed [rad]."""
    normal_turn: Floats
    """Angle by which the normal turned, at the same level [rad]."""
    shift: Floats
    """How far the vertex moved, at the same level, in the mesh's unit."""
    shift_across: float
    """How far contacts moved across the line between them, at the same level over area and copies,
    in the mesh's unit; for three fingers and more, how far vertices moved."""
    confirmed_fraction: float
    """Area fraction of what is S in the copies whose grasp is S on the surface itself. Noise that
    makes normals look opposed is found by the search, so it is smaller than for given grasps."""
    advice: Advice
    """The errors to enter, and how they were checked."""

    __repr__ = short_repr

    @property
    def mesh(self) -> ObjectMesh:
        """The surface."""
        return self.labels.mesh

    @property
    def model(self) -> GraspModel:
        """The model with the errors to enter; see `Advice.passed`.

        Raises:
            SettingError: The normal error is 90 degrees or more.
        """
        advice = self.advice
        return replace(
            self.labels.model,
            normal_error=advice.normal_error,
            location_error=advice.location_error,
        )

    @property
    def fractions(self) -> dict[Label, Floats]:
        """Fraction of the copies that have each label, (V,) each."""
        return {Label.S: self.stable, Label.M: self.ambiguous, Label.U: self.unstable}

    def columns(self) -> dict[str, Any]:
        """Arrays over the vertices by the names that they have in files, (V,) each."""
        names = (
            "stable", "ambiguous", "unstable", "kept", "critical_angle_low", "critical_angle_high",
            "normal_turn", "shift",
        )  # fmt: skip
        return {name: getattr(self, name) for name in names}


SUFFIXES = (".ply", *TABLES)
"""Endings of the files."""


def write_perturbation(path: str | Path, perturbation: Perturbation) -> None:
    """Write the results of noisy copies for each vertex.

    A PLY is the surface with x y z, outward nx ny nz and the properties below (float, angles in
    radians; nan and inf where there is no grasp); the settings are in comments that begin with
    `grasp3d`. CSV and Parquet have a row for each vertex with x y z and the same columns:
    `stable`, `ambiguous`, `unstable`, `kept`, `critical_angle_low`, `critical_angle_high`,
    `normal_turn`, `shift`.

    Args:
        path: File to make or replace; .ply, .csv or .parquet.
        perturbation: The results.

    Raises:
        OutputError: The suffix is unknown, or the file cannot be written.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.validating import perturbing
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), max_edge=9.0)
        >>> noisy = perturbing.perturb_surface(ball)
        >>> perturbing.write_perturbation("noise.ply", noisy)
        >>> trimesh.load_mesh("noise.ply").vertices.shape == noisy.mesh.vertices.shape
        True
    """
    path = Path(path)
    check_suffix(path, SUFFIXES, "table or mesh")
    if path.suffix.lower() == ".ply":
        _write_ply(path, perturbation)
        return
    position = {axis: perturbation.mesh.vertices[:, k] for k, axis in enumerate("xyz")}
    write_columns(path, {**position, **perturbation.columns()}, settings=settings_of(perturbation))


def settings_of(perturbation: Perturbation) -> dict[str, Any]:
    """Settings of the copies and the errors to enter; angles in radians."""
    labels, advice = perturbation.labels, perturbation.advice
    return {
        "version": package_version(),
        **chosen_settings(labels.mesh, labels.model, labels.sampling, labels.mode),
        **plain_values(perturbation.settings),
        "noise_from": "roughness" if perturbation.estimated else "given",
        **{f"advised_{name}": getattr(advice, name) for name in ("normal_error", "location_error")},
    }


def _write_ply(path: Path, perturbation: Perturbation) -> None:
    mesh = perturbation.mesh
    columns = {
        **{axis: mesh.vertices[:, k].astype("<f8") for k, axis in enumerate("xyz")},
        **{f"n{axis}": -mesh.normals[:, k].astype("<f4") for k, axis in enumerate("xyz")},
        **{name: values.astype("<f4") for name, values in perturbation.columns().items()},
    }
    write_ply_columns(path, columns, mesh.faces, settings_of(perturbation))


def advise(labels: SurfaceLabels, confirmed: Bools, turn: float, across: float) -> Advice:
    """Choose errors with which S holds in most copies, and check them.

    The surface is labelled again with the location error; as its margin falls by every further
    normal error as much, one labelling checks all of them.

    Args:
        labels: The labels of the surface itself.
        confirmed: Whether enough copies are S at each vertex, (V,).
        turn: Measured turn of the normals [rad].
        across: Measured shift of the contacts, in the mesh's unit.
    """
    location, areas = _rounded_up(across), labels.mesh.vertex_areas
    model = replace(labels.model, location_error=location)
    located = label_surface(labels.mesh, model, sampling=labels.sampling)
    least = least_error(located.margin, confirmed, areas)
    error = math.radians(
        _rounded_up(math.degrees(error_to_enter(located.margin, least, turn, areas)))
    )
    stable = located.margin > error
    area, own = float(areas[stable].sum()), labels.model.normal_error
    return Advice(
        normal_error=own + error,
        location_error=location,
        measured_turn=turn,
        least_normal_error=own + least,
        stable_fraction=area / float(areas.sum()),
        unconfirmed_fraction=float(areas[stable & ~confirmed].sum()) / area if area else 0.0,
    )


def error_to_enter(margin: Floats, least: float, turn: float, areas: Floats) -> float:
    """Choose the larger of two errors, unless it leaves much less S than the measured turn.

    On some scans a rough part, such as a fine thread, is S in too few copies at any error that
    leaves anything S elsewhere.

    Args:
        margin: Margins without normal error [rad], (V,).
        least: The least error that passes the check [rad]; inf: none.
        turn: Measured turn of the normals [rad].
        areas: Areas of the vertices, (V,).
    """
    larger = max(turn, least)
    area, most = (float(areas[margin > error].sum()) for error in (larger, turn))
    return larger if area > MUCH_LESS * most else turn


def least_error(margin: Floats, confirmed: Bools, areas: Floats) -> float:
    """The smallest error that leaves nearly only confirmed vertices S.

    Args:
        margin: Margins [rad]: with an error e, vertices whose margin is above e are S; (V,).
        confirmed: Whether enough copies are S there, (V,).
        areas: Areas of the vertices, (V,).

    Returns:
        The error [rad], at least 0; inf: whatever the error, too much of what is S is not
        confirmed, or nothing is S.
    """
    rows = np.flatnonzero(margin > 0.0)
    rows = rows[np.argsort(-margin[rows], kind="stable")]
    area = np.cumsum(areas[rows])
    failed = np.cumsum(np.where(confirmed[rows], 0.0, areas[rows]))
    passing = (failed <= MOST_UNCONFIRMED * area) & (area > 0.0)
    # An error at one vertex's margin excludes it: a border must lie between different margins.
    below = np.append(margin[rows][1:], 0.0)
    passing &= below < margin[rows]
    return float(below[passing].min()) if passing.any() else math.inf


def _rounded_up(number: float) -> float:
    """Round up to two digits, as what is typed."""
    if not 0.0 < number < math.inf:
        return number
    step = 10.0 ** (math.floor(math.log10(number)) - 1)
    return float(f"{math.ceil(number / step - 1e-9) * step:.12g}")
