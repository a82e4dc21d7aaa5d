"""Pictures against rays that trimesh traces, and against known surfaces."""

import math

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from grasp3d._kernels.surface.visible_faces import FINE, draw_surface
from tests.helpers import shapes

WIDTH, HEIGHT = 60, 50
PALETTE = np.eye(3)
SURFACES = {
    "lopsided": shapes.lopsided(3), "finned": shapes.finned(), "torus": shapes.torus(),
    "tube": shapes.tube(sections=24), "box": shapes.box(),
}  # fmt: skip

Floats = NDArray[np.float64]


def shown(name: str, seed: int) -> tuple[Floats, NDArray[np.int64], NDArray[np.uint8]]:
    """Positions in a picture (V, 3), faces and codes of a surface that is turned at random."""
    vertices, faces = SURFACES[name]
    turned = vertices @ shapes.rotation(seed).T
    positions = 40.0 * (turned - turned.min(axis=0)) / np.ptp(turned, axis=0).max() + [9.5, 4, 0]
    codes = np.random.default_rng(seed).integers(0, 3, len(vertices)).astype(np.uint8)
    return positions, faces, codes


def draw(
    positions: Floats,
    faces: NDArray[np.int64],
    codes: NDArray[np.uint8],
    lighting: Floats | None = None,
    *,
    both_sides: bool = False,
) -> Floats:
    """Colours and coverage of the pixels; in full light where no lighting is given."""
    picture = np.zeros((HEIGHT, WIDTH, 4))
    lit = np.ones((3 * len(faces), 2)) if lighting is None else lighting
    corners = np.arange(3 * len(faces)).reshape(-1, 3)
    across = np.ascontiguousarray(positions.T)
    draw_surface(across, faces, codes, corners, lit, both_sides, PALETTE, 0.25, picture)
    return picture


def traced(positions: Floats, faces: NDArray[np.int64], codes: NDArray[np.uint8]) -> Floats:
    """The same picture, from rays that go down through all samples."""
    surface = trimesh.Trimesh(positions, faces, process=False)
    steps = [(np.arange(FINE * size) + 0.5) / FINE for size in (WIDTH, HEIGHT)]
    x, y = (axis.ravel() for axis in np.meshgrid(*steps))
    origins = np.stack([x, y, np.full(len(x), positions[:, 2].max() + 1.0)], axis=1)
    found = surface.ray.intersects_first(origins, np.tile([0.0, 0.0, -1.0], (len(x), 1)))
    hit = np.flatnonzero(found >= 0)
    triangles = surface.triangles[found[hit]]
    points = origins[hit]
    normals = surface.face_normals[found[hit]]
    heights = triangles[:, 0, 2] - (
        (normals[:, :2] * (points - triangles[:, 0])[:, :2]).sum(axis=1) / normals[:, 2]
    )
    points[:, 2] = heights
    weights = trimesh.triangles.points_to_barycentric(triangles, points)
    samples = np.zeros((len(x), 4))
    nearest = faces[found[hit], weights.argmax(axis=1)]
    samples[hit] = np.hstack([PALETTE[codes[nearest]], np.ones((len(hit), 1))])
    return samples.reshape(HEIGHT, FINE, WIDTH, FINE, 4).mean(axis=(1, 3))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", SURFACES)
def test_pictures_are_those_of_rays(name: str, seed: int) -> None:
    scene = shown(name, seed)
    picture, expected = draw(*scene), traced(*scene)
    assert 0.1 < expected[..., 3].mean() < 0.9
    # Rays have 32 bits: on silhouettes and between corners a few samples are decided otherwise.
    other = np.abs(picture - expected).max(axis=2) > 1e-9
    assert other.mean() < 0.004
    assert np.abs(picture - expected).mean() < 0.0005


@pytest.mark.parametrize("name", SURFACES)
def test_behind_the_front_faces_of_closed_surfaces_nothing_is_seen(name: str) -> None:
    scene = shown(name, 7)
    np.testing.assert_allclose(draw(*scene, both_sides=True), draw(*scene), atol=0.26)
    assert np.abs(draw(*scene, both_sides=True) - draw(*scene)).mean() < 0.0005


def test_faces_that_share_edges_leave_no_gap_between_them() -> None:
    """A grid whose edges and corners are at samples and between them."""
    x, y = np.meshgrid(np.arange(0.0, 41.0, 0.25), np.arange(0.0, 41.0, 0.25))
    grid = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    a = (np.arange(x.shape[0] - 1)[:, None] * x.shape[1] + np.arange(x.shape[1] - 1)).ravel()
    b, c, d = a + 1, a + x.shape[1], a + x.shape[1] + 1
    faces = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    picture = draw(grid, faces, np.zeros(len(grid), np.uint8))
    assert (picture[:40, :40, 3] == 1.0).all()
    assert picture[..., 3].sum() == 82.0**2 / FINE**2  # up to its last edges


@pytest.mark.parametrize("both_sides", [False, True])
def test_light_on_both_sides_of_a_square(both_sides: bool) -> None:
    square = np.array([[10.0, 10.0, 0.0], [30.0, 10.0, 0.0], [30.0, 30.0, 9.0], [10.0, 30.0, 9.0]])
    faces, codes = np.array([[0, 1, 2], [0, 2, 3]]), np.full(4, 1, np.uint8)
    toward = math.cos(math.radians(35.0))
    above = draw(square, faces, codes, np.tile([toward, 0.9], (6, 1)), both_sides=both_sides)
    assert above[20, 20] == pytest.approx([0.0, 0.25 + 0.75 * toward, 0.0, 1.0])
    below = draw(square, faces[:, ::-1].copy(), codes, np.tile([-toward, -0.9], (6, 1)),
                 both_sides=both_sides)  # fmt: skip
    assert below[20, 20] == pytest.approx(above[20, 20] if both_sides else [0.0] * 4)
    dark = draw(square, faces, codes, np.tile([-toward, 0.9], (6, 1)))
    assert dark[20, 20] == pytest.approx([0.0, 0.25, 0.0, 1.0])


def test_faces_seen_edge_on_and_outside_the_picture_are_left_out() -> None:
    upright = np.array([[5.0, 5.0, 0.0], [9.0, 5.0, 0.0], [7.0, 5.0, 3.0]])
    outside = np.array([[-9.0, -9.0, 0.0], [-2.0, -9.0, 0.0], [-2.0, -2.0, 0.0]])
    faces, codes = np.array([[0, 1, 2], [3, 4, 5]]), np.zeros(6, np.uint8)
    assert not draw(np.concatenate([upright, outside]), faces, codes, both_sides=True).any()
    larger = np.array([[-200.0, -200.0, 0.0], [400.0, -200.0, 0.0], [0.0, 500.0, 0.0]])
    assert (draw(larger, faces[:1], codes)[..., 3] == 1.0).all()
