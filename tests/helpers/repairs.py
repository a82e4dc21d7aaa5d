"""Surfaces of several bodies, and the results of their repair."""

import manifold3d
import numpy as np
import pytest
from numpy.typing import NDArray

from grasp3d import ObjectMesh
from grasp3d.arrays import first_at_position
from grasp3d.mesh.measures import Triangles, is_closed
from grasp3d.mesh.repair import RepairedSurface, repair_surface
from grasp3d.settings.mesh_options import Repair
from tests.helpers.shapes import Surface


def joined(*surfaces: Surface) -> Surface:
    """Combine surfaces into one, without joining vertices."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in surfaces)])
    return (
        np.vstack([vertices for vertices, _ in surfaces]),
        np.vstack([faces + start for (_, faces), start in zip(surfaces, starts, strict=False)]),
    )


def moved(surface: Surface, shift: tuple[float, float, float], scale: float = 1.0) -> Surface:
    return surface[0] * scale + shift, surface[1]


def inward(surface: Surface) -> Surface:
    return surface[0], surface[1][:, ::-1]


def repaired(surface: Surface, level: Repair = "safe") -> RepairedSurface:
    return repair_surface(*surface, level, "test")


def counts(surface: RepairedSurface | ObjectMesh) -> dict[str, int]:
    """Number of changes of each kind, by name."""
    steps = surface.steps if isinstance(surface, RepairedSurface) else surface.report.repairs
    return {step.name: step.count for step in steps}


def volume_of(surface: RepairedSurface) -> float:
    return float(Triangles(surface.vertices, surface.faces).volumes.sum())


def used_by(surface: RepairedSurface) -> NDArray[np.bool_]:
    """Mask of the vertices whose canonical vertex is on the surface."""
    used = np.zeros(len(surface.vertices), dtype=bool)
    used[surface.faces] = True
    return used[surface.canonical]


def assert_whole(surface: RepairedSurface) -> None:
    """Check the properties of every united surface, and that Manifold accepts it as a solid."""
    assert surface.closed
    assert is_closed(surface.faces)
    assert np.array_equal(surface.canonical[surface.faces], surface.faces)
    assert np.array_equal(surface.canonical[surface.canonical], surface.canonical)
    size = np.ptp(surface.vertices, axis=0).max()
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(surface.vertices / size, surface.faces.astype(np.uint64))
    )
    assert solid.status() == manifold3d.Error.NoError
    assert solid.volume() == pytest.approx(volume_of(surface) / size**3, rel=1e-9)


def over_positions(surface: Surface) -> Surface:
    """Index the surface by its distinct positions, as in a file without indices."""
    return surface[0], first_at_position(surface[0])[surface[1]]
