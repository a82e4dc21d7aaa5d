"""Which side is the object: winding, inside-out bodies, small holes, closedness."""

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from grasp3d.arrays import Bools, Floats, Ints, unit_rows
from grasp3d.mesh.measures import face_areas, signed_volumes

CLEAR_VOTE = 0.5
"""An open body is turned when its outermost faces look inward by this much; see `_hull_vote`."""

SMALL_HOLES = 0.01
"""Holes are filled when the faces that fill them add at most this share to the area."""


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
    doubled: int
    """Bodies that lie within another and are wound alike: counted twice in the volume."""


def orient_faces(vertices: Floats, faces: Ints) -> OrientedFaces:
    """Make the winding consistent, close the smallest holes, and turn what is inside out.

    Args:
        vertices: Positions (V, 3), centred and of size about 1, so that volumes keep their digits.
        faces: Welded faces (F, 3).
    """
    wound = _consistent(vertices, faces)
    whole = _without_small_holes(vertices, wound)
    body = _body_of_face(whole)
    bodies = _Bodies(vertices, whole, body)
    flip = bodies.inside_out()[body]
    result = np.where(flip[:, None], whole[:, ::-1], whole)
    return OrientedFaces(
        faces=result,
        closed=is_closed(result),
        bodies=int(body.max()) + 1,
        rewound=int((wound != faces).any(axis=1).sum()),
        inverted=int(flip.sum()),
        filled=len(whole) - len(wound),
        doubled=_Bodies(vertices, result, body).doubled(),
    )


def _consistent(vertices: Floats, faces: Ints) -> Ints:
    """Turn faces that disagree with their neighbours."""
    mesh = trimesh.Trimesh(vertices, faces, process=False, validate=False)
    if is_closed(faces) or mesh.is_winding_consistent:
        return faces
    trimesh.repair.fix_winding(mesh)
    return np.array(mesh.faces, dtype=np.int64)


def _without_small_holes(vertices: Floats, faces: Ints) -> Ints:
    """Fill holes of three or four edges, if that hardly changes the surface."""
    if is_closed(faces):
        return faces
    mesh = trimesh.Trimesh(vertices, faces, process=False, validate=False)
    trimesh.repair.fill_holes(mesh)
    filled = np.array(mesh.faces, dtype=np.int64)
    areas = face_areas(vertices, filled)
    small = areas[len(faces) :].sum() <= SMALL_HOLES * areas[: len(faces)].sum()
    return filled if small else faces


def is_closed(faces: Ints) -> bool:
    """Tell whether every edge is passed equally often in both directions.

    Then the signed volume does not depend on the origin, even where more than two faces meet.
    """
    return not _unbalanced_vertices(faces).size


def _unbalanced_vertices(faces: Ints) -> Ints:
    """First vertices of the edges that are passed more often one way than the other."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forward = edges[:, 0] < edges[:, 1]
    unique, inverse = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    balance = np.bincount(inverse.ravel(), weights=np.where(forward, 1.0, -1.0))
    return np.asarray(unique[balance != 0.0, 0])


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


class _Bodies:
    """The connected parts of a surface, and which of them lie within others."""

    def __init__(self, vertices: Floats, faces: Ints, body: Ints) -> None:
        self.vertices, self.faces, self.body = vertices, faces, body
        count = int(body.max()) + 1
        part_of_vertex = np.zeros(len(vertices), dtype=np.int64)
        part_of_vertex[faces] = body[:, None]
        self.open = np.zeros(count, dtype=bool)
        self.open[part_of_vertex[_unbalanced_vertices(faces)]] = True
        corners = vertices[faces]
        self.volumes = np.bincount(body, weights=signed_volumes(vertices, faces))
        self.lower = np.full((count, 3), np.inf)
        self.upper = np.full((count, 3), -np.inf)
        np.minimum.at(self.lower, body, corners.min(axis=1))
        np.maximum.at(self.upper, body, corners.max(axis=1))

    def inside_out(self) -> Bools:
        """Tell the bodies to turn; a cavity within another body is rightly wound inward."""
        flip = np.zeros(len(self.open), dtype=bool)
        for part in np.flatnonzero(self.open):
            flip[part] = _hull_vote(self.vertices, self.faces[self.body == part]) < -CLEAR_VOTE
        closed = ~self.open
        if self.volumes[closed].sum() < 0.0:  # the whole object, cavities and all
            flip[closed] = True
        negative = np.where(flip, -self.volumes, self.volumes) < 0.0
        for part in np.flatnonzero(closed & negative):
            if not self._lies_within(part, np.flatnonzero(closed & ~negative)):
                flip[part] = not flip[part]
        return flip

    def doubled(self) -> int:
        """Count the closed bodies that lie within another of the same winding."""
        solid = np.flatnonzero(~self.open & (self.volumes > 0.0))
        return sum(self._lies_within(part, solid[solid != part]) for part in solid)

    def _lies_within(self, part: np.integer, others: Ints) -> bool:
        """Tell whether a body lies in one of the others, by the winding number at its corner."""
        around = (self.lower[others] < self.lower[part]).all(axis=1)
        around &= (self.upper[others] > self.upper[part]).all(axis=1)
        if not around.any():
            return False
        point = self.vertices[self.faces[np.argmax(self.body == part), 0]]
        for other in others[around]:
            corners = self.vertices[self.faces[self.body == other]] - point
            if abs(_winding_number(corners)) > 0.5:  # noqa: PLR2004
                return True
        return False


def _winding_number(corners: Floats) -> float:
    """How often triangles (F, 3, 3) wind around the origin (van Oosterom & Strackee 1983)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    determinant = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", u, v) * w for u, v, w in ((a, b, lc), (b, c, la), (c, a, lb))]
    angles = 2.0 * np.arctan2(determinant, la * lb * lc + sum(dots))
    return float(angles.sum() / (4.0 * np.pi))


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
