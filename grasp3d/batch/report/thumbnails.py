"""Thumbnails of labelled surfaces, ray traced since workers have no OpenGL."""

import io
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from PIL import Image

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.batch.report.views import informative_view, thickened
from grasp3d.rendering import AMBIENT, LIGHT
from grasp3d.stability.label import COLORS, Label

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels

WIDTH, HEIGHT = 128, 96
"""Size of the picture [pixels]."""

MARGIN = 3
"""Empty pixels at each edge."""

FINE = np.array([(x, y) for x in (-0.25, 0.25) for y in (-0.25, 0.25)], dtype=np.float32)
"""Offsets of the rays of a pixel on an edge; other pixels have one ray, since shading changes
slowly."""

NO_SURFACE = -1
"""Code of pixels without surface; others have the code of their label."""

QUALITY = 82
"""Quality of the compression, from 0 to 100."""

_PALETTE = np.array([COLORS[label] for label in sorted(Label)], dtype=np.float32)


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
    drawn = _drawn(_Scene(labels, _fitted(axes @ points.T, mesh.on_surface), axes))
    coverage = drawn[..., 3:]
    drawn[..., :3] /= np.maximum(coverage, 1e-6)
    coverage *= 255.0
    file = io.BytesIO()
    picture = Image.fromarray(np.rint(drawn[::-1]).astype(np.uint8))
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


class _Scene:
    """A labelled surface seen from above, by rays that go down."""

    def __init__(self, labels: "SurfaceLabels", positions: Floats, axes: Floats) -> None:
        # Imported here: writing pages needs neither ray tracing nor the compiler.
        from grasp3d.mesh.ray_tracing import FaceRays

        mesh = labels.mesh
        self._mesh, self._label = mesh, labels.label
        self.columns = _covered(positions[0], WIDTH)
        self.rows = _covered(positions[1], HEIGHT)
        closed = mesh.report.closed
        self._front = _front_faces(positions, mesh.faces) if closed else np.arange(len(mesh.faces))
        self._rays = FaceRays(positions.T, mesh.faces[self._front])
        light = np.array(LIGHT) / np.linalg.norm(LIGHT)
        toward = np.stack([light, [0.0, 0.0, 1.0]], axis=1)  # (3, 2)
        self._toward = (-mesh.corner_normals.normals @ axes.T @ toward).astype(np.float32)  # (C, 2)

    def colours_at(
        self, points: npt.NDArray[np.float32]
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int8]]:
        """Colours with coverage (k, 4) and codes (k,) of the surface at points (k, 2) [pixels]."""
        origins = np.ones((len(points), 3), dtype=np.float32)
        origins[:, :2] = points
        downward = np.zeros_like(origins)
        downward[:, 2] = -1.0
        found = self._rays.hits(origins, downward)
        numbers = found["primID"].view(np.int32)
        hit = np.flatnonzero(numbers >= 0)
        face = self._front.take(numbers.take(hit))
        u, v = found["u"].take(hit), found["v"].take(hit)
        weights = np.stack([1.0 - u - v, u, v])  # (3, k)
        nearest = 3 * face + np.where(v > u, np.where(v > weights[0], 2, 0), u > weights[0])
        labels = self._label.take(self._mesh.faces.take(nearest))
        lit = np.ones((len(hit), 4), dtype=np.float32)
        np.multiply(_PALETTE.take(labels, 0), self._light(face, weights)[:, None], out=lit[:, :3])
        colours = np.zeros((len(points), 4), dtype=np.float32)
        colours[hit] = lit
        codes = np.full(len(points), NO_SURFACE, dtype=np.int8)
        codes[hit] = labels
        return colours, codes

    def _light(self, face: Ints, weights: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Brightness of each colour, from 0 to 1, shape (k,); both sides of a surface are lit."""
        corners = self._toward.take(self._mesh.corner_normals.corners.take(face, 0), 0)  # (k, 3, 2)
        facing, turned = np.einsum("ik,kij->jk", weights, corners)
        lit = np.where(turned < 0.0, -facing, facing)
        return np.asarray(AMBIENT + (1.0 - AMBIENT) * np.maximum(lit, 0.0), dtype=np.float32)


def _drawn(scene: _Scene) -> npt.NDArray[np.float32]:
    """Colours with coverage, shape (HEIGHT, WIDTH, 4), the lowest row first."""
    picture = np.zeros((HEIGHT, WIDTH, 4), dtype=np.float32)
    codes = np.full((HEIGHT, WIDTH), NO_SURFACE, dtype=np.int8)
    pixels = np.ix_(scene.rows, scene.columns)
    middles = np.stack(np.broadcast_arrays(scene.columns, scene.rows[:, None]), axis=-1) + 0.5
    colours, found = scene.colours_at(middles.reshape(-1, 2).astype(np.float32))
    picture[pixels] = colours.reshape(*middles.shape[:2], 4)
    codes[pixels] = found.reshape(middles.shape[:2])
    rows, columns = np.nonzero(_on_edges(codes))
    fine = np.stack([columns, rows], axis=1)[:, None].astype(np.float32) + 0.5 + FINE  # (e, 4, 2)
    colours, _ = scene.colours_at(fine.reshape(-1, 2).astype(np.float32))
    picture[rows, columns] = colours.reshape(len(rows), len(FINE), 4).mean(axis=1)
    return picture


def _on_edges(codes: npt.NDArray[np.int8]) -> Bools:
    """Whether each pixel has a neighbour with another code."""
    found = np.zeros(codes.shape, dtype=bool)
    across, along = codes[:, 1:] != codes[:, :-1], codes[1:] != codes[:-1]
    found[:, 1:] |= across
    found[:, :-1] |= across
    found[1:] |= along
    found[:-1] |= along
    return found


def _covered(coordinates: Floats, count: int) -> npt.NDArray[np.int64]:
    """Numbers of the rows or columns of pixels that the surface may cover."""
    return np.arange(max(0, int(coordinates.min())), min(count, int(coordinates.max()) + 1))


def _front_faces(positions: Floats, faces: Ints) -> npt.NDArray[np.int64]:
    """Numbers of the faces that face the viewer: of a closed surface only these are visible."""
    (ax, bx, cx), (ay, by, cy) = positions[0][faces.T], positions[1][faces.T]
    return np.flatnonzero((bx - ax) * (cy - ay) > (by - ay) * (cx - ax))
