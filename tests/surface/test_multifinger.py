"""Search for grasps of three fingers and more: its laws, and the labels of its grasps."""

import math
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from grasp3d import (
    Contacts,
    GraspModel,
    Label,
    ObjectMesh,
    Sampling,
    SurfaceLabels,
    classify,
    label_surface,
    load_mesh,
)
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.surface.multifinger import search
from grasp3d.system.context import running
from tests.helpers import shapes
from tests.helpers.solids import box_mesh, sphere_mesh

SEARCH_ANGLE = math.radians(80.0)
ROUNDING = 2e-4
"""Brackets of critical angles are 1e-4 wide [rad]."""


@cache
def wedge() -> ObjectMesh:
    """A prism over an isosceles triangle: most points have no opposite face."""
    corners = np.array([[-1.0, -0.6], [1.0, -0.6], [0.0, 1.1]])
    vertices = np.concatenate([np.c_[corners, np.full(3, h)] for h in (-0.7, 0.7)])
    faces = [[0, 2, 1], [3, 4, 5]]
    for i in range(3):
        j = (i + 1) % 3
        faces += [[i, j, j + 3], [i, j + 3, i + 3]]
    return load_mesh((vertices, np.array(faces)), max_edge=0.22)


@cache
def tapered() -> ObjectMesh:
    """A cone."""
    return load_mesh(shapes.cone(math.radians(25.0), sections=24), max_edge=0.4)


@cache
def labelled(shape: str, fingers: int, **sampling: Any) -> SurfaceLabels:
    mesh = {
        "wedge": wedge,
        "tapered": tapered,
        "box": lambda: box_mesh((2.0, 1.5, 1.0), max_edge=0.45),
    }[shape]()
    settings = Sampling(**{"search_angle": SEARCH_ANGLE, "candidates": 32, **sampling})
    return label_surface(mesh, GraspModel(fingers=fingers), sampling=settings)


def contacts_of(labels: SurfaceLabels, vertices: np.ndarray) -> np.ndarray:
    """All contacts of the vertices' best grasps, (k, n, 3)."""
    first = labels.mesh.vertices[vertices]
    return np.concatenate([first[:, None], labels.partners[vertices]], axis=1)


@pytest.mark.slow
def test_the_result_does_not_depend_on_threads_and_only_the_seed_changes_it() -> None:
    mesh = wedge()
    sampling = Sampling(candidates=16)
    found = [running(threads=threads)(search)(mesh, 4, sampling, 0.7) for threads in (1, 2, 3)]
    for other in found[1:]:
        assert np.array_equal(found[0].partner_points.faces, other.partner_points.faces)
        assert np.array_equal(found[0].partner_points.weights, other.partner_points.weights)
        assert found[0].evaluated == other.evaluated
    another = search(mesh, 4, Sampling(candidates=16, seed=7), 0.7)
    assert not np.array_equal(found[0].partner_points.weights, another.partner_points.weights)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1000.0, 0.0254, 7.3])
@pytest.mark.parametrize("shape", ["wedge", "tapered", "box"])
def test_the_unit_of_lengths_changes_no_letter(shape: str, factor: float) -> None:
    """On regular shapes many grasps are equally good, and rounding errors must not choose."""
    mesh = labelled(shape, 3).mesh
    both = [load_mesh((f * mesh.vertices, mesh.faces), max_edge=10.0 * f) for f in (1.0, factor)]
    sampling = Sampling(search_angle=SEARCH_ANGLE, candidates=32)
    for fingers in (3, 4):
        model = GraspModel(fingers=fingers)
        one, other = (label_surface(of, model, sampling=sampling) for of in both)
        moved = other.partners / both[1].size - one.partners / both[0].size
        assert np.abs(np.nan_to_num(moved)).max() < 1e-6
        assert np.array_equal(one.label, other.label)


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["wedge", "tapered"])
@pytest.mark.parametrize("fingers", [3, 4, 5])
def test_every_grasp_has_the_angle_of_its_label(shape: str, fingers: int) -> None:
    """Contacts lie on the surface; normals and angles are those of the grasp itself."""
    labels = labelled(shape, fingers)
    mesh = labels.mesh
    vertices = np.flatnonzero(np.isfinite(labels.critical_angle))
    assert len(vertices) > 0.8 * mesh.on_surface.sum()
    smooth = vertices[mesh.contact_normals.counts[mesh.canonical[vertices]] == 1][::7]
    first = vertex_surface_points(mesh, smooth)
    others = labels.partner_points
    grasps = SurfaceContacts(
        mesh,
        type(others)(
            np.concatenate([first.faces[:, None], others.faces[smooth]], axis=1),
            np.concatenate([first.weights[:, None], others.weights[smooth]], axis=1),
        ),
    )
    assert not grasps.on_crease.any()
    assert grasps.points == pytest.approx(contacts_of(labels, smooth), abs=1e-12)
    model = GraspModel(friction=1.0, fingers=fingers)
    outcome = classify(grasps.contacts(model), 0.0)
    assert labels.critical_angle[smooth] == pytest.approx(
        outcome.critical_friction_angle, abs=ROUNDING
    )


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["wedge", "tapered", "box"])
def test_more_fingers_never_make_a_vertex_worse(shape: str) -> None:
    """Each finger is added to the best grasp of one finger less."""
    angles = [labelled(shape, n).critical_angle for n in (3, 4, 5)]
    for fewer, more in pairwise(angles):
        # Nearly rays make a thin hull, which is surely closed at a slightly larger angle.
        assert (more <= fewer + 3.0 * ROUNDING).all()
    # On the others three fingers are as good as any number.
    assert (angles[1] < angles[0] - 0.01).any() or shape != "tapered"


@pytest.mark.slow
def test_labels_are_monotone_in_friction_and_antitone_in_resolution() -> None:
    labels = labelled("wedge", 3)
    before = None
    for friction in (0.1, 0.3, 0.6, 1.0):
        label = labels.relabel(friction=friction, sensor_resolution=0.2).label
        assert before is None or (label >= before).all()
        before = label
    stable = [
        labels.relabel(friction=0.6, sensor_resolution=alpha).label == Label.S
        for alpha in (0.0, 0.2, 0.5, 1.0)
    ]
    for finer, coarser in pairwise(stable):
        assert (finer | ~coarser).all()


@pytest.mark.slow
def test_contacts_keep_the_limits_of_distances() -> None:
    low, high = 0.4, 1.5
    labels = labelled("wedge", 4, min_opening=low, max_opening=high)
    vertices = np.flatnonzero(np.isfinite(labels.critical_angle))
    assert len(vertices) > 100
    contacts = contacts_of(labels, vertices)
    distances = np.linalg.norm(contacts[:, :, None] - contacts[:, None], axis=-1)
    distances_of_pairs = distances[:, *np.triu_indices(4, 1)]
    assert distances_of_pairs.min() >= low - 1e-9
    assert distances_of_pairs.max() <= high + 1e-9
    assert labels.opening[vertices] == pytest.approx(distances_of_pairs.max(axis=1))


@pytest.mark.slow
def test_with_candidate_points_on_vertices_all_contacts_are_vertices() -> None:
    labels = labelled("tapered", 4, candidate_points="vertices")
    vertices = np.flatnonzero(np.isfinite(labels.critical_angle))
    assert len(vertices) > 0
    weights = labels.partner_points.weights[vertices]
    assert (weights.max(axis=-1) == 1.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("fingers", [3, 4])
def test_a_ball_is_force_closed_with_any_friction(fingers: int) -> None:
    mesh = sphere_mesh(subdivisions=2)
    model = GraspModel(friction=0.02, sensor_resolution=0.0, fingers=fingers)
    labels = label_surface(mesh, model)
    assert (labels.label == Label.S).all()
    assert (labels.epsilon > 0.0).all()


@pytest.mark.slow
def test_hulls_at_extreme_normals_agree_on_a_thousand_grasps() -> None:
    """With circular cones only an exact M can be labelled S or U, for lack of a sampled tilt."""
    sources = (labelled("wedge", 3), labelled("wedge", 3, max_opening=0.6))
    found = [_smooth_grasps(labels) for labels in sources]
    points, normals, critical = (
        np.concatenate([some[:500] for some in rows]) for rows in zip(*found, strict=True)
    )
    assert len(points) == 1000
    # Frictions about each grasp's own critical angle, so that all three labels occur.
    offsets = np.random.default_rng(0).uniform(-0.35, 0.4, 1000)
    beta, alpha = np.clip(critical + offsets, 0.1, 1.2), 0.3
    contacts = Contacts(points, normals, friction=np.tan(beta)[:, None])
    exact = np.full(1000, Label.M)
    exact[critical >= beta + alpha / 2.0] = Label.U
    exact[critical < beta - alpha / 2.0] = Label.S
    assert all((exact == code).mean() > 0.1 for code in Label)
    sampled = classify(contacts, alpha, method="extremes").label
    near = np.abs(np.abs(critical - beta) - alpha / 2.0) < ROUNDING
    differ = (sampled != exact) & ~near
    assert (exact[differ] == Label.M).all()
    assert differ.mean() < 0.05


def _smooth_grasps(labels: SurfaceLabels) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(points, normals, critical angles) of grasps without contacts on creases."""
    mesh = labels.mesh
    smooth = mesh.contact_normals.counts[mesh.canonical] == 1
    vertices = np.flatnonzero(np.isfinite(labels.critical_angle) & smooth)
    first = mesh.normals[vertices][:, None]
    normals = np.concatenate([first, labels.partner_normals[vertices]], axis=1)
    points = contacts_of(labels, vertices) - mesh.center_mass
    return points, normals, labels.critical_angle[vertices]


@pytest.mark.slow
def test_idle_fingers_may_be_placed_on_corners() -> None:
    corners = load_mesh(shapes.box((2.0, 1.5, 1.0)), max_edge=1e3)
    sampling = Sampling(candidate_points="vertices", search_angle=SEARCH_ANGLE)
    angles = [
        label_surface(corners, GraspModel(fingers=n), sampling=sampling).critical_angle_best
        for n in (3, 4, 5)
    ]
    assert np.isfinite(angles[0]).all()
    assert np.isfinite(angles[1]).all()
    assert np.isfinite(angles[2]).all()
