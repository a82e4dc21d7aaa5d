import itertools
import math
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import (
    GraspModel,
    Label,
    ObjectMesh,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    best_grasps,
    evaluate_grasps,
    label_surface,
    load_mesh,
    read_labels,
)
from grasp3d.arrays import Bools, Floats, locked
from grasp3d.errors import SettingError
from grasp3d.formats.surface_files import write_ply_columns, writer_for
from grasp3d.surface.vertex_fields import Reason
from tests.helpers import shapes


@cache
def object_of(name: str) -> ObjectMesh:
    """A small object, in metres."""
    solids = {
        "box": (trimesh.creation.box([0.06, 0.04, 0.05]), 0.015),
        "ball": (trimesh.creation.icosphere(2, 0.03), 0.1),
        "lopsided": (shapes.lopsided(2), 9.0),
    }
    solid, edge = solids[name]
    return load_mesh(solid, unit="m", max_edge=edge)


@st.composite
def regions(draw: st.DrawFn, names: tuple[str, ...] = ("box", "ball", "lopsided")) -> ObjectMesh:
    """A small object of which a box is allowed, or all but a ball."""
    mesh = object_of(draw(st.sampled_from(names)))
    centre = mesh.vertices[draw(st.integers(0, len(mesh.vertices) - 1))]
    half = 0.6 * mesh.size * draw(st.floats(0.2, 1.1))
    if draw(st.booleans()):
        outside = np.linalg.norm(mesh.vertices - centre, axis=1) > 0.5 * half
        mesh = replace(mesh, region=locked(outside[mesh.canonical]))
    else:
        corners = [*(centre - half), *(centre + half)]
        with suppress(SettingError):
            mesh = load_mesh(mesh, region=f"box:{','.join(map(str, corners))}")
    return mesh if mesh.region is not None else load_mesh(mesh, region="box:-9,-9,-9,9,9,9")


def inside(mesh: ObjectMesh) -> Bools:
    """Mask of the allowed vertices; of a box from its text."""
    kind, _, numbers = str(mesh.options.region).partition(":")
    if kind != "box":
        return mesh.allowed
    low, high = np.array(numbers.split(","), dtype=float).reshape(2, 3)
    beyond = np.maximum(low - mesh.vertices, mesh.vertices - high)
    return np.asarray((beyond <= 1e-9).all(axis=1))


def on_allowed_faces(mesh: ObjectMesh, points: Floats) -> Bools:
    """Whether points (k, 3) lie on faces all of whose corners are allowed, or at such a corner."""
    at_corner = np.zeros(len(points), dtype=bool)
    for vertex in mesh.vertices[inside(mesh)]:
        at_corner |= np.linalg.norm(points - vertex, axis=1) < 1e-9 * mesh.size
    faces = mesh.faces[inside(mesh)[mesh.faces].all(axis=1)]
    scale = 1000.0 / mesh.size  # trimesh's tolerances are absolute
    part = trimesh.Trimesh(scale * mesh.vertices, faces, process=False)
    _, gaps, _ = trimesh.proximity.closest_point(part, scale * points)
    return np.asarray(gaps < 1e-4) | at_corner


def exhaustive(mesh: ObjectMesh, vertex: int, steps: int = 12) -> float:
    """Smallest critical angle over points of all allowed faces, squeezing, for a smooth vertex."""
    faces = np.flatnonzero(inside(mesh)[mesh.faces].all(axis=1))
    pairs = itertools.product(range(1, steps), repeat=2)
    weights = np.array([(i, j, steps - i - j) for i, j in pairs if i + j < steps]) / steps
    corners = mesh.corner_normals
    points = (weights @ mesh.vertices[mesh.faces[faces]]).reshape(-1, 3)
    normals = (weights @ corners.normals[corners.corners[faces]]).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    lines = points - mesh.vertices[vertex]
    lines /= np.maximum(np.linalg.norm(lines, axis=1, keepdims=True), 1e-12)
    own = np.arccos(np.clip(lines @ mesh.normals[vertex], -1.0, 1.0))
    other = np.arccos(np.clip(-(lines * normals).sum(axis=1), -1.0, 1.0))
    return float(np.maximum(own, other).min(initial=math.inf))


def check_contacts(labels: SurfaceLabels) -> None:
    """Every contact is allowed, and only allowed vertices have grasps and areas."""
    mesh, allowed = labels.mesh, inside(labels.mesh)
    assert (labels.reason[~allowed] == Reason.EXCLUDED).all()
    assert (labels.reason[allowed] != Reason.EXCLUDED).all()
    assert not labels.label[~allowed].any()
    assert not mesh.vertex_areas[~allowed].any()
    contacts = labels.partners[labels.reason == Reason.FOUND].reshape(-1, 3)
    assert not len(contacts) or on_allowed_faces(mesh, contacts).all()
    assert sum(labels.fractions().values()) == pytest.approx(1.0)


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(regions(), st.integers(0, 2**32 - 1))
def test_the_best_grasps_are_those_of_an_exhaustive_search_of_the_region(
    mesh: ObjectMesh, seed: int
) -> None:
    check_best(mesh, most=12, seed=seed)


def test_the_best_grasp_may_be_at_the_corner_of_a_strongly_bent_face() -> None:
    mesh = object_of("lopsided")
    corners = [*(mesh.vertices[83] - 0.6755), *(mesh.vertices[83] + 0.6755)]
    check_best(load_mesh(mesh, region=f"box:{','.join(map(str, corners))}"), most=27)


def check_best(mesh: ObjectMesh, *, most: int, seed: int = 0) -> None:
    """The best grasps of some smooth vertices are those of an exhaustive search."""
    labels = label_surface(mesh, sampling=Sampling(search_angle=1.0))
    check_contacts(labels)
    smooth = np.flatnonzero(mesh.allowed & (mesh.contact_normals.counts == 1))
    for vertex in np.random.default_rng(seed).permutation(smooth)[:most]:
        oracle = exhaustive(mesh, vertex)
        if oracle < 1.0:
            assert labels.critical_angle[vertex] <= oracle + 1e-6
        if labels.reason[vertex] == Reason.FOUND:
            assert labels.critical_angle[vertex] >= oracle - 0.2  # the coarse oracle is above


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(regions(), st.sampled_from(["expand", "both"]), st.booleans())
def test_contacts_of_searches_by_rays_are_allowed(
    mesh: ObjectMesh, grip: str, located: bool
) -> None:
    model = GraspModel(location_error=0.01 * mesh.size if located else 0.0)
    check_contacts(label_surface(mesh, model, sampling=Sampling(grip=grip)))  # type: ignore[arg-type]


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(regions(), st.sampled_from(["surface", "vertices"]))
def test_contacts_of_three_fingers_are_allowed(mesh: ObjectMesh, points: str) -> None:
    sampling = Sampling(candidates=16, candidate_points=points)  # type: ignore[arg-type]
    try:
        labels = label_surface(mesh, GraspModel(fingers=3), sampling=sampling)
    except SettingError:
        assert len(mesh.contact_vertices) < 3
        return
    check_contacts(labels)


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(regions(("box", "ball")))
def test_no_grasp_is_named_whose_closed_jaws_touch_elsewhere(mesh: ObjectMesh) -> None:
    labels = label_surface(mesh, hand=ParallelGripper.preset("franka"))
    check_contacts(labels)
    grasps = best_grasps(labels, 5)
    if not grasps.size:
        return
    points = grasps.jaws.points.reshape(-1, 3)
    nearest = trimesh.proximity.ProximityQuery(mesh.to_trimesh()).vertex(points)[1]
    assert inside(mesh)[nearest].all()


def test_given_grasps_with_a_contact_outside_are_u() -> None:
    mesh = object_of("box")
    upper, lower = [[0.0, 0.02, 0.01], [0.0, -0.02, 0.01]], [[0.0, 0.02, -0.01], [0.0, -0.02, 0.01]]
    part = load_mesh(mesh, region="box:-1,-1,-4mm,1,1,1")
    assert evaluate_grasps(mesh, [upper, lower]).label.tolist() == [Label.S, Label.M]
    grasps = evaluate_grasps(part, [upper, lower])
    assert grasps.label.tolist() == [Label.S, Label.U]
    assert np.isinf(grasps.critical_angle).tolist() == [False, True]
    hand, pose = ParallelGripper.preset("franka"), np.diag([1.0, -1.0, -1.0, 1.0])
    above, below = pose.copy(), np.eye(4)
    above[2, 3], below[2, 3] = 0.015, -0.015
    poses = [above, below]
    assert evaluate_grasps(mesh, poses, hand=hand).label.tolist() == [Label.S, Label.S]
    assert evaluate_grasps(part, poses, hand=hand).label.tolist() == [Label.S, Label.U]


def test_a_region_of_everything_changes_nothing() -> None:
    mesh = object_of("lopsided")
    whole, same = label_surface(mesh), label_surface(load_mesh(mesh, region="box:-9,-9,-9,9,9,9"))
    assert same.mesh.region is not None
    for name in ("label", "critical_angle", "critical_angle_best", "partners", "reason"):
        np.testing.assert_array_equal(getattr(same, name), getattr(whole, name))
    assert same.fractions() == whole.fractions()


@pytest.mark.parametrize("suffix", [".ply", ".npz"])
def test_files_have_the_region(tmp_path: Path, suffix: str) -> None:
    mesh = object_of("box")
    mesh = load_mesh(mesh, region="box:0,-1,-1,1,1,2cm")
    labels, path = label_surface(mesh), tmp_path / f"box{suffix}"
    writer_for(path)(path, labels)
    read = read_labels(path)
    np.testing.assert_array_equal(read.mesh.allowed, mesh.allowed)
    assert read.mesh.options.region == mesh.options.region
    assert read.fractions() == pytest.approx(labels.fractions(), abs=1e-6)
    assert (read.reason[~mesh.allowed] == Reason.EXCLUDED).all()
    again = tmp_path / f"again{suffix}"
    writer_for(again)(again, read)
    assert again.read_bytes() == path.read_bytes()
    assert label_surface(read.mesh).fractions() == labels.fractions()


@pytest.mark.parametrize("kind", ["colour", "scalar"])
def test_a_painted_mask_is_the_part_that_is_painted(tmp_path: Path, kind: str) -> None:
    """On a mesh with other vertices, too."""
    mesh, path = object_of("box"), tmp_path / "mask.ply"
    fine = load_mesh(trimesh.creation.box([0.06, 0.04, 0.05]), max_edge=0.006)
    painted = fine.vertices[:, 2] > 0.001
    columns = dict(zip("xyz", fine.vertices.T.astype("f4"), strict=True))
    if kind == "colour":
        channels = np.where(painted, 30, 255).astype("u1")
        columns |= {"red": np.full(len(painted), 255, "u1"), "green": channels, "blue": channels}
    else:
        columns |= {"other": np.ones(len(painted), "f4"), "grip": painted.astype("u1")}
    write_ply_columns(path, columns, fine.faces, {})
    part = load_mesh(mesh, region=f"{path}:grip" if kind == "scalar" else str(path))
    np.testing.assert_array_equal(part.allowed, mesh.vertices[:, 2] > 0.001)
    with pytest.raises(SettingError, match=r"is not a mask of arrays, .* farther than 0\.0\d+"):
        load_mesh((mesh.vertices + 0.02, mesh.faces), region=f"{path}:{list(columns)[-1]}")
