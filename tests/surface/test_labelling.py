import json
import math
from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest
import trimesh

from grasp3d import (
    Contacts,
    GraspModel,
    Label,
    ObjectMesh,
    Sampling,
    SurfaceLabels,
    epsilon,
    label_surface,
    load_mesh,
    scan_surface,
)
from grasp3d.errors import SearchCoverageError, SettingError
from grasp3d.surface import Reason
from tests.helpers import shapes
from tests.helpers.shapes import Surface

degrees = math.radians


@cache
def ball() -> SurfaceLabels:
    mesh = load_mesh(shapes.sphere(5))
    return label_surface(mesh, GraspModel(), sampling=Sampling(search_angle=math.pi / 2.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("friction", "resolution", "label"),
    [(0.2, 20.0, Label.S), (1.0, 80.0, Label.S), (0.2, 22.7, Label.M), (1.0, 90.0, Label.M)],
)
def test_a_ball_is_s_exactly_if_the_tilt_is_below_the_friction_angle(
    friction: float, resolution: float, label: Label
) -> None:
    labels = ball().relabel(friction=friction, sensor_resolution=degrees(resolution))
    assert (labels.label == label).all()


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.2, 1.0])
def test_a_box_is_s_on_its_faces_and_not_on_edges_and_corners(friction: float) -> None:
    mesh = load_mesh(shapes.box((1.0, 1.5, 2.0)))
    labels = label_surface(mesh, GraspModel(friction=friction, sensor_resolution=degrees(10.0)))
    on_face = mesh.contact_normals.counts == 1
    assert (labels.label[on_face] == Label.S).all()
    assert (labels.label[~on_face] <= Label.M).all()
    assert labels.critical_angle[on_face] == pytest.approx(0.0, abs=1e-9)
    assert labels.critical_angle[~on_face].min() >= math.pi / 4.0 - 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("half_angle", [5.0, 25.0])
def test_the_critical_angle_of_a_long_cone_is_its_half_angle(half_angle: float) -> None:
    gamma = degrees(half_angle)
    mesh = load_mesh(shapes.cone(gamma, height=1.0, sections=128), max_edge=0.08)
    labels = label_surface(mesh, GraspModel(friction=math.tan(gamma + 0.1)))
    flank = (mesh.vertices[:, 2] > 0.4) & (mesh.vertices[:, 2] < 0.8)
    assert flank.sum() > 100
    assert labels.critical_angle[flank].min() > gamma - degrees(0.05)
    assert np.median(labels.critical_angle[flank]) == pytest.approx(gamma, abs=degrees(0.05))
    assert labels.critical_angle[flank].max() < gamma + degrees(0.3)


def test_a_ring_has_internal_grasps_without_friction() -> None:
    mesh = load_mesh(shapes.tube(0.4, 0.5, 0.2))
    labels = label_surface(mesh, GraspModel(), sampling=Sampling(grip="expand"))
    radius = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
    inside = (radius < 0.41) & (np.abs(mesh.vertices[:, 2]) < 0.08)
    assert labels.critical_angle[inside].max() < degrees(0.2)
    assert (labels.grip[inside] == -1).all()
    assert labels.opening[inside] == pytest.approx(0.8, abs=2e-3)
    outside = (radius > 0.49) & (np.abs(mesh.vertices[:, 2]) < 0.08)
    assert (labels.reason[outside] == Reason.NO_PARTNER).all()
    assert (labels.label[outside] == Label.U).all()


def tube_openings(**limits: float) -> np.ndarray:
    mesh = load_mesh(shapes.tube(0.4, 0.5, 1.0), max_edge=0.1)
    labels = label_surface(mesh, GraspModel(), sampling=Sampling(**limits))  # type: ignore[arg-type]
    radius = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
    outside = (radius > 0.49) & (np.abs(mesh.vertices[:, 2]) < 0.3)
    assert (labels.label[outside] == Label.S).all()
    opening: np.ndarray = labels.opening[outside]
    return opening


@pytest.mark.slow
def test_a_hollow_cylinder_is_grasped_across_its_wall_or_its_diameter() -> None:
    assert tube_openings(max_opening=0.95) == pytest.approx(0.1, abs=2e-3)
    assert tube_openings(min_opening=0.95) == pytest.approx(1.0, abs=2e-3)
    either = tube_openings()
    assert (np.isclose(either, 0.1, atol=2e-3) | np.isclose(either, 1.0, atol=2e-3)).all()


@pytest.mark.slow
@pytest.mark.parametrize(("width", "offset"), [(0.04, 0.123), (0.1, 0.0), (0.3, 40.0)])
def test_an_opening_equal_to_the_width_fits_at_any_pose(width: float, offset: float) -> None:
    vertices, faces = shapes.box((width, 1.5 * width, 2.0 * width))
    edge = 0.3 * width
    fine = load_mesh((vertices, faces), max_edge=edge)
    sides = np.abs(np.abs(fine.vertices[:, 0]) - width / 2.0) < 1e-9
    for rotation in (np.eye(3), shapes.rotation(1)):
        mesh = load_mesh((vertices @ rotation.T + offset, faces), max_edge=edge)
        sampling = Sampling(max_opening=width, min_opening=width)
        labels = label_surface(mesh, sampling=sampling)
        inside = sides & (mesh.contact_normals.counts == 1)
        assert (labels.label[inside] == Label.S).all()
        assert labels.opening[inside] == pytest.approx(width, rel=1e-5)


@pytest.mark.slow
def test_internal_grasps_end_at_the_first_surface() -> None:
    """A ring within a ring: fingers inside the small one do not reach the large one."""
    inner, faces = shapes.tube(0.2, 0.3, 0.2)
    outer, more = shapes.tube(0.4, 0.5, 0.2)
    mesh = load_mesh((np.vstack([inner, outer]), np.vstack([faces, more + len(inner)])))
    sampling = Sampling(grip="expand", min_opening=0.5)
    labels = label_surface(mesh, sampling=sampling)
    radius = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
    inside = (radius < 0.21) & (np.abs(mesh.vertices[:, 2]) < 0.08)
    assert inside.sum() > 50
    assert (labels.reason[inside] == Reason.OPENING).all()
    either = label_surface(mesh, sampling=Sampling(grip="expand"))
    assert (either.opening[inside] < 0.41).all()


def test_a_vertex_on_an_edge_of_one_face_only_is_on_a_crease() -> None:
    """A T-junction: a vertex in the middle of an edge that only one of the two faces has."""
    vertices, faces = shapes.box()
    a, b = next(
        (f[k], f[(k + 1) % 3])
        for f in faces
        for k in range(3)
        if (vertices[f[k]] == vertices[f[(k + 1) % 3]]).sum() == 2
    )
    cut = len(vertices)
    vertices = np.vstack([vertices, vertices[[a, b]].mean(axis=0)])
    split = []
    for face in faces:
        turned = next(
            (np.roll(face, -k) for k in range(3) if (np.roll(face, -k)[:2] == (a, b)).all()), None
        )
        split += [face] if turned is None else [[a, cut, turned[2]], [cut, b, turned[2]]]
    mesh = load_mesh((vertices, np.array(split)))
    assert len(np.unique(mesh.vertices.round(12), axis=0)) == len(mesh.vertices)
    labels = label_surface(mesh, GraspModel(friction=0.9))
    on_edge = (np.abs(mesh.vertices) == 0.5).sum(axis=1) >= 2
    assert (labels.label[on_edge] <= Label.M).all()


def planar_settings() -> list[tuple[float, float]]:
    cases = json.loads(shapes.shared("reference", "planar.json").read_text())["circle"]
    return [(case["mu"], degrees(case["alpha_deg"])) for case in cases]


@pytest.mark.slow
def test_scanning_a_ball_gives_the_closed_form_fractions() -> None:
    """40,962 vertices, one finger at a pole: S and M are caps around the antipode."""
    mesh = load_mesh(shapes.sphere(6))
    scan = scan_surface(mesh, fixed=(0.0, 0.0, 1.0))
    for friction, resolution in planar_settings():
        beta, tilt = math.atan(friction), resolution / 2.0
        fractions = scan.relabel(friction=friction, sensor_resolution=resolution).fractions()
        stable = (1.0 - math.cos(2.0 * max(0.0, beta - tilt))) / 2.0
        not_unstable = (1.0 - math.cos(2.0 * min(beta + tilt, math.pi / 2.0))) / 2.0
        assert fractions["S"] == pytest.approx(stable, abs=5e-3)
        assert fractions["S"] + fractions["M"] == pytest.approx(not_unstable, abs=5e-3)


def test_scans_from_a_corner_a_face_and_an_edge() -> None:
    mesh = load_mesh(shapes.box())
    scan = scan_surface(mesh, fixed=mesh.vertices[0])
    assert scan.reason[0] == Reason.SAME_POINT
    assert scan.label[0] == Label.U
    across = int(np.nanargmax(scan.opening))  # opposite: the diagonal lies in both sets of normals
    assert scan.critical_angle_best[across] == 0.0
    assert scan.critical_angle[across] == pytest.approx(math.acos(1.0 / math.sqrt(3.0)))
    face = scan_surface(mesh, fixed=(0.0, 0.0, 0.5))
    below = int(np.argmin(np.linalg.norm(mesh.vertices - [0.0, 0.0, -0.5], axis=1)))
    assert face.critical_angle[below] == pytest.approx(0.0, abs=0.05)
    edge = scan_surface(mesh, fixed=(0.5, 0.02, 0.5))
    opposite = int(np.argmin(np.linalg.norm(mesh.vertices - [-0.5, 0.0, -0.5], axis=1)))
    assert edge.critical_angle[opposite] == pytest.approx(math.pi / 4.0, abs=0.05)
    assert edge.critical_angle_best[opposite] == pytest.approx(0.0, abs=0.05)


@pytest.mark.slow
def test_relabelling_equals_a_new_labelling() -> None:
    mesh = load_mesh(shapes.lopsided(3), max_edge=9.0)
    wide = label_surface(mesh, GraspModel(), sampling=Sampling(search_angle=1.0))
    for friction, resolution in ((0.3, 0.2), (0.8, 0.5), (0.1, 0.0)):
        model = GraspModel(friction=friction, sensor_resolution=resolution)
        again = label_surface(mesh, model, sampling=Sampling(search_angle=1.0))
        threshold = wide.relabel(friction=friction, sensor_resolution=resolution)
        assert np.array_equal(threshold.label, again.label)
        assert threshold.model == model
        assert np.array_equal(threshold.max_resolution, again.max_resolution)


@cache
def blob() -> SurfaceLabels:
    return label_surface(
        load_mesh(shapes.lopsided(), max_edge=9.0), sampling=Sampling(search_angle=1.0)
    )


def test_epsilon_is_that_of_the_grasp() -> None:
    labels = blob()
    mesh, model = labels.mesh, labels.model
    for v in range(0, len(mesh.vertices), 200):
        contacts = Contacts(
            [mesh.vertices[v] - mesh.center_mass, labels.partners[v, 0] - mesh.center_mass],
            [mesh.normals[v], labels.partner_normals[v, 0]],
        )
        for value, cone_offset in ((labels.epsilon, 0.0), (labels.epsilon_min, -model.tilt)):
            expected = epsilon(contacts, cone_offset=cone_offset, torque_scale=mesh.torque_scale)
            assert 0.98 * expected.lower <= value[v] <= expected.upper


@pytest.mark.slow
def test_duplicates_have_the_numbers_of_their_position_and_strays_none() -> None:
    vertices, faces = shapes.sphere(3)
    more = np.vstack([vertices, vertices[:5], [[9.0, 9.0, 9.0]]])
    labels = label_surface(load_mesh((more, faces), max_edge=9.0))
    plain = label_surface(load_mesh((vertices, faces), max_edge=9.0))
    for weights in ("area", "vertex"):
        expected = pytest.approx(plain.fractions(weights=weights))  # type: ignore[arg-type]
        assert labels.fractions(weights=weights) == expected  # type: ignore[arg-type]
    count = len(vertices)
    for values in (labels.critical_angle, labels.epsilon):
        assert np.array_equal(values[count : count + 5], values[:5])
    assert labels.reason[count + 5] == Reason.OFF_SURFACE
    assert labels.label[count + 5] == Label.U
    assert np.isnan(labels.epsilon[count + 5])
    assert np.isfinite(labels.epsilon[:count]).all()
    narrow = label_surface(labels.mesh, labels.model, sampling=Sampling(max_opening=0.5))
    assert (narrow.reason[labels.mesh.on_surface] == Reason.OPENING).all()
    assert narrow.fractions() == {"S": 0.0, "M": 0.0, "U": pytest.approx(1.0)}
    assert (narrow.max_resolution == 0.0).all()
    for values in (narrow.epsilon, narrow.epsilon_min, narrow.epsilon_max):
        assert np.isnan(values).all()
    assert narrow.quantiles("epsilon", [0.5]) == [0.0]
    box = load_mesh(shapes.box(), max_edge=0.2)
    scan = scan_surface(box, fixed=box.vertices[0])
    assert np.isnan(scan.epsilon[0])
    assert np.isfinite(scan.epsilon[scan.reason == Reason.FOUND]).all()


def test_relabelling_beyond_the_search_names_the_needed_search_angle() -> None:
    labels = label_surface(load_mesh(shapes.sphere(2)), GraspModel(friction=0.3))
    with pytest.raises(SearchCoverageError, match=r"Sampling\(search_angle="):
        labels.relabel(friction=0.5)
    with pytest.raises(SearchCoverageError, match="searched only up to"):
        labels.relabel(sensor_resolution=1.0)
    with pytest.raises(SettingError):
        labels.relabel(friction=-1.0)
    assert labels.relabel(friction=0.2).model.friction == 0.2


@pytest.mark.slow
def test_fractions_and_quantiles_by_area_and_by_vertex() -> None:
    mesh = load_mesh(shapes.cone(0.3), max_edge=0.1)
    labels = label_surface(mesh)
    areas = mesh.vertex_areas / mesh.vertex_areas.sum()
    assert labels.fractions()["S"] == pytest.approx(areas[labels.label == Label.S].sum())
    counts = np.bincount(labels.label, minlength=3) / len(labels.label)
    assert labels.fractions(weights="vertex")["S"] == pytest.approx(counts[Label.S])
    low, high = labels.quantiles("critical_angle", [0.0, 1.0])
    assert (low, high) == (labels.critical_angle.min(), labels.critical_angle.max())
    assert labels.quantiles("critical_angle", [0.5], weights="vertex") == pytest.approx(
        np.quantile(labels.critical_angle, 0.5, method="inverted_cdf")
    )
    with pytest.raises(SettingError, match="known: area, vertex"):
        labels.fractions(weights="face")  # type: ignore[arg-type]


MODEL = GraspModel()


def representations(
    vertices: np.ndarray, faces: np.ndarray
) -> Iterator[tuple[str, Surface, np.ndarray]]:
    """(name, equivalent surface, new index of each vertex)."""
    rng = np.random.default_rng(3)
    own = np.arange(len(vertices))
    order = rng.permutation(len(vertices))
    index = np.argsort(order)
    far = 1e6 * np.ptp(vertices) * np.array([1.0, -0.5, 0.3])
    rolled = np.stack([np.roll(face, number % 3) for number, face in enumerate(faces)])
    yield "rotated", (vertices @ shapes.rotation(5).T, faces), own
    yield "far away", (vertices + far, faces), own
    yield "tiny", (vertices * 1e-6, faces), own
    yield "in inches", (vertices / 25.4, faces), own
    yield "permuted vertices", (vertices[order], index[faces]), index
    yield "permuted faces", (vertices, faces[rng.permutation(len(faces))]), own
    yield "other first corners of faces", (vertices, rolled), own


def assert_same(expected: SurfaceLabels, found: SurfaceLabels, index: np.ndarray) -> None:
    count = len(index)
    thresholds = (MODEL.friction_angle - MODEL.tilt, MODEL.friction_angle + MODEL.tilt)
    near = np.zeros(count, dtype=bool)
    for angles in (expected.critical_angle[:count], expected.critical_angle_best[:count]):
        for threshold in thresholds:
            near |= np.abs(angles - threshold) < 1e-6
    same = found.label[index] == expected.label[:count]
    assert (same | near).all()
    assert near.mean() < 0.01


OBJECTS = {
    "lopsided": shapes.lopsided,
    "cone": lambda: shapes.cone(0.25, sections=48),
    "tube": lambda: shapes.tube(sections=48),
    "box": lambda: shapes.box((1.0, 1.5, 2.0)),
    "mug": lambda: from_library("mug.glb"),
}


def from_library(name: str) -> Surface:
    mesh = load_mesh(shapes.LIBRARY / name, max_edge=1e9)
    return mesh.vertices, mesh.faces


def prepared(vertices: np.ndarray, faces: np.ndarray) -> ObjectMesh:
    """A mesh with edges of the same length in all representations: a part of the area's root."""
    area = trimesh.Trimesh(vertices - vertices.mean(axis=0), faces, process=False).area
    return load_mesh((vertices, faces), max_edge=0.15 * math.sqrt(area))


@pytest.mark.slow
@pytest.mark.parametrize("name", OBJECTS)
def test_equivalent_surfaces_have_the_same_labels(name: str) -> None:
    vertices, faces = OBJECTS[name]()
    expected = label_surface(prepared(vertices, faces), MODEL)
    for representation, surface, index in representations(vertices, faces):
        found = label_surface(prepared(*surface), MODEL)
        try:
            assert_same(expected, found, index)
        except AssertionError as error:
            raise AssertionError(f"{name} {representation}") from error
