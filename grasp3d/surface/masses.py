"""Mass and centre of mass of an object under a load."""

import math
from dataclasses import replace

import numpy as np

from grasp3d.arrays import Floats, locked
from grasp3d.errors import SettingError
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.quality.loads import Load
from grasp3d.settings.lengths import METRES

OVERLAP = 0.01
"""Fraction by which volumes of bodies may add to more than that of the object: they overlap."""

LISTED = 8
"""Most volumes of bodies that an error lists."""


def with_load(mesh: ObjectMesh, load: Load) -> ObjectMesh:
    """The mesh for a load: with a density for each body the centre of mass follows from them.

    A centre of mass that was given (`MeshOptions.center_of_mass`) stays.

    Args:
        mesh: The object.
        load: The load.

    Raises:
        SettingError: The centre of mass is not known, as the mesh is open; or a density needs the
            mesh's unit, or a volume, or as many densities as there are bodies.

    Example:
        A head of steel and a handle of wood:

        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.surface import mass_of, with_load
        >>> head = trimesh.creation.box([120, 30, 30])
        >>> handle = trimesh.creation.box([20, 20, 250]).apply_translation([0, 0, -140])
        >>> both = trimesh.util.concatenate([head, handle])
        >>> mesh = grasp3d.load_mesh(both, unit="mm", max_edge=100.0)
        >>> load = grasp3d.Load(density=(7850, 700))
        >>> hammer = with_load(mesh, load)
        >>> heights = f"from {mesh.center_mass[2]:.0f} to {hammer.center_mass[2]:.0f} mm"
        >>> print(f"{mass_of(hammer, load):.2f} kg; the centre of mass moves {heights}")
        0.92 kg; the centre of mass moves from -67 to -11 mm
    """
    source = mesh.report.source
    mass_of(mesh, load)  # checks the density
    if math.isnan(mesh.volume) and mesh.report.center_mass_from == "surface":
        raise SettingError(
            f"{source}: {_without_volume(mesh)}, so its centre of mass is not known, which a load "
            "needs: give it (--center-of-mass, in Python center_of_mass=...), or close the mesh "
            "(--repair full)"
        )
    if not isinstance(load.density, tuple) or mesh.report.center_mass_from == "given":
        return mesh
    assert mesh.solids is not None  # their volumes give the mass
    masses = np.array(load.density) * mesh.solids.volumes
    center = locked(mesh.from_normalized(masses @ mesh.solids.centers / masses.sum()))
    x, y, z = center.tolist()
    return replace(
        mesh,
        center_mass=center,
        options=replace(mesh.options, center_of_mass=(x, y, z)),
        report=replace(mesh.report, center_mass_from="densities"),
    )


def loaded_mesh(mesh: ObjectMesh, load: Load | None) -> tuple[ObjectMesh, Load | None]:
    """The mesh for a load, and the load with lengths in the mesh's unit; see `with_load`.

    Args:
        mesh: The object.
        load: The load; None: none, the mesh stays as it is.

    Raises:
        SettingError: As in `with_load`; or a length has a unit, but that of the mesh is not known.
    """
    if load is None:
        return mesh, None
    return with_load(mesh, load), *mesh.in_own_unit(load)


def mass_of(mesh: ObjectMesh, load: Load) -> float | None:
    """Mass of an object [kg]: as given, or from the density; None: neither is given.

    Args:
        mesh: The object.
        load: The load.

    Raises:
        SettingError: A density needs the mesh's unit, or a volume, or as many densities as there
            are bodies.
    """
    if load.density is None:
        return load.mass
    source = mesh.report.source
    if math.isnan(mesh.volume):
        raise SettingError(
            f"{source}: {_without_volume(mesh)}, so a density gives no mass: give the mass "
            "(--mass) and the centre of mass (--center-of-mass) instead, or close the mesh "
            "(--repair full)"
        )
    if mesh.unit is None:
        raise SettingError(
            f"density is in kg/m^3, but the unit of {source} is not known: give the unit of its "
            "coordinates (--unit, in Python unit=...)"
        )
    cubic_metres = METRES[mesh.unit] ** 3
    if not isinstance(load.density, tuple):
        return load.density * mesh.volume * cubic_metres
    return float(np.dot(load.density, _volumes(mesh, len(load.density)))) * cubic_metres


def _volumes(mesh: ObjectMesh, count: int) -> Floats:
    """Volumes of the bodies, shape (count,); raises SettingError if there are not so many."""
    solids, source = mesh.solids, mesh.report.source
    if solids is None or len(solids.volumes) != count:
        bodies = "too many" if solids is None else len(solids.volumes)
        listed = ""
        if solids is not None and 1 < len(solids.volumes) <= LISTED:
            volumes = ", ".join(f"{one * mesh.size**3:.4g}" for one in solids.volumes)
            listed = f" (volumes {volumes} {mesh.unit}^3)"
        raise SettingError(
            f"density has {count} values, one for each closed body, but {source} has "
            f"{bodies}{listed}: give one density, or one for each in the order of the file"
        )
    ratio = float(solids.volumes.sum()) * mesh.size**3 / mesh.volume
    if ratio > 1.0 + OVERLAP:
        raise SettingError(
            f"{source}: its bodies overlap (their volumes add to {ratio:.3g} times that of the "
            "object), so densities of each give no mass: give the mass (--mass) and the centre of "
            "mass (--center-of-mass) instead"
        )
    return solids.volumes * mesh.size**3


def _without_volume(mesh: ObjectMesh) -> str:
    return "encloses no volume" if mesh.report.closed else "is open"
