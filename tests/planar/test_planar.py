"""Planar outlines and scans: laws, comparison with sampled definitions and hulls, known shapes."""

import itertools
import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import QhullError

from grasp3d import GraspModel, Label
from grasp3d.errors import SettingError
from grasp3d.planar import (
    Circle,
    Outline,
    PlanarScan,
    Polyline,
    circle_fractions,
    regular_polygon,
    scan,
    square,
    square_fractions,
)
from tests.helpers import oracles, shapes

Floats = NDArray[np.float64]

DEGREE = math.pi / 180.0
NEAR = 1e-6
"""Distance to a threshold within which labels from hulls may differ from the exact ones [rad]."""
SQUARE = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
HOOK = [
    (-2.0, -1.0), (2.0, -1.0), (2.0, -0.8), (-1.8, -0.8), (-1.8, 2.0), (-0.1, 2.0), (0.0, 0.0),
    (0.1, 2.0), (2.0, 2.0), (2.0, 2.2), (-2.0, 2.2),
]  # fmt: skip
"""A bar, and a needle that points at it from a second bar."""

seeds = st.integers(0, 100_000)
frictions = st.floats(0.05, 4.0)
resolutions = st.floats(0.0, 2.5)
few = settings(max_examples=30, deadline=None)


def star(seed: int, count: int = 7) -> Floats:
    """A star-shaped polygon about the origin, in most cases not convex."""
    rng = np.random.default_rng(seed)
    gaps = rng.uniform(0.5, 1.0, count)
    turn = np.cumsum(gaps) * 2.0 * math.pi / gaps.sum()
    return np.asarray(
        rng.uniform(0.4, 1.6, (count, 1)) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    )


def random_outline(seed: int, **options: Any) -> Polyline:
    """A star with the fixed finger at a corner for every third seed."""
    corners = star(seed)
    rng = np.random.default_rng(seed + 1)
    outline = Polyline(corners)
    fixed = [*rng.uniform(0.0, outline.perimeter, 2), float(rng.choice(outline.corner_positions))]
    return Polyline(corners, fixed=fixed[seed % 3], **options)


def model(friction: float, degrees: float, **options: Any) -> GraspModel:
    return GraspModel(friction=friction, sensor_resolution=degrees * DEGREE, **options)


def off(a: Floats, b: Floats) -> Floats:
    """Angles between unit vectors."""
    return np.asarray(np.arccos(np.clip((a * b).sum(axis=-1), -1.0, 1.0)))


def between(first: Floats, last: Floats, steps: int) -> Floats:
    """Unit vectors spread evenly from one to another (steps, 2)."""
    whole = off(first, last)
    if whole < 1e-7:
        return first[None]
    fraction = np.linspace(0.0, 1.0, steps)[:, None]
    return np.asarray(
        (np.sin((1.0 - fraction) * whole) * first + np.sin(fraction * whole) * last) / np.sin(whole)
    )


def defined_angles(outline: Polyline, points: int, steps: int) -> tuple[Floats, Floats]:
    """Worst and best critical angle at the middles of even cells, from the definition."""
    contacts = outline.contacts_at((np.arange(points) + 0.5) * outline.perimeter / points)
    fixed = outline.contacts_at([outline.fixed])
    d = contacts.points - fixed.points
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    worst, best = np.zeros(points), np.full(points, math.inf)
    for normal in between(fixed.first[0], fixed.last[0], steps):
        squeeze = np.maximum(off(normal, d), off(contacts.first, -d))
        expand = np.maximum(off(normal, -d), off(contacts.first, d))
        angle = np.minimum(squeeze, expand)
        worst, best = np.maximum(worst, angle), np.minimum(best, angle)
    return worst, best


def expected_circle(friction: float, degrees: float) -> dict[str, float]:
    """From the angle off both normals, which is uniform from 0 to 90 degrees."""
    beta, tilt = math.atan(friction), 0.5 * degrees * DEGREE
    stable = max(0.0, 2.0 * (beta - tilt) / math.pi)
    unstable = max(0.0, 1.0 - 2.0 * (beta + tilt) / math.pi)
    return {"S": stable, "U": unstable, "M": 1.0 - stable - unstable}


def expected_square(friction: float, degrees: float) -> dict[str, float]:
    """By trigonometry from the middle of the bottom: t off both normals of the opposite side; on
    the others t off the first and 90 degrees - t off the second."""

    def below(angle: float) -> float:
        if angle <= 0.0:
            return 0.0
        if angle > math.pi / 2.0:
            return 1.0
        top = 4.0 * min(math.tan(angle), 0.5)
        tallest = min(2.0, math.tan(min(angle, 1.5)))
        sides = 2.0 * max(0.0, tallest - 1.0 / math.tan(angle))
        return (top + sides) / 8.0

    beta, tilt = math.atan(friction), 0.5 * degrees * DEGREE
    # The finger's own side is at 90 degrees exactly, which is not closed at 90 degrees.
    stable, possible = below(beta - tilt), below(beta + tilt - 1e-12)
    return {"S": stable, "U": 1.0 - possible, "M": possible - stable}


def near_threshold(found: PlanarScan) -> NDArray[np.bool_]:
    beta, tilt = found.model.friction_angle, found.model.tilt
    away = np.abs(found.critical_angle - (beta - tilt))
    return np.minimum(away, np.abs(found.critical_angle_best - (beta + tilt))) < NEAR


def smooth(found: PlanarScan) -> NDArray[np.bool_]:
    """Rows that are neither a corner nor the fixed finger's."""
    return found.weights > 0.0


# Laws of the fractions


@pytest.mark.slow
@given(seeds, frictions, resolutions, st.floats(0.0, 7.0), st.floats(1e-6, 1e6))
@few
def test_fractions_do_not_depend_on_pose_unit_or_order_of_corners(
    seed: int, friction: float, resolution: float, turn: float, unit: float
) -> None:
    one = random_outline(seed)
    parameters = {"friction": friction, "sensor_resolution": resolution}
    cos, sin = math.cos(turn), math.sin(turn)
    moved = unit * one.corners @ np.array([[cos, sin], [-sin, cos]]) + [3.0 * unit, -unit]
    start = np.hypot(*(one.corners[1] - one.corners[0]))
    others = [
        Polyline(moved, fixed=unit * one.fixed),
        Polyline(one.corners * (-1.0, 1.0), fixed=-one.fixed),
        Polyline(np.roll(one.corners, -1, axis=0), fixed=one.fixed - start),
        Polyline(np.roll(one.corners[::-1], 1, axis=0), fixed=one.fixed + one.perimeter),
    ]
    for other in others:
        assert other.fractions(**parameters) == pytest.approx(one.fractions(**parameters), abs=1e-9)
        assert other.torque_scale / other.perimeter == pytest.approx(
            one.torque_scale / one.perimeter
        )


@given(seeds, frictions, frictions, resolutions, resolutions)
@few
def test_more_friction_and_a_finer_sensor_never_reduce_stability(
    seed: int, friction: float, other: float, resolution: float, finer: float
) -> None:
    outline = random_outline(seed)
    low, high = sorted((friction, other))
    fine, coarse = sorted((resolution, finer))
    worse = outline.fractions(friction=low, sensor_resolution=coarse)
    slick = outline.fractions(friction=low, sensor_resolution=fine)
    rough = outline.fractions(friction=high, sensor_resolution=coarse)
    slack = 1e-12
    assert slick["S"] >= worse["S"] - slack
    assert slick["U"] >= worse["U"] - slack
    assert rough["S"] >= worse["S"] - slack
    assert rough["U"] <= worse["U"] + slack
    assert sum(worse.values()) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.slow
@given(seeds)
@few
def test_distributions_rise_from_0_to_1_and_best_is_at_least_worst(seed: int) -> None:
    outline = random_outline(seed)
    angles = np.linspace(-math.pi, math.pi + 1e-9, 300).reshape(3, 100)
    worst, best = outline.worst_below(angles), outline.best_below(angles)
    assert worst.shape == best.shape == angles.shape
    assert worst.max() == pytest.approx(1.0, abs=1e-12)
    assert (best >= worst - 1e-12).all()
    for fractions in (worst.ravel(), best.ravel()):
        assert (np.diff(fractions) >= -1e-12).all()
        assert (fractions[angles.ravel() <= 0.0] == 0.0).all()


@pytest.mark.slow
@given(seeds, st.floats(0.05, 0.95))
@few
def test_quantiles_invert_the_distribution(seed: int, fraction: float) -> None:
    for outline in (random_outline(seed), Circle(2.0)):
        angle = outline.worst_quantile(fraction)
        assert float(outline.worst_below(angle + 1e-6)) >= fraction - 1e-9
        assert float(outline.worst_below(angle - 1e-6)) <= fraction + 1e-9


# The definition, sampled


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(9))
def test_fractions_agree_with_the_definition(seed: int) -> None:
    outline = random_outline(seed)
    worst, best = defined_angles(outline, 4000, 181)
    angles = np.radians(np.arange(3.0, 180.0, 4.0))  # 90 degrees itself decides whole edges
    counted = (best[:, None] < angles).mean(axis=0)
    np.testing.assert_allclose(outline.best_below(angles), counted, atol=4e-3)
    exact = angles[angles < math.pi / 2.0]  # beyond, the worst is a bound that no label needs
    counted = (worst[:, None] < exact).mean(axis=0)
    np.testing.assert_allclose(outline.worst_below(exact), counted, atol=4e-3)
    beyond = angles[angles >= math.pi / 2.0]
    counted = (worst[:, None] < beyond).mean(axis=0)
    assert (outline.worst_below(beyond) <= counted + 4e-3).all()


@pytest.mark.parametrize("seed", range(6))
def test_critical_angles_of_a_scan_agree_with_the_definition(seed: int) -> None:
    outline = random_outline(seed)
    found = scan(outline, points=60)
    rows = np.flatnonzero(smooth(found))
    fixed = outline.contacts_at([outline.fixed])
    deep = [np.append(v, 0.0) for v in (fixed.points[0], fixed.first[0], fixed.last[0])]
    for row in rows:
        p, n = np.append(found.points[row], 0.0), np.append(found.contacts.first[row], 0.0)
        ends = [oracles.critical_angle(deep[0], normal, p, n) for normal in deep[1:]]
        assert found.critical_angle_best[row] <= min(ends) + 1e-12
        if max(ends) < math.pi / 2.0:
            assert found.critical_angle[row] == pytest.approx(max(ends), abs=1e-12)
        if np.allclose(deep[1], deep[2]):
            assert found.critical_angle_best[row] == pytest.approx(ends[0], abs=1e-7)


# Reference and formulas


def test_fractions_agree_with_the_reference() -> None:
    reference = json.loads(shapes.shared("reference", "planar.json").read_text(encoding="utf-8"))
    functions = {"circle": circle_fractions, "square": square_fractions}
    cases = [(kind, case) for kind in functions for case in reference[kind]]
    assert len(cases) == 60
    for kind, case in cases:
        found = functions[kind](friction=case["mu"], sensor_resolution=case["alpha_deg"] * DEGREE)
        # Two of the reference's squares have an error of 1.1e-6: see `expected_square`.
        assert found == pytest.approx({k: case[k] for k in "SMU"}, abs=1.2e-6)


@pytest.mark.parametrize("friction", [1e-6, 0.2, 0.5, 1.0, 10.0])
@pytest.mark.parametrize("degrees", [0.0, 5.0, 22.6, 53.13, 60.0, 90.0, 120.0, 170.0])
def test_fractions_agree_with_trigonometry(friction: float, degrees: float) -> None:
    parameters = {"friction": friction, "sensor_resolution": degrees * DEGREE}
    circle, sides = expected_circle(friction, degrees), expected_square(friction, degrees)
    assert circle_fractions(**parameters) == pytest.approx(circle, abs=1e-12)
    assert Circle(3.0, fixed=-7.0).fractions(**parameters) == pytest.approx(circle, abs=1e-12)
    assert square_fractions(**parameters) == pytest.approx(sides, abs=1e-9)
    assert square(0.01).fractions(**parameters) == pytest.approx(sides, abs=1e-9)


def test_at_alpha_of_twice_beta_nothing_is_surely_stable() -> None:
    grasp_model = GraspModel(friction=0.5, sensor_resolution=2.0 * math.atan(0.5))
    for outline in (Circle(), square(), regular_polygon(5)):
        fractions = outline.fractions(friction=0.5, sensor_resolution=grasp_model.sensor_resolution)
        assert fractions["S"] == 0.0
        found = scan(outline, grasp_model, points=100)
        assert not (found.label == Label.S).any()
        assert not (found.label_extremes == Label.S).any()
        assert not found.epsilon_effective.any()


@pytest.mark.slow
@given(st.floats(0.02, 1.5), st.floats(0.0, 3.1))
@few
def test_polygons_of_many_sides_approach_the_circle(friction: float, resolution: float) -> None:
    parameters = {"friction": friction, "sensor_resolution": resolution}
    found = regular_polygon(400, radius=2.0).fractions(**parameters)
    assert found == pytest.approx(circle_fractions(**parameters), abs=6e-3)


# Outlines


def test_outlines_have_their_centroid_and_size() -> None:
    half = Polyline([(0.0, 0.0), (3.0, 0.0), (0.0, 4.0)])
    np.testing.assert_allclose(half.center_mass, [1.0, 4.0 / 3.0])
    assert half.perimeter == pytest.approx(12.0)
    assert half.torque_scale == pytest.approx(math.hypot(1.0, 8.0 / 3.0))
    np.testing.assert_allclose(half.corner_positions, [0.0, 3.0, 8.0])
    whole = square(2.0)
    np.testing.assert_allclose(whole.center_mass, 0.0, atol=1e-15)
    assert whole.torque_scale == pytest.approx(math.sqrt(8.0))
    np.testing.assert_allclose(whole.corner_positions, [2.0, 6.0, 10.0, 14.0])
    assert Circle(2.0).torque_scale == 2.0
    assert len(Circle().corner_positions) == 0
    np.testing.assert_allclose(regular_polygon(5).center_mass, 0.0, atol=1e-15)


def test_contacts_go_round_counter_clockwise_with_normals_inward() -> None:
    found = square().contacts_at([0.0, 0.5, 1.0, 2.0, 8.0 + 4.0, -1.0])
    np.testing.assert_allclose(
        found.points, [(0, -1), (0.5, -1), (1, -1), (1, 0), (0, 1), (-1, -1)], atol=1e-15
    )
    up, left, right, down = (0.0, 1.0), (-1.0, 0.0), (1.0, 0.0), (0.0, -1.0)
    np.testing.assert_allclose(found.first, [up, up, up, left, down, right], atol=1e-15)
    np.testing.assert_allclose(found.last, [up, up, left, left, down, up], atol=1e-15)
    around = Circle(2.0).contacts_at([0.0, math.pi, 2.0 * math.pi])
    np.testing.assert_allclose(around.points, [(0, -2), (2, 0), (0, 2)], atol=1e-15)
    np.testing.assert_allclose(around.first, [up, left, down], atol=1e-15)


@given(seeds)
@few
def test_normals_are_inward_unit_vectors_and_contacts_on_the_outline(seed: int) -> None:
    outline = random_outline(seed)
    contacts = outline.contacts_at(np.random.default_rng(seed).uniform(-30.0, 30.0, 50))
    np.testing.assert_allclose(np.linalg.norm(contacts.first, axis=1), 1.0, rtol=1e-12)
    inside = contacts.points + 1e-6 * contacts.first
    x, y = inside.T[..., None]
    (x1, y1), (x2, y2) = outline.corners.T, np.roll(outline.corners, -1, axis=0).T
    crossed = ((y1 > y) != (y2 > y)) & (x < x1 + (y - y1) * (x2 - x1) / (y2 - y1))
    assert (crossed.sum(axis=1) % 2 == 1).all()


def test_a_concave_corner_has_normals_between_its_edges_too() -> None:
    arrow = Polyline([(-1.0, -1.0), (0.0, -0.5), (1.0, -1.0), (0.0, 1.0)])
    dent = arrow.contacts_at([math.hypot(1.0, 0.5)])
    assert dent.middle[0] == pytest.approx(math.pi / 2.0)
    assert dent.half_range[0] == pytest.approx(math.atan(0.5))


# Epsilon


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
    center, scale = found.outline.center_mass, found.outline.torque_scale
    bodies = []
    for contact, tilt in zip((0, row), tilts, strict=True):
        normal = found.contacts.first[contact] + found.contacts.last[contact]
        point = found.points[contact] - center
        bodies.append(rows_of(point, normal, tilt, beta, found.edges, scale))
    if found.model.actuation == "per_finger":
        bodies.append([np.add(a, b).tolist() for a, b in itertools.product(*bodies)])
    try:
        return max(0.0, oracles.epsilon_of_hull(np.vstack(bodies)))
    except QhullError:  # all in one plane
        return 0.0


@pytest.mark.slow
@pytest.mark.parametrize("edges", [2, 5])
@pytest.mark.parametrize("actuation", ["total", "per_finger"])
@pytest.mark.parametrize("seed", range(3))
def test_epsilon_agrees_with_full_hulls(seed: int, actuation: Any, edges: int) -> None:
    outlines = [Circle(3.0, fixed=1.0), square(), random_outline(3 * seed)]
    grasp_model = model(0.8, 20.0, actuation=actuation)
    found = scan(outlines[seed], grasp_model, points=24, edges=edges)
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


def test_opposite_fingers_make_a_regular_tetrahedron_of_wrenches() -> None:
    found = scan(Circle(5.0), model(1.0, 30.0), points=8)
    assert found.position[4] == pytest.approx(5.0 * math.pi)
    assert found.angle[4] == pytest.approx(math.pi)
    assert found.epsilon[4] == pytest.approx(math.sqrt(1.5) / 3.0, rel=1e-12)


@pytest.mark.parametrize("outline", [Circle(), square(), random_outline(1)], ids=str)
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


def test_curves_of_a_circle_depend_on_the_angle_alone() -> None:
    one = scan(Circle(), model(0.6, 30.0), points=36)
    other = scan(Circle(40.0, fixed=33.0), model(0.6, 30.0), points=36)
    np.testing.assert_allclose(one.angle, other.angle, atol=1e-12)
    np.testing.assert_allclose(one.epsilon_extremes, other.epsilon_extremes, atol=1e-12)
    np.testing.assert_allclose(one.epsilon_min, one.epsilon_min[-np.arange(36)], atol=1e-12)
    np.testing.assert_array_equal(one.label, other.label)


def test_curves_of_a_square_do_not_depend_on_unit_or_frame() -> None:
    one = scan(square(), model(0.6, 30.0), points=37)
    moved = Polyline([(1e3 * x + 7e3, 1e3 * y) for x, y in SQUARE], fixed=1e3)
    other = scan(moved, model(0.6, 30.0), points=37)
    np.testing.assert_allclose(other.position - 1e3, 1e3 * one.position, atol=1e-8)
    np.testing.assert_allclose(one.epsilon_max, other.epsilon_max, atol=1e-11)
    np.testing.assert_array_equal(one.label_extremes, other.label_extremes)


# Labels


CASES = [(1.0, 0.0), (1.0, 30.0), (0.5, 22.6), (0.2, 22.6), (0.2, 30.0), (0.2, 100.0), (3.0, 150.0)]


@pytest.mark.parametrize(("friction", "degrees"), CASES)
def test_hulls_with_rings_give_the_exact_labels(friction: float, degrees: float) -> None:
    seen = set()
    outlines = [
        Circle(),
        square(),
        Polyline(HOOK, fixed=2.0),
        *(random_outline(seed) for seed in range(6)),
    ]
    for outline in outlines:
        found = scan(outline, model(friction, degrees), points=90)
        differ = found.label_extremes != found.label
        assert not (differ & ~near_threshold(found)).any()
        seen |= set(found.label.tolist())
    assert len(seen) >= 2


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "degrees"), [(1.0, 22.6), (0.5, 53.0), (0.2, 30.0)])
def test_curves_add_up_to_the_closed_form(friction: float, degrees: float) -> None:
    outlines = [Circle(), square(), Polyline(SQUARE, fixed=0.0), random_outline(2)]
    grasp_model = model(friction, degrees)
    for outline in outlines:
        found = scan(outline, grasp_model, points=4000)
        exact = outline.fractions(
            friction=friction, sensor_resolution=grasp_model.sensor_resolution
        )
        assert found.fractions(of="extremes") == pytest.approx(exact, abs=1e-3)
        assert found.fractions() == pytest.approx(exact, abs=1e-3)


def test_weights_are_those_of_the_points_that_are_not_corners() -> None:
    found = scan(square(), points=10)
    corners = found.at_corner
    assert corners.sum() == 4
    assert found.weights.sum() == pytest.approx(1.0, abs=1e-14)
    assert not found.weights[corners].any()
    assert found.weights[0] == 0.0
    assert (found.weights[~corners][1:] > 0.0).all()
    assert (np.diff(found.position) > 0.0).all()


@pytest.mark.parametrize(
    "outline", [Circle(), square(), random_outline(0), random_outline(1)], ids=str
)
@pytest.mark.parametrize(("friction", "degrees"), CASES)
def test_four_combinations_differ_where_a_line_passes_between_the_extreme_cones(
    outline: Outline, friction: float, degrees: float
) -> None:
    found = scan(outline, model(friction, degrees), points=360)
    beta, tilt = found.model.friction_angle, found.model.tilt
    differ = (found.label_four != found.label) & smooth(found)
    d = found.contacts.points - found.contacts.points[0]
    d /= np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-300)
    missed = np.ones(len(d), dtype=np.bool_)
    sure = ~near_threshold(found)
    for sign in (1.0, -1.0):
        offs = np.stack(
            [off(found.contacts.first[:1], sign * d), off(found.contacts.first, -sign * d)]
        )
        closed = (offs < beta + tilt).all(axis=0) & (offs > tilt - beta).all(axis=0)
        missed &= ~closed
        sure &= (np.abs(offs - (tilt - beta)) > NEAR).all(axis=0)
    expected = (found.label == Label.M) & missed & smooth(found)
    np.testing.assert_array_equal(differ[sure], expected[sure])
    assert (found.label_four[differ & sure] == Label.U).all()
    if tilt < beta:
        assert not differ[sure].any()


def test_four_combinations_miss_the_middle_of_the_opposite_side() -> None:
    grasp_model = model(0.2, 30.0)
    found = scan(square(), grasp_model, points=4000)
    gap = grasp_model.tilt - grasp_model.friction_angle
    wrong = found.label_four != found.label
    opposite = np.abs(found.points[:, 0]) < 2.0 * math.tan(gap)
    opposite &= found.points[:, 1] > 1.0 - 1e-9
    np.testing.assert_array_equal(wrong & smooth(found), opposite)
    lost = found.fractions()["M"] - found.fractions(of="four")["M"]
    assert lost == pytest.approx(0.5 * math.tan(gap), abs=1e-3)
    perceived = scan(square(), grasp_model, points=400, rings=False)  # the gap is below 2 beta
    np.testing.assert_array_equal(perceived.label_extremes, perceived.label)


def test_on_a_circle_four_combinations_stop_growing_at_alpha_of_twice_beta() -> None:
    beta = math.atan(0.2)
    for degrees in (25.0, 60.0, 120.0):
        found = scan(Circle(), model(0.2, degrees), points=4000)
        assert found.fractions(of="four")["M"] == pytest.approx(4.0 * beta / math.pi, abs=1e-3)
        assert found.fractions()["M"] > 4.0 * beta / math.pi + 5e-3


def test_without_rings_normals_between_rim_and_center_are_missed() -> None:
    grasp_model = model(0.1, 40.0)
    scans = [scan(Circle(), grasp_model, points=400, rings=rings) for rings in (True, False)]
    true, coarse = (found.label_extremes for found in scans)
    missed = coarse != true
    off_normal = np.abs(math.pi - scans[0].angle) / 2.0
    beta, tilt = grasp_model.friction_angle, grasp_model.tilt
    np.testing.assert_array_equal(missed, (off_normal > beta) & (off_normal < tilt - beta))
    assert missed.any()


def test_extreme_normals_of_a_needle_may_point_to_the_opposite_side() -> None:
    found = scan(Polyline(HOOK, fixed=2.0), model(4.0, 60.0), points=720)
    tip = int(np.hypot(*found.points.T).argmin())
    assert 2.0 * found.contacts.half_range[tip] + 60.0 * DEGREE > math.pi
    assert found.label[tip] == found.label_extremes[tip] == Label.M
    assert found.label_four[tip] == Label.S
    assert found.critical_angle[tip] == math.pi
    keel = Polyline([HOOK[0], (0.0, -1.2), *HOOK[1:]], fixed=math.hypot(2.0, 0.2))
    turned = scan(keel, points=720)
    assert turned.contacts.half_range[0] > 0.0
    tip = int(np.hypot(*turned.points.T).argmin())
    assert turned.critical_angle[tip] == math.pi
    from_tip = Polyline(np.roll(HOOK, -6, axis=0))
    assert from_tip.worst_below(math.pi + 1e-9) == pytest.approx(1.0, abs=1e-12)


def test_bisecting_normals_grasp_a_square_at_its_corners() -> None:
    found = scan(Polyline(SQUARE), model(0.2, 10.0), points=16, rings=False)
    opposite = 8
    np.testing.assert_allclose(found.points[opposite], (1.0, 1.0))
    assert found.label[opposite] == found.label_extremes[opposite] == Label.M
    assert found.label_four[opposite] == Label.U
    assert found.critical_angle_best[opposite] == 0.0
    assert found.critical_angle[opposite] == pytest.approx(math.pi / 4.0)
    assert found.epsilon_max[opposite] == found.epsilon[opposite] > 0.0
    assert found.epsilon_min[opposite] == found.epsilon_effective[opposite] == 0.0


def test_rows_of_corners_have_the_whole_range_of_normals() -> None:
    grasp_model = model(1.0, 15.0)
    found = scan(square(), grasp_model, points=90)
    for position, corner in zip((3.0, 5.0), ((1.0, 1.0), (-1.0, 1.0)), strict=True):
        (row,) = np.flatnonzero(np.isclose(found.position, position)).tolist()
        np.testing.assert_allclose(found.points[row], corner, atol=1e-12)
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


@pytest.mark.parametrize("fixed", [0.0, 0.3])
def test_the_fixed_point_makes_no_grasp(fixed: float) -> None:
    found = scan(Polyline(SQUARE, fixed=fixed), model(10.0, 90.0), points=16)
    assert found.label[0] == found.label_extremes[0] == found.label_four[0] == Label.U
    assert found.critical_angle[0] == found.critical_angle_best[0] == math.inf
    assert found.epsilon[0] == found.epsilon_max[0] == found.epsilon_effective[0] == 0.0
    assert found.angle[0] == 0.0
    assert not found.epsilon_extremes[:, 0].any()
    assert np.isfinite(found.critical_angle[1:]).all()


def test_a_grasp_within_one_side_is_possible_only_beyond_ninety_degrees() -> None:
    own = 2.0 / 8.0
    for degrees, possible in ((89.0, False), (90.0, False), (91.0, True)):
        fractions = square_fractions(friction=1.0, sensor_resolution=degrees * DEGREE)
        assert (fractions["U"] < own - 1e-9) == possible
        found = scan(square(), model(1.0, degrees), points=80)
        side = (found.points[:, 1] < -1.0 + 1e-9) & smooth(found)
        expected = Label.M if possible else Label.U
        assert (found.label[side] == expected).all()
        assert (found.label_extremes[side] == expected).all()


def test_without_tilt_only_corners_are_ambiguous() -> None:
    found = scan(square(), model(0.6, 0.0), points=360)
    assert not (found.label == Label.M)[smooth(found)].any()
    assert (found.label == Label.M)[found.contacts.half_range > 0.0].any()
    np.testing.assert_array_equal(found.epsilon_min[smooth(found)], found.epsilon[smooth(found)])


@pytest.mark.parametrize("friction", [1e-6, 10.0])
@pytest.mark.parametrize("degrees", [0.0, 22.6, 179.0])
def test_extreme_friction(friction: float, degrees: float) -> None:
    for outline in (Circle(), square(), random_outline(4)):
        found = scan(outline, model(friction, degrees), points=90, rings=friction > 1.0)
        fractions = outline.fractions(friction=friction, sensor_resolution=degrees * DEGREE)
        assert found.fractions() == pytest.approx(fractions, abs=0.06)
        assert np.isfinite(found.epsilon_extremes).all()
        assert ((found.epsilon >= 0.0) & (found.epsilon <= 1.0)).all()
        if friction > 1.0:
            differ = found.label_extremes != found.label
            assert not (differ & ~near_threshold(found)).any()


def test_too_many_rings_are_refused_and_other_results_are_available() -> None:
    found = scan(Circle(), model(1e-6, 22.6), points=16)
    for name in ("label_extremes", "epsilon_min", "epsilon_max"):
        with pytest.raises(
            SettingError, match=r"1972\d\d normals .* rings=False, or use the exact"
        ):
            getattr(found, name)
    assert (found.label == Label.M).any()
    assert found.epsilon[8] > 0.0
    assert found.label_four.shape == found.label.shape


def test_results_are_locked() -> None:
    found = scan(square(), points=16)
    for name in (
        "position", "angle", "points", "at_corner", "label", "critical_angle",
        "critical_angle_best", "weights", "epsilon", "epsilon_extremes",
        "epsilon_effective", "epsilon_min", "epsilon_max", "label_extremes", "label_four",
    ):  # fmt: skip
        values = getattr(found, name)
        assert not values.flags.writeable
        assert values.shape[{"epsilon_extremes": 1}.get(name, 0)] == len(found.position)


# Refused settings


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ([(0, 0), (1, 0)], "at least 3 corners; got 2"),
        ([(0, 0), (1, 0), (1, 0), (0, 0)], "at least 3 different corners; got 2"),
        ([(1, 1), (1, 1), (1, 1)], "must not all be one point"),
        ([(0, 0), (1, 0), (0, math.nan)], r"finite and at most 1e\+100; corner 2 is \(0, nan\)"),
        ([(0, 0), (1, 0), (0, 1e200)], r"corner 2 is \(0, 1e\+200\)"),
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], r"shape \(k, 2\); got \(3, 3\)"),
        ([1.0, 2.0], r"shape \(k, 2\); got \(2,\)"),
        (["a", "b", "c"], "array of numbers"),
        ([(0, 0), (1, 0), (2, 0)], "touch itself; corner 1 lies on the edge that starts"),
        ([(0, 0), (1, 0), (0, 1), (1, 1)], "cross itself; the edges that start at corners 1 and 3"),
        ([(0, 0), (4, 0), (4, 1), (2, 0), (0, 1)], "corner 3 lies on the edge that starts at corn"),
        ([(0, 0), (4, 0), (2, 0), (2, 3)], "touch itself; corner 2 lies on the edge"),
    ],
)
def test_corners_that_are_no_simple_polygon(corners: Any, message: str) -> None:
    with pytest.raises(SettingError, match=message):
        Polyline(corners)


def test_other_settings_out_of_range() -> None:
    for radius in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(SettingError, match="radius of the circle must be above 0"):
            Circle(radius)
        with pytest.raises(SettingError, match="radius of the polygon must be above 0"):
            regular_polygon(5, radius)
        with pytest.raises(SettingError, match="half side of the square must be above 0"):
            square(radius)
    for fixed in (math.nan, math.inf):
        with pytest.raises(SettingError, match="fixed finger's position must be a finite"):
            Circle(fixed=fixed)
        with pytest.raises(SettingError, match="fixed finger's position must be a finite"):
            Polyline(SQUARE, fixed=fixed)
    wrong: Any
    for wrong in (2, 4.5, "5"):
        with pytest.raises(SettingError, match="sides must be a whole number of at least 3"):
            regular_polygon(wrong)
    for wrong in (7, 100.5, None):
        with pytest.raises(SettingError, match="points must be a whole number of at least 8"):
            scan(Circle(), points=wrong)
    for wrong in (1, 2.5):
        with pytest.raises(SettingError, match="edges of a planar cone must be a whole number"):
            scan(Circle(), edges=wrong)
    with pytest.raises(SettingError, match="every point is a corner"):
        scan(Polyline(regular_polygon(8).corners[1:]), points=8)
    wrong = "best"
    with pytest.raises(SettingError, match="called 'best'; known: exact, extremes, four"):
        scan(Circle(), points=8).fractions(of=wrong)


def test_fixed_positions_are_taken_modulo_the_perimeter() -> None:
    assert Polyline(SQUARE, fixed=-1.0).fixed == pytest.approx(7.0)
    assert Polyline(SQUARE, fixed=17.0).fixed == pytest.approx(1.0)
    assert Polyline(SQUARE, fixed=-1e-17).fixed == 0.0
    assert Circle(fixed=9.0 * math.pi).fixed == pytest.approx(math.pi)


def test_clockwise_corners_are_reversed_behind_the_first() -> None:
    outline = Polyline([SQUARE[0], *SQUARE[:0:-1]])
    np.testing.assert_array_equal(outline.corners, SQUARE)


def test_repeated_corners_count_once_and_the_first_stays_first() -> None:
    kite = [(0.0, 0.0), (2.0, 0.0), (3.0, 1.0), (0.0, 2.0)]
    repeated = [kite[0], *kite[:2], *kite[1:], kite[3], kite[0]]
    np.testing.assert_array_equal(Polyline(repeated).corners, kite)
    np.testing.assert_array_equal(Polyline(repeated[::-1]).corners, kite)
