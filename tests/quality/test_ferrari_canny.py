import math
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial import QhullError

from grasp3d import Contacts, Epsilon, epsilon, epsilon_of_wrenches, force_closure
from grasp3d.errors import ContactError, SettingError
from grasp3d.quality import Status, wrench_problem
from grasp3d.quality.wrenches import span, wrenches
from tests.helpers import grasps, oracles, shapes
from tests.helpers.random_grasps import REGULAR, SHAPES, Shape, random_contacts, regular_contacts
from tests.helpers.tilts import with_normals

ROUNDING = 1e-9
RTOL = 1e-3

seeds = st.integers(0, 100_000)
fingers = st.integers(2, 5)
kinds = st.sampled_from(["total", "per_finger"])
few = settings(max_examples=25, deadline=None)


def overlap(a: Epsilon, b: Epsilon) -> bool:
    """Whether two intervals of bounds overlap."""
    return bool(a.lower <= b.upper + ROUNDING and b.lower <= a.upper + ROUNDING)


def is_valid(result: Epsilon) -> bool:
    """Whether a result is consistent: finite bounds in order, a valid status, matching closure."""
    numbers = (result.lower, result.upper, result.certificate.direction)
    return bool(
        all(np.isfinite(values).all() for values in numbers)
        and (result.lower >= 0.0).all()
        and (result.lower <= result.upper).all()
        and np.isin(result.status, list(Status)).all()
        and ((result.rank >= 0) & (result.rank <= 6)).all()
        and (result.closed == (result.lower > 0.0)).all()
    )


def assert_equal(one: Epsilon, other: Epsilon) -> None:
    for name in ("lower", "upper", "rank", "status", "closed"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(one.certificate.equilibrium, other.certificate.equilibrium)


# Laws


@given(st.integers(3, 4), seeds, kinds, st.sampled_from([None, 5]))
@few
def test_another_contact_never_lowers_epsilon(
    count: int, seed: int, kind: Any, edges: int | None
) -> None:
    more = grasps.random_grasp(count + 1, seed)
    less = grasps.one(more, np.arange(count))
    before, after = (epsilon(c, edges=edges, actuation=kind) for c in (less, more))
    assert before.rank == after.rank == 6
    assert after.upper >= before.lower * (1.0 - ROUNDING) - ROUNDING
    assert after.closed >= before.closed


@given(fingers, seeds, kinds, st.floats(1.0, 3.0))
@few
def test_more_friction_never_lowers_epsilon(
    count: int, seed: int, kind: Any, factor: float
) -> None:
    contacts = grasps.random_grasp(count, seed, soft=count == 2)
    rougher = grasps.changed(contacts, friction=factor * contacts.friction)
    assert epsilon(rougher, actuation=kind).upper >= epsilon(contacts, actuation=kind).lower
    # Polygons grow with friction if the normal components of their edges are fixed.
    before, after = (
        epsilon(c, edges=6, actuation=kind, bounded="normal") for c in (contacts, rougher)
    )
    assert after.value >= before.value - ROUNDING


@given(fingers, seeds, kinds, st.integers(3, 24), st.sampled_from(["force", "normal"]))
@few
def test_polygons_lie_inside_their_circular_cones(
    count: int, seed: int, kind: Any, edges: int, bounded: Any
) -> None:
    contacts = grasps.random_grasp(count, seed, soft=count == 2)
    polygon = epsilon(contacts, edges=edges, actuation=kind, bounded=bounded)
    circle = epsilon(contacts, actuation=kind, bounded=bounded)
    assert polygon.value <= circle.upper * (1.0 + ROUNDING) + ROUNDING


@given(fingers, seeds)
@few
def test_per_finger_limits_resist_more_than_a_total_limit(count: int, seed: int) -> None:
    contacts = grasps.random_grasp(count, seed, soft=count == 2)
    total, each = (epsilon(contacts, edges=6, actuation=k) for k in ("total", "per_finger"))
    assert total.value - ROUNDING <= each.value <= count * total.value + ROUNDING


@given(fingers, seeds, kinds, st.sampled_from([1e-2, 1e-3, 1e-4]))
@few
def test_bounds_are_within_the_tolerance(count: int, seed: int, kind: Any, rtol: float) -> None:
    result = epsilon(grasps.random_grasp(count, seed, soft=count == 2), actuation=kind, rtol=rtol)
    assert is_valid(result)
    assert result.status == Status.CONVERGED
    assert result.upper - result.lower <= rtol * result.upper + ROUNDING


@pytest.mark.slow
@given(fingers, seeds, kinds)
@few
def test_no_direction_has_a_support_below_the_lower_bound(count: int, seed: int, kind: Any) -> None:
    """The support in any direction is an upper bound; tested at random and optimised directions."""
    contacts = grasps.random_grasp(count, seed, soft=count == 2)
    result = epsilon(contacts, actuation=kind)
    basis = span(wrenches(contacts))
    rng = np.random.default_rng(seed)
    starts = [basis @ result.certificate.direction, *rng.normal(size=(6, len(basis)))]

    def support(x: np.ndarray) -> float:
        u = x @ basis / np.linalg.norm(x)
        return oracles.support(contacts, u, actuation=kind)

    for start in starts:
        found = minimize(support, start, method="Nelder-Mead", options={"maxfev": 150})
        assert support(start) >= result.lower * (1.0 - ROUNDING) - ROUNDING
        assert found.fun >= result.lower * (1.0 - ROUNDING) - ROUNDING


# Tilted normals, with `cone_offset`


def tilted_randomly(contacts: Contacts, tilt: float, count: int, seed: int) -> Contacts:
    """A batch of one grasp with normals tilted by up to an angle."""
    rng = np.random.default_rng(seed)
    normals = [[oracles.tilted(n, tilt, rng) for n in contacts.normals] for _ in range(count)]
    return with_normals(contacts, np.array(normals))


@pytest.mark.slow
@given(st.integers(4, 6), seeds, kinds, st.floats(0.0, 0.3))
@few
def test_every_tilt_is_between_epsilon_of_narrower_and_of_wider_cones(
    count: int, seed: int, kind: Any, tilt: float
) -> None:
    """And away from the contacts' velocities in the hardest direction it is the narrower ones'."""
    contacts = grasps.random_grasp(count, seed)
    worst, best = (epsilon(contacts, actuation=kind, cone_offset=a) for a in (-tilt, tilt))
    tilted = epsilon(tilted_randomly(contacts, tilt, 20, seed), actuation=kind)
    assert (tilted.upper >= worst.lower * (1.0 - ROUNDING)).all()
    assert (tilted.lower <= best.upper * (1.0 + ROUNDING) + ROUNDING).all()
    velocities = oracles.velocities(contacts, worst.certificate.direction)
    away = [oracles.turned(n, g, -tilt) for n, g in zip(contacts.normals, velocities, strict=True)]
    tilted = epsilon(with_normals(contacts, np.array(away)), actuation=kind)
    assert tilted.lower <= worst.upper + ROUNDING


@pytest.mark.slow
@given(fingers, seeds, st.floats(0.01, 0.5))
@settings(max_examples=60, deadline=None)
def test_some_tilt_is_closed_exactly_where_wider_cones_are(
    count: int, seed: int, tilt: float
) -> None:
    contacts = grasps.random_grasp(count, seed)
    wider = force_closure(contacts, cone_offset=tilt)
    if wider.closed:
        forces = wider.certificate.equilibrium[:, :3]
        pairs = zip(contacts.normals, forces, strict=True)
        normals = np.array([oracles.turned(n, f, tilt) for n, f in pairs])
        assert force_closure(grasps.changed(contacts, normals=normals)).closed
        return
    assert not force_closure(tilted_randomly(contacts, tilt, 50, seed)).closed.any()


def test_few_contacts_are_not_closed_with_tilts_that_exceed_friction() -> None:
    for name in grasps.REGULAR_SHAPES:
        contacts = grasps.regular_on_ball(name)
        result = epsilon(contacts, cone_offset=-1.5)
        assert not result.closed, name
        assert is_valid(result)


@given(fingers, seeds, kinds, st.sampled_from([None, 6]))
@few
def test_cone_offsets_per_contact_equal_other_friction_coefficients(
    count: int, seed: int, kind: Any, edges: int | None
) -> None:
    contacts = grasps.random_grasp(count, seed)
    rng = np.random.default_rng(seed)
    angles = rng.uniform(0.1, 1.2, size=count)
    other = grasps.changed(contacts, friction=np.tan(angles))
    cone_offset = angles - contacts.friction_angle
    result = epsilon(contacts, cone_offset=cone_offset, edges=edges, actuation=kind)
    expected = epsilon(other, edges=edges, actuation=kind)
    assert overlap(result, expected)
    assert result.closed == expected.closed
    closure = force_closure(contacts, cone_offset=cone_offset, edges=edges)
    assert closure.closed == expected.closed
    # Every grasp of a batch has its own offsets.
    batch = grasps.stacked([contacts, contacts, contacts])
    each = force_closure(
        batch, cone_offset=np.stack([cone_offset, 0.0 * cone_offset, cone_offset]), edges=edges
    )
    middle = force_closure(contacts, edges=edges).closed
    assert each.closed.tolist() == [closure.closed, middle, closure.closed]
    groups = epsilon(batch, cone_offset=cone_offset[None], edges=edges, actuation=kind)
    assert groups.lower == pytest.approx(np.tile(result.lower, 3), rel=1e-9)


def test_a_contact_whose_tilt_exceeds_its_friction_prevents_closure() -> None:
    contacts = grasps.regular_on_ball("triangle")
    assert force_closure(contacts, cone_offset=[-0.1, -0.1, -0.1]).closed
    result = force_closure(contacts, cone_offset=[-0.1, -0.5, -0.1])
    assert not result.closed
    assert np.isnan(result.certificate.equilibrium).all()
    # The other three are force-closed, but the fourth may push against them.
    four = Contacts(
        np.vstack([contacts.points, [0, 0, 1]]), np.vstack([contacts.normals, [0, 0, -1]]), 0.5
    )
    for solve in (force_closure, epsilon):
        result = solve(four, cone_offset=[-0.1, -0.1, -0.1, -0.5])
        assert not result.closed
        assert result.status == Status.UNDECIDED


@given(fingers, seeds, st.floats(0.3, 1.5))
@few
def test_cones_of_90_degrees_and_more_have_no_equilibrium_forces(
    count: int, seed: int, cone_offset: float
) -> None:
    """They are not convex: sums of forces inside them may lie outside."""
    contacts = grasps.random_grasp(count, seed)
    one_wide = np.where(np.arange(count) == 0, cone_offset, 0.0)
    for more in (cone_offset, one_wide):
        result = force_closure(contacts, cone_offset=more)
        angles = contacts.friction_angle + more
        if (angles >= math.pi / 2.0).any():
            assert np.isnan(result.certificate.equilibrium).all()
        elif result.closed:
            pushes = result.certificate.equilibrium[:, :3]
            pairs = zip(pushes, contacts.normals, angles, strict=True)
            assert all(oracles.angle(push, n) < angle for push, n, angle in pairs)


# Certificates, verified by linear algebra


def check_equilibrium(contacts: Contacts, forces: np.ndarray, cone_offset: float = 0.0) -> None:
    pushes, moments = forces[:, :3], forces[:, 3]
    lengths = np.linalg.norm(pushes, axis=1)
    assert (lengths > 0.0).all()
    assert lengths.sum() == pytest.approx(1.0)
    size = np.linalg.norm(contacts.points, axis=1).max() + contacts.torsion_radius.max()
    torque = np.cross(contacts.points, pushes) + moments[:, None] * contacts.normals
    assert np.linalg.norm(pushes.sum(axis=0)) <= 1e-8
    assert np.linalg.norm(torque.sum(axis=0)) <= 1e-8 * size
    for i, push in enumerate(pushes):
        beta = max(float(contacts.friction_angle[i]) + cone_offset, 0.0)
        angle = oracles.angle(push, contacts.normals[i])
        assert angle < beta or max(angle, beta) <= 1e-12  # frictionless: along the normal
        if contacts.torsion_radius[i] == 0.0:
            assert moments[i] == 0.0
            continue
        normal = float(push @ contacts.normals[i])
        sideways = float(np.linalg.norm(push - normal * contacts.normals[i]))
        used = math.hypot(sideways / math.tan(beta), moments[i] / contacts.torsion_radius[i])
        assert used <= normal * (1.0 + ROUNDING)


def check_certificate(
    contacts: Contacts, result: Any, *, edges: int | None = None, cone_offset: float = 0.0
) -> None:
    """Verify forces in equilibrium, or a direction along which no wrench has a component."""
    direction, forces = result.certificate.direction, result.certificate.equilibrium
    if result.closed:
        check_equilibrium(contacts, forces, cone_offset)
        return
    assert np.isnan(forces).all()
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    if edges:
        largest = float((wrenches(contacts, edges=edges) @ direction).max())
    else:
        largest = oracles.support(contacts, direction, cone_offset=cone_offset)
    # Undecided: the interval is narrower than 1e4 tolerances of 1e-12 of the wrenches.
    assert largest <= (1e-7 if result.status == Status.UNDECIDED else ROUNDING)


@given(fingers, seeds, st.sampled_from([None, 4, 9]), st.booleans())
@settings(max_examples=80, deadline=None)
def test_certificates_prove_closure(count: int, seed: int, edges: int | None, soft: bool) -> None:
    contacts = grasps.random_grasp(count, seed, soft=soft)
    check_certificate(contacts, force_closure(contacts, edges=edges), edges=edges)


@given(fingers, seeds, kinds, st.sampled_from([None, 4, 9]), st.booleans())
@settings(max_examples=80, deadline=None)
def test_certificates_prove_epsilon(
    count: int, seed: int, kind: Any, edges: int | None, soft: bool
) -> None:
    contacts = grasps.random_grasp(count, seed, soft=soft)
    result = epsilon(contacts, edges=edges, actuation=kind)
    check_certificate(contacts, result, edges=edges)
    if result.closed:
        direction = result.certificate.direction
        assert np.linalg.norm(direction) == pytest.approx(1.0)
        if edges:
            bodies = wrenches(contacts, edges=edges).reshape(count, -1, 6) @ direction
            largest = bodies.max(axis=1).clip(0.0)
            support = largest.max() if kind == "total" else largest.sum()
        else:
            support = oracles.support(contacts, direction, actuation=kind)
        assert support == pytest.approx(result.upper, abs=ROUNDING)


@given(fingers, seeds, st.floats(-0.3, 0.3))
@few
def test_certificates_are_valid_for_other_cones(count: int, seed: int, cone_offset: float) -> None:
    contacts = grasps.random_grasp(count, seed)
    check_certificate(
        contacts, force_closure(contacts, cone_offset=cone_offset), cone_offset=cone_offset
    )


@given(fingers, seeds, st.sampled_from([1e-6, 1e-3, 1.0, 1e6]))
@few
def test_certificates_are_valid_far_from_the_origin(count: int, seed: int, unit: float) -> None:
    contacts = grasps.random_grasp(count, seed)
    far = grasps.changed(contacts, points=unit * (contacts.points + 1e3))
    closure = force_closure(far)
    assert closure.closed == force_closure(contacts).closed
    if closure.closed:
        check_certificate(far, closure)


@pytest.mark.parametrize("name", grasps.REGULAR_SHAPES)
@pytest.mark.parametrize("edges", [None, 3, 4, 8, 9])
@pytest.mark.parametrize("torsion_radius", [0.0, 0.1])
def test_certificates_of_regular_grasps_are_valid(
    name: str, edges: int | None, torsion_radius: float
) -> None:
    contacts = grasps.regular_on_ball(name, torsion_radius=torsion_radius)
    check_certificate(contacts, force_closure(contacts, edges=edges), edges=edges)
    check_certificate(contacts, epsilon(contacts, edges=edges), edges=edges)


def test_certificates_of_given_wrenches_are_valid() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        rows = rng.normal(size=(14, 6)) + rng.normal(size=6) * 0.4
        result = epsilon_of_wrenches(rows)
        weights, direction = result.certificate.equilibrium, result.certificate.direction
        if result.closed:
            assert weights.shape == (14,)
            assert (weights >= 0.0).all()
            assert weights.sum() == pytest.approx(1.0)
            np.testing.assert_allclose(weights @ rows, 0.0, atol=1e-8)
            assert (rows @ direction).max() == pytest.approx(result.upper, abs=ROUNDING)
        else:
            assert np.isnan(weights).all()
            assert (rows @ direction).max() <= ROUNDING


# Oracles


def test_polygons_equal_those_of_the_reference() -> None:
    for case in grasps.reference("epsilon.json"):
        contacts = grasps.of_case(case)
        for kind, expected in (("total", case["epsilon_l1"]), ("per_finger", case["epsilon_linf"])):
            result = epsilon(
                contacts, edges=case["edges"], actuation=kind, torque_scale=case["torque_scale"]
            )
            assert result.rank == case["rank"], case["id"]
            assert result.closed == case["force_closure"], case["id"]
            if expected is not None:
                assert result.value == pytest.approx(expected, abs=ROUNDING), case["id"]
        assert force_closure(contacts, edges=case["edges"]).closed == case["force_closure"]


def test_circular_cones_agree_with_the_reference() -> None:
    for case in grasps.reference("epsilon.json"):
        if case["circular_cone"] is None:
            continue
        for kind, bounds in (("total", "l1"), ("per_finger", "linf")):
            low, high = case["circular_cone"][bounds]
            result = epsilon(
                grasps.of_case(case), actuation=kind, torque_scale=case["torque_scale"]
            )
            common = result.lower <= high + ROUNDING and low <= result.upper + ROUNDING
            assert common or max(result.lower, low) < 2e-5, case["id"]


def test_regular_wrenches_equal_those_of_the_reference() -> None:
    for case in grasps.reference("regular.json"):
        result = epsilon_of_wrenches(case["wrenches"])
        assert result.value == pytest.approx(case["epsilon_l1"], abs=1e-8), case["id"]


def test_wrenches_with_which_a_simpler_algorithm_did_not_end() -> None:
    rows = np.loadtxt(shapes.shared("reference", "looped_for_ever.csv"), delimiter=",")
    result = epsilon_of_wrenches(rows)
    assert is_valid(result)
    assert result.value == pytest.approx(1.0 / math.sqrt(3.0), abs=1e-8)


COUNTS = [
    pytest.param(shape, 60, marks=pytest.mark.slow)
    if shape.contacts * shape.edges > 45
    else pytest.param(shape, 500)
    for shape in SHAPES
]


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "count"), COUNTS, ids=str)
def test_against_qhull_on_random_grasps(shape: Shape, count: int) -> None:
    contacts = random_contacts(shape, count, seed=7)
    results = epsilon(contacts, edges=shape.edges)
    rows = wrenches(contacts, edges=shape.edges)
    assert 0.1 < results.closed.mean() < 0.95
    for i in range(count):
        distance = oracles.epsilon_of_hull(rows[i])
        assert results.closed[i] == (distance > 0.0) or abs(distance) < ROUNDING
        assert results.value[i] == pytest.approx(max(distance, 0.0), abs=ROUNDING)


@pytest.mark.parametrize("noise", [0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("name", REGULAR)
def test_against_qhull_on_regular_grasps(name: str, noise: float) -> None:
    contacts = regular_contacts(name, 12, noise, seed=1)
    results = epsilon(contacts, edges=8)
    rows = wrenches(contacts, edges=8)
    assert is_valid(results)
    failures = 0
    for i in range(12):
        try:
            distance = oracles.epsilon_of_hull(rows[i])
        except QhullError:
            failures += 1
            continue
        assert results.value[i] == pytest.approx(max(distance, 0.0), abs=ROUNDING)
    assert failures < 12


@pytest.mark.slow
@pytest.mark.parametrize(("count", "edges", "soft"), [(2, 4, True), (2, 8, True), (3, 4, False)])
def test_against_qhull_on_minkowski_sums(count: int, edges: int, soft: bool) -> None:
    contacts = random_contacts(Shape(count, edges, soft=soft), 20, seed=3)
    results = epsilon(contacts, edges=edges, actuation="per_finger")
    rows = wrenches(contacts, edges=edges).reshape(20, count, -1, 6)
    assert results.closed.any()
    for i in range(20):
        distance = oracles.epsilon_of_hull(oracles.minkowski_sum(rows[i]))
        assert results.value[i] == pytest.approx(max(distance, 0.0), abs=ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("edges", [3, 4, 8])
def test_closure_against_a_linear_program(edges: int) -> None:
    for seed in range(60):
        contacts = grasps.random_grasp(2 + seed % 4, seed)
        rows = wrenches(contacts, edges=edges)
        inside = oracles.hull_contains_origin(rows @ span(rows).T)
        assert force_closure(contacts, edges=edges).closed == inside


# Known grasps


@pytest.mark.parametrize(("phase", "expected"), [(0, 0.27592), (11.25, 0.27319), (22.5, 0.26674)])
def test_three_fingers_at_120_degrees(phase: float, expected: float) -> None:
    """A published value for unit normal components; it depends on the phase of the edges."""
    contacts = Contacts(0.03 * grasps.TRIANGLE, -grasps.TRIANGLE, 0.5)
    result = epsilon(
        contacts, edges=8, bounded="normal", torque_scale=0.03, phase=math.radians(phase)
    )
    assert result.value == pytest.approx(expected, abs=1e-5)


def test_wrenches_in_the_plane() -> None:
    square = [[1, 1, 0.3], [1, -1, -0.3], [-1, 1, -0.3], [-1, -1, 0.3]]
    flat = epsilon_of_wrenches(square)
    embedded = epsilon_of_wrenches(np.insert(np.array(square), [2, 2, 2], 0.0, axis=1))
    assert flat.rank == 3
    assert flat.value == embedded.value > 0.0
    assert flat.certificate.direction.shape == (6,)
    assert flat.certificate.direction[2:5].tolist() == [0.0, 0.0, 0.0]
    assert flat.value == pytest.approx(oracles.epsilon_of_hull(np.array(square)), abs=1e-12)


def test_soft_fingers_resist_the_torque_about_their_line() -> None:
    hard, soft = (grasps.regular_on_ball("pair", torsion_radius=e) for e in (0.0, 0.1))
    assert (epsilon(hard).rank, epsilon(soft).rank) == (5, 6)
    assert epsilon(soft).value < epsilon(hard).value


def test_cones_of_soft_fingers_stay_below_90_degrees() -> None:
    soft = grasps.regular_on_ball("triangle", torsion_radius=0.1)
    for solve in (epsilon, force_closure):
        with pytest.raises(SettingError, match="those of soft fingers, must stay below 90 degrees"):
            solve(soft, cone_offset=1.2)


@pytest.mark.parametrize("friction", [0.3, 0.8])
@pytest.mark.parametrize("part", [0.1, 0.5])
def test_two_opposed_soft_fingers_have_a_closed_form(friction: float, part: float) -> None:
    """A pure twist about their line is hardest to resist where e is at most half of mu.

    With forces of both up to 1 in total it takes e; with each up to 1 twice that, or less where a
    force along the line is added, which either finger alone resists.
    """
    radius = part * friction
    contacts = grasps.regular_on_ball("pair", friction=friction, torsion_radius=radius)
    for kind, expected in (("total", radius), ("per_finger", 2.0 * radius / math.hypot(1, radius))):
        found = epsilon(contacts, actuation=kind, bounded="normal")  # type: ignore[arg-type]
        assert found.rank == 6
        assert found.lower <= expected * (1.0 + ROUNDING)
        assert found.upper >= expected * (1.0 - ROUNDING)
        assert found.upper - found.lower <= RTOL * found.upper + ROUNDING


def on_limit_surfaces(contacts: Contacts, bounded: str) -> np.ndarray:
    """Wrenches on the elliptic limit surfaces of contacts, densely sampled (n, m, 6)."""
    around, upward = np.meshgrid(np.arange(16) * math.pi / 8.0, np.arange(-4, 5) * math.pi / 8.0)
    sides, twists = np.cos(upward).ravel(), np.sin(upward).ravel()
    bodies = []
    for p, n, mu, e in zip(*(getattr(contacts, name) for name in grasps.NAMES), strict=True):
        first, second = np.linalg.svd(n[None])[2][1:]
        across = np.outer(np.cos(around), first) + np.outer(np.sin(around), second)
        forces = n + mu * sides[:, None] * across
        moments = e * twists[:, None] * n
        size = np.linalg.norm(forces, axis=1, keepdims=True) if bounded == "force" else 1.0
        bodies.append(np.hstack([forces, np.cross(p, forces) + moments]) / size)
    return np.array(bodies)


@pytest.mark.parametrize("bounded", ["force", "normal"])
def test_soft_fingers_against_qhull_on_points_of_their_limit_surfaces(bounded: Any) -> None:
    """From inside: with steps of 22.5 degrees the points' hull is up to a sixth smaller."""
    contacts = random_contacts(Shape(2, 8, soft=True), 6, seed=3)
    for grasp in (grasps.one(contacts, g) for g in range(6)):
        inner = oracles.epsilon_of_hull(on_limit_surfaces(grasp, bounded).reshape(-1, 6))
        found = epsilon(grasp, bounded=bounded)
        assert found.closed == (inner > 0.0)
        assert max(inner, 0.0) <= found.upper + ROUNDING
        assert found.lower <= 1.2 * max(inner, 0.0)


@given(fingers, seeds, kinds, st.sampled_from(["force", "normal"]), st.floats(1.0, 3.0))
@few
def test_more_torsion_never_lowers_epsilon(
    count: int, seed: int, kind: Any, bounded: Any, factor: float
) -> None:
    contacts = grasps.random_grasp(count, seed, soft=True)
    softer = grasps.changed(contacts, torsion_radius=factor * contacts.torsion_radius)
    before, after = (epsilon(c, actuation=kind, bounded=bounded) for c in (contacts, softer))
    assert after.upper >= before.lower
    assert after.closed >= before.closed


@given(st.integers(3, 5), seeds, kinds)
@few
def test_without_torsion_soft_fingers_are_hard(count: int, seed: int, kind: Any) -> None:
    hard = grasps.random_grasp(count, seed)
    nearly = grasps.changed(hard, torsion_radius=1e-9)
    before, after = (epsilon(c, actuation=kind) for c in (hard, nearly))
    assert after.upper >= before.lower
    assert after.lower <= before.upper + count * 2e-9


@pytest.mark.parametrize("edges", [None, 8])
def test_parallel_normals_are_never_force_closed(edges: int | None) -> None:
    points = [[1, 0, 0], [0, 1, 0], [-1, -1, 0]]
    contacts = Contacts(points, [[0, 0, 1.0]] * 3, [0.1, 0.5, 0.9])
    result = epsilon(contacts, edges=edges)
    assert not result.closed
    check_certificate(contacts, result, edges=edges)


@pytest.mark.parametrize("count", [1, 2, 3, 6])
@pytest.mark.parametrize("kind", ["total", "per_finger"])
def test_frictionless_parallel_normals_are_never_force_closed(count: int, kind: Any) -> None:
    points = np.array([[1, 0, 0], [0, 1, 0], [-1, -1, 0], [2, 0, 0], [0, 2, 0], [3, 1, 0]])[:count]
    contacts = Contacts(points, [[0, 0, 1.0]] * count, 0.0)
    assert epsilon(contacts, actuation=kind).value == 0.0
    assert not epsilon(contacts, actuation=kind).closed
    assert not force_closure(contacts).closed
    assert not force_closure(grasps.changed(contacts, friction=0.2), cone_offset=-0.2).closed


# Batches


def test_a_batch_of_any_shape_equals_its_grasps_one_by_one() -> None:
    flat = random_contacts(Shape(3, 8, soft=False), 24, seed=5)
    many = flat.reshape((2, 3, 4))
    functions: list[Callable[[Contacts], Any]] = [
        epsilon,
        lambda c: epsilon(c, edges=8, actuation="per_finger"),
        force_closure,
    ]
    for function in functions:
        together = function(many)
        assert together.closed.shape == (2, 3, 4)
        assert together.certificate.direction.shape == (2, 3, 4, 6)
        assert together.certificate.equilibrium.shape == (2, 3, 4, 3, 4)
        for index in np.ndindex(2, 3, 4):
            alone = function(grasps.one(many, *index))
            for name in ("lower", "upper", "rank", "status", "closed"):
                if hasattr(alone, name):
                    expected = pytest.approx(getattr(alone, name), abs=1e-13)
                    assert getattr(together, name)[index] == expected
            missing = np.isnan(together.certificate.equilibrium[index]).any()
            assert missing == np.isnan(alone.certificate.equilibrium).any()
            np.testing.assert_allclose(  # rounding of vectorised code depends on the index
                together.certificate.direction[index], alone.certificate.direction, atol=1e-13
            )


# Degenerate grasps: always a result, never a warning

AT_ONE_POINT = Contacts([[1.0, 2.0, 3.0]] * 3, [[1, 0, 0], [0, 1, 0], [-1, -1, 1]], 0.5)
PLANE = Contacts([[1, 0, 0], [0, 1, 0], [-1, -1, 0]], [[0, 0, 1.0]] * 3, 0.5)
RIGHT_AT = math.atan(0.5)
DEGENERATE = {
    "one": Contacts([[1.0, 0.0, 0.0]], [[-1.0, 0.0, 0.0]]),
    "one soft": Contacts([[1.0, 0.0, 0.0]], [[-1.0, 0.0, 0.0]], 0.5, 0.1),
    "one at the centre": Contacts([[0.0, 0.0, 0.0]], [[-1.0, 0.0, 0.0]]),
    "one soft at the centre": Contacts([[0.0, 0.0, 0.0]], [[-1.0, 0.0, 0.0]], 0.5, 0.1),
    "two at the centre": Contacts([[0.0, 0.0, 0.0]] * 2, [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
    "three at one point": AT_ONE_POINT,
    "the same contact twice": Contacts([[1.0, 2.0, 3.0]] * 2, [[1.0, 0.0, 0.0]] * 2),
    "on a line": grasps.LINE,
    "on a line off the centre": grasps.changed(grasps.LINE, points=grasps.LINE.points + 1),
    "on a line, soft": grasps.changed(grasps.LINE, torsion_radius=0.1),
    "in a plane": PLANE,
    "in a plane, frictionless": grasps.changed(PLANE, friction=0.0),
    "exactly critical": Contacts(
        grasps.PAIR,
        [[-math.cos(RIGHT_AT), math.sin(RIGHT_AT), 0], [math.cos(RIGHT_AT), math.sin(RIGHT_AT), 0]],
    ),
    "triangle doubled": Contacts(
        np.repeat(grasps.TRIANGLE, 2, axis=0), -np.repeat(grasps.TRIANGLE, 2, axis=0)
    ),
}
for _name in grasps.REGULAR_SHAPES:
    _contacts = grasps.regular_on_ball(_name)
    DEGENERATE[_name] = _contacts
    for _friction in (0.0, 1e-12, 1e-6, 1e3, 1e7):
        DEGENERATE[f"{_name}, friction {_friction:g}"] = grasps.changed(
            _contacts, friction=_friction
        )
    for _arm in (1e-9, 1e9):
        DEGENERATE[f"{_name}, arms {_arm:g}"] = grasps.changed(
            _contacts, points=_arm * _contacts.points
        )
for _gap in (1e-11, 1e-9, 1e-8, 1e-6, 1e-4):
    DEGENERATE[f"off a line by {_gap:g}"] = grasps.just_off_a_line(_gap)


def bound_on_epsilon(contacts: Contacts, kind: str, bounded: str, cone_offset: float) -> float:
    """Upper bound on epsilon from the unit forces and torques projected onto the span."""
    basis = span(wrenches(contacts))
    projected = np.eye(6) @ basis.T @ basis
    lengths = np.linalg.norm(projected, axis=1)
    bounds = [
        oracles.support(contacts, sign * u, cone_offset=cone_offset, actuation=kind)
        for u in projected[lengths > 0.1] / lengths[lengths > 0.1, None]
        for sign in (1.0, -1.0)
    ]
    wide = math.tan(float(contacts.friction_angle.max()))
    return min(bounds) * (math.hypot(1.0, wide) if bounded == "normal" else 1.0)


VARIANTS: list[dict[str, Any]] = [
    {"actuation": kind, "bounded": bounded, "cone_offset": cone_offset}
    for kind in ("total", "per_finger")
    for bounded in ("force", "normal")
    for cone_offset in (0.0, -0.1)
]


def variants(contacts: Contacts) -> list[dict[str, Any]]:
    """Options that are accepted: unit normal components are refused at extreme friction."""
    steep = (contacts.friction > 1e6).any()
    return [options for options in VARIANTS if not (steep and options["bounded"] == "normal")]


def test_unit_normal_components_are_refused_at_extreme_friction() -> None:
    with pytest.raises(SettingError, match="friction must stay below 1e\\+06"):
        epsilon(grasps.regular_on_ball("pair", friction=1e9), bounded="normal")


@pytest.mark.slow
@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_grasps_have_valid_results(name: str) -> None:
    contacts = DEGENERATE[name]
    for edges in (None, 3, 4, 8):
        check_certificate(contacts, force_closure(contacts, edges=edges), edges=edges)
    for options in variants(contacts):
        bound = bound_on_epsilon(
            contacts, options["actuation"], options["bounded"], options["cone_offset"]
        )
        for edges in (None, 3, 4, 8):
            result = epsilon(contacts, edges=edges, **options)
            case = f"{name}, edges={edges}, {options}: {result}"
            assert is_valid(result), case
            assert result.lower <= bound * (1.0 + ROUNDING) + 1e-11, case
            missing = np.isnan(result.certificate.equilibrium).any()
            assert not (result.closed and missing), case


@pytest.mark.parametrize("gap", [1e-11, 1e-9, 1e-8, 1e-7, 1e-6, 1e-4])
def test_just_off_a_line_the_lower_bound_is_certified(gap: float) -> None:
    """At rank 6 the torque about the line bounds epsilon."""
    contacts = grasps.just_off_a_line(gap)
    about_the_line = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    bounded: Any
    for bounded in ("force", "normal"):
        for edges in (3, 4, 8, 12, 16):
            result = epsilon(contacts, edges=edges, bounded=bounded)
            rows = wrenches(contacts, edges=edges, bounded=bounded)
            if result.rank == 6:
                assert result.lower <= (rows @ about_the_line).max() + 1e-11, (edges, bounded)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4])
@pytest.mark.parametrize("name", grasps.REGULAR_SHAPES)
def test_regular_grasps_with_noise_have_valid_results_near_the_regular_one(
    name: str, noise: float
) -> None:
    rng = np.random.default_rng(1)
    exact = grasps.REGULAR_SHAPES[name]
    points = exact + noise * rng.normal(size=(8, *exact.shape))
    normals = -exact + noise * rng.normal(size=(8, *exact.shape))
    noisy = Contacts(points, normals, 0.5, 0.1)
    regular = grasps.regular_on_ball(name, torsion_radius=0.1)
    for edges in (None, 4, 8):
        results, expected = epsilon(noisy, edges=edges), epsilon(regular, edges=edges)
        assert is_valid(results)
        near = 20.0 * noise + ROUNDING
        assert (results.lower <= expected.upper + near).all()
        assert (results.upper >= expected.lower - near).all()


@pytest.mark.parametrize("name", grasps.REGULAR_SHAPES)
@pytest.mark.parametrize("kind", ["total", "per_finger"])
def test_circular_cones_of_regular_hard_grasps_converge(name: str, kind: Any) -> None:
    result = epsilon(grasps.regular_on_ball(name), actuation=kind)
    assert result.status == Status.CONVERGED
    assert result.upper - result.lower <= RTOL * result.upper
    assert result.closed
    polygon = epsilon(grasps.regular_on_ball(name), edges=24, actuation=kind)
    assert result.upper >= polygon.value - 1e-12
    assert result.lower < 1.2 * polygon.value


def test_a_grasp_with_the_origin_on_the_hull_is_not_force_closed() -> None:
    simplex = np.vstack([np.eye(6), -np.ones((1, 6))])
    on_a_facet = simplex - simplex[:6].mean(axis=0)
    on_a_corner = simplex - simplex[0]
    for rows in (on_a_facet, on_a_corner):
        result = epsilon_of_wrenches(rows)
        assert is_valid(result)
        assert not result.closed
        assert result.upper < 1e-8


def test_zero_wrenches() -> None:
    result = epsilon_of_wrenches(np.zeros((2, 5, 6)))
    assert result.rank.tolist() == [0, 0]
    assert result.upper.tolist() == [0.0, 0.0]
    assert is_valid(result)


def test_duplicated_rows_do_not_change_epsilon() -> None:
    rows = wrenches(grasps.regular_on_ball("triangle"), edges=8)
    rng = np.random.default_rng(0)
    for noise in (0.0, 1e-16, 1e-14, 1e-12):
        doubled = np.vstack([rows, rows]) + noise * rng.normal(size=(2 * len(rows), 6))
        result = epsilon_of_wrenches(doubled)
        assert is_valid(result)
        assert result.value == pytest.approx(epsilon_of_wrenches(rows).value, abs=1e-9)


# Capacity of the polytope


@pytest.fixture
def set_capacity(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, int], None]:
    """Sets the initial and the largest capacity of polytopes; the thread's own is discarded."""

    def set_capacities(first: int, last: int) -> None:
        monkeypatch.setattr(wrench_problem, "INITIAL_FACETS", first)
        monkeypatch.setattr(wrench_problem, "MAX_FACETS", last)
        monkeypatch.setattr(wrench_problem, "_local", threading.local())

    return set_capacities


def test_a_hull_that_exceeds_its_capacity_gets_a_larger_polytope(
    set_capacity: Callable[[int, int], None],
) -> None:
    contacts = random_contacts(Shape(4, 8, soft=False), 40, seed=0)
    usual = epsilon(contacts)
    set_capacity(16, 1 << 18)
    assert_equal(usual, epsilon(contacts))


@pytest.mark.parametrize("name", ["triangle", "tetrahedron"])
@pytest.mark.parametrize("last", [64, 256, 1024])
def test_a_hull_that_exceeds_the_largest_capacity_is_exhausted_with_valid_bounds(
    name: str, last: int, set_capacity: Callable[[int, int], None]
) -> None:
    contacts = grasps.regular_on_ball(name)
    usual = epsilon(contacts, rtol=1e-3)
    set_capacity(32, last)
    result = epsilon(grasps.stacked([contacts, contacts]), rtol=1e-6)
    assert result.status.tolist() == [Status.EXHAUSTED] * 2
    assert is_valid(result)
    assert (result.lower <= usual.upper).all()
    assert (usual.lower <= result.upper).all()
    assert result.lower[0] == result.lower[1]
    if last == 1024:
        assert result.closed.all()
        check_certificate(contacts, epsilon(contacts, rtol=1e-6))


# Errors

TRIPLE = grasps.regular_on_ball("triangle")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"edges": 2}, "at least 3 edges, a whole number; got 2"),
        ({"edges": 8, "phase": math.nan}, "phase of the edges must be finite; got nan"),
        ({"actuation": "both"}, "no actuation is called 'both'; known: total, per_finger"),
        ({"torque_scale": 0.0}, "torque_scale must be a finite length above 0; got 0"),
        ({"rtol": 0.0}, "rtol must lie between 0 and 1; got 0"),
        ({"bounded": "length"}, "no bound is called 'length'; known: force, normal"),
        ({"edges": 8, "cone_offset": 1.2}, "polygonal friction cones, and those of soft fingers, "),
        ({"cone_offset": math.nan}, "cone_offset must be"),
        (
            {"cone_offset": [0.1, 0.2]},
            r"cone_offset must be one number or have shape \(.*3,?\); got \(2,\)",
        ),
    ],
)
def test_settings_out_of_range_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        epsilon(TRIPLE, **options)
    if set(options) <= {"edges", "cone_offset", "phase"}:
        with pytest.raises(SettingError, match=message):
            force_closure(TRIPLE, **options)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("wrenches", "wrenches must be an array of numbers"),
        (np.zeros((4, 5)), r"wrenches must have shape .*; got \(4, 5\)"),
        ([[0.0] * 6, [0, 0, 0, math.inf, 0, 0]], r"wrenches must be finite; inf at \(1, 3\)"),
    ],
)
def test_invalid_wrenches_are_refused(rows: Any, message: str) -> None:
    with pytest.raises(ContactError, match=message):
        epsilon_of_wrenches(rows)


def test_grasps_of_any_rank_share_a_batch() -> None:
    """Where three contacts are on a line, their wrenches have rank 5, which has its own kernel."""
    rng = np.random.default_rng(3)
    points = rng.normal(size=(12, 3, 3))
    points[[4, 5, 9]] = np.linspace(-1.0, 1.5, 3)[:, None] * rng.normal(size=(3, 1, 3))
    normals = -points / np.linalg.norm(points, axis=-1, keepdims=True)
    normals[[4, 5, 9], 1] = np.array([0.6, 0.0, 0.8])
    contacts = Contacts(points, normals, 1.5)
    batch = epsilon(contacts, edges=8)
    assert set(batch.rank) == {5, 6}
    for g in range(12):
        alone = epsilon(Contacts(points[g], normals[g], 1.5), edges=8)
        assert (alone.lower, alone.upper) == (batch.lower[g], batch.upper[g])
