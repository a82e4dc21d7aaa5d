"""Which side is the object: winding, inside-out bodies, small holes, closedness."""

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from grasp3d.arrays import Bools, Floats, Ints, unit_rows

CLEAR_VOTE = 0.5
"""An open mesh is turned when its outermost faces look inward by this much; see `_hull_vote`."""


@dataclass(frozen=True, eq=False)
class OrientedFaces:
    """Faces wound counter-clockwise as seen from outside, as far as that can be told."""

    faces: Ints
    """Shape (F, 3)."""
    closed: bool
    """Every edge is passed as often one way as the other: the faces bound a volume."""
    bodies: int
    """Connected parts."""
    rewound: int
    """Faces turned to agree with their neighbours."""
    inverted: int
    """Faces of bodies that were inside out and have been turned."""
    filled: int
    """Faces added in holes of three or four edges."""


def orient_faces(vertices: Floats, faces: Ints) -> OrientedFaces:
    """Make the winding consistent, close the smallest holes, and turn what is inside out.

    Args:
        vertices: Positions (V, 3), centred and of size about 1, so that volumes keep their digits.
        faces: Welded faces (F, 3).
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False, validate=False)
    rewound = filled = 0
    if not (is_closed(faces) or mesh.is_winding_consistent):
        trimesh.repair.fix_winding(mesh)
        rewound = int((np.asarray(mesh.faces) != faces).any(axis=1).sum())
    if not is_closed(np.asarray(mesh.faces)):
        trimesh.repair.fill_holes(mesh)
        filled = len(mesh.faces) - len(faces)
    result = np.array(mesh.faces, dtype=np.int64)
    closed = is_closed(result)
    body = _body_of_face(result)
    flip = _inside_out(vertices, result, body, closed=closed)
    result[flip] = result[flip][:, ::-1]
    return OrientedFaces(
        faces=result,
        closed=closed,
        bodies=int(body.max()) + 1,
        rewound=rewound,
        inverted=int(flip.sum()),
        filled=filled,
    )


def is_closed(faces: Ints) -> bool:
    """Tell whether every edge is passed equally often in both directions.

    Then the signed volume does not depend on the origin, even where more than two faces meet.
    """
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forward = edges[:, 0] < edges[:, 1]
    ordered = np.sort(edges, axis=1)
    _, inverse = np.unique(ordered, axis=0, return_inverse=True)
    balance = np.bincount(inverse.ravel(), weights=np.where(forward, 1.0, -1.0))
    return not balance.any()


def signed_volumes(vertices: Floats, faces: Ints) -> Floats:
    """Volumes of the tetrahedra from the origin to each face, shape (F,)."""
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)


def _body_of_face(faces: Ints) -> Ints:
    """Connected part of each face, faces being neighbours when they share a vertex, shape (F,)."""
    size = int(faces.max()) + 1
    links = coo_array(
        (
            np.ones(2 * len(faces), dtype=np.int8),
            (faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()),
        ),
        shape=(size, size),
    )
    _, part = connected_components(links, directed=False)
    _, body = np.unique(part[faces[:, 0]], return_inverse=True)
    return np.asarray(body, dtype=np.int64).ravel()


def _inside_out(vertices: Floats, faces: Ints, body: Ints, *, closed: bool) -> Bools:
    """Tell the faces whose body is inside out; a cavity within another body is rightly so."""
    if not closed:
        return np.full(len(faces), _hull_vote(vertices, faces) < -CLEAR_VOTE)
    middle = vertices[faces].mean(axis=(0, 1))
    pieces = signed_volumes(vertices - middle, faces)
    all_flipped = pieces.sum() < 0.0
    volumes = np.bincount(body, weights=pieces) * (-1.0 if all_flipped else 1.0)
    flip = np.full(len(faces), all_flipped)
    negative = np.flatnonzero(volumes < 0.0)
    if len(negative):
        lower, upper = _boxes(vertices, faces, body)
        outer = volumes > 0.0
        for part in negative:
            around = (lower[outer] <= lower[part]).all(axis=1)
            around &= (upper[outer] >= upper[part]).all(axis=1)
            if not around.any():
                flip[body == part] ^= True
    return np.asarray(flip)


def _boxes(vertices: Floats, faces: Ints, body: Ints) -> tuple[Floats, Floats]:
    """Bounding boxes of the bodies, (bodies, 3) each."""
    corners = vertices[faces]
    lower = np.full((int(body.max()) + 1, 3), np.inf)
    upper = -lower
    np.minimum.at(lower, body, corners.min(axis=1))
    np.maximum.at(upper, body, corners.max(axis=1))
    return lower, upper


def _hull_vote(vertices: Floats, faces: Ints) -> float:
    """How far the faces at the convex hull's corners look outward, from -1 to 1; 0 if flat.

    An open surface has no volume whose sign could tell, but its outermost places must look away
    from it.
    """
    used = np.unique(faces)
    try:
        hull = ConvexHull(vertices[used])
    except QhullError:
        return 0.0
    outward = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(outward, used[hull.simplices[:, k]], hull.equations[:, :3])
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    doubled = np.cross(b - a, c - a)
    votes = np.einsum("fi,fki->fk", doubled, unit_rows(outward)[faces])
    return float(votes.sum() / max(np.abs(votes).sum(), np.finfo(np.float64).tiny))
