"""The arrays that the kernels pass around, by name."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt


class Sets(NamedTuple):
    """All normals that a contact at a vertex may have; see `normal_sets`."""

    start: npt.NDArray[np.int64]
    """First row of each vertex in `normals` (V + 1,)."""
    counts: npt.NDArray[np.int64]
    """Corners of each polygon of normals (V,)."""
    normals: npt.NDArray[np.float64]
    """Unit normals (K, 3)."""


class Frames(NamedTuple):
    """Where the directions about each vertex are laid out."""

    centres: npt.NDArray[np.float64]
    """Middle of the vertex's normals (V, 3)."""
    tangents: npt.NDArray[np.float64]
    """A direction across it (V, 3)."""
    radii: npt.NDArray[np.float64]
    """Largest angle from the middle to a normal [rad] (V,)."""


class Surface(NamedTuple):
    """The faces that rays meet, with the normals along them."""

    points: npt.NDArray[np.float64]
    """Positions of the vertices (V, 3)."""
    faces: npt.NDArray[np.int64]
    """Vertices of each face (F, 3)."""
    corners: npt.NDArray[np.int64]
    """Row of `normals` at each corner of each face (F, 3)."""
    normals: npt.NDArray[np.float64]
    """Unit normals at the corners (C, 3)."""
    twins: npt.NDArray[np.int64]
    """Rows of `normals` across each crease (F, 3, 2), -1 where smooth or open."""


class Grasps(NamedTuple):
    """The best grasps so far, a row per vertex; written in place."""

    worst: npt.NDArray[np.float64]
    """Critical angle over the worst normals [rad]."""
    best: npt.NDArray[np.float64]
    """Critical angle over the best normals, of a grasp of its own [rad]."""
    closing: npt.NDArray[np.float64]
    """Closing direction of the grasp of `worst` (V, 3)."""
    closing_best: npt.NDArray[np.float64]
    """Closing direction of the grasp of `best` (V, 3)."""
    partner: npt.NDArray[np.float64]
    """Second contact of the grasp of `worst` (V, 3)."""
    partner_normal: npt.NDArray[np.float64]
    """Normal there (V, 3)."""
    signs: npt.NDArray[np.int8]
    """+1 squeeze, -1 expand, of the grasp of `worst`."""
    signs_best: npt.NDArray[np.int8]
    """The same for the grasp of `best`."""
    reason: npt.NDArray[np.uint8]
    """FOUND, NO_PARTNER or OPENING."""
    starts: npt.NDArray[np.float64]
    """Closing directions of the best grasps that lie apart, ordered (V, k, 3)."""
    start_angles: npt.NDArray[np.float64]
    """Their critical angles over the worst normals [rad] (V, k)."""
    start_signs: npt.NDArray[np.int8]
    """+1 squeeze, -1 expand (V, k)."""
    apart: float
    """Cosine of the angle from which two closing directions lie apart."""


class Rays(NamedTuple):
    """Rays from vertices, compacted in place as they end."""

    owner: npt.NDArray[np.int32]
    """Vertex that each starts from (r,)."""
    closing: npt.NDArray[np.float64]
    """Closing direction (r, 3)."""
    signs: npt.NDArray[np.int8]
    """+1: the ray runs along the closing direction, -1: against it (r,)."""
    along: npt.NDArray[np.float64]
    """Distance from the vertex at which the ray goes on (r,)."""
    step: npt.NDArray[np.float64]
    """How much farther it starts when it meets the same face again (r,)."""
    last: npt.NDArray[np.int32]
    """Face crossed last, -1 none (r,)."""
