"""Quality measures: laws, other formulations, known shapes, degenerate grasps."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from grasp3d import Contacts, critical_friction_angle, epsilon, force_closure
from grasp3d.contact.friction_cones import cone_edges
from grasp3d.errors import SettingError
from grasp3d.quality import METRICS, MetricValues, metric_names, metrics
from tests.helpers import shapes
from tests.helpers.grasps import LINE, changed, just_off_a_line, one, regular_on_ball, stacked
from tests.helpers.random_grasps import Shape, random_contacts

Floats = NDArray[np.float64]

PAGE = Path(__file__).parents[2] / "docs" / "theory" / "metrics.md"
AXIS = np.array([0.3, -0.5, 0.8])
OF_CLOSURE = {"min_weight", "internal_force_margin", "friction_margin"}
"""They depend neither on the centre of mass nor on the torque scale."""

TOLERANCE = 1.1e-4
"""Largest error of friction margins [rad], and rounding."""

KINDS = [Shape(2, 8, soft=False), Shape(2, 8, soft=True), Shape(3, 8, soft=False),
         Shape(4, 8, soft=True), Shape(5, 8, soft=False)]  # fmt: skip
kinds = st.sampled_from(KINDS)
seeds = st.integers(0, 10_000)
few = settings(max_examples=15, deadline=None)


def grasp(kind: Shape, seed: int) -> Contacts:
    """A random grasp off the centre of mass."""
    contacts = one(random_contacts(kind, 1, seed), 0)
    return changed(contacts, points=contacts.points + [0.2, -0.1, 0.3])


def measured(contacts: Contacts, names: str = "all", **options: object) -> MetricValues:
    return metrics(contacts, names, principal_axis=AXIS, **options)  # type: ignore[arg-type]


def assert_same(one: MetricValues, other: MetricValues, rel: float = 1e-6) -> None:
    for name in one:
        rounding = TOLERANCE if name == "friction_margin" else 2e-6
        assert other[name] == pytest.approx(one[name], rel=rel, abs=rounding, nan_ok=True), name


# --- other formulations --------------------------------------------------------------------------


def grasp_matrix(contacts: Contacts, scale: float = 1.0) -> Floats:
    """Shape (6, 3 n), of soft fingers (6, 4 n), in world axes."""
    columns = []
    for p, n, e in zip(contacts.points, contacts.normals, contacts.torsion_radius, strict=True):
        skew = np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])
        columns.append(np.vstack([np.eye(3), skew / scale]))
        if e > 0.0:
            columns.append(np.concatenate([np.zeros(3), e * n / scale])[:, None])
    return np.hstack(columns)


def primitive_wrenches(contacts: Contacts, edges: int = 8) -> Floats:
    """Rows of unit forces on the edges, and of normal forces with torsional moments."""
    rows = []
    for k in range(contacts.count):
        p, n, e = contacts.points[k], contacts.normals[k], contacts.torsion_radius[k]
        forces = cone_edges(n, contacts.friction_angle[k], edges=edges)
        rows += [np.concatenate([f, np.cross(p, f)]) for f in forces]
        moments = (e, -e) if e > 0.0 else ()
        rows += [np.concatenate([n, np.cross(p, n) + moment * n]) for moment in moments]
    return np.array(rows)


@few
@given(kinds, seeds, st.floats(0.1, 10.0))
def test_singular_values_are_those_of_the_grasp_matrix(
    kind: Shape, seed: int, scale: float
) -> None:
    contacts = grasp(kind, seed)
    found = measured(contacts, torque_scale=scale)
    matrix = grasp_matrix(contacts, scale)
    values = np.linalg.svd(matrix, compute_uv=False)[: found.rank]
    assert found.rank == np.linalg.matrix_rank(matrix, tol=1e-8) == force_closure(contacts).rank
    assert found["smallest_singular_value"] == pytest.approx(values[-1])
    assert found["grasp_isotropy"] == pytest.approx(values[-1] / values[0])
    assert found["grasp_matrix_volume"] == pytest.approx(values.prod())
    if found.rank == 6:
        volume = math.sqrt(np.linalg.det(matrix @ matrix.T))
        assert found["grasp_matrix_volume"] == pytest.approx(volume)


@settings(max_examples=6, deadline=None)
@given(kinds, seeds)
def test_the_volume_of_the_wrench_space_is_that_of_a_hull(kind: Shape, seed: int) -> None:
    contacts = grasp(kind, seed)
    rows = primitive_wrenches(contacts)
    rank = np.linalg.matrix_rank(rows, tol=1e-8)
    basis = np.linalg.svd(rows)[2][:rank]
    volume = ConvexHull(rows @ basis.T).volume
    assert measured(contacts, "wrench_space_volume")["wrench_space_volume"] == pytest.approx(volume)


@few
@given(kinds, seeds)
def test_min_weight_is_the_linear_program_of_its_paper(kind: Shape, seed: int) -> None:
    """Li et al. 2023: maximise l with weights of at least l, of sum 1, that combine to 0.

    It is positive exactly where the grasp is force-closed.
    """
    contacts = grasp(kind, seed)
    rows = primitive_wrenches(contacts)
    count = len(rows)
    result = linprog(
        np.concatenate([np.zeros(count), [-1.0]]),
        A_eq=np.vstack(
            [np.hstack([rows.T, np.zeros((6, 1))]), np.concatenate([np.ones(count), [0.0]])]
        ),
        b_eq=np.concatenate([np.zeros(6), [1.0]]),
        A_ub=np.hstack([-np.eye(count), np.ones((count, 1))]),
        b_ub=np.zeros(count),
        bounds=(None, None),
    )
    found = measured(contacts, "min_weight")["min_weight"]
    assert found == pytest.approx(-result.fun, abs=1e-6)
    assert found <= 1.0 / count + 1e-9
    polygons = epsilon(contacts, edges=8)
    if polygons.status == 0 and not 0.0 < polygons.upper < 1e-6:
        assert (found > 0.0) == polygons.closed


def face_normals(contacts: Contacts, k: int) -> Floats:
    """Unit normals of the faces of a contact's pyramid, into it."""
    edges = cone_edges(contacts.normals[k], contacts.friction_angle[k], edges=8)
    normals = np.cross(edges, np.roll(edges, -1, axis=0))
    normals *= np.sign(normals @ contacts.normals[k])[:, None]
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


@few
@given(st.sampled_from([kind for kind in KINDS if not kind.soft]), seeds)
def test_the_internal_margin_is_a_linear_program_in_world_axes(kind: Shape, seed: int) -> None:
    contacts = grasp(kind, seed)
    count = 3 * contacts.count
    faces = np.zeros((8 * contacts.count, count + 1))
    faces[:, -1] = 1.0
    for k in range(contacts.count):
        faces[8 * k : 8 * k + 8, 3 * k : 3 * k + 3] = -face_normals(contacts, k)
    pressing = np.zeros((contacts.count, count + 1))
    for k in range(contacts.count):
        pressing[k, 3 * k : 3 * k + 3] = -contacts.normals[k]
    result = linprog(
        -np.eye(count + 1)[-1],
        A_eq=np.vstack(
            [np.hstack([grasp_matrix(contacts), np.zeros((6, 1))]), -pressing.sum(axis=0)]
        ),
        b_eq=np.concatenate([np.zeros(6), [1.0]]),
        A_ub=np.vstack([faces, pressing]),
        b_ub=np.zeros(len(faces) + len(pressing)),
        bounds=(None, None),
    )
    found = measured(contacts, "internal_force_margin")["internal_force_margin"]
    if result.status == 0:
        assert found == pytest.approx(-result.fun, abs=1e-6)
    else:
        assert np.isnan(found)


@few
@given(kinds, seeds)
def test_the_friction_margin_is_that_of_the_critical_angle(kind: Shape, seed: int) -> None:
    contacts = grasp(kind, seed)
    found = measured(contacts, "friction_margin")["friction_margin"]
    expected = contacts.friction_angle[0] - critical_friction_angle(contacts)
    assert found == pytest.approx(expected, abs=TOLERANCE)
    if abs(found) > 1e-3 and not kind.soft:
        assert (found > 0.0) == force_closure(contacts).closed


# --- laws ----------------------------------------------------------------------------------------


@few
@given(kinds, seeds)
def test_rotations_matter_less_to_the_internal_force_margin_the_more_edges_there_are(
    kind: Shape, seed: int
) -> None:
    contacts, turn = grasp(kind, seed), shapes.rotation(seed)
    turned = changed(contacts, points=contacts.points @ turn.T, normals=contacts.normals @ turn.T)
    name = "internal_force_margin"
    margin, again = (metrics(each, name, edges=64)[name] for each in (contacts, turned))
    assert again == pytest.approx(margin, rel=5e-3, abs=5e-4, nan_ok=True)


@pytest.mark.slow
@few
@given(kinds, seeds, st.floats(0.01, 100.0))
@example(Shape(2, 8, soft=True), 5427, 1.0)  # only without a presolver the moved one is solved
def test_measures_of_closure_depend_on_no_centre_and_no_scale(
    kind: Shape, seed: int, scale: float
) -> None:
    contacts = grasp(kind, seed)
    moved = changed(contacts, points=contacts.points + [3.0, -2.0, 1.0])
    names = ",".join(OF_CLOSURE)
    assert_same(measured(contacts, names), measured(moved, names, torque_scale=scale), rel=1e-5)


@pytest.mark.slow
@few
@given(kinds, seeds, st.floats(1.0, 2.0))
def test_more_friction_lowers_no_margin(kind: Shape, seed: int, factor: float) -> None:
    contacts = grasp(kind, seed)
    more = contacts.with_friction(factor * contacts.friction)
    before, after = measured(contacts), measured(more)
    for name in ("internal_force_margin", "friction_margin"):
        if not np.isnan(before[name]):
            assert after[name] >= before[name] - TOLERANCE, name


@settings(max_examples=6, deadline=None)
@given(seeds)
def test_another_finger_lowers_no_volume(seed: int) -> None:
    contacts = grasp(Shape(4, 8, soft=False), seed)
    fewer = Contacts(contacts.points[:3], contacts.normals[:3], contacts.friction[:3])
    names = "grasp_matrix_volume,wrench_space_volume,smallest_singular_value"
    before, after = metrics(fewer, names), metrics(contacts, names)
    for name in before:
        assert after[name] >= before[name] * (1.0 - 1e-9), name


def test_a_batch_has_the_values_of_its_grasps() -> None:
    single = [grasp(Shape(4, 8, soft=True), seed) for seed in range(6)]
    single[2] = changed(single[2], torsion_radius=np.array([0.0, 0.2, 0.0, 0.1]))
    single[4] = changed(single[4], points=np.ones((4, 3)))
    batch = stacked(single).reshape((2, 3))
    found = measured(batch)
    assert found.rank.shape == (2, 3)
    for k, contacts in enumerate(single):
        alone = measured(contacts)
        where = divmod(k, 3)
        for name in found:
            assert found[name].shape == (2, 3)
            assert found[name][where] == pytest.approx(
                alone[name], rel=1e-6, abs=1e-8, nan_ok=True
            ), name
            assert found.reasons[name][where] == alone.reasons[name]


def test_values_are_within_their_ranges_and_undefined_ones_have_reasons() -> None:
    for kind in KINDS:
        found = measured(random_contacts(kind, 5, 3))
        for metric in found.descriptions:
            values, reasons = found[metric.name], found.reasons[metric.name]
            assert ((reasons != "") == np.isnan(values)).all()
            defined = values[~np.isnan(values)]
            assert ((defined >= metric.least) & (defined <= metric.most)).all(), metric.name


# --- known shapes --------------------------------------------------------------------------------

APOTHEM = math.cos(math.pi / 8.0)


@pytest.mark.parametrize("friction", [0.2, 0.5, 1.0])
def test_opposed_fingers(friction: float) -> None:
    found = measured(regular_on_ball("pair", friction))
    assert found.rank == 5
    assert found["smallest_singular_value"] == pytest.approx(math.sqrt(2.0))
    assert found["grasp_isotropy"] == pytest.approx(1.0)
    assert found["grasp_matrix_volume"] == pytest.approx(2.0**2.5)
    assert found["min_weight"] == pytest.approx(1.0 / 16.0)
    slope = math.atan(friction * APOTHEM)
    assert found["internal_force_margin"] == pytest.approx(math.sin(slope) / 2.0)
    assert found["friction_margin"] == pytest.approx(math.atan(friction))
    assert found["centroid_distance"] == pytest.approx(0.0, abs=1e-12)
    assert np.isnan([found["polygon_area"], found["polygon_shape"]]).all()
    assert "needs 3 fingers, has 2" in found.columns()["undefined_metrics"][0]


def test_torsion_of_opposed_fingers_adds_a_dimension() -> None:
    found = measured(regular_on_ball("pair", 0.5, torsion_radius=0.1))
    assert found.rank == 6
    assert found["smallest_singular_value"] == pytest.approx(0.1 * math.sqrt(2.0))
    assert found["min_weight"] == pytest.approx(1.0 / 20.0)
    assert found["internal_force_margin"] == pytest.approx(math.sin(math.atan(0.5 * APOTHEM)) / 2.0)


def test_a_torsional_moment_takes_its_part_of_the_margin() -> None:
    """Opposed forces off the centre need no moments; fingers that meet at an angle do."""
    hard = just_off_a_line(0.3)
    soft = changed(hard, torsion_radius=np.full(3, 0.2))
    before, after = (measured(c, "internal_force_margin") for c in (hard, soft))
    assert after["internal_force_margin"] >= before["internal_force_margin"] - 1e-9


def test_three_fingers_at_120_degrees() -> None:
    found = measured(regular_on_ball("triangle"))
    assert found["polygon_area"] == pytest.approx(0.75 * math.sqrt(3.0))
    assert found["polygon_shape"] == pytest.approx(0.0, abs=1e-9)
    slope = math.atan(0.5 * APOTHEM)
    assert found["internal_force_margin"] == pytest.approx(math.sin(slope) / 3.0)
    # Forces: G G^T = 3 I. Torques: 1.5, 1.5 and 3, as of three points on a circle.
    assert found["smallest_singular_value"] == pytest.approx(math.sqrt(1.5))
    assert found["grasp_matrix_volume"] == pytest.approx(math.sqrt(3.0**3 * 1.5 * 1.5 * 3.0))
    assert found["friction_margin"] == pytest.approx(math.atan(0.5), abs=1e-3)


def test_fingers_at_the_corners_of_a_tetrahedron() -> None:
    found = measured(regular_on_ball("tetrahedron"))
    assert found["smallest_singular_value"] == pytest.approx(math.sqrt(8.0 / 3.0))
    assert found["grasp_isotropy"] == pytest.approx(math.sqrt(2.0 / 3.0))
    assert found["internal_force_margin"] == pytest.approx(math.sin(math.atan(0.5 * APOTHEM)) / 4.0)
    for name in ("polygon_area", "polygon_shape", "orthogonality"):
        assert found.reasons[name] == "the contacts are nearest to no single plane"


@few
@given(seeds)
def test_polygons_of_three_fingers_are_triangles(seed: int) -> None:
    contacts = grasp(Shape(3, 8, soft=False), seed)
    found = measured(contacts)
    p, q, r = contacts.points
    assert found["polygon_area"] == pytest.approx(0.5 * np.linalg.norm(np.cross(q - p, r - p)))
    angles = [
        math.acos(np.dot(b - a, c - a) / np.linalg.norm(b - a) / np.linalg.norm(c - a))
        for a, b, c in ((p, q, r), (q, r, p), (r, p, q))
    ]
    difference = sum(abs(angle - math.pi / 3.0) for angle in angles)
    assert found["polygon_shape"] == pytest.approx(difference / math.radians(240.0), abs=1e-6)


def test_polygons_of_four_fingers() -> None:
    square = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    across = square[[0, 2, 1, 3]] * [2.0, 1.0, 1.0] + [0.5, 0.0, 1.0]
    for points, area in ((square, 4.0), (across, 8.0)):
        found = measured(Contacts(points, -square - [0, 0, 0.01]))
        assert found["polygon_area"] == pytest.approx(area)
        assert found["polygon_shape"] == pytest.approx(0.0, abs=1e-9)
    kite = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -3, 0]])
    angles = np.array([2.0 * math.atan(1.0 / 3.0), math.pi / 2.0])
    others = (2.0 * math.pi - angles.sum()) / 2.0
    difference = abs(angles - math.pi / 2.0).sum() + 2.0 * abs(others - math.pi / 2.0)
    found = measured(Contacts(kite, -kite - [0, 0, 0.01]), "polygon_shape")
    assert found["polygon_shape"] == pytest.approx(difference / (2.0 * math.pi))


@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0, 70.0, 90.0])
def test_orthogonality_is_the_angle_to_the_nearest_of_parallel_and_orthogonal(
    degrees: float,
) -> None:
    angle = math.radians(degrees)
    line = np.array([math.cos(angle), math.sin(angle), 0.0])
    pair = Contacts([line, -line], [-line, line])
    found = metrics(pair, "orthogonality", principal_axis=[-2.0, 0.0, 0.0])["orthogonality"]
    assert found == pytest.approx(min(angle, math.pi / 2.0 - angle), abs=1e-9)
    disc = regular_on_ball("triangle")
    tilted = changed(disc, points=disc.points + 0.0)
    axis = [0.0, math.sin(angle), math.cos(angle)]
    found = metrics(tilted, "orthogonality", principal_axis=axis)["orthogonality"]
    assert found == pytest.approx(min(angle, math.pi / 2.0 - angle), abs=1e-9)


# --- degenerate grasps ---------------------------------------------------------------------------


def test_one_contact_is_no_grasp() -> None:
    found = measured(Contacts([[1.0, 0, 0]], [[-1.0, 0, 0]]))
    for name in found:
        assert np.isnan(found[name])
        assert re.fullmatch(r"needs [23] fingers, has 1", str(found.reasons[name]))


@pytest.mark.parametrize("torsion_radius", [0.0, 0.1])
@pytest.mark.parametrize("position", [[0.0, 0, 0], [1.0, 2.0, 3.0]])
def test_contacts_at_one_point_have_no_best_score(
    position: list[float], torsion_radius: float
) -> None:
    normals = [[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0]]
    found = measured(Contacts([position] * 3, normals, 0.5, torsion_radius))
    assert found["centroid_distance"] == pytest.approx(np.linalg.norm(position))
    assert found["polygon_area"] == 0.0
    for name in (*OF_CLOSURE, "polygon_shape", "orthogonality"):
        assert np.isnan(found[name]), name
    if torsion_radius == 0.0:
        assert found.rank == 3
        for name in ("grasp_isotropy", "smallest_singular_value", "grasp_matrix_volume"):
            assert found.reasons[name] == "the grasp matrix has rank 3, less than 5"
        assert found.reasons["wrench_space_volume"].startswith("the wrenches span 3 dimensions")


def test_contacts_on_a_line_make_a_polygon_that_is_a_line() -> None:
    found = measured(LINE)
    assert found.rank == 5
    assert found["polygon_area"] == pytest.approx(0.0, abs=1e-12)
    assert found["polygon_shape"] == 1.0
    assert found["orthogonality"] == pytest.approx(
        min(math.acos(0.3 / np.linalg.norm(AXIS)), math.asin(0.3 / np.linalg.norm(AXIS)))
    )


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9, 1e-12, 1e-15])
def test_contacts_nearly_on_a_line_have_values(gap: float) -> None:
    found = measured(just_off_a_line(gap))
    for name in found:
        assert np.isfinite(found[name]) or found.reasons[name], name
    assert found["polygon_shape"] == pytest.approx(1.0, abs=10.0 * gap + 1e-9)
    assert found["min_weight"] > 0.0


def test_two_contacts_that_coincide_leave_a_polygon_with_too_few_corners() -> None:
    points = [[1.0, 0, 0], [1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0]]
    found = measured(Contacts(points, -np.array(points) - [0, 0, 0.1]))
    assert found.reasons["polygon_shape"] == "two contacts coincide in the plane of the polygon"
    assert found["polygon_area"] == pytest.approx(1.0)


def test_without_friction_only_normal_forces_count() -> None:
    found = measured(regular_on_ball("octahedron", friction=0.0))
    assert found.rank == 3
    assert found.reasons["grasp_isotropy"] == "the grasp matrix has rank 3, less than 5"
    assert found["internal_force_margin"] == pytest.approx(0.0, abs=1e-9)
    assert found["min_weight"] == pytest.approx(1.0 / 48.0)


def test_fingers_that_only_push_one_way_have_no_internal_forces() -> None:
    contacts = Contacts([[-1.0, 0, 0], [1.0, 0, 0]], [[0, 0, 1.0], [0, 0, 1.0]])
    found = measured(contacts)
    assert found.reasons["internal_force_margin"] == "no forces of the fingers are in equilibrium"
    assert found["min_weight"] < 0.0 or found.reasons["min_weight"]
    frictionless = measured(contacts.with_friction(0.0), "min_weight")
    assert frictionless.reasons["min_weight"]


def test_fingers_of_different_friction_have_no_one_margin() -> None:
    found = measured(Contacts([[-1, 0, 0], [1, 0, 0]], [[1, 0, 0], [-1, 0, 0]], [0.3, 0.5]))
    assert found.reasons["friction_margin"] == "the fingers' friction differs"


# --- names, settings, documentation --------------------------------------------------------------


def test_names() -> None:
    assert metric_names("all") == tuple(METRICS)
    assert metric_names(["min_weight", "all"])[0] == "min_weight"
    assert set(metric_names(["min_weight", "all"])) == set(metric_names("all"))
    assert metric_names("min_weight,polygon_area,min_weight") == ("min_weight", "polygon_area")
    with pytest.raises(SettingError, match=r"called 'min_wait'; did you mean min_weight\? known:"):
        metric_names("min_wait")
    with pytest.raises(SettingError, match="no metric is called 'beauty'; known: all, smallest"):
        metric_names(["beauty"])
    for nothing in ("", [], " , "):
        with pytest.raises(SettingError, match="no metric"):
            metric_names(nothing)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"torque_scale": 0.0}, "torque_scale"),
        ({"edges": 2}, "at least 3 edges"),
        ({"principal_axis": [0.0, 0.0, 0.0]}, "principal_axis must be a direction"),
        ({"principal_axis": [1.0, 0.0]}, "principal_axis must have shape"),
        ({"tolerance": 0.0}, "tolerance must be above 0"),
    ],
)
def test_settings_out_of_range_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        metrics(regular_on_ball("pair"), **options)  # type: ignore[arg-type]


def test_the_page_lists_every_metric_with_source_and_range() -> None:
    text = PAGE.read_text(encoding="utf-8")
    rows = {
        match[1]: [cell.strip() for cell in line.split(" | ")]
        for line in text.partition("## ")[0].splitlines()
        if (match := re.match(r"\| `(\w+)` \|", line))
    }
    assert list(rows) == list(METRICS)
    for name, cells in rows.items():
        metric = METRICS[name]
        assert f"${metric.formula}$" in cells, name
        assert metric.better in cells, name
        assert metric.source.split(",")[0] in cells[-1], name
    for metric in METRICS.values():
        year = metric.source[-4:]
        first = re.split(" & | et al", metric.source)[0]
        sources = re.split(r"\n\* ", text.partition("## Sources")[2])
        assert any(first in source and year in source for source in sources), metric.name
