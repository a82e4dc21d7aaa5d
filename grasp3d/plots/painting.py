"""Pictures of labelled surfaces, with exact borders between the labels."""

import math
from collections.abc import Sequence

import numpy as np

from grasp3d.arrays import Bytes, Floats, unit_rows
from grasp3d.contact.contacts import Contacts
from grasp3d.plots.rendering import Finger, View, picture
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.settings import GraspModel
from grasp3d.stability.label import COLORS, GREY, Label
from grasp3d.stability.located_angles import ContactLimits, located_contacts
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason

POSITION, NORMAL, WORST, BEST, COLUMNS = slice(0, 3), slice(3, 6), 6, 7, 8
"""Columns of a triangle's corner: position, outward normal, located angles."""

PALETTE = np.array([*(COLORS[label] for label in sorted(Label)), GREY], dtype=np.uint8)
EXCLUDED = len(Label)
"""Row of the colour of faces where no contact may be."""


def paint_labels(
    labels: SurfaceLabels,
    *,
    view: View | None = None,
    size: tuple[int, int] = (640, 640),
    fingers: Sequence[Finger] = (),
) -> Bytes:
    """Render a surface in the colours of its labels.

    Between the vertices of a triangle the located angles are interpolated, not the colours; with
    labels of method extremes, which have no angles, the borders are halfway.

    Args:
        labels: The surface with its labels.
        view: Direction of view.
        size: Width and height [pixels].
        fingers: Contacts to mark.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3).

    Raises:
        OutputError: OpenGL is not available.
    """
    parts = _parts(labels)
    rows = np.concatenate(list(parts.values())).reshape(-1, COLUMNS)
    colors = [np.tile(PALETTE[label], (3 * len(part), 1)) for label, part in parts.items()]
    return picture(
        rows[:, POSITION], np.arange(len(rows)).reshape(-1, 3), np.concatenate(colors),
        normals=unit_rows(rows[:, NORMAL]), view=view, size=size, fingers=fingers,
    )  # fmt: skip


def _parts(labels: SurfaceLabels) -> dict[int, Floats]:
    """Triangles of each label, those with several labels cut along the borders.

    Returns:
        For each label, and for `EXCLUDED`, the corners of its triangles, shape (n, 3, COLUMNS).
    """
    mesh, model = labels.mesh, labels.model
    inward = mesh.corner_normals.normals[mesh.corner_normals.corners]  # (F, 3, 3)
    angles = _corner_angles(labels, inward)
    corners = np.concatenate([mesh.vertices[mesh.faces], -inward, angles], axis=2)
    inside = np.isin(np.arange(len(mesh.faces)), mesh.contact_faces)
    stable, others = _cut(corners[inside], WORST, model.effective_friction_angle)
    ambiguous, unstable = _cut(others, BEST, _unstable_from(model))
    excluded = corners[~inside]
    return {Label.S: stable, Label.M: ambiguous, Label.U: unstable, EXCLUDED: excluded}


def _corner_angles(labels: SurfaceLabels, inward: Floats) -> Floats:
    """Located angles, worst and best, at the corners of the faces, shape (F, 3, 2).

    A crease has no area, but the angles of its wider range of normals would extend over the faces
    next to it; so in a scan each face takes the angle of the same grasp at its own normal. With
    searched grasps another grasp may suit that normal: the crease's angles are kept.
    """
    mesh, model = labels.mesh, labels.model
    if model.method == "extremes":
        worst = model.effective_friction_angle - np.where(labels.label == Label.S, 1.0, -1.0)
        best = _unstable_from(model) + np.where(labels.label == Label.U, 1.0, -1.0)
        return np.stack([worst, best], axis=1)[mesh.faces]
    angles = np.minimum(np.stack(labels.located_angles, axis=1), math.pi)[mesh.faces]
    if labels.mode != "scan":
        return angles
    has_grasp = labels.reason == Reason.FOUND
    has_grasp &= (labels.partner_normals != 0.0).any(axis=2).all(axis=1)
    creased = (mesh.normal_sets.counts[mesh.canonical] > 1) & has_grasp
    at = np.nonzero(creased[mesh.faces])
    vertex = mesh.faces[at]
    grasps = Contacts(
        np.concatenate([mesh.vertices[vertex, None], labels.partners[vertex]], axis=1)
        - mesh.center,
        np.concatenate([inward[at][:, None], labels.partner_normals[vertex]], axis=1),
    )
    critical = np.asarray(critical_friction_angle(grasps))
    limits = ContactLimits.of(model.fingertips)
    own = np.stack(located_contacts(grasps, critical, limits), axis=1)
    angles[at] = np.clip(own, angles[at][:, 1:], angles[at][:, :1])
    return angles


def _unstable_from(model: GraspModel) -> float:
    """Located angle from which the surface is U [rad]; at most pi, the value for no grasp."""
    return min(model.unstable_from, math.pi)


def _cut(corners: Floats, column: int, limit: float) -> tuple[Floats, Floats]:
    """Cut triangles where one of their columns reaches a limit.

    Args:
        corners: Values at the corners, linear between them, shape (n, 3, k).
        column: Column that is compared with the limit.
        limit: Triangles below it are strictly below.

    Returns:
        The triangles below the limit and the others, (m, 3, k) each.
    """
    below = corners[..., column] < limit  # (n, 3)
    count = below.sum(axis=1)
    sides = {True: [corners[count == 3]], False: [corners[count == 0]]}
    for alone, size in ((True, 1), (False, 2)):
        cut = count == size
        first = np.argmax(below[cut] == alone, axis=1)  # the only corner on its side of the limit
        order = (first[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(corners[cut], order[..., None], axis=1).swapaxes(0, 1)
        ab, ac = _reached(a, b, column, limit), _reached(a, c, column, limit)
        sides[alone].append(np.stack([a, ab, ac], axis=1))
        sides[not alone] += [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
    return np.concatenate(sides[True]), np.concatenate(sides[False])


def _reached(a: Floats, b: Floats, column: int, limit: float) -> Floats:
    """Points between a and b, (n, k) each, where the column reaches the limit."""
    fraction = (limit - a[:, column]) / (b[:, column] - a[:, column])
    return np.asarray(a + fraction[:, None] * (b - a))
