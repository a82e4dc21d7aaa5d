from typing import Any

import numpy as np
import pytest

from grasp3d import ObjectMesh, Sampling, label_surface, load_mesh
from grasp3d._kernels.search.antipodal_candidates import FOUND, PairLimits, no_pairs
from grasp3d._kernels.search.rays import STEP, Rays
from grasp3d.mesh import surface_points
from grasp3d.mesh.surface_points import FaceRays
from grasp3d.surface.antipodal import SurfaceRays
from tests.helpers import oracles, shapes
from tests.helpers.shapes import Surface


def exits_found(shape: Surface, seed: int, count: int) -> tuple[int, int]:
    """Numbers of rays that meet the surface from outside, and of those that the tracer follows.

    Fingers expand: the opposing contact is where a ray away from the surface first meets it again.
    """
    mesh = load_mesh(shape)
    surface, sets = mesh.contact_surface, mesh.contact_normals
    tracer = SurfaceRays(surface, sets, np.arange(len(surface.faces)))
    rng = np.random.default_rng(seed)
    expected = found = 0
    for _ in range(count):
        v = int(rng.integers(len(mesh.vertices)))
        direction = oracles.tilted(-mesh.normals[v], 1.3, rng)
        hits = oracles.crossings(surface.points[v], direction, surface.points, mesh.faces)
        ahead = [t for _, t in hits if t > 1e-4]
        if not ahead:
            continue
        nearest, grasps = min(ahead), no_pairs(len(mesh.vertices))
        rays = Rays(
            np.array([v], dtype=np.int32),
            -direction[None],
            np.full(1, STEP),
            np.full(1, STEP),
            np.full(1, -1, dtype=np.int32),
        )
        tracer.evaluate_all(rays, PairLimits(nearest - 1e-5, nearest + 1e-5), grasps)
        expected += 1
        found += grasps.reason[v] == FOUND
        if grasps.reason[v] == FOUND:
            point = surface.points[v] + nearest * direction
            assert np.abs(grasps.partner[v] - point).max() < 1e-6
    return expected, found


@pytest.mark.slow
@pytest.mark.parametrize("embree", [True, False])
@pytest.mark.parametrize(("shape", "count"), [(shapes.tube(), 100), (shapes.torus(), 900)])
def test_every_exit_of_every_ray_is_found(
    shape: Surface, count: int, embree: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(surface_points, "EMBREE", embree)
    expected, found = exits_found(shape, seed=2, count=count)
    assert expected > 25
    assert found == expected


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "offset"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e6)])
def test_exits_are_found_at_any_size_and_anywhere(scale: float, offset: float) -> None:
    vertices, faces = shapes.torus()
    expected, found = exits_found((vertices * scale + offset, faces), seed=3, count=900)
    assert expected > 25
    assert found == expected


def rays_from(mesh: ObjectMesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays from just beside the surface, in any direction."""
    rng = np.random.default_rng(0)
    faces, weights = rng.integers(len(mesh.faces), size=count), rng.dirichlet([1, 1, 1], size=count)
    points = (mesh.normalized[mesh.faces[faces]] * weights[..., None]).sum(axis=1)
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = points + 1e-4 * directions
    return origins.astype(np.float32), directions.astype(np.float32)


@pytest.mark.parametrize("shape", [shapes.lopsided(), shapes.tube(), shapes.box(), shapes.torus()])
def test_the_tree_meets_the_first_face_of_all(
    shape: Surface, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(surface_points, "EMBREE", False)
    mesh = load_mesh(shape, max_edge=0.3)
    origins, directions = rays_from(mesh, 300)
    rays = FaceRays(mesh.normalized, mesh.faces)
    faces, far = rays.hits(origins, directions)
    ends = np.full(len(far), 0.5, dtype=np.float32) * far
    assert (rays.hits(origins, directions, ends)[0] == -1).all()
    for origin, direction, face, distance in zip(origins, directions, faces, far, strict=True):
        met = oracles.crossings(
            origin.astype(float), direction.astype(float), mesh.normalized, mesh.faces
        )
        ahead = [(t, f) for f, t in met if t > 1e-9]
        assert (face >= 0) == bool(ahead)
        if ahead:
            assert distance == pytest.approx(min(ahead)[0], abs=1e-6)
            assert any(f == face and t - min(ahead)[0] < 1e-6 for t, f in ahead)


def test_both_tracers_meet_the_same_faces_but_for_those_at_the_rays_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mesh = load_mesh(shapes.LIBRARY / "mug.glb")
    origins, directions = rays_from(mesh, 100_000)
    theirs, distance = FaceRays(mesh.normalized, mesh.faces).hits(origins, directions)
    monkeypatch.setattr(surface_points, "EMBREE", False)
    own, far = FaceRays(mesh.normalized, mesh.faces).hits(origins, directions)
    same = (own == theirs) | (np.abs(far - distance) < 1e-5)
    assert (~same).mean() < 1e-3
    assert ((own >= 0) == (theirs >= 0)).mean() > 0.999


@pytest.mark.slow
@pytest.mark.parametrize("grip", ["both", "expand"])
@pytest.mark.parametrize("name", ["mug.glb", "torus.glb", "wrench.glb"])
def test_labels_are_those_of_the_other_tracer(
    name: str, grip: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = load_mesh(shapes.LIBRARY / name, unit="m")
    labels = label_surface(mesh, sampling=Sampling(grip=grip))
    monkeypatch.setattr(surface_points, "EMBREE", False)
    own = label_surface(mesh, sampling=Sampling(grip=grip))
    assert (own.label != labels.label).mean() < 4e-3
