"""Convex parts of a mesh, since MuJoCo collides meshes as their convex hulls."""

import hashlib
import os
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from grasp3d.arrays import Floats, Ints, locked
from grasp3d.errors import GraspError, MeshError, OutputError, SettingError
from grasp3d.jobs.child import LostError
from grasp3d.jobs.cluster_settings import ClusterSettings
from grasp3d.jobs.running import run
from grasp3d.mesh import ObjectMesh
from grasp3d.outcomes.simulation_settings import SimulationSettings
from grasp3d.system.files import atomic_write

SEARCH = {"mcts_iterations": 60, "mcts_nodes": 10, "preprocess_mode": "off"}
"""How CoACD divides: it searches for cuts half as long as by default, for about as few parts, and
does not remesh the surface, which moves it outward by a hundredth of the object's size. What is
closed needs no remeshing."""

CACHE = "GRASP3D_CACHE"
"""Environment variable with the folder in which parts are kept; empty: none."""


Parts = tuple[Floats, ...]
"""Corners of convex bodies whose union is nearly an object [m], shape (n, 3) each."""


def parts_of(mesh: ObjectMesh, settings: SimulationSettings, cluster: ClusterSettings) -> Parts:
    """Convex parts of a mesh, found in a watched process unless there shall be none.

    Args:
        mesh: The mesh.
        settings: Of the parts.
        cluster: Its limits.

    Raises:
        MeshError: The mesh is open.
        GraspError: CoACD crashed, took too long, or too much memory.
        SettingError: It is not installed, or finds no parts.
    """
    source = mesh.report.source
    if not mesh.report.closed:
        raise MeshError(
            f"{source}: is open, so it bounds no body that could be simulated; close it "
            "(--repair full)"
        )
    task = partial(_parts, settings=settings)
    (done,) = run(task, [(mesh.vertices, mesh.faces)], cluster=cluster)
    if isinstance(done.error, LostError):
        raise GraspError(
            f"{source}: CoACD, which divides it into convex parts, {done.error}; try a larger "
            "part_threshold, or repair the mesh (--repair full)"
        )
    return done.result


def _parts(surface: tuple[Floats, Ints], settings: SimulationSettings) -> Parts:
    return convex_parts(*surface, threshold=settings.part_threshold, seed=settings.seed)


def convex_parts(vertices: Floats, faces: Ints, *, threshold: float = 0.02, seed: int = 0) -> Parts:
    """Divide a closed surface into convex parts with CoACD (Wei et al., SIGGRAPH 2022).

    Args:
        vertices: Positions, shape (V, 3).
        faces: Corners of each face, shape (F, 3).
        threshold: Concavity, as a fraction of the object's size, below which a part is not divided
            further, from 0.01 to 1.
        seed: Seed of the search for cuts; the same seed gives the same parts.

    Returns:
        Corners of each part, shape (n, 3); those of the same surface and settings are kept in a
        file.

    Raises:
        SettingError: CoACD is not installed, or divides the surface into nothing.

    Example:
        >>> import trimesh
        >>> from grasp3d.outcomes import convex_parts
        >>> box = trimesh.creation.box([0.04, 0.06, 0.1])
        >>> len(convex_parts(box.vertices, box.faces))
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


def coacd_module() -> Any:
    """CoACD, of the extra `physics`. Raises SettingError if it is not installed."""
    try:
        import coacd
    except ImportError as error:
        text = "a simulation needs coacd; install it with: pip install 'grasp3d[physics]'"
        raise SettingError(text) from error
    return coacd


def _decomposed(vertices: Floats, faces: Ints, threshold: float, seed: int) -> Parts:
    coacd = coacd_module()
    coacd.set_log_level("error")
    # Its threshold is for an object that is scaled to a box from -1 to 1.
    parts: Any = coacd.run_coacd(
        coacd.Mesh(vertices, faces), threshold=threshold, seed=seed, **SEARCH
    )
    solid = [one for one in (np.asarray(points, float) for points, _ in parts) if _is_solid(one)]
    if not solid:
        raise SettingError("the mesh has no convex parts: it must enclose a volume")
    return tuple(map(locked, solid))


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


def _read(path: Path) -> Parts | None:
    """Parts of a file; None: it is missing or damaged."""
    try:
        with np.load(path) as file:
            vertices, first = file["vertices"], file["first"]
    except (OSError, ValueError, KeyError, EOFError):
        return None
    return tuple(map(locked, np.split(vertices, first)))


def _write(path: Path, parts: Parts) -> None:
    """Keep parts in a file, where one can be written."""
    counts = np.cumsum([len(one) for one in parts])
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary:
            np.savez(temporary, vertices=np.concatenate(parts), first=counts[:-1])
    except (OSError, OutputError):
        return
