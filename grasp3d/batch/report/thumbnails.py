"""Thumbnails of labelled surfaces, drawn by a kernel since workers have no OpenGL."""

import io
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from grasp3d.arrays import Bools, Floats
from grasp3d.batch.report.views import informative_view, thickened
from grasp3d.rendering import AMBIENT, LIGHT
from grasp3d.stability.label import COLORS, Label

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels

WIDTH, HEIGHT = 128, 96
"""Size of the picture [pixels]."""

MARGIN = 3
"""Empty pixels at each edge."""

QUALITY = 82
"""Quality of the compression, from 0 to 100."""

_PALETTE = np.array([COLORS[label] for label in sorted(Label)]) / 255.0


def thumbnail(labels: "SurfaceLabels") -> bytes:
    """Draw a thumbnail of a labelled surface, as WebP with a transparent background.

    The z-axis is up; the view shows much of the surface and of each label.

    Args:
        labels: The labelled surface.

    Returns:
        A picture of 128 x 96 pixels; equal labels give equal pictures.
    """
    mesh = labels.mesh
    points = thickened(mesh.normalized)
    codes = labels.label[mesh.faces[:, 0]]
    axes = informative_view(points, mesh.faces, codes, WIDTH / HEIGHT).axes
    drawn = _drawn(labels, _fitted(axes @ points.T, mesh.on_surface), axes)
    drawn[..., :3] /= np.maximum(drawn[..., 3:], 1e-6)
    file = io.BytesIO()
    picture = Image.fromarray(np.rint(255.0 * drawn[::-1]).astype(np.uint8))
    picture.save(file, "WEBP", quality=QUALITY, method=2)
    return file.getvalue()


def _fitted(positions: Floats, used: Bools) -> Floats:
    """Positions (3, V) in pixels from the lower left corner, the depth from 0 down."""
    shown = positions[:, used]
    low, high = shown.min(axis=1), shown.max(axis=1)
    available = np.array([WIDTH - 2 * MARGIN, HEIGHT - 2 * MARGIN])
    scale = float((available / np.maximum((high - low)[:2], 1e-12)).min())
    middle = np.array([WIDTH / 2.0, HEIGHT / 2.0, 0.0])
    origin = 0.5 * (low + high) - [0.0, 0.0, -0.5 * (high - low)[2]]
    return np.asarray(scale * (positions - origin[:, None]) + middle[:, None])


def _drawn(labels: "SurfaceLabels", positions: Floats, axes: Floats) -> Floats:
    """Colours with coverage, shape (HEIGHT, WIDTH, 4), the lowest row first."""
    # Imported here: writing pages needs no compiler.
    from grasp3d._kernels.visible_faces import draw_surface

    mesh, picture = labels.mesh, np.zeros((HEIGHT, WIDTH, 4))
    light = np.array(LIGHT) / np.linalg.norm(LIGHT)
    toward = np.stack([light, [0.0, 0.0, 1.0]], axis=1)  # (3, 2)
    draw_surface(
        positions,
        mesh.faces,
        labels.label,
        mesh.corner_normals.corners,
        -mesh.corner_normals.normals @ axes.T @ toward,
        not mesh.report.closed,
        _PALETTE,
        AMBIENT,
        picture,
    )
    return picture
