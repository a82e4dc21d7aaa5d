"""Convex parts of a mesh, since MuJoCo collides meshes as their convex hulls."""

import hashlib
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from grasp3d.arrays import Floats, Ints, locked, short_repr
from grasp3d.errors import OutputError, SettingError
from grasp3d.physics.engine import NEEDS_PHYSICS
from grasp3d.system.files import atomic_write

SEARCH = {"mcts_iterations": 60, "mcts_nodes": 10, "preprocess_mode": "off"}
"""How CoACD divides: it searches for cuts half as long as by default, for about as few parts, and
does not remesh the surface, which moves it outward by a hundredth of the object's size. What is
closed needs no remeshing."""

CACHE = "GRASP3D_CACHE"
"""Environment variable with the folder in which parts are kept; empty: none."""


@dataclass(frozen=True, eq=False)
class ConvexParts:
    """Convex bodies whose union is nearly an object."""

    vertices: tuple[Floats, ...]
    """Corners of each part [m], shape (n, 3)."""

    __repr__ = short_repr

    @property
    def count(self) -> int:
        """Number of parts."""
        return len(self.vertices)

    @cached_property
    def _planes(self) -> tuple[Floats, ...]:
        """Outward normals and offsets of each part's faces, shape (m, 4)."""
        return tuple(ConvexHull(one).equations for one in self.vertices)

    def depths(self, points: Floats) -> Floats:
        """How deep points lie below the surface of the union.

        Args:
            points: Positions in the mesh's frame, shape (k, 3).

        Returns:
            Depth in the deepest part, shape (k,); negative outside, there at most the distance.
            For points of the mesh's surface it is the distance by which the parts are off there.
        """
        inside = [-(points @ one[:, :3].T + one[:, 3]).max(axis=1) for one in self._planes]
        return np.max(inside, axis=0)  # type: ignore[no-any-return]

    def outward(self, points: Floats) -> Floats:
        """Outward normals of the union near points on it, shape (k, 3)."""
        normals, deepest = np.zeros((len(points), 3)), np.full(len(points), -np.inf)
        for planes in self._planes:
            heights = points @ planes[:, :3].T + planes[:, 3]
            face = heights.argmax(axis=1)
            depth = -heights[np.arange(len(points)), face]
            nearer = depth > deepest
            normals[nearer], deepest[nearer] = planes[face[nearer], :3], depth[nearer]
        return normals


def convex_parts(
    vertices: Floats, faces: Ints, *, threshold: float = 0.03, seed: int = 0
) -> ConvexParts:
    """Divide a closed surface into convex parts with CoACD (Wei et al., SIGGRAPH 2022).

    Args:
        vertices: Positions, shape (V, 3).
        faces: Corners of each face, shape (F, 3).
        threshold: Concavity, as a fraction of the object's size, below which a part is not divided
            further, from 0.01 to 1.
        seed: Seed of the search for cuts; the same seed gives the same parts.

    Returns:
        The parts; those of the same surface and settings are kept in a file.

    Raises:
        SettingError: CoACD is not installed, or divides the surface into nothing.

    Example:
        >>> import trimesh
        >>> from grasp3d.physics import convex_parts
        >>> box = trimesh.creation.box([0.04, 0.06, 0.1])
        >>> convex_parts(box.vertices, box.faces).count
        1
    """
    key = hashlib.sha256(repr((SEARCH, threshold, seed)).encode())
    for array in (vertices, faces):
        key.update(np.ascontiguousarray(array).tobytes())
    path = _cached_file(key.hexdigest())
    cached = None if path is None else _read(path)
    if cached is not None:
        return cached
    parts = _decomposed(vertices, faces, threshold, seed)
    if path is not None:
        _write(path, parts)
    return parts


def _decomposed(vertices: Floats, faces: Ints, threshold: float, seed: int) -> ConvexParts:
    try:
        import coacd
    except ImportError as error:
        raise SettingError(NEEDS_PHYSICS.format("a simulation", "coacd")) from error
    coacd.set_log_level("error")
    # Its threshold is for an object that is scaled to a box from -1 to 1.
    parts: Any = coacd.run_coacd(
        coacd.Mesh(vertices, faces), threshold=threshold, seed=seed, **SEARCH
    )
    solid = [one for one in (np.asarray(points, float) for points, _ in parts) if _is_solid(one)]
    if not solid:
        raise SettingError("the mesh has no convex parts: it must enclose a volume")
    return ConvexParts(tuple(locked(one) for one in solid))


def _is_solid(vertices: Floats) -> bool:
    """Whether points span a volume."""
    if len(vertices) < 4:
        return False
    try:
        ConvexHull(vertices)
    except QhullError:
        return False
    return True


def _cached_file(key: str) -> Path | None:
    """File in which the parts of a key are kept; None: nowhere."""
    folder = os.environ.get(CACHE)
    if folder == "":
        return None
    try:
        home = Path.home()
    except RuntimeError:  # no home folder
        return None
    cache = os.environ.get("XDG_CACHE_HOME") or str(home / ".cache")
    return Path(folder or Path(cache) / "grasp3d") / "parts" / f"{key[:32]}.npz"


def _read(path: Path) -> ConvexParts | None:
    """Parts of a file; None: it is missing or damaged."""
    try:
        with np.load(path) as file:
            vertices, first = file["vertices"], file["first"]
    except (OSError, ValueError, KeyError, EOFError):
        return None
    return ConvexParts(tuple(locked(one) for one in np.split(vertices, first)))


def _write(path: Path, parts: ConvexParts) -> None:
    """Keep parts in a file, where one can be written."""
    counts = np.cumsum([len(one) for one in parts.vertices])
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary:
            np.savez(temporary, vertices=np.concatenate(parts.vertices), first=counts[:-1])
    except (OSError, OutputError):
        return
