"""Files of noisy copies' labels: PLY, CSV and Parquet."""

from pathlib import Path
from typing import Any

from grasp3d.export.settings import chosen_settings
from grasp3d.settings.parsing import plain_values
from grasp3d.system.files import check_suffix
from grasp3d.system.tables import SUFFIXES as TABLES
from grasp3d.system.tables import write_columns
from grasp3d.system.tables.ply_files import write_ply_columns
from grasp3d.system.versions import package_version
from grasp3d.validating.perturbing.perturbation import Perturbation

SUFFIXES = (".ply", *TABLES)
"""Endings of the files."""


def write_perturbation(path: str | Path, found: Perturbation) -> None:
    """Write the results of noisy copies for each vertex.

    A PLY is the surface with x y z, outward nx ny nz and the properties below (float, angles in
    radians; nan and inf where there is no grasp); the settings are in comments that begin with
    `grasp3d`. CSV and Parquet have a row for each vertex with x y z and the same columns:
    `stable`, `ambiguous`, `unstable`, `kept`, `critical_angle_low`, `critical_angle_high`,
    `normal_turn`, `shift`.

    Args:
        path: File to make or replace; .ply, .csv or .parquet.
        found: The results.

    Raises:
        OutputError: The suffix is unknown, or the file cannot be written.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.validating import perturbing
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), max_edge=9.0)
        >>> found = perturbing.perturb_surface(ball)
        >>> perturbing.write_perturbation("noise.ply", found)
        >>> trimesh.load_mesh("noise.ply").vertices.shape == found.mesh.vertices.shape
        True
    """
    path = Path(path)
    check_suffix(path, SUFFIXES, "table or mesh")
    if path.suffix.lower() == ".ply":
        _write_ply(path, found)
        return
    position = {axis: found.mesh.vertices[:, k] for k, axis in enumerate("xyz")}
    write_columns(path, {**position, **found.columns()}, settings=settings_of(found))


def settings_of(found: Perturbation) -> dict[str, Any]:
    """Settings of the copies and the errors to enter; angles in radians."""
    labels, noise, advice = found.labels, plain_values(found.settings), found.advice
    return {
        "version": package_version(),
        **chosen_settings(labels.mesh, labels.model, labels.sampling, labels.mode),
        **{name: value for name, value in noise.items() if name != "seed"},
        "noise_seed": found.settings.seed,
        "noise_from": "roughness" if found.estimated else "given",
        **{f"advised_{name}": getattr(advice, name) for name in ("normal_error", "location_error")},
    }


def _write_ply(path: Path, found: Perturbation) -> None:
    mesh = found.mesh
    columns = {
        **{axis: mesh.vertices[:, k].astype("<f8") for k, axis in enumerate("xyz")},
        **{f"n{axis}": -mesh.normals[:, k].astype("<f4") for k, axis in enumerate("xyz")},
        **{name: values.astype("<f4") for name, values in found.columns().items()},
    }
    write_ply_columns(path, columns, mesh.faces, settings_of(found))
