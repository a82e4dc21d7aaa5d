import numpy as np
import pytest

from grasp3d import load_mesh
from grasp3d._kernels.search.antipodal_candidates import FOUND, NO_PARTNER, BestPairs
from grasp3d._kernels.search.rays import STEP, Rays
from grasp3d.mesh.ray_tracing import SurfaceRays
from tests.helpers import oracles, shapes
from tests.helpers.shapes import Surface


def exits_found(shape: Surface, seed: int, count: int) -> tuple[int, int]:
    """Trace rays one by one; returns how many exits there are and how many were found.

    Each ray is limited to the opening of one exit after another, so that the grasp found
    identifies the crossing.
    """
    mesh = load_mesh(shape)
    surface, sets = mesh.contact_surface, mesh.contact_normals
    tracer = SurfaceRays(surface, sets)
    rng = np.random.default_rng(seed)
    expected = found = 0
    for _ in range(count):
        v = int(rng.integers(len(mesh.vertices)))
        direction = oracles.tilted(mesh.normals[v], 0.9, rng)
        hits = oracles.crossings(surface.points[v], direction, surface.points, mesh.faces)
        sides = np.diff(surface.points[mesh.faces[[f for f, _ in hits]]], axis=1)
        outward = np.cross(sides[:, 0], sides[:, 1])
        exits = [
            t for (_, t), n in zip(hits, outward, strict=True) if direction @ n > 0.0 and t > 1e-4
        ]
        for t in exits:
            grasps = empty_grasps(len(mesh.vertices))
            rays = Rays(
                np.array([v], dtype=np.int32),
                direction[None].copy(),
                np.ones(1, dtype=np.int8),
                np.full(1, STEP),
                np.full(1, STEP),
                np.full(1, -1, dtype=np.int32),
            )
            tracer.evaluate_all(rays, (t - 1e-5, t + 1e-5), grasps)
            expected += 1
            found += grasps.reason[v] == FOUND
            if grasps.reason[v] == FOUND:
                point = surface.points[v] + t * direction
                assert np.abs(grasps.partner[v] - point).max() < 1e-6
    return expected, found


def empty_grasps(count: int) -> BestPairs:
    return BestPairs(
        np.full(count, np.inf),
        np.full(count, np.inf),
        np.zeros((count, 3)),
        np.zeros((count, 3)),
        np.zeros((count, 3)),
        np.zeros((count, 3)),
        np.full((count, 2), -1),
        np.zeros((count, 2, 3)),
        np.zeros(count, dtype=np.int8),
        np.zeros(count, dtype=np.int8),
        np.full(count, NO_PARTNER, dtype=np.uint8),
        np.zeros((count, 1, 3)),
        np.full((count, 1), np.inf),
        np.zeros((count, 1), dtype=np.int8),
        1.0,
    )


@pytest.mark.slow
@pytest.mark.parametrize("shape", [shapes.lopsided(), shapes.tube(), shapes.torus()])
def test_every_exit_of_every_ray_is_found(shape: Surface) -> None:
    expected, found = exits_found(shape, seed=2, count=40)
    assert expected > 25
    assert found == expected


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "offset"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e6)])
def test_exits_are_found_at_any_size_and_anywhere(scale: float, offset: float) -> None:
    vertices, faces = shapes.torus()
    expected, found = exits_found((vertices * scale + offset, faces), seed=3, count=40)
    assert expected > 25
    assert found == expected
