"""The direction of the camera that shows the fingertips of a grasp."""

import itertools
import math

import numpy as np

from grasp3d.arrays import Floats, Ints, unit_rows
from grasp3d.contact.friction_cones import tangents
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.hand.scene import Scene
from grasp3d.hand.triangles import Part, Triangles
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.ray_tracing import FaceRays
from grasp3d.rendering.opengl import UPRIGHT, View, view_axes
from grasp3d.settings import DEGREE
from grasp3d.settings.lengths import METRES

AZIMUTHS = 24
"""Number of directions about the vertical that are compared."""

ELEVATIONS = {
    -25.0 * DEGREE: -0.15, 10.0 * DEGREE: 0.05, 28.0 * DEGREE: 0.1, 45.0 * DEGREE: 0.05,
    65.0 * DEGREE: 0.0,
}  # fmt: skip
"""Elevations that are compared, and the bonus of each; above a table only those from above."""

MEAN, ENDWISE, BEHIND, NEAR = 0.25, 0.15, 0.3, 0.01
"""Weights beside the root of what is seen of the tip seen least, of which a glimpse is worth most:
of the mean over tips and approach; against views along the closing axis or the approach, and from
behind the palm; and for the usual azimuth."""

THROUGH = 0.4
"""How much what is behind a palm counts as seen, since it is drawn translucent."""

TIP = 0.4
"""Greatest distance of a fingertip's points from its contact, in lengths of the finger."""

LINK_TIP = 0.08
"""The same of a hand with joints, in sizes of the hand."""

SAMPLES = 600
"""Points on the fingers of a hand at which visibility is tested."""

BESIDE = 1e-3
"""Distance from the surface at which it is tested, in object sizes."""

ARROW = 0.19
"""Length of the arrow at a contact, relative to the object's size."""

APPROACH = np.array([1.6, 0.15])
"""Distances of the tail and the tip of the approach's arrow from the TCP, in finger lengths: the
tail is in the translucent palm, which no object hides."""

ALONG, AROUND, RADIUS = (0.05, 0.1, 0.3, 0.5, 0.7, 0.9), 6, 0.01
"""Points at which an arrow's visibility is tested: fractions of its length, number about its axis,
and distance from it, relative to the object's size."""


class GraspViews:
    """Chooses the views of grasps of one object: of each fingertip as much as possible is seen.

    What hides a tip is the object, the hand and the table. Of many contacts hardly any view shows
    all: those half of them decide that are seen least.
    """

    def __init__(self, mesh: ObjectMesh, scene: Scene | None) -> None:
        """Prepare an object.

        Args:
            mesh: The object.
            scene: The hand, and the table that it stands on; None: there is none.
        """
        self._mesh, self._scene = mesh, scene
        self._rays = FaceRays(mesh.normalized, mesh.faces)
        self.up = UPRIGHT if scene is None else scene.up
        """Direction that points up in all views, shape (3,)."""
        above = scene is not None and scene.table is not None
        pairs = [
            (View(2.0 * math.pi * step / AZIMUTHS, elevation), bonus)
            for step, (elevation, bonus) in itertools.product(range(AZIMUTHS), ELEVATIONS.items())
            if elevation > 0.0 or not above
        ]
        self._views = [view for view, _ in pairs]
        self._toward = np.stack([view_axes(view, self.up)[2] for view in self._views])
        turns = [math.cos(view.azimuth - View.azimuth) for view in self._views]
        self._bonus = np.array([bonus for _, bonus in pairs]) + NEAR * np.array(turns)

    def best(self, points: Floats, normals: Floats, pose: GripperPose | None = None) -> View:
        """The view that shows a grasp best; about `up`, see `view_axes`.

        Args:
            points: Contacts, shape (n, 3); where there are none, the usual view is the best.
            normals: Inward unit normals there, (n, 3).
            pose: Pose of the hand at them; None: arrows are drawn.
        """
        mesh, scene = self._mesh, self._scene
        if not len(points):
            return View()
        if scene is None or pose is None or mesh.unit is None:
            tails = points - ARROW * mesh.size * normals
            seen = self._seen(*_rods(points, tails, RADIUS * mesh.size), len(points), None)
            against = np.zeros(len(self._views))
        else:
            shape = pose.triangles(scene.hand, mesh.unit)
            length = scene.hand.finger_length / METRES[mesh.unit]
            ends = approach_ends(pose, length)
            tips = _tips(shape, points, (LINK_TIP if pose.has_joints else TIP) * length)
            arrow = _rods(ends[1:], ends[:1], RADIUS * length)
            arrow[2][:] = len(points)
            parts = [np.concatenate(pair) for pair in zip(tips, arrow, strict=True)]
            seen = self._seen(parts[0], parts[1], parts[2], len(points) + len(ends) // 2, shape)
            along = self._toward @ pose.approach
            against = ENDWISE * along**2 + BEHIND * np.minimum(along, 0.0) ** 2
            if not pose.has_joints:
                against += ENDWISE * (self._toward @ pose.pose[:3, 0]) ** 2
        half = (len(points) + 1) // 2
        least = np.sqrt(np.sort(seen[:, : len(points)], axis=1)[:, :half]).mean(axis=1)
        score = self._bonus + least + MEAN * seen.mean(axis=1) - against
        return self._views[int(np.argmax(score))]

    def _seen(
        self, points: Floats, normals: Floats, group: Ints, count: int, hand: Triangles | None
    ) -> Floats:
        """Area of each group of points that the views show, relative to a free one, (v, count).

        It counts as little as it is of what a view would show if nothing hid it: half a tip from
        its broad side says less than all of it from a narrow one.
        """
        mesh, groups = self._mesh, np.eye(count + 1)[group, :count]
        starts = (points - mesh.center) / mesh.size + BESIDE * normals
        area = np.maximum(self._toward @ normals.T, 0.0)  # (v, p)
        free = np.maximum(area @ groups, np.finfo(float).tiny)
        if hand is not None:
            rays = FaceRays((hand.vertices - mesh.center) / mesh.size, hand.faces)
            passing = np.append(np.where(hand.parts == Part.PALM, THROUGH, 0.0), 1.0)
            area *= passing[self._first_faces(rays, starts, area)]
        most = np.maximum((area @ groups).max(axis=0), np.finfo(float).tiny)
        area *= self._first_faces(self._rays, starts, area) < 0
        seen = area @ groups
        return np.asarray(seen / most * np.sqrt(seen / free))

    def _first_faces(self, rays: FaceRays, starts: Floats, area: Floats) -> Ints:
        """First face between points (p, 3) and cameras where `area` (v, p) is seen; -1: none."""
        faces = np.full(area.shape, -1)
        view, point = np.nonzero(area)
        origins, toward = starts[point].astype(np.float32), self._toward[view].astype(np.float32)
        faces[view, point] = rays.hits(origins, toward)["primID"].astype(np.int32)
        return faces


def _tips(shape: Triangles, contacts: Floats, reach: float) -> tuple[Floats, Floats, Ints]:
    """Points on the fingers of a hand, their outward normals, and the contact that each is near.

    Those beyond reach of all contacts (n, 3) are of -1. The palm of a hand with joints may touch.
    """
    fingers = (shape.parts != Part.PALM) | shape.links.any()
    corners = shape.vertices[shape.faces[fingers]]  # (F, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas, random = np.linalg.norm(normals, axis=1), np.random.default_rng(0)
    face = random.choice(len(corners), SAMPLES, p=areas / areas.sum())
    points = np.einsum("pi,pij->pj", random.dirichlet(np.ones(3), SAMPLES), corners[face])
    gaps = np.linalg.norm(points[:, None] - contacts, axis=2)  # (p, n)
    reached = (gaps <= np.maximum(reach, 1.5 * gaps.min(axis=0))).any(axis=1)
    return points, unit_rows(normals[face]), np.where(reached, gaps.argmin(axis=1), -1)


def _rods(tips: Floats, tails: Floats, radius: float) -> tuple[Floats, Floats, Ints]:
    """Points about lines between tips and tails (n, 3), outward normals, numbers of the lines."""
    tips, tails = np.atleast_2d(tips), np.atleast_2d(tails)
    one, two = tangents(unit_rows(tails - tips))
    angles = 2.0 * math.pi * np.arange(AROUND)[:, None, None] / AROUND
    around = np.cos(angles) * one + np.sin(angles) * two  # (k, n, 3)
    along = tips + np.array(ALONG)[:, None, None] * (tails - tips)  # (s, n, 3)
    points = along[:, None] + radius * around  # (s, k, n, 3)
    outward = np.broadcast_to(around, points.shape).reshape(-1, 3)
    return points.reshape(-1, 3), outward, np.tile(np.arange(len(tips)), len(ALONG) * AROUND)


def approach_ends(pose: GripperPose, length: float) -> Floats:
    """Tail and tip of the arrow along the approach between fingers of a length, (2, 3).

    (0, 3) of a hand with joints, which has no TCP.
    """
    if pose.has_joints:
        return np.empty((0, 3))
    return np.asarray(pose.pose[:3, 3] - np.outer(APPROACH * length, pose.pose[:3, 2]))
