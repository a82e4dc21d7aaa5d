"""Uniting bodies that overlap or touch, so that no place inside the object seems to be outside."""

from dataclasses import dataclass, replace

import manifold3d
import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats, Ints, first_at_position
from grasp3d.mesh.measures import has_area
from grasp3d.mesh.repair.bodies import Bodies
from grasp3d.mesh.repair.boxes import overlap_groups
from grasp3d.mesh.repair.cleaning import from_least_corner
from grasp3d.mesh.repair.seams import put_on_surface, without_slits, without_slivers
from grasp3d.mesh.repair.solids import Solid, solids_of
from grasp3d.mesh.repair.welding import WELDS, clusters

NEAR = 4.0
"""Distance within which places are one after faces were shifted, in units of the shift."""

SNAPS = (16.0, 64.0, 256.0, 1024.0)
"""The same for places on the lines where bodies meet, which a shift moves farther where they meet
at a small angle; the first counts that leaves no face without an area."""

REAL = 1e-6
"""Share of the area that must vanish in a union; bodies that touch in a line are left alone."""


@dataclass(frozen=True, eq=False)
class United:
    """A surface on which no body reaches into another."""

    points: Floats
    """Positions (V', 3): those given, then those on the lines where bodies meet."""
    faces: Ints
    """Shape (F', 3)."""
    canonical: Ints
    """For every vertex the one that stands for it, shape (V',)."""
    bodies: int
    """Bodies that overlapped or touched others."""
    refused: int
    """Bodies with overlapping boxes of which no sound union came out."""
    rounding: float
    """How far a position may lie off the faces that were given."""


@dataclass(frozen=True, eq=False)
class _Joint:
    """The union of some solids, over vertices of its own."""

    given: Ints
    """Vertices of the solids, shape (k,), the first of its own."""
    added: Floats
    """Positions of the others, shape (m, 3)."""
    standing: Ints
    """For every vertex the one that stands for it, shape (k + m,)."""
    faces: Ints
    """Shape (f, 3)."""
    changed: int
    """Solids that lost faces."""


def unite(bodies: Bodies) -> United:
    """Unite the closed bodies that overlap, or touch over an area.

    Each body's faces are first shifted outward by less than its positions mean, so that faces which
    lie against each other surely overlap, and faces that are flush stay so. Given positions are
    then put back; a vertex that lies on the united surface is made a corner of it even if the union
    did without.

    Args:
        bodies: Of a surface of size about 1, its faces counter-clockwise from outside.
    """
    points, touch = bodies.points, bodies.touch
    owner = bodies.owners()
    outer = np.flatnonzero(owner == np.arange(bodies.count))
    groups = [
        outer[group]
        for group in overlap_groups(bodies.lower[outer] - touch, bodies.upper[outer] + touch)
    ]
    joints, left, refused = [], np.ones(bodies.count, dtype=bool), 0
    for group, solids in zip(groups, _solids(bodies, owner, groups), strict=True):
        whole = manifold3d.Manifold.batch_boolean(
            [solid.manifold for solid in solids], manifold3d.OpType.Add
        )
        if not _is_sound(whole, solids):
            refused += len(group)
        elif _has_less_area(whole, solids, touch):
            joints.append(_joint(points, whole, solids, touch))
            left[np.isin(owner, group)] = False
    united = _put_together(points, bodies.faces[left[bodies.body]], joints)
    return replace(united, refused=refused, rounding=touch if joints else 0.0)


def _solids(bodies: Bodies, owner: Ints, groups: list[Ints]) -> list[list[Solid]]:
    """Solids of the bodies of each group, with their cavities."""
    if not groups:
        return []
    members = np.concatenate(groups)
    number = np.full(bodies.count + 1, -1)  # the last one for bodies that no one owns
    number[members] = np.arange(len(members))
    of_face = number[owner][bodies.body]
    own = of_face >= 0
    solids = solids_of(bodies.points, bodies.faces[own], of_face[own], bodies.touch)
    ends = np.cumsum([len(group) for group in groups]).tolist()
    return [solids[end - len(group) : end] for group, end in zip(groups, ends, strict=True)]


def _is_sound(whole: manifold3d.Manifold, solids: list[Solid]) -> bool:
    """Tell whether a union holds at least its largest part, and at most all of them."""
    volumes = [solid.manifold.volume() for solid in solids]
    return bool(
        whole.status() == manifold3d.Error.NoError
        and min(volumes) > 0.0
        and (1.0 - REAL) * max(volumes) < whole.volume() < (1.0 + REAL) * sum(volumes)
    )


def _has_less_area(whole: manifold3d.Manifold, solids: list[Solid], touch: float) -> bool:
    """Tell whether the parts of a union meet over an area."""
    area = sum(solid.manifold.surface_area() for solid in solids)
    return bool(whole.surface_area() < (1.0 - max(REAL, 100.0 * touch)) * area)


def _joint(points: Floats, whole: manifold3d.Manifold, solids: list[Solid], touch: float) -> _Joint:
    """Put a union on the vertices that were given."""
    mesh = whole.to_mesh64()
    given, corners = np.unique(
        np.concatenate([solid.corners for solid in solids]), return_inverse=True
    )
    places = np.concatenate([solid.places for solid in solids])
    found = np.asarray(mesh.vert_properties)[:, :3]
    same = first_at_position(np.concatenate([places, found]))[len(places) :]
    new = same >= len(places)
    number = len(given) + np.cumsum(new) - 1
    number[~new] = corners[same[~new]]
    own = np.concatenate([points[given], found[new]])
    cut = number[np.asarray(mesh.tri_verts).astype(np.int64)]
    standing, faces = _snapped(own, cut, len(given), touch)
    lost = standing == np.arange(len(own))
    lost[faces] = False
    faces = put_on_surface(own, faces, np.flatnonzero(lost[: len(given)]), NEAR * touch)
    parts = np.searchsorted(given, np.concatenate([solid.corners[solid.faces] for solid in solids]))
    gone = ~np.isin(_keys(parts), _keys(cut))
    solid_of_face = np.repeat(np.arange(len(solids)), [len(solid.faces) for solid in solids])
    return _Joint(given, found[new], standing, faces, len(np.unique(solid_of_face[gone])))


def _put_together(points: Floats, left: Ints, joints: list[_Joint]) -> United:
    """Put unions in the place of their parts, beside the faces that are left as they were."""
    count = len(points) + sum(len(joint.added) for joint in joints)
    canonical, faces, end = np.arange(count), [left], len(points)
    for joint in joints:
        own = np.concatenate([joint.given, np.arange(end, end + len(joint.added))])
        canonical[own] = own[joint.standing]
        faces.append(own[joint.faces])
        end += len(joint.added)
    return United(
        points=np.concatenate([points, *(joint.added for joint in joints)]),
        faces=np.concatenate(faces),
        canonical=canonical,
        bodies=sum(joint.changed for joint in joints),
        refused=0,
        rounding=0.0,
    )


def _snapped(points: Floats, cut: Ints, given: int, touch: float) -> tuple[Ints, Ints]:
    """Join the places of a union that are one but for the shift.

    Args:
        points: Positions (V, 3) of its vertices and those of its parts.
        cut: Faces of the union (F, 3).
        given: From here on vertices are new.
        touch: How far faces were shifted.

    Returns:
        For every vertex the one that stands for it (V,); the faces, as far as may be with an area.
    """
    new = np.arange(len(points)) >= given
    for snap in SNAPS:
        reach = min(snap * touch, WELDS[-1])
        standing = clusters(points, NEAR * touch, loose=new, reach=reach)
        faces = without_slivers(points, without_slits(standing[cut]), touch)
        if has_area(points, faces, touch).all():
            break
    return standing, faces


def _keys(faces: Ints) -> npt.NDArray[np.void]:
    """One value for each face, the same whatever corner it begins at, shape (F,)."""
    turned = np.ascontiguousarray(from_least_corner(faces))
    return turned.view(np.dtype((np.void, turned.dtype.itemsize * 3))).ravel()
