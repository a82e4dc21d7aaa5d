"""Surfaces of known shape, as (vertices, faces)."""

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

Surface = tuple[NDArray[np.float64], NDArray[np.int64]]

SHARED = Path(__file__).parents[3] / "shared"
LIBRARY = Path(__file__).parents[2] / "meshes"


def arrays(mesh: trimesh.Trimesh) -> Surface:
    return np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)


def sphere(subdivisions: int = 4, radius: float = 1.0) -> Surface:
    return arrays(trimesh.creation.icosphere(subdivisions, radius))


def box(extents: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Surface:
    return arrays(trimesh.creation.box(extents))


def cone(half_angle: float, height: float = 1.0, sections: int = 128) -> Surface:
    return arrays(trimesh.creation.cone(height * math.tan(half_angle), height, sections=sections))


def tube(
    inner: float = 0.4, outer: float = 0.5, height: float = 1.0, sections: int = 128
) -> Surface:
    return arrays(trimesh.creation.annulus(inner, outer, height, sections=sections))


def torus(major: float = 1.0, minor: float = 0.25) -> Surface:
    return arrays(trimesh.creation.torus(major, minor, major_sections=96, minor_sections=48))


def lopsided(subdivisions: int = 4) -> Surface:
    """A smooth blob without any symmetry, so that there are no ties."""
    vertices, faces = sphere(subdivisions)
    x, y, z = vertices.T
    radius = 1.0 + 0.25 * x * y + 0.15 * z**3 + 0.1 * np.sin(3.0 * x + y) + 0.2 * y**2
    return vertices * radius[:, None] * (1.0, 0.8, 1.3), faces


def finned() -> Surface:
    """A bumpy ball with three thin fins, seen under small solid angles."""
    parts = [trimesh.Trimesh(*lopsided())]
    for k, angle in enumerate((0.3, 2.0, 4.1)):
        fin = trimesh.creation.box((0.02, 1.2, 0.3))
        fin.apply_translation((0.0, 1.2, 0.0))
        fin.apply_transform(trimesh.transformations.rotation_matrix(angle, (1.0, 0.4 * k, 0.0)))
        parts.append(fin)
    return arrays(trimesh.boolean.union(parts, engine="manifold"))


def rotation(seed: int) -> NDArray[np.float64]:
    rotated: NDArray[np.float64] = trimesh.transformations.random_rotation_matrix(
        np.random.default_rng(seed).random(3)
    )[:3, :3]
    return rotated


def shared(*parts: str) -> Path:
    """A file beside the project; the test is skipped if it is missing."""
    path = SHARED.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"needs {'/'.join(parts)}, which is not part of the project")
    return path


def reader(name: str) -> Any:
    """Import another tool's package; if it is missing, the test is skipped, or fails in CI."""
    if os.environ.get("CI"):
        return __import__(name)
    return pytest.importorskip(name, exc_type=ImportError)
