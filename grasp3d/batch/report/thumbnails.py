"""Small pictures of painted surfaces, by rays: workers have no OpenGL."""

import io
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from PIL import Image

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.batch.report.views import telling_view, thickened
from grasp3d.rendering import AMBIENT, LAMP
from grasp3d.stability.label import COLORS, Label

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels

WIDTH, HEIGHT = 128, 96
"""Of the picture [pixels]."""

MARGIN = 3
"""Empty pixels at each edge."""

FINE = np.array([(x, y) for x in (-0.25, 0.25) for y in (-0.25, 0.25)], dtype=np.float32)
"""Places of the rays of a pixel on an edge; others need one, since light changes slowly."""

NOTHING = -1
"""Kind of what is beside the surface."""

QUALITY = 82
"""Of the compression, from 0 to 100."""

_PALETTE = np.array([COLORS[label] for label in sorted(Label)], dtype=np.float32)


def thumbnail(labels: "SurfaceLabels") -> bytes:
    """Draw a labelled surface small, as WebP on transparent ground.

    The z-axis is up; the eye stands where much of the surface and of its labels shows.

    Args:
        labels: The labelled surface.

    Returns:
        A picture of 128 x 96 pixels; the same for the same labels.
    """
    mesh = labels.mesh
    points = thickened(mesh.normalized)
    kinds = labels.label[mesh.faces[:, 0]]
    axes = telling_view(points, mesh.faces, kinds, WIDTH / HEIGHT).axes
    drawn = _drawn(_Scene(labels, _fitted(axes @ points.T, mesh.on_surface), axes))
    share = drawn[..., 3:]
    drawn[..., :3] /= np.maximum(share, 1e-6)
    share *= 255.0
    file = io.BytesIO()
    picture = Image.fromarray(np.rint(drawn[::-1]).astype(np.uint8))
    picture.save(file, "WEBP", quality=QUALITY, method=2)
    return file.getvalue()


def _fitted(seen: Floats, used: Bools) -> Floats:
    """Positions (3, V) in pixels from the lower left corner, the depth from 0 down."""
    shown = seen[:, used]
    low, high = shown.min(axis=1), shown.max(axis=1)
    room = np.array([WIDTH - 2 * MARGIN, HEIGHT - 2 * MARGIN])
    scale = float((room / np.maximum((high - low)[:2], 1e-12)).min())
    middle = np.array([WIDTH / 2.0, HEIGHT / 2.0, 0.0])
    origin = 0.5 * (low + high) - [0.0, 0.0, -0.5 * (high - low)[2]]
    return np.asarray(scale * (seen - origin[:, None]) + middle[:, None])


class _Scene:
    """A labelled surface below the eye, whose rays go down."""

    def __init__(self, labels: "SurfaceLabels", seen: Floats, axes: Floats) -> None:
        # Loaded here: whoever writes pages needs no rays and no compiler.
        from grasp3d.mesh.ray_tracing import FaceRays

        mesh = labels.mesh
        self._mesh, self._label = mesh, labels.label
        self.columns, self.rows = _crossed(seen[0], WIDTH), _crossed(seen[1], HEIGHT)
        closed = mesh.report.closed
        self._front = _toward_eye(seen, mesh.faces) if closed else np.arange(len(mesh.faces))
        self._rays = FaceRays(seen.T, mesh.faces[self._front])
        lamp = np.array(LAMP) / np.linalg.norm(LAMP)
        toward = np.stack([lamp, [0.0, 0.0, 1.0]], axis=1)  # (3, 2)
        self._toward = (-mesh.corner_normals.normals @ axes.T @ toward).astype(np.float32)  # (C, 2)

    def painted(
        self, places: npt.NDArray[np.float32]
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int8]]:
        """Colours with coverage (k, 4) and kinds (k,) that rays meet at places (k, 2) [pixels]."""
        origins = np.ones((len(places), 3), dtype=np.float32)
        origins[:, :2] = places
        downward = np.zeros_like(origins)
        downward[:, 2] = -1.0
        answer = self._rays.hits(origins, downward)
        met = np.flatnonzero(answer["primID"].astype(np.int32) >= 0)
        face = self._front[answer["primID"][met]]
        u, v = answer["u"][met], answer["v"][met]
        near = np.stack([1.0 - u - v, u, v])  # (3, k)
        labels = self._label[self._mesh.faces[face, near.argmax(axis=0)]]
        colours = np.zeros((len(places), 4), dtype=np.float32)
        colours[met, :3] = _PALETTE[labels] * self._light(face, near)[:, None]
        colours[met, 3] = 1.0
        kinds = np.full(len(places), NOTHING, dtype=np.int8)
        kinds[met] = labels
        return colours, kinds

    def _light(self, face: Ints, near: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Share of each colour that the eye sees, shape (k,); both sides of a surface are lit."""
        corners = self._toward[self._mesh.corner_normals.corners[face]]  # (k, 3, 2)
        facing, turned = np.einsum("ik,kij->jk", near, corners)
        lit = np.where(turned < 0.0, -facing, facing)
        return np.asarray(AMBIENT + (1.0 - AMBIENT) * np.maximum(lit, 0.0), dtype=np.float32)


def _drawn(scene: _Scene) -> npt.NDArray[np.float32]:
    """Colours with coverage, shape (HEIGHT, WIDTH, 4), the lowest row first."""
    picture = np.zeros((HEIGHT, WIDTH, 4), dtype=np.float32)
    kinds = np.full((HEIGHT, WIDTH), NOTHING, dtype=np.int8)
    pixels = np.ix_(scene.rows, scene.columns)
    middles = np.stack(np.broadcast_arrays(scene.columns, scene.rows[:, None]), axis=-1) + 0.5
    colours, met = scene.painted(middles.reshape(-1, 2).astype(np.float32))
    picture[pixels] = colours.reshape(*middles.shape[:2], 4)
    kinds[pixels] = met.reshape(middles.shape[:2])
    rows, columns = np.nonzero(_on_edges(kinds))
    fine = np.stack([columns, rows], axis=1)[:, None].astype(np.float32) + 0.5 + FINE  # (e, 4, 2)
    colours, _ = scene.painted(fine.reshape(-1, 2).astype(np.float32))
    picture[rows, columns] = colours.reshape(len(rows), len(FINE), 4).mean(axis=1)
    return picture


def _on_edges(kinds: npt.NDArray[np.int8]) -> Bools:
    """Tell the pixels beside which another kind begins."""
    found = np.zeros(kinds.shape, dtype=bool)
    across, along = kinds[:, 1:] != kinds[:, :-1], kinds[1:] != kinds[:-1]
    found[:, 1:] |= across
    found[:, :-1] |= across
    found[1:] |= along
    found[:-1] |= along
    return found


def _crossed(places: Floats, count: int) -> npt.NDArray[np.int64]:
    """Numbers of the rows or columns of pixels that the surface may reach into."""
    return np.arange(max(0, int(places.min())), min(count, int(places.max()) + 1))


def _toward_eye(seen: Floats, faces: Ints) -> npt.NDArray[np.int64]:
    """Numbers of the faces that face the eye: of a closed surface only these are seen."""
    (ax, bx, cx), (ay, by, cy) = seen[0][faces.T], seen[1][faces.T]
    return np.flatnonzero((bx - ax) * (cy - ay) > (by - ay) * (cx - ax))
