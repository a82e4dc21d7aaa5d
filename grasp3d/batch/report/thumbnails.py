"""Thumbnails of labelled surfaces, from a direction that shows most of an object and its labels."""

import io
import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from grasp3d.arrays import Bools, Bytes, Floats, Ints
from grasp3d.pictures.camera import AMBIENT, LIGHT, UPRIGHT, View, turn_to
from grasp3d.settings import DEGREE
from grasp3d.stability.label import COLORS, GREY, Label

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels

WIDTH, HEIGHT = 128, 96
"""Size of the picture [pixels]."""

MARGIN = 3
"""Empty pixels at each edge."""

QUALITY = 82
"""Quality of the compression, from 0 to 100."""

_PALETTE = np.array([*(COLORS[label] for label in sorted(Label)), GREY]) / 255.0


AZIMUTH_OFFSETS = tuple(degrees * DEGREE for degrees in (60.0, 75.0, 105.0, 120.0))
"""Azimuths of the views from the object's long horizontal axis, nearly sideways [rad]."""

ELEVATIONS = ((20.0 * DEGREE, 0.9), (35.0 * DEGREE, 1.0), (55.0 * DEGREE, 0.85))
"""Elevations of the views [rad], and the weight of each."""

EQUAL_SCORES = 1e-6
"""Relative difference below which scores of views are equal; the first view is taken."""

MAX_FACES = 3000
"""Number of faces from which a view is chosen."""

THINNEST = 1.0 / 40.0
"""Least thickness at which an object is drawn, as a fraction of its length."""


def thumbnail(labels: "SurfaceLabels") -> bytes:
    """Draw a thumbnail of a labelled surface, as WebP with a transparent background.

    The table is level, else the z-axis up; the view shows much of the surface and of each label.

    Args:
        labels: The labelled surface.

    Returns:
        A picture of 128 x 96 pixels; equal labels give equal pictures.
    """
    mesh, scene = labels.mesh, labels.scene
    turn = turn_to(UPRIGHT if scene is None else scene.up)
    points = thickened(mesh.normalized)
    codes = labels.label[mesh.faces[:, 0]]
    axes = informative_view(points @ turn, mesh.faces, codes, WIDTH / HEIGHT).axes @ turn.T
    pixels = _pixels(labels, _fitted(axes @ points.T, mesh.on_surface), axes)
    pixels[..., :3] /= np.maximum(pixels[..., 3:], 1e-6)
    file = io.BytesIO()
    picture = Image.fromarray(np.rint(255.0 * pixels[::-1]).astype(np.uint8))
    picture.save(file, "WEBP", quality=QUALITY, method=2)
    return file.getvalue()


def _fitted(positions: Floats, on_surface: Bools) -> Floats:
    """Positions (3, V) in pixels from the lower left corner, the depth from 0 down."""
    visible = positions[:, on_surface]
    low, high = visible.min(axis=1), visible.max(axis=1)
    available = np.array([WIDTH - 2 * MARGIN, HEIGHT - 2 * MARGIN])
    scale = float((available / np.maximum((high - low)[:2], 1e-12)).min())
    middle = np.array([WIDTH / 2.0, HEIGHT / 2.0, 0.0])
    origin = 0.5 * (low + high) - [0.0, 0.0, -0.5 * (high - low)[2]]
    return np.asarray(scale * (positions - origin[:, None]) + middle[:, None])


def _pixels(labels: "SurfaceLabels", positions: Floats, axes: Floats) -> Floats:
    """Colours with coverage, shape (HEIGHT, WIDTH, 4), the lowest row first."""
    # Imported here: writing pages needs no compiler.
    from grasp3d._kernels.surface.visible_faces import draw_surface

    mesh, picture = labels.mesh, np.zeros((HEIGHT, WIDTH, 4))
    light = np.array(LIGHT) / np.linalg.norm(LIGHT)
    toward = np.stack([light, [0.0, 0.0, 1.0]], axis=1)  # (3, 2)
    draw_surface(
        positions,
        mesh.faces,
        np.where(mesh.allowed, labels.label, np.uint8(len(Label))),
        mesh.corner_normals.corners,
        -mesh.corner_normals.normals @ axes.T @ toward,
        not mesh.report.closed,
        _PALETTE,
        AMBIENT,
        picture,
    )
    return picture


def thickened(points: Floats) -> Floats:
    """Thicken an object to at least 1/40 of its length in each direction, to make needles visible.

    Args:
        points: Centred positions, shape (V, 3).
    """
    axes = np.linalg.eigh(points.T @ points)[1]
    along = axes.T @ points.T  # (3, V)
    extents = along.max(axis=1) - along.min(axis=1)
    least = THINNEST * extents.max()
    if extents.min() >= least:
        return points
    grown = np.where(extents < least, least / np.maximum(extents, 1e-3 * least), 1.0)
    return np.asarray((axes @ (grown[:, None] * along)).T)


def informative_view(points: Floats, faces: Ints, labels: Bytes, aspect: float) -> View:
    """Choose a three-quarter view in which the object is large and its labels are visible.

    Args:
        points: Positions, shape (V, 3).
        faces: Corners, counter-clockwise from outside, shape (F, 3).
        labels: Codes of the faces, shape (F,).
        aspect: Width of the picture over its height.
    """
    some = slice(None, None, max(1, len(faces) // MAX_FACES))
    corners = points[faces[some]]  # (f, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_label = np.eye(3)[labels[some]]  # (f, 3)
    positions = np.ascontiguousarray(corners.reshape(-1, 3).T)  # (3, k)
    long = _long_axis(positions)
    views = [
        (View(long + offset + turn, elevation), weight)
        for offset, turn, (elevation, weight) in itertools.product(
            AZIMUTH_OFFSETS, (0.0, math.pi), ELEVATIONS
        )
    ]
    axes = np.stack([view.axes for view, _ in views])  # (n, 3, 3)
    across = axes[:, :2].reshape(-1, 3) @ positions
    extents = (across.max(axis=1) - across.min(axis=1)).reshape(-1, 2)
    visible = np.maximum(axes[:, 2] @ normals.T, 0.0) @ is_label  # (n, 3)
    scores = _scores(visible, extents, aspect) * np.array([weight for _, weight in views])
    return views[int(np.argmax(scores > scores.max() * (1.0 - EQUAL_SCORES)))][0]


def _long_axis(positions: Floats) -> float:
    """Direction of the largest horizontal spread about the z-axis [rad]; positions (3, k)."""
    x, y = (positions - positions.mean(axis=1, keepdims=True))[:2]
    return 0.5 * math.atan2(2.0 * float(x @ y), float(x @ x - y @ y))


def _scores(visible: Floats, extents: Floats, aspect: float) -> Floats:
    """Filled fraction of the picture times how evenly the labels are visible, shape (n,).

    Args:
        visible: Visible area of each label in each view, shape (n, 3).
        extents: Width and height of each view, shape (n, 2).
        aspect: Width of the picture over its height.
    """
    total = np.maximum(visible.sum(axis=1), np.finfo(np.float64).tiny)
    filled = total / np.maximum(extents[:, 0], extents[:, 1] * aspect) ** 2
    return np.asarray(filled * np.sqrt(visible / total[:, None]).sum(axis=1))
