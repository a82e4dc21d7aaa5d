import math
import os
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import ObjectMesh, SurfaceLabels, label_surface, load_mesh
from grasp3d._kernels.surface.patches import make_front, measure_distances, reset_front
from grasp3d.arrays import unit_rows
from grasp3d.errors import SettingError
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.normals import (
    CornerNormals,
    corner_normals,
    crease_twins,
    facet_width,
    patch_areas,
    patch_normals,
    surface_net,
)
from grasp3d.system.context import running
from tests.helpers import geodesics, shapes
from tests.helpers.shapes import Surface

seeds = st.integers(0, 100_000)
COARSE = 1e9
"""A longest edge with which no edge is divided."""


def distances(surface: Surface, source: int, radius: float) -> np.ndarray:
    """Distances of all vertices along the surface, inf where not computed."""
    vertices, faces = surface
    front = make_front(len(vertices), len(faces))
    measure_distances(source, radius, surface_net(Triangles(vertices, faces)), front)
    found = front.distances.copy()
    reset_front(front)
    assert np.isinf(front.distances).all()
    assert (front.rows == -1).all()
    assert not front.marks.any()
    return found


def vectors(surface: Surface, radius: float, *sources: int) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = surface
    chosen = np.array(sources or range(len(vertices)), dtype=np.int64)
    return patch_areas(surface_net(Triangles(vertices, faces)), chosen, radius)


def own_normals(surface: Surface, crease_angle: float = math.radians(30.0)) -> CornerNormals:
    return corner_normals(Triangles(*surface), crease_angle)


def normals(surface: Surface, radius: float) -> np.ndarray:
    """The patch's normal at each vertex; every vertex must have one."""
    found = patch_normals(surface_net(Triangles(*surface)), own_normals(surface), radius)
    assert (found.vertices == np.arange(len(surface[0]))).all()
    return found.normals


def turns(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles between the rows [rad]."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))


def noisy(surface: Surface, fraction: float, seed: int = 1) -> Surface:
    """Every vertex of a surface about the origin moved in or out by a random fraction."""
    vertices, faces = surface
    noise = np.random.default_rng(seed).standard_normal(len(vertices))
    return vertices * (1.0 + fraction * noise)[:, None], faces


def nearest(vertices: np.ndarray, point: list[float]) -> int:
    return int(np.linalg.norm(vertices - point, axis=1).argmin())


@pytest.mark.parametrize("seed", range(4))
def test_on_a_plane_distances_and_areas_are_exact(seed: int) -> None:
    surface = vertices, _ = geodesics.sheet(300, seed)
    source, radius = nearest(vertices, [0.5, 0.5, 0.0]), 0.3
    found = distances(surface, source, radius)
    true = np.linalg.norm(vertices - vertices[source], axis=1)
    assert found[true < radius] == pytest.approx(true[true < radius], abs=1e-8)
    vector, area = vectors(surface, radius, source)
    assert area[0] == pytest.approx(math.pi * radius**2, rel=1e-7)
    assert vector[0] == pytest.approx([0.0, 0.0, -area[0]])


@given(seeds, st.floats(1.0, 6.0), st.floats(0.02, 0.4))
@settings(max_examples=40, deadline=None)
def test_needles_on_a_plane_have_little_effect(seed: int, stretch: float, radius: float) -> None:
    surface = vertices, _ = geodesics.sheet(150, seed, stretch)
    source = nearest(vertices, [0.5, 0.5, 0.0])
    found = distances(surface, source, radius)
    true = np.linalg.norm(vertices - vertices[source], axis=1)
    reached = np.isfinite(found)
    assert (found[reached] >= true[reached] - 1e-12).all()
    assert found[true < radius] == pytest.approx(true[true < radius], abs=0.01 * radius)
    _, area = vectors(surface, radius, source)
    margin = np.minimum(vertices[source, :2], 1.0 - vertices[source, :2]).min()
    if radius < margin:
        assert area[0] == pytest.approx(math.pi * radius**2, rel=0.01)


def test_only_near_vertices_are_visited() -> None:
    surface = vertices, _ = shapes.sphere(5)
    found = distances(surface, 0, 0.1)
    gap = np.linalg.norm(vertices - vertices[0], axis=1)
    assert np.isfinite(found[gap < 0.1]).all()
    assert np.isinf(found[gap > 0.25]).all()


@pytest.mark.parametrize("surface", [shapes.sphere(4), geodesics.random_ball(2000, 0)])
def test_on_a_ball_distances_follow_great_circles(surface: Surface) -> None:
    vertices, _ = surface
    for source in (0, 777):
        found = distances(surface, source, 1.0)
        circle = 2.0 * np.arcsin(np.linalg.norm(vertices - vertices[source], axis=1) / 2.0)
        near = circle < 0.95
        assert found[near] == pytest.approx(circle[near], rel=0.01)
        _, area = vectors(surface, 1.0, source)
        assert area[0] == pytest.approx(2.0 * math.pi * (1.0 - math.cos(1.0)), rel=0.01)


def divided(surface: Surface, edge: float) -> Surface:
    """The same surface with a longest edge."""
    mesh = load_mesh(surface, max_edge=edge)
    return mesh.vertices, mesh.faces


TENT = (
    np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.3, 0.6, 0.5]]),
    np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [0, 2, 1], [0, 3, 2]]),
)
TRUTHS = {
    "ball": lambda: (noisy(shapes.sphere(2), 0.03), 0.6),
    "tent": lambda: (divided(TENT, 0.2), 0.6),
    "box": lambda: (divided(shapes.box((0.4, 0.7, 1.0)), 0.2), 0.6),
    "cone": lambda: (divided(shapes.cone(0.5, sections=12), 0.2), 0.5),
    "plate": lambda: (divided(shapes.box((1.0, 1.0, 0.05)), 0.2), 0.4),
    "random ball": lambda: (geodesics.random_ball(200, 3), 0.6),
    "sheet": lambda: (geodesics.sheet(40, 2), 0.4),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", TRUTHS)
def test_patches_agree_with_a_slow_computation(name: str) -> None:
    surface, radius = TRUTHS[name]()
    graph = geodesics.EdgeGraph.of(surface)
    for source in np.random.default_rng(0).choice(len(surface[0]), 4, replace=False):
        for part in (radius, 0.4 * radius):
            vector, area = graph.patch(int(source), part)
            found, total = vectors(surface, part, int(source))
            assert total[0] == pytest.approx(area, rel=0.04)
            assert np.linalg.norm(found[0] - vector) < 0.025 * area


@given(st.floats(-0.6, 0.6), st.floats(0.1, 0.25))
@settings(max_examples=25, deadline=None)
def test_an_edge_is_rounded_within_the_patch_radius(offset: float, radius: float) -> None:
    """Unfolded at the edge the patch is a disc that the edge cuts in two, away from borders."""
    surface = vertices, _ = geodesics.bent_sheet(4, math.pi / 2.0)
    flat_part, steep_part = min(offset, 0.0) * radius, max(offset, 0.0) * radius
    source = nearest(vertices, [0.5, 0.5 + flat_part, steep_part])
    away = float(np.hypot(*(vertices[source, 1:] - (0.5, 0.0))))
    beyond = 0.0
    if away < radius:
        beyond = radius**2 * math.acos(away / radius) - away * math.sqrt(radius**2 - away**2)
    this = math.pi * radius**2 - beyond
    vector, area = vectors(surface, radius, source)
    flat, steep = (beyond, this) if vertices[source, 2] > 0.0 else (this, beyond)
    assert area[0] == pytest.approx(this + beyond, rel=2e-3)
    assert vector[0] == pytest.approx([0.0, steep, -flat], abs=2e-3 * area[0])


def test_an_edge_and_a_corner_of_a_box_have_one_normal_in_the_middle() -> None:
    box = shapes.box()
    mesh = load_mesh(box, max_edge=0.12, patch_radius=0.2)
    assert (mesh.normal_sets.counts == 1).all()
    assert mesh.crease_fraction == 0.0
    assert (mesh.contact_surface.twins == -1).all()
    extreme = np.abs(mesh.vertices) == 0.5
    inner = (np.abs(mesh.vertices) < 0.29) | extreme
    middle = unit_rows(-np.sign(mesh.vertices) * extreme)
    symmetric = inner.all(axis=1)
    assert (extreme[symmetric].sum(axis=1) > 1).sum() > 20
    assert turns(mesh.normals[symmetric], middle[symmetric]).max() < 1e-6
    corner = extreme.all(axis=1)
    assert turns(mesh.normals[corner], middle[corner]).max() < math.radians(1.0)


def test_no_patch_changes_nothing() -> None:
    surface = noisy(shapes.sphere(2), 0.02)
    plain, off = load_mesh(surface), load_mesh(surface, patch_radius=0.0)
    assert np.array_equal(plain.corner_normals.normals, off.corner_normals.normals)
    assert np.array_equal(plain.corner_normals.corners, off.corner_normals.corners)
    assert plain.report == off.report


@given(seeds)
@settings(max_examples=10, deadline=None)
def test_a_tiny_patch_weights_faces_by_their_angle(seed: int) -> None:
    surface = noisy(shapes.sphere(2), 0.03, seed)
    expected = own_normals(surface, math.pi)
    assert turns(normals(surface, 1e-3)[expected.vertices], expected.normals).max() < 1e-7


@pytest.mark.slow
@given(seeds, st.floats(0.03, 0.6), st.floats(1e-6, 0.02))
@settings(max_examples=20, deadline=None)
def test_the_normal_is_continuous_in_the_radius(seed: int, radius: float, growth: float) -> None:
    """A larger disc adds about twice its relative growth, at any angle to the mean."""
    surface = noisy(shapes.sphere(3), 0.02, seed)
    gap = turns(normals(surface, radius), normals(surface, radius * (1.0 + growth)))
    assert gap.max() < 4.0 * growth


@pytest.mark.slow
@given(seeds, st.floats(0.1, 0.5), st.floats(-3.0, 3.0))
@settings(max_examples=5, deadline=None)
def test_patches_are_independent_of_pose_size_and_order(
    seed: int, radius: float, power: float
) -> None:
    vertices, faces = surface = noisy(shapes.lopsided(), 0.01, seed)
    turn, scale = shapes.rotation(seed), 10.0**power
    order = np.random.default_rng(seed).permutation(len(vertices))
    moved = (scale * vertices @ turn.T)[order], np.argsort(order)[faces]
    expected = normals(surface, radius) @ turn.T
    assert turns(normals(moved, scale * radius), expected[order]).max() < 1e-6


@pytest.mark.slow
def test_a_finer_mesh_of_the_same_surface_has_the_same_patches() -> None:
    surface = noisy(shapes.sphere(2), 0.02)
    own = slice(0, len(surface[0]))
    for radius, most in ((0.4, 1.0), (0.8, 0.5)):
        coarse, fine = (
            load_mesh(surface, max_edge=edge, patch_radius=radius) for edge in (COARSE, 0.12)
        )
        assert len(fine.vertices) > 4 * len(coarse.vertices)
        gap = turns(coarse.normals[own], fine.normals[own])
        assert np.degrees(gap).max() < most


def test_threads_change_nothing() -> None:
    surface = noisy(shapes.sphere(3), 0.02)
    one, three = (
        running(threads=threads)(patch_normals)(
            surface_net(Triangles(*surface)), own_normals(surface), 0.3
        )
        for threads in (1, 3)
    )
    assert np.array_equal(one.normals, three.normals)


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.1, 0.4, 0.9])
def test_on_a_ball_a_patch_changes_no_normal(radius: float) -> None:
    """The icosahedron's triangles are only about equal: the error falls with their size squared."""
    surface = vertices, faces = shapes.sphere(4)
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).max()
    assert turns(normals(surface, radius), -vertices).max() < 0.25 * edge**2


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.08, 0.15])
def test_on_a_ring_a_patch_tilts_the_normal_according_to_the_curvature(radius: float) -> None:
    """The mean of a field over a disc differs by r^2 / 8 of its Laplacian.

    Of the normals that is, along the surface, the slope of the sum of the curvatures:
    1 / b + cos(t) / (a + b cos(t)) on a ring, t the angle about its tube.
    """
    major, minor = 1.0, 0.4
    ring = trimesh.creation.torus(major, minor, major_sections=160, minor_sections=80)
    surface = vertices, _ = shapes.arrays(ring)
    out = np.hypot(vertices[:, 0], vertices[:, 1])
    angle = np.arctan2(vertices[:, 2], out - major)
    slope = np.sin(angle) * major / (major + minor * np.cos(angle)) ** 2 / minor
    shift = radius**2 / 8.0 * np.abs(slope)
    round_ = np.column_stack(
        [vertices[:, :2] / out[:, None] * np.cos(angle)[:, None], np.sin(angle)]
    )
    found = turns(normals(surface, radius), -round_)
    assert found == pytest.approx(shift, abs=0.1 * shift.max() + 2e-4)
    assert found.max() > 0.8 * shift.max()


def test_the_two_sides_of_a_plate_are_not_mixed() -> None:
    vertices, faces = shapes.box((2.0, 2.0, 0.01))
    mesh = load_mesh((vertices, faces), max_edge=0.1, patch_radius=0.3)
    inner = (np.abs(mesh.vertices[:, :2]) < 0.69).all(axis=1)
    assert inner.sum() > 300
    sides = np.column_stack([np.zeros((inner.sum(), 2)), -np.sign(mesh.vertices[inner, 2])])
    assert turns(mesh.normals[inner], sides).max() < 1e-7
    _, areas = vectors((mesh.vertices, mesh.faces), 0.3, *np.flatnonzero(inner)[:20])
    assert areas == pytest.approx(math.pi * 0.3**2, rel=1e-6)


def test_where_normals_cancel_a_vertex_keeps_its_normals() -> None:
    """The rim of a plate and the tip of a needle; a blunter tip is rounded."""
    plate = shapes.box((2.0, 2.0, 0.01))
    kept = load_mesh(plate, max_edge=0.2, patch_radius=0.3)
    plain = load_mesh(plate, max_edge=0.2)
    rim = (np.abs(plain.vertices[:, :2]) == 1.0).any(axis=1)
    assert np.array_equal(kept.normal_sets.counts[rim], plain.normal_sets.counts[rim])
    assert (kept.normal_sets.counts[rim] > 1).sum() > 40
    assert (kept.normal_sets.counts[~rim] == 1).all()
    assert np.array_equal(kept.normals[rim], plain.normals[rim])
    assert (kept.contact_surface.twins >= 0).any()
    for half_angle, single in ((0.05, False), (0.3, True)):
        pointed = load_mesh(shapes.cone(half_angle, sections=16), max_edge=0.2, patch_radius=0.3)
        tip = int(np.argmax(pointed.vertices[:, 2]))
        assert (pointed.normal_sets.counts[tip] == 1) == single
        if single:
            assert pointed.normals[tip] == pytest.approx([0.0, 0.0, -1.0], abs=1e-3)


def test_a_patch_ends_where_the_surface_does() -> None:
    surface = vertices, _ = geodesics.sheet(300, 0)
    border = [nearest(vertices, [0.5, 0.0, 0.0]), nearest(vertices, [0.0, 0.0, 0.0])]
    vector, areas = vectors(surface, 0.3, *border)
    assert areas == pytest.approx(math.pi * 0.09 * np.array([0.5, 0.25]), rel=1e-6)
    assert vector[:, 2] == pytest.approx(-areas)


def three_leaves() -> Surface:
    """Three flat leaves that meet along the line x = 0."""
    steps = np.linspace(0.0, 1.0, 9)
    flat, faces = geodesics.triangulated(np.array(np.meshgrid(steps, steps)).reshape(2, -1).T)
    leaves, corners = [], []
    for number, turn in enumerate((0.0, 0.9, 2.4)):  # so that normals do not cancel
        away = flat[:, 0]
        leaves.append(np.column_stack([away * math.cos(turn), flat[:, 1], away * math.sin(turn)]))
        corners.append(faces + number * len(flat))
    vertices = np.concatenate(leaves)
    on_line = np.tile(flat[:, 0] == 0.0, 3)
    row = np.arange(len(vertices))
    row[on_line] = row[on_line] % len(flat)
    return vertices, row[np.concatenate(corners)]


def test_a_patch_includes_all_faces_at_an_edge_whose_vertices_keep_their_normals() -> None:
    vertices, faces = surface = three_leaves()
    line = nearest(vertices, [0.0, 0.5, 0.0])
    _, areas = vectors(surface, 0.25, line)
    assert areas[0] == pytest.approx(1.5 * math.pi * 0.25**2, rel=1e-6)
    own = own_normals(surface)
    found = patch_normals(surface_net(Triangles(vertices, faces)), own, 0.25)
    on_line = np.unique(faces[vertices[faces][..., 0] == 0.0])
    for vertex in on_line:
        before, after = own.vertices == vertex, found.vertices == vertex
        assert before.sum() == after.sum() == 3
        assert np.array_equal(own.normals[before], found.normals[after])
    away = np.setdiff1d(faces, on_line)
    assert np.isin(found.vertices, away).sum() == len(away)
    assert (crease_twins(faces, found.corners) == -2).any()


def test_joined_vertices_share_their_patch() -> None:
    vertices, faces = shapes.box()
    twice = np.vstack([vertices, vertices]), np.vstack([faces[:6], faces[6:] + 8])
    one = load_mesh((vertices, faces), max_edge=0.2, patch_radius=0.3)
    two = load_mesh(twice, max_edge=0.2, patch_radius=0.3)
    assert two.normals[:8] == pytest.approx(one.normals[:8], abs=1e-3)
    assert np.array_equal(two.normals[:8], two.normals[8:16])


def test_corners_and_sets_agree() -> None:
    mesh = load_mesh(noisy(shapes.sphere(2), 0.03), max_edge=0.2, patch_radius=0.3)
    corners = mesh.corner_normals
    assert (corners.vertices[corners.corners] == mesh.faces).all()
    assert np.linalg.norm(corners.normals, axis=1) == pytest.approx(1.0)
    at = np.unique(mesh.faces)
    assert np.array_equal(mesh.normal_sets.centres[corners.vertices], corners.normals)
    assert (mesh.normal_sets.counts[at] == 1).all()


def test_a_patch_that_would_reach_around_the_object_is_refused() -> None:
    with pytest.raises(SettingError, match=r"patch_radius is 1.1, but the object's size is 2") as e:
        load_mesh(shapes.sphere(2), patch_radius=1.1)
    assert "\n" not in str(e.value)
    assert (
        load_mesh(shapes.sphere(2), max_edge=COARSE, patch_radius=0.99).normal_sets.counts.max()
        == 1
    )


@pytest.mark.slow
def test_patches_that_would_take_hours_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("grasp3d.mesh.normals.MOST_VISITS", 1e6)
    load_mesh(shapes.sphere(3), patch_radius=0.1)
    with pytest.raises(SettingError, match="would take hours; give a smaller one"):
        load_mesh(shapes.sphere(3), patch_radius=0.9)


def test_a_patch_smaller_than_a_facet_gives_a_warning() -> None:
    prism = trimesh.creation.cylinder(0.5, 0.6, sections=16)
    width = 2.0 * 0.5 * math.sin(math.pi / 16.0)
    assert facet_width(Triangles(prism.vertices, prism.faces), 0.5) == pytest.approx(
        width, rel=1e-6
    )
    small, enough = (
        load_mesh((prism.vertices, prism.faces), max_edge=0.1, patch_radius=radius)
        for radius in (0.9 * width, 1.1 * width)
    )
    assert "less than the mean width of the mesh's facets, 0.195" in small.report.warnings[0]
    assert enough.report.warnings == ()


def test_a_patch_smaller_than_the_edges_gives_a_warning_and_a_box_has_no_facets() -> None:
    vertices, faces = shapes.box()
    assert facet_width(Triangles(vertices, faces), math.radians(30.0)) == 0.0
    (warning,) = load_mesh((vertices, faces), max_edge=0.2, patch_radius=0.05).report.warnings
    assert "less than the mean edge of the refined mesh" in warning
    assert load_mesh((vertices, faces), max_edge=0.1, patch_radius=0.1).report.warnings == ()


def agreement(one: SurfaceLabels, two: SurfaceLabels) -> float:
    """Area fraction with the same label."""
    areas = two.mesh.vertex_areas
    return float(areas[one.label == two.label].sum() / areas.sum())


def labels_of(surface: Surface, radius: float = 0.0) -> SurfaceLabels:
    return label_surface(load_mesh(surface, max_edge=COARSE, patch_radius=radius))


def mean_edge(mesh: ObjectMesh) -> float:
    corners = mesh.vertices[mesh.faces]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


@pytest.mark.slow
def test_noise_of_a_scan_changes_labels_and_a_patch_restores_them() -> None:
    ball = shapes.sphere(4)
    scan = noisy(ball, 0.012)
    clean, spoilt = labels_of(ball), labels_of(scan)
    smoothed = labels_of(scan, 6.0 * mean_edge(clean.mesh))
    assert clean.fractions()["S"] == 1.0
    assert agreement(clean, spoilt) < 0.85
    assert agreement(clean, smoothed) >= 0.99
    for level, before, after in ((0.5, 2.0, 0.5), (0.9, 10.0, 1.0)):
        assert np.degrees(spoilt.angle_quantiles(level)) > before
        assert np.degrees(smoothed.angle_quantiles(level)) < after


@pytest.mark.slow
def test_the_kernels_give_the_same_results_uncompiled() -> None:
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        return
    chosen = "exact or angle or leaves or ends_where"
    subprocess.run(
        [sys.executable, "-m", "pytest", "-q", __file__, "-p", "no:cacheprovider", "-k", chosen],
        check=True,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
    )
