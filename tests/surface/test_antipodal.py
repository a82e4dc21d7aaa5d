import math

import numpy as np
import pytest

from grasp3d import ObjectMesh, Sampling, load_mesh, mesh_from_arrays
from grasp3d.surface.sampling import antipodal
from grasp3d.surface.sampling.antipodal import best_pairs, tangents
from tests.helpers import oracles, shapes


def exhaustive(mesh: ObjectMesh, vertex: int, cone: float) -> float:
    """Best critical angle of a smooth vertex over the centres of all faces, squeezing.

    Every place seen from the vertex from behind (its normal less than 90 degrees off the line) is
    an exit of the ray to it, so no ray needs to be traced.
    """
    point, normal = mesh.vertices[vertex], mesh.normals[vertex]
    corners = mesh.corner_normals
    places = mesh.vertices[mesh.faces].mean(axis=1)
    normals = corners.normals[corners.corners].mean(axis=1)
    d = places - point
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    phi1 = np.arctan2(np.linalg.norm(np.cross(normal, d), axis=1), d @ normal)
    phi2 = np.arctan2(
        np.linalg.norm(np.cross(normals, -d), axis=1), np.einsum("ij,ij->i", normals, -d)
    )
    worst = np.maximum(phi1, phi2)
    worst[(phi1 > cone) | (phi2 > math.pi / 2.0)] = math.inf
    return float(worst.min())


@pytest.mark.parametrize("shape", [shapes.lopsided(), shapes.torus(), shapes.cone(0.3)])
def test_the_search_finds_what_an_exhaustive_one_finds(shape: shapes.Surface) -> None:
    mesh = mesh_from_arrays(*shape)
    cone = 1.0
    grasps = best_pairs(mesh, Sampling(), cone)
    smooth = np.flatnonzero(mesh.normal_sets.counts == 1)
    chosen = np.random.default_rng(4).choice(smooth, 300, replace=False)
    behind = []
    for vertex in chosen:
        oracle = exhaustive(mesh, vertex, cone)
        if oracle < cone:
            behind.append(grasps.worst[vertex] - oracle)
    assert len(behind) > 200
    assert np.mean(np.array(behind) < 5e-3) >= 0.99
    assert np.median(behind) <= 1e-4


@pytest.mark.parametrize("grip", ["squeeze", "expand", "both"])
def test_the_named_grasp_is_real_and_its_angle_exact(grip: str) -> None:
    """The partner lies on the surface, and two lines of NumPy give the same critical angle."""
    mesh = mesh_from_arrays(*shapes.tube())
    grasps = best_pairs(mesh, Sampling(grip=grip), 0.8)  # type: ignore[arg-type]
    smooth = np.flatnonzero((mesh.normal_sets.counts == 1) & (grasps.reason == 0))
    assert len(smooth) > 1000
    for vertex in smooth[::97]:
        q, n = grasps.partner[vertex], grasps.partner_normal[vertex]
        angle = oracles.critical_angle(
            mesh.vertices[vertex], mesh.normals[vertex], q, n, int(grasps.grip[vertex])
        )
        assert grasps.worst[vertex] >= angle - 1e-12  # a partner on a crease has worse normals too
        radius, height = math.hypot(q[0], q[1]), abs(q[2])
        on_wall = min(abs(radius - 0.4), abs(radius - 0.5)) < 1e-3 or height == pytest.approx(0.5)
        assert on_wall
        assert np.linalg.norm(n) == pytest.approx(1.0)
    gap = [
        grasps.worst[v]
        - oracles.critical_angle(
            mesh.vertices[v],
            mesh.normals[v],
            grasps.partner[v],
            grasps.partner_normal[v],
            int(grasps.grip[v]),
        )
        for v in smooth
    ]
    assert np.mean(np.array(gap) < 1e-9) > 0.98


def test_the_number_of_threads_changes_nothing() -> None:
    mesh = mesh_from_arrays(*shapes.lopsided())
    one = best_pairs(mesh, Sampling(), 0.7, threads=1)
    three = best_pairs(mesh, Sampling(), 0.7, threads=3)
    for name in ("worst", "best", "partner", "grip", "reason"):
        assert np.array_equal(getattr(one, name), getattr(three, name), equal_nan=True)
    assert one.rays == three.rays


def test_more_rays_find_no_worse_grasps() -> None:
    mesh = mesh_from_arrays(*shapes.torus())
    few = best_pairs(mesh, Sampling(rays=16), 0.7).worst
    many = best_pairs(mesh, Sampling(rays=256), 0.7).worst
    assert np.mean(many) <= np.mean(few) + 1e-4
    assert np.mean(many > few + 2e-3) < 0.01


def test_several_starts_find_better_grasps_than_one(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = load_mesh(shapes.LIBRARY / "banana.ply")
    several = best_pairs(mesh, Sampling(), 0.66)
    monkeypatch.setattr(antipodal, "EXPLORING_ROUNDS", 0)
    one = best_pairs(mesh, Sampling(), 0.66)
    gain = np.minimum(one.worst, 2.0) - np.minimum(several.worst, 2.0)
    assert gain.mean() > 2e-4
    assert np.mean(gain > 0.01) > 2.0 * np.mean(gain < -0.01)


def test_search_directions_turn_with_the_object() -> None:
    vertices, faces = shapes.lopsided()
    turn = shapes.rotation(7)
    here, there = mesh_from_arrays(vertices, faces), mesh_from_arrays(vertices @ turn.T, faces)
    assert tangents(there) == pytest.approx(tangents(here) @ turn.T, abs=1e-9)
    assert np.einsum("ij,ij->i", tangents(here), here.normals) == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.norm(tangents(here), axis=1) == pytest.approx(1.0)


def test_every_vertex_of_a_perfect_ball_has_a_search_direction() -> None:
    mesh = mesh_from_arrays(*shapes.sphere(3))
    assert np.linalg.norm(tangents(mesh), axis=1) == pytest.approx(1.0)


def test_progress_goes_from_nothing_to_all() -> None:
    seen: list[float] = []
    best_pairs(mesh_from_arrays(*shapes.lopsided()), Sampling(), 0.7, progress=seen.append)
    assert seen == sorted(seen)
    assert 0.0 < seen[0] < seen[-1] == 1.0
