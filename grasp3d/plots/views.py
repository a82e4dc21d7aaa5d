"""Choice of the view that shows the fingers of a grasp best."""

import itertools
import math

import numpy as np

from grasp3d.arrays import Bools, Floats
from grasp3d.mesh.ray_tracing import SurfaceRays
from grasp3d.rendering import ARROW, View
from grasp3d.settings import DEGREE
from grasp3d.surface.contacts import SurfaceContacts

AZIMUTHS = 24
"""Number of directions about the object that are compared."""

ELEVATIONS = {-25.0 * DEGREE: -0.15, 10.0 * DEGREE: 0.0, 35.0 * DEGREE: 0.1, 60.0 * DEGREE: 0.0}
"""Elevations of the camera that are compared, and their bonus."""

ALONG = (0.06, 0.35, 0.65, 0.95)
"""Fractions of a finger's arrow at which visibility is tested; the first one is the contact's."""

HIDDEN, ENDWISE, OVERLAP = 1.0, 0.4, 0.6
"""Penalties of a view: for hidden parts, for arrows along the line of sight, and for arrows that
overlap."""


BEHIND = (0.05, 0.3, 0.6, 0.9)
"""Fractions of a finger's length behind its contact at which visibility is tested."""

BESIDE = 0.02
"""Distance from the surface of what is tested, in object sizes."""


def views_of_gripper(contacts: SurfaceContacts, poses: Floats, length: float) -> list[View]:
    """Choose for each grasp the view that shows most of a gripper's fingers, side by side.

    Args:
        contacts: The grasps, (b, 2).
        poses: Matrices from the gripper's frame to the mesh's, shape (b, 4, 4).
        length: Length of the fingers, in the mesh's unit.
    """
    mesh = contacts.mesh
    rays = SurfaceRays(mesh.contact_surface, mesh.contact_normals)
    found = []
    for points, normals, pose in zip(contacts.points, contacts.normals, poses, strict=True):
        back = length * np.array(BEHIND)[:, None] * pose[:3, 2]  # (p, 3)
        parts = (points - BESIDE * mesh.size * normals)[:, None] - back  # (2, p, 3)
        found.append(_view_of_fingers(rays, pose, (parts - mesh.center) / mesh.size))
    return found


def _view_of_fingers(rays: SurfaceRays, pose: Floats, parts: Floats) -> View:
    """Choose the view of fingers with some parts (2, p, 3) in the normalised frame."""
    candidates = list(itertools.product(np.arange(AZIMUTHS) * 2.0 * math.pi / AZIMUTHS, ELEVATIONS))
    views = [View(float(azimuth), elevation) for azimuth, elevation in candidates]
    toward = np.stack([view.axes[2] for view in views])  # (v, 3)
    bonus = np.array([ELEVATIONS[elevation] for _, elevation in candidates])
    visible = _visible(rays, parts, toward)  # (v, 2, p)
    hidden = 1.0 - 0.5 * (visible[..., 0] + visible.mean(axis=2)).mean(axis=1)
    along = np.abs(toward @ pose[:3, :3]) ** 2  # (v, 3), of the closing axis, y and the approach
    behind = np.maximum(-toward @ pose[:3, 2], 0.0)  # there the palm hides the fingers
    endwise = along[:, 0] + 0.5 * along[:, 2] + 2.0 * behind**2
    score = bonus - HIDDEN * hidden - ENDWISE * endwise
    return views[int(np.argmax(score))]


def views_of(contacts: SurfaceContacts, extent: float) -> list[View]:
    """Choose for each grasp the view that shows most of its fingers, well apart.

    Args:
        contacts: The grasps, (b, n).
        extent: Length that `rendering.picture` scales the fingers' marks by, in the mesh's unit.
    """
    candidates = list(itertools.product(np.arange(AZIMUTHS) * 2.0 * math.pi / AZIMUTHS, ELEVATIONS))
    views = [View(float(azimuth), elevation) for azimuth, elevation in candidates]
    axes = np.stack([view.axes for view in views])  # (v, 3, 3)
    bonus = np.array([ELEVATIONS[elevation] for _, elevation in candidates])
    mesh = contacts.mesh
    rays = SurfaceRays(mesh.contact_surface, mesh.contact_normals)
    found = []
    for points, normals in zip(contacts.points, contacts.normals, strict=True):
        steps = ARROW * extent * np.array(ALONG)[:, None]
        parts = points[:, None] - steps * normals[:, None]  # (n, p, 3)
        visible = _visible(rays, (parts - mesh.center) / mesh.size, axes[:, 2])  # (v, n, p)
        hidden = 1.0 - 0.5 * (visible[..., 0] + visible.mean(axis=2)).mean(axis=1)
        endwise = np.abs(axes[:, 2] @ normals.T).mean(axis=1) ** 2
        overlap = _overlap(np.einsum("vij,npj->vnpi", axes[:, :2], parts) / (ARROW * extent))
        score = bonus - HIDDEN * hidden - ENDWISE * endwise - OVERLAP * overlap
        found.append(views[int(np.argmax(score))])
    return found


def _visible(rays: SurfaceRays, parts: Floats, eyes: Floats) -> Bools:
    """Whether nothing is between parts (n, p, 3) and cameras in directions (v, 3): (v, n, p)."""
    shape = (len(eyes), *parts.shape)
    origins = np.broadcast_to(parts, shape).reshape(-1, 3).astype(np.float32)
    toward = np.broadcast_to(eyes[:, None, None], shape).reshape(-1, 3).astype(np.float32)
    return np.asarray(rays.hits(origins, toward)["primID"].reshape(shape[:-1]) < 0)


def _overlap(flat: Floats) -> Floats:
    """Proximity of the nearest two arrows of each view, from 0 to 1, shape (v,).

    Args:
        flat: Points of the arrows in the picture, in units of an arrow, shape (v, n, p, 2).
    """
    nearest = np.full(len(flat), math.inf)
    for one, two in itertools.combinations(range(flat.shape[1]), 2):
        gaps = np.linalg.norm(flat[:, one, :, None] - flat[:, two, None], axis=-1)  # (v, p, p)
        nearest = np.minimum(nearest, gaps.min(axis=(1, 2)))
    return np.clip(1.0 - nearest / 0.5, 0.0, 1.0)
