"""Closed bodies that lie wholly within others."""

import manifold3d
import numpy as np

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.mesh.repair.boxes import enclosed
from grasp3d.mesh.repair.solids import Solid, marked, solids_of
from grasp3d.mesh.work_bounds import NESTED_BODIES


def nested(
    points: Floats, faces: Ints, body: Ints, volumes: Floats, margin: float
) -> tuple[Ints, Ints]:
    """Find the bodies that lie wholly within others, their surfaces apart by a margin.

    Such a body minus the other one is empty, both taken as wound outward, the inner one offset
    outward and the outer one inward by the margin. A body that crosses the other one, or touches it
    from inside, is not within it.

    Args:
        points: Positions (V, 3).
        faces: Faces (F, 3) of closed bodies.
        body: Body of each face, shape (F,).
        volumes: Volume of each body, negative if wound inward, not 0, shape (B,).
        margin: Distance by which surfaces are offset.

    Returns:
        The inner and the outer body of each pair, shape (k,) each.
    """
    lower, upper = boxes_of(points, faces, body, len(volumes))
    inner, outer = enclosed(lower, upper)
    if not len(inner):
        return inner, outer
    sizes = np.bincount(body)
    NESTED_BODIES.check(int((sizes[inner] + sizes[outer]).sum()))
    turned = np.where((volumes < 0.0)[body][:, None], faces[:, ::-1], faces)
    grown = _solids(points, turned, body, np.unique(inner), margin)
    shrunk = _solids(points, turned, body, np.unique(outer), -margin)
    order = np.argsort(outer, kind="stable")
    inner, outer = inner[order], outer[order]
    found, first = np.unique(outer, return_index=True)
    within = [
        _within([grown[one] for one in ones.tolist()], shrunk[other])
        for other, ones in zip(found.tolist(), np.split(inner, first[1:]), strict=True)
    ]
    kept = np.concatenate(within)
    return inner[kept], outer[kept]


def boxes_of(points: Floats, faces: Ints, body: Ints, count: int) -> tuple[Floats, Floats]:
    """Lower and upper corner of each body's box, shape (B, 3) each; inf and -inf without a face."""
    lower, upper = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    corners = points[faces]
    np.minimum.at(lower, body, corners.min(axis=1))
    np.maximum.at(upper, body, corners.max(axis=1))
    return lower, upper


def _solids(
    points: Floats, faces: Ints, body: Ints, chosen: Ints, shift: float
) -> dict[int, Solid]:
    """Offset solids of some bodies, by body number."""
    own = np.isin(body, chosen)
    solids = solids_of(points, faces[own], np.searchsorted(chosen, body[own]), shift)
    return dict(zip(chosen.tolist(), solids, strict=True))


def _within(inner: list[Solid], outer: Solid) -> Bools:
    """Mask of the solids of which no face is left when another solid is subtracted, shape (k,)."""
    together, marks = marked(inner)
    difference = together - outer.manifold
    if difference.status() != manifold3d.Error.NoError:
        return np.zeros(len(inner), dtype=bool)
    mesh = difference.to_mesh64()
    left = np.asarray(mesh.run_original_id)[np.diff(np.asarray(mesh.run_index)) > 0]
    return np.asarray(~np.isin(marks, left))
