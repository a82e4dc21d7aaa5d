"""Scans with fixed fingers, and the best contact point of the last finger.

A scan labels the vertices. The contact that decides whether the fixed fingers can hold the object
may lie between them: therefore the opposing contacts that inspecting the fixed finger shows are
tested as well, and the faces about the best vertices in ever finer grids.
"""

from dataclasses import replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from grasp3d.grasps.explanations import PAIR
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import GraspModel
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.surface.critical_angles import critical_angles
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.scanning import scan_surface
from grasp3d.system.context import report_progress, unreported, within
from grasp3d.viewer.session.inspection import warm_up
from grasp3d.viewer.session.state import FixedPoints
from grasp3d.viewer.subjects.subject import LastContact, Subject, subject_of

SCANNED = 0.8
"""Fraction of the work after which the vertices are scanned."""

BEST_VERTICES = 12
"""Vertices of the scan whose faces are searched."""
STEPS = 5
"""Divisions of a face's side in a grid."""
KEPT = 3
"""Points about which the next, finer grid is laid."""
ROUNDS = 4
"""Grids, each finer than the previous grid."""
FINER = 0.3
"""Size of a grid relative to the previous grid."""
INSIDE = 0.98
"""Size of the first grid relative to its face, whose edges may be sharp."""

_STEPS = [(i, j, STEPS - i - j) for i in range(STEPS + 1) for j in range(STEPS + 1 - i)]
GRID = INSIDE * (np.array(_STEPS) / STEPS - 1.0 / 3.0)
"""Barycentric coordinates of a grid's points, relative to its middle, shape (g, 3)."""
MIDDLE = np.full(3, 1.0 / 3.0)

Candidates: TypeAlias = npt.NDArray[np.void]
CANDIDATE = np.dtype(
    [
        ("face", np.int64),
        ("weights", np.float64, 3),
        ("worst", np.float64),
        ("smallest", np.float64),
    ]
)
"""A point on the surface, and the critical friction angles of the grasp with its contact there,
over the worst and over the best normals [rad]."""


def scan_with_fixed(subject: Subject, model: GraspModel, fixed: FixedPoints) -> Subject:
    """Label every vertex as the contact of one more finger, and search the best contact for it."""
    model = replace(model, fingers=len(fixed) + 1)
    with within(0.0, SCANNED):
        labels = scan_surface(subject.mesh, model, fixed=np.array(fixed))
    with within(SCANNED, 1.0):
        contact = best_last_contact(labels, _opposing_contacts(subject, fixed))
    return warm_up(replace(subject_of(labels, subject.name), last_contact=contact))


def _opposing_contacts(subject: Subject, fixed: FixedPoints) -> SurfacePoints:
    """Opposing contacts of one fixed finger's own best grasps, shape (c,); else none."""
    labels, none = subject.labels, SurfacePoints(np.empty(0, dtype=np.int64), np.empty((0, 3)))
    if labels.mode != "label" or labels.model.fingers != PAIR or len(fixed) != 1:
        return none
    nearest = int(np.argmin(((subject.mesh.vertices - np.array(fixed[0])) ** 2).sum(axis=1)))
    faces, weights = labels.partner_points.faces[nearest], labels.partner_points.weights[nearest]
    has_contact = faces[:, 0] >= 0
    return SurfacePoints(faces[has_contact, 0], weights[has_contact, 0])


def scan_of_grasp(grasps: GraspTable, row: int) -> Subject:
    """The surface with all fingers of a grasp fixed but the first."""
    contacts = grasps.contacts.take(slice(row, row + 1))
    labels = scan_surface(grasps.mesh, grasps.model, fixed=contacts.points[0, 1:])
    contact = LastContact(
        contacts,
        float(grasps.critical_angle[row]),
        float(grasps.critical_angle_best[row]),
        GripperPose.of(grasps.reach, row),
    )
    return warm_up(replace(subject_of(labels.using(scene=grasps.scene)), last_contact=contact))


def best_last_contact(scan: SurfaceLabels, tested: SurfacePoints) -> LastContact | None:
    """Search the best contact of the last finger over the whole surface.

    Args:
        scan: Labels of every vertex as the contact of the last finger.
        tested: Further candidate points, shape (c,).

    Returns:
        The best contact found, at a vertex or between vertices; None: there is no grasp.
    """
    mesh = scan.mesh
    rows = np.flatnonzero(np.isfinite(scan.critical_angle_best))
    order = rows[np.lexsort((scan.critical_angle_best[rows], scan.critical_angle[rows]))]
    if not len(order):
        return None
    near = np.append(order[:BEST_VERTICES], rows[np.argmin(scan.critical_angle_best[rows])])
    with unreported():
        tested_too = _evaluated(scan, vertex_surface_points(mesh, near)), _evaluated(scan, tested)
    leading = np.concatenate(tested_too)
    faces = np.flatnonzero(np.isin(mesh.faces, mesh.canonical[near]).any(axis=1))
    faces = np.concatenate([faces, tested.faces])
    grids = SurfacePoints(faces, np.tile(MIDDLE, (len(faces), 1)))
    for number in range(ROUNDS):
        with unreported():
            finer = _evaluated(scan, _grid_points(grids, FINER**number))
        best = [np.argsort(finer[angle], kind="stable")[:KEPT] for angle in ("worst", "smallest")]
        finer = finer[np.unique(np.concatenate(best))]
        leading, grids = np.concatenate([leading, finer]), _points(finer)
        report_progress((number + 1) / ROUNDS)
    worst, smallest = leading["worst"], leading["smallest"]
    row = int(np.lexsort((smallest, worst))[0])
    if np.isinf(worst[row]):  # the best over the worst normals only if that is bounded
        row = int(np.argmin(smallest))
    grasp = _grasps(scan, _points(leading[row : row + 1]))
    return LastContact(grasp, float(worst.min()), float(smallest.min()))


def _evaluated(scan: SurfaceLabels, points: SurfacePoints) -> Candidates:
    """Evaluate points (c,) as contacts of the last finger."""
    found = np.empty(len(points.faces), CANDIDATE)
    found["face"], found["weights"] = points.faces, points.weights
    found["worst"], found["smallest"] = critical_angles(_grasps(scan, points))
    return found


def _points(candidates: Candidates) -> SurfacePoints:
    return SurfacePoints(candidates["face"], candidates["weights"])


def _grid_points(middles: SurfacePoints, size: float) -> SurfacePoints:
    """Grids about points (m,), of a size relative to their faces, shape (m * g,)."""
    weights = np.clip(middles.weights[:, None] + size * GRID, 0.0, 1.0)
    weights /= weights.sum(axis=2, keepdims=True)
    return SurfacePoints(np.repeat(middles.faces, len(GRID)), weights.reshape(-1, 3))


def _grasps(scan: SurfaceLabels, points: SurfacePoints) -> SurfaceContacts:
    """Grasps (c, n) of a last finger at points (c,) and the fixed fingers of a scan."""
    fixed, count = scan.grasps.contacts.surface_points, len(points.faces)
    faces = np.broadcast_to(fixed.faces[0, 1:], (count, fixed.faces.shape[1] - 1))
    weights = np.broadcast_to(fixed.weights[0, 1:], (*faces.shape, 3))
    return SurfaceContacts(
        scan.mesh,
        SurfacePoints(
            np.concatenate([points.faces[:, None], faces], axis=1),
            np.concatenate([points.weights[:, None], weights], axis=1),
        ),
    )
