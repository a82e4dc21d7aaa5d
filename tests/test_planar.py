"""Circle and square: the reference, comparison with sampled definitions and hulls, known grasps."""

import itertools
import json
import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import QhullError

from grasp3d import GraspModel, Label
from grasp3d.errors import SettingError
from grasp3d.planar import Circle, Outline, OutlineContacts, PlanarScan, Square, scan
from tests.helpers import oracles, shapes

Floats = NDArray[np.float64]

DEGREE = math.pi / 180.0
NEAR = 1e-6
"""Distance to a threshold within which labels from hulls may differ from the exact ones [rad]."""
OUTLINES = {"circle": Circle(), "square": Square()}
BOTH = pytest.mark.parametrize("outline", OUTLINES.values(), ids=OUTLINES)


def model(friction: float, degrees: float) -> GraspModel:
    return GraspModel(friction=friction, sensor_resolution=degrees * DEGREE)


def off(a: Floats, b: Floats) -> Floats:
    """Angles between unit vectors."""
    return np.asarray(np.arccos(np.clip((a * b).sum(axis=-1), -1.0, 1.0)))


def near_threshold(found: PlanarScan) -> NDArray[np.bool_]:
    beta, tilt = found.model.friction_angle, found.model.tilt
    away = np.abs(found.critical_angle - (beta - tilt))
    return np.minimum(away, np.abs(found.critical_angle_best - (beta + tilt))) < NEAR


def smooth(found: PlanarScan) -> NDArray[np.bool_]:
    """Rows that are neither a corner nor the fixed finger's."""
    return found.weights > 0.0


def normals(contacts: OutlineContacts, side: float = 0.0) -> Floats:
    """Unit normals, at corners the middle ones, or those before (-1) or behind (1) it."""
    turn = contacts.middle + side * contacts.half_range
    return np.stack([np.cos(turn), np.sin(turn)], axis=-1)


@BOTH
def test_fractions_agree_with_the_definition(outline: Outline) -> None:
    count = 4000
    contacts = outline.contacts_at((np.arange(count) + 0.5) * outline.perimeter / count)
    fixed = outline.contacts_at([0.0])
    d = contacts.points - fixed.points
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    squeeze, expand = (
        np.maximum(off(normals(fixed), sign * d), off(normals(contacts), -sign * d))
        for sign in (1, -1)
    )
    sampled = np.minimum(squeeze, expand)
    angles = np.radians(np.arange(3.0, 180.0, 4.0)).reshape(3, 15)  # 90 itself decides a side
    counted = (sampled < angles[..., None]).mean(axis=-1)
    np.testing.assert_allclose(outline.worst_below(angles), counted, atol=1e-3)
    np.testing.assert_array_equal(outline.best_below(angles), outline.worst_below(angles))
    assert outline.worst_below(0.0) == outline.worst_below(-1.0) == 0.0


@BOTH
def test_critical_angles_of_a_scan_agree_with_the_definition(outline: Outline) -> None:
    found = scan(outline, points=60)
    point, normal = np.array([0.0, -1.0, 0.0]), np.array([0.0, 1.0, 0.0])
    for row in np.flatnonzero(smooth(found)):
        p, n = (np.append(v[row], 0.0) for v in (found.contacts.points, normals(found.contacts)))
        expected = oracles.critical_angle(point, normal, p, n)
        assert found.critical_angle[row] == pytest.approx(expected, abs=1e-7)
        assert found.critical_angle_best[row] == pytest.approx(expected, abs=1e-7)


def test_fractions_agree_with_the_reference() -> None:
    reference = json.loads(shapes.shared("reference", "planar.json").read_text(encoding="utf-8"))
    cases = [(kind, case) for kind in OUTLINES for case in reference[kind]]
    assert len(cases) == 60
    for kind, case in cases:
        found = OUTLINES[kind].fractions(
            friction=case["mu"], sensor_resolution=case["alpha_deg"] * DEGREE
        )
        # Two of the reference's squares have an error of 1.1e-6.
        assert found == pytest.approx({k: case[k] for k in "SMU"}, abs=1.2e-6)


@BOTH
def test_at_alpha_of_twice_beta_nothing_is_surely_stable(outline: Outline) -> None:
    grasp_model = GraspModel(friction=0.5, sensor_resolution=2.0 * math.atan(0.5))
    fractions = outline.fractions(friction=0.5, sensor_resolution=grasp_model.sensor_resolution)
    found = scan(outline, grasp_model, points=100)
    assert fractions["S"] == 0.0
    assert not {*found.label, *found.label_extremes} & {Label.S}
    assert not found.epsilon_effective.any()


def test_contacts_go_round_counter_clockwise_with_normals_inward() -> None:
    found = Square().contacts_at([0.0, 0.5, 1.0, 2.0, 8.0 + 4.0, -1.0])
    np.testing.assert_allclose(
        found.points, [(0, -1), (0.5, -1), (1, -1), (1, 0), (0, 1), (-1, -1)], atol=1e-15
    )
    up, left, right, down = (0.0, 1.0), (-1.0, 0.0), (1.0, 0.0), (0.0, -1.0)
    np.testing.assert_allclose(normals(found, -1.0), [up, up, up, left, down, right], atol=1e-15)
    np.testing.assert_allclose(normals(found, 1.0), [up, up, left, left, down, up], atol=1e-15)
    around = Circle().contacts_at([0.0, 0.5 * math.pi, math.pi])
    np.testing.assert_allclose(around.points, [(0, -1), (1, 0), (0, 1)], atol=1e-15)
    np.testing.assert_allclose(normals(around), [up, left, down], atol=1e-15)


def rows_of(
    point: Floats, normal: Floats, tilt: float, beta: float, edges: int, scale: float
) -> list[list[float]]:
    rows = []
    for j in range(edges):
        turn = math.atan2(normal[1], normal[0]) + tilt - beta + 2.0 * beta * j / (edges - 1)
        fx, fy = math.cos(turn), math.sin(turn)
        rows.append([fx, fy, (point[0] * fy - point[1] * fx) / scale])
    return rows


def slow_epsilon(found: PlanarScan, row: int, tilts: tuple[float, float], beta: float) -> float:
    """Epsilon by Qhull of explicit wrenches, with normals tilted from the middle ones."""
    scale = float(np.hypot(*found.contacts.points.T).max())
    bodies = []
    for contact, tilt in zip((0, row), tilts, strict=True):
        normal = normals(found.contacts)[contact]
        point = found.contacts.points[contact]
        bodies.append(rows_of(point, normal, tilt, beta, found.edges, scale))
    try:
        return max(0.0, oracles.epsilon_of_hull(np.vstack(bodies)))
    except QhullError:  # all in one plane
        return 0.0


@pytest.mark.slow
@pytest.mark.parametrize("edges", [2, 5])
@BOTH
def test_epsilon_agrees_with_full_hulls(outline: Outline, edges: int) -> None:
    grasp_model = model(0.8, 20.0)
    found = scan(outline, grasp_model, points=24, edges=edges)
    beta, tilt = grasp_model.friction_angle, grasp_model.tilt
    assert found.epsilon.max() > 0.04
    for row in np.flatnonzero(smooth(found)).tolist():
        nominal = slow_epsilon(found, row, (0.0, 0.0), beta)
        assert found.epsilon[row] == pytest.approx(nominal, abs=1e-9)
        signs = ((1, 1), (1, -1), (-1, 1), (-1, -1))
        four = [slow_epsilon(found, row, (tilt * a, tilt * b), beta) for a, b in signs]
        np.testing.assert_allclose(found.epsilon_extremes[:, row], four, atol=1e-9)
        effective = slow_epsilon(found, row, (0.0, 0.0), beta - tilt)
        assert found.epsilon_effective[row] == pytest.approx(effective, abs=1e-9)
        turns = (-tilt, 0.0, tilt)
        pairs = itertools.product(turns, turns)
        values = [slow_epsilon(found, row, pair, beta) for pair in pairs]
        assert found.epsilon_min[row] == pytest.approx(min(values), abs=1e-9)
        assert found.epsilon_max[row] == pytest.approx(max(values), abs=1e-9)


@BOTH
def test_for_round_cones_the_least_epsilon_is_that_at_the_effective_friction(
    outline: Outline,
) -> None:
    found = scan(outline, model(0.7, 25.0), points=60, edges=129)
    rows = smooth(found)
    lowest = found.epsilon_extremes.min(axis=0)
    np.testing.assert_allclose(lowest[rows], found.epsilon_effective[rows], atol=1e-4)
    np.testing.assert_allclose(found.epsilon_min[rows], lowest[rows], atol=1e-4)
    assert (found.epsilon_min <= found.epsilon).all()
    assert (found.epsilon <= found.epsilon_max).all()


CASES = [
    (10.0, 22.6),
    (1.0, 0.0),
    (1.0, 30.0),
    (0.5, 22.6),
    (0.2, 22.6),
    (0.2, 30.0),
    (0.2, 100.0),
    (3.0, 150.0),
]


@BOTH
@pytest.mark.parametrize(("friction", "degrees"), CASES)
def test_hulls_of_all_tested_normals_give_the_exact_labels(
    outline: Outline, friction: float, degrees: float
) -> None:
    found = scan(outline, model(friction, degrees), points=90)
    differ = found.label_extremes != found.label
    assert not (differ & ~near_threshold(found)).any()
    assert len(set(found.label.tolist())) >= 2


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize(("friction", "degrees"), [(1.0, 22.6), (0.2, 30.0)])
def test_curves_add_up_to_the_closed_form(
    outline: Outline, friction: float, degrees: float
) -> None:
    found = scan(outline, model(friction, degrees), points=4000)
    exact = outline.fractions(friction=friction, sensor_resolution=degrees * DEGREE)
    assert found.fractions(found.label_extremes) == pytest.approx(exact, abs=1e-3)
    assert found.fractions() == pytest.approx(exact, abs=1e-3)


def test_four_combinations_miss_what_lies_in_the_gap_between_extreme_cones() -> None:
    beta, degrees = math.atan(0.2), 30.0
    gap = 0.5 * degrees * DEGREE - beta
    found = scan(Square(), model(0.2, degrees), points=4000)
    x, y = found.contacts.points.T
    opposite = (np.abs(x) < 2.0 * math.tan(gap)) & (y > 1.0 - 1e-9)
    np.testing.assert_array_equal((found.label_four != found.label) & smooth(found), opposite)
    for wider in (25.0, 60.0, 120.0):  # from alpha of twice beta on their M stop growing
        found = scan(Circle(), model(0.2, wider), points=4000)
        four, exact = found.fractions(found.label_four)["M"], found.fractions()["M"]
        assert four == pytest.approx(4.0 * beta / math.pi, abs=1e-3)
        assert exact > four + 5e-3


def test_rows_of_corners_have_the_whole_range_of_normals() -> None:
    grasp_model = model(1.0, 15.0)
    found = scan(Square(), grasp_model, points=90)
    for position, corner in zip((3.0, 5.0), ((1.0, 1.0), (-1.0, 1.0)), strict=True):
        (row,) = np.flatnonzero(np.isclose(found.position, position)).tolist()
        np.testing.assert_allclose(found.contacts.points[row], corner, atol=1e-12)
        assert found.at_corner[row]
        # From the middle of the bottom the corner is atan(1/2) off that normal; its normals reach
        # from the diagonal to 45 degrees on either side.
        line = math.atan2(2.0, 1.0)
        assert found.critical_angle_best[row] == pytest.approx(math.atan(0.5))
        assert found.critical_angle[row] == pytest.approx(line)
        assert found.label[row] == found.label_extremes[row] == Label.M
        both = [slow_epsilon(found, row, pair, grasp_model.friction_angle) for pair in (
            (grasp_model.tilt, math.pi / 4.0 + grasp_model.tilt),
            (grasp_model.tilt, -math.pi / 4.0 - grasp_model.tilt),
        )]  # fmt: skip
        np.testing.assert_allclose(found.epsilon_extremes[:2, row], both, atol=1e-9)
        nominal = slow_epsilon(found, row, (0.0, 0.0), grasp_model.friction_angle)
        assert found.epsilon[row] == pytest.approx(nominal, abs=1e-9)


@BOTH
def test_the_fixed_point_makes_no_grasp(outline: Outline) -> None:
    found = scan(outline, model(10.0, 90.0), points=16)
    assert found.label[0] == found.label_extremes[0] == found.label_four[0] == Label.U
    assert found.critical_angle[0] == found.critical_angle_best[0] == math.inf
    assert found.epsilon[0] == found.epsilon_max[0] == found.epsilon_effective[0] == 0.0
    assert found.angle[0] == 0.0
    assert not found.epsilon_extremes[:, 0].any()
    assert np.isfinite(found.critical_angle[1:]).all()


def test_too_many_normals_are_refused_and_epsilon_is_available() -> None:
    found = scan(Circle(), model(1e-6, 22.6), points=16)
    for name in ("label_extremes", "epsilon_min", "epsilon_max"):
        with pytest.raises(SettingError, match=r"1972\d\d normals .* use the exact"):
            getattr(found, name)
    assert found.epsilon[8] > 0.0
