"""Tests of critical angles over all normals that contacts on a surface may have."""

import itertools
import math
from functools import cache

import numpy as np
import pytest

from grasp3d import (
    Contacts,
    GraspModel,
    Label,
    classify,
    critical_friction_angle,
    load_mesh,
    scan_surface,
)
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.stability.normal_sets import NormalSamples, angle_bounds, sampled_sets
from grasp3d.surface import critical_angles as module
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.surface.critical_angles import critical_angles
from tests.helpers import oracles, shapes
from tests.helpers.tilts import within_sets

Floats = np.ndarray
TOLERANCE = 1e-4


@cache
def box() -> ObjectMesh:
    return load_mesh(shapes.box((1.0, 1.4, 2.0)), max_edge=0.5)


def random_grasps(count: int, size: int, seed: int, creased: int) -> SurfaceContacts:
    """Random grasps at a box's vertices, `creased` contacts of each on edges and corners."""
    mesh, rng = box(), np.random.default_rng(seed)
    smooth = mesh.contact_normals.counts == 1
    columns = [
        rng.choice(np.flatnonzero(~smooth if i < creased else smooth), size) for i in range(count)
    ]
    return SurfaceContacts(mesh, vertex_surface_points(mesh, np.stack(columns, axis=1)))


def set_of(contacts: SurfaceContacts, grasp: int, finger: int) -> Floats:
    number = grasp * contacts.count + finger
    return contacts.set_normals[contacts.set_start[number] : contacts.set_start[number + 1]]


def angle_at(contacts: SurfaceContacts, grasp: int, normals: Floats) -> Floats:
    """Critical angles of one grasp at many choices of normals (k, n, 3)."""
    points = np.broadcast_to(contacts.points[grasp], normals.shape)
    return np.asarray(critical_friction_angle(Contacts(points, normals)))


# Two contacts


def test_two_contacts_agree_with_a_scan() -> None:
    mesh = box()
    vertices = np.unique(mesh.faces)
    for fixed in (np.array([0.1, 0.2, 1.0]), np.array([0.5, 0.7, 0.33]), mesh.vertices[0]):
        scan = scan_surface(mesh, fixed=fixed)
        first = vertex_surface_points(mesh, vertices[:, None])
        other = scan.grasps.contacts.take(np.zeros(len(vertices), dtype=np.int64)).surface_points
        pairs = SurfacePoints(
            np.concatenate([first.faces, other.faces[:, 1:]], axis=1),
            np.concatenate([first.weights, other.weights[:, 1:]], axis=1),
        )
        worst, best = critical_angles(SurfaceContacts(mesh, pairs))
        assert worst == pytest.approx(scan.critical_angle[vertices], abs=1e-9)
        # In a scan no finger fits where another one is, whatever their normals.
        apart = np.isfinite(worst)
        assert best[apart] == pytest.approx(scan.critical_angle_best[vertices][apart], abs=1e-9)
        assert np.isinf(scan.critical_angle_best[vertices][~apart]).all()
        assert (worst > best).any()


def test_two_contacts_bound_every_choice_of_normals() -> None:
    contacts = random_grasps(2, 40, 1, creased=2)
    worst, best = critical_angles(contacts)
    rng = np.random.default_rng(0)
    for g in range(contacts.size):
        if not np.isfinite(worst[g]):
            continue
        first, second = contacts.points[g]
        for _ in range(20):
            normals = [within_sets(set_of(contacts, g, i)[None], rng)[0] for i in (0, 1)]
            angle = oracles.critical_angle(first, normals[0], second, normals[1])
            assert best[g] - 1e-9 <= angle <= worst[g] + 1e-9


# Three and more


@pytest.mark.parametrize("count", [3, 4, 5])
def test_smooth_contacts_have_one_critical_angle(count: int) -> None:
    contacts = random_grasps(count, 30, 2, creased=0)
    worst, best = critical_angles(contacts)
    np.testing.assert_array_equal(worst, best)
    expected = critical_friction_angle(Contacts(contacts.points, contacts.normals))
    assert worst == pytest.approx(expected, abs=TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "creased"), [(3, 1), (3, 2), (5, 1)])
def test_angles_are_tight_bounds_for_every_choice_of_normals(count: int, creased: int) -> None:
    contacts = random_grasps(count, 6, 10 * count + creased, creased)
    worst, best = critical_angles(contacts)
    rng = np.random.default_rng(0)
    for g in range(contacts.size):
        sets = [set_of(contacts, g, i) for i in range(count)]
        normals = [
            np.concatenate(
                [faces, *(within_sets(faces[None], rng) for _ in range(300 // len(faces)))]
            )
            for faces in sets
        ]
        tested = np.stack(
            [rows[rng.integers(len(rows), size=20_000 if count == 3 else 400)] for rows in normals],
            axis=1,
        )  # (k, n, 3)
        angles = angle_at(contacts, g, tested)
        assert angles.max() <= worst[g] + TOLERANCE
        assert angles.min() >= best[g] - TOLERANCE
        assert worst[g] - angles.max() < 0.06
        assert angles.min() - best[g] < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("count", [3, 4, 5])
def test_the_search_among_samples_finds_the_extremes(count: int) -> None:
    """Compared with the critical angles of all combinations."""
    contacts = random_grasps(count, 5, count, creased=2)
    step = math.radians(30.0)
    samples = NormalSamples.of_sets(contacts.set_start, contacts.set_normals, count, step)
    worst, best = angle_bounds(contacts.points, samples, tolerance=TOLERANCE)
    sets, _ = sampled_sets(contacts.set_start, contacts.set_normals, step)
    for g in range(contacts.size):
        own = sets[g * count : (g + 1) * count]
        assert samples.combinations[g] == math.prod(len(samples_) for samples_ in own)
        angles = angle_at(contacts, g, np.array(list(itertools.product(*own))))
        shrink = math.cos(samples.steps[g] / 2.0)
        high = math.asin(min(1.0, math.sin(angles.max()) / shrink))
        low = math.acos(min(1.0, math.cos(angles.min()) / shrink))
        assert worst[g] == pytest.approx(high, abs=3.0 * TOLERANCE)
        assert low - 0.03 <= best[g] <= low + TOLERANCE  # arccos is steep near 0
        assert math.cos(best[g]) == pytest.approx(math.cos(low), abs=3.0 * TOLERANCE)


@pytest.mark.slow
def test_labels_are_those_of_classify_or_ambiguous() -> None:
    contacts = random_grasps(3, 60, 4, creased=1)
    worst, best = critical_angles(contacts)
    plain = contacts.contacts(GraspModel())
    seen, agreed, total = set(), 0, 0
    for g in range(contacts.size):
        grasp = Contacts(plain.points[g], plain.normals[g], 0.6)
        creases = {0: set_of(contacts, g, 0)}
        for friction, alpha in ((0.2, 0.1), (0.6, 0.4), (1.2, 0.2)):
            beta, tilt = math.atan(friction), alpha / 2.0
            stable, unstable = worst[g] < beta - tilt, best[g] >= beta + tilt
            rough = grasp.with_friction(friction)
            exact = classify(rough, alpha, creases=creases).label
            assert not stable or exact == Label.S
            assert not unstable or exact == Label.U
            label = Label.S if stable else Label.U if unstable else Label.M
            agreed, total = agreed + int(label == exact), total + 1
            seen.add(label)
            if g < 12:
                sampled = classify(
                    rough, alpha, creases=creases, method="extremes", extreme_normals=4
                ).label
                assert not stable or sampled == Label.S
                assert not unstable or sampled == Label.U
    assert seen == {Label.S, Label.M, Label.U}
    assert agreed / total > 0.95


@pytest.mark.slow
def test_coarser_steps_are_safe(monkeypatch: pytest.MonkeyPatch) -> None:
    contacts = random_grasps(4, 12, 5, creased=2)
    worst, best = critical_angles(contacts)
    monkeypatch.setattr(module, "MAX_COMBINATIONS", 30)
    coarse_worst, coarse_best = critical_angles(contacts)
    assert (coarse_worst >= worst - TOLERANCE).all()
    assert (coarse_best <= best + TOLERANCE).all()
    assert (coarse_worst > worst + 1e-3).any()
    monkeypatch.setattr(module, "MAX_COMBINATIONS", 1)
    ambiguous = critical_angles(contacts)
    assert (ambiguous[0] == math.pi / 2.0).all()
    assert (ambiguous[1] == 0.0).all()


def test_contacts_with_any_normal_are_ambiguous() -> None:
    vertices, faces = shapes.box()
    both = np.vstack([vertices, vertices + [1.0, 1.0, 0.0]])
    mesh = load_mesh((both, np.vstack([faces, faces + 8])), max_edge=0.6)
    shared = (np.abs(mesh.vertices - [0.5, 0.5, 0.0]) < [1e-9, 1e-9, 0.4]).all(axis=1)
    edge = int(np.flatnonzero(shared)[0])
    smooth = np.flatnonzero(mesh.contact_normals.counts == 1)
    grasps = np.array([[edge, smooth[0], smooth[9]], [smooth[1], smooth[20], edge]])
    contacts = SurfaceContacts(mesh, vertex_surface_points(mesh, grasps))
    assert contacts.any_normal.sum() == 2
    worst, best = critical_angles(contacts)
    assert (worst == math.pi / 2.0).all()
    assert (best == 0.0).all()


@pytest.mark.parametrize("count", [2, 3, 4])
def test_contacts_at_one_point_are_no_grasp(count: int) -> None:
    corner = int(np.flatnonzero(box().contact_normals.counts == 3)[0])
    smooth = int(np.flatnonzero(box().contact_normals.counts == 1)[0])
    grasps = np.array([[corner] * count, [smooth] * count])
    worst, best = critical_angles(SurfaceContacts(box(), vertex_surface_points(box(), grasps)))
    assert np.isinf(worst).all()
    # Friction may let them push against each other at a corner, where normals differ.
    assert best == pytest.approx([math.pi / 2.0 - math.acos(math.sqrt(1.0 / 3.0)), math.pi / 2.0])


def test_a_duplicated_contact_does_not_change_the_angle() -> None:
    """Three contacts, two of them at one point, equal the grasp of two."""
    mesh = load_mesh(shapes.sphere(2), max_edge=9.0)
    rng = np.random.default_rng(0)
    pairs = rng.integers(len(mesh.vertices), size=(60, 2))
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    two, _ = critical_angles(SurfaceContacts(mesh, vertex_surface_points(mesh, pairs)))
    duplicated = SurfaceContacts(mesh, vertex_surface_points(mesh, pairs[:, [0, 1, 1]]))
    three, _ = critical_angles(duplicated)
    assert three == pytest.approx(np.minimum(two, math.pi / 2.0), abs=2.0 * TOLERANCE)


def test_negative_angles_of_smooth_contacts() -> None:
    """Angles of form-closed grasps are negative if all contacts are smooth, else 0."""
    mesh = load_mesh(shapes.lopsided(), max_edge=9.0)
    rng = np.random.default_rng(3)
    grasps = rng.integers(len(mesh.vertices), size=(3, 9))
    worst, best = critical_angles(
        SurfaceContacts(mesh, vertex_surface_points(mesh, grasps)), tolerance=0.02
    )
    assert (worst < 0.0).any()
    np.testing.assert_array_equal(worst, best)
    cube = load_mesh(shapes.box(), max_edge=0.3)
    smooth = np.flatnonzero(cube.contact_normals.counts == 1)
    edge = np.flatnonzero(cube.contact_normals.counts == 2)
    many = np.column_stack([rng.choice(edge, 1), rng.choice(smooth, (1, 12))])
    worst, best = critical_angles(
        SurfaceContacts(cube, vertex_surface_points(cube, many)), tolerance=0.02
    )
    assert (worst >= 0.0).all()
    assert (worst < 0.03).any()
    assert (best <= worst).all()
