import itertools
import math
import threading
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial import QhullError

from grasp3d import Contacts, Epsilon, epsilon, epsilon_of_wrenches, force_closure
from grasp3d.errors import ContactError, SettingError
from grasp3d.quality import Status, wrench_problem
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.quality.wrenches import span, wrenches
from tests.helpers import grasps, oracles, shapes
from tests.helpers.random_grasps import REGULAR, SHAPES, Shape, random_contacts, regular_contacts

ROUNDING = 1e-9
RTOL = 1e-3

seeds = st.integers(0, 100_000)
fingers = st.integers(2, 5)
kinds = st.sampled_from(["total", "per_finger"])
few = settings(max_examples=25, deadline=None)


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


@given(fingers, seeds, kinds, st.sampled_from([1e-2, 1e-3, 1e-4]))
@few
def test_bounds_are_within_the_tolerance(count: int, seed: int, kind: Any, rtol: float) -> None:
    result = epsilon(grasps.random_grasp(count, seed, soft=count == 2), actuation=kind, rtol=rtol)
    assert is_valid(result)
    assert result.status == Status.CONVERGED
    assert result.upper - result.lower <= rtol * result.upper + ROUNDING


@pytest.mark.slow
@given(fingers, seeds, kinds, st.booleans())
@settings(max_examples=15, deadline=None)
def test_no_direction_has_a_support_below_the_lower_bound(
    count: int, seed: int, kind: Any, soft: bool
) -> None:
    """The support in any direction is an upper bound; tested at random and optimised directions."""
    contacts = grasps.random_grasp(count, seed, soft=soft)
    result = epsilon(contacts, actuation=kind)
    basis = span(wrenches(contacts))
    rng = np.random.default_rng(seed)
    starts = [basis @ result.certificate.direction, *rng.normal(size=(3, len(basis)))]

    def support(x: np.ndarray) -> float:
        u = x @ basis / np.linalg.norm(x)
        return oracles.support(contacts, u, actuation=kind)

    for start in starts:
        found = minimize(support, start, method="Nelder-Mead", options={"maxfev": 150})
        assert support(start) >= result.lower * (1.0 - ROUNDING) - ROUNDING
        assert found.fun >= result.lower * (1.0 - ROUNDING) - ROUNDING


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
    assert result.lower <= expected.upper + ROUNDING
    assert expected.lower <= result.upper + ROUNDING
    assert result.closed == expected.closed
    # Every grasp of a batch has its own offsets.
    each = force_closure(
        grasps.stacked([contacts, contacts]),
        cone_offset=np.stack([cone_offset, 0.0 * cone_offset]), edges=edges,
    )  # fmt: skip
    assert each.closed.tolist() == [expected.closed, force_closure(contacts, edges=edges).closed]


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


@given(fingers, seeds, st.sampled_from([None, 4, 9]), st.booleans(), st.floats(-0.3, 0.3))
@settings(max_examples=80, deadline=None)
def test_certificates_prove_closure(
    count: int, seed: int, edges: int | None, soft: bool, cone_offset: float
) -> None:
    contacts = grasps.random_grasp(count, seed, soft=soft)
    check_certificate(contacts, force_closure(contacts, edges=edges), edges=edges)
    hard = grasps.changed(contacts, torsion_radius=0.0)
    check_certificate(hard, force_closure(hard, cone_offset=cone_offset), cone_offset=cone_offset)


@given(fingers, seeds, kinds, st.sampled_from([None, 4, 9]), st.booleans())
@settings(max_examples=80, deadline=None)
def test_certificates_prove_epsilon(
    count: int, seed: int, kind: Any, edges: int | None, soft: bool
) -> None:
    """The support in the direction of the certificate is the upper bound."""
    contacts = grasps.random_grasp(count, seed, soft=soft)
    result = epsilon(contacts, edges=edges, actuation=kind)
    check_certificate(contacts, result, edges=edges)
    if not result.closed:
        return
    direction = result.certificate.direction
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    support = oracles.support(contacts, direction, actuation=kind)
    if edges:
        bodies = wrenches(contacts, edges=edges).reshape(count, -1, 6) @ direction
        largest = bodies.max(axis=1).clip(0.0)
        support = largest.max() if kind == "total" else largest.sum()
    assert support == pytest.approx(result.upper, abs=ROUNDING)


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


ACTUATIONS: list[tuple[Any, str, str]] = [
    ("total", "epsilon_l1", "l1"),
    ("per_finger", "epsilon_linf", "linf"),
]


@pytest.mark.parametrize(("kind", "of_polygons", "of_circles"), ACTUATIONS)
def test_values_agree_with_the_reference(kind: Any, of_polygons: str, of_circles: str) -> None:
    for case in grasps.reference("epsilon.json"):
        contacts, scale = grasps.of_case(case), case["torque_scale"]
        result = epsilon(contacts, edges=case["edges"], actuation=kind, torque_scale=scale)
        assert (result.rank, result.closed) == (case["rank"], case["force_closure"]), case["id"]
        assert force_closure(contacts, edges=case["edges"]).closed == case["force_closure"]
        if case[of_polygons] is not None:
            assert result.value == pytest.approx(case[of_polygons], abs=ROUNDING), case["id"]
        if case["circular_cone"] is not None:
            low, high = case["circular_cone"][of_circles]
            result = epsilon(contacts, actuation=kind, torque_scale=scale)
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


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_against_qhull_on_random_grasps(shape: Shape) -> None:
    count = 200 if shape.contacts * shape.edges <= 32 else 20  # Qhull takes long
    contacts = random_contacts(shape, count, seed=7)
    results = epsilon(contacts, edges=shape.edges)
    rows = wrenches(contacts, edges=shape.edges)
    assert 0.1 < results.closed.mean() < 0.95
    for i in range(count):
        distance = oracles.epsilon_of_hull(rows[i])
        assert results.closed[i] == (distance > 0.0) or abs(distance) < ROUNDING
        assert results.value[i] == pytest.approx(max(distance, 0.0), abs=ROUNDING)


@pytest.mark.parametrize("noise", [0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4])
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


@pytest.mark.parametrize("friction", [0.3, 0.8])
@pytest.mark.parametrize("part", [0.1, 0.5])
def test_two_opposed_soft_fingers_have_a_closed_form(friction: float, part: float) -> None:
    """A pure twist about their line is hardest to resist where e is at most half of mu."""
    radius = part * friction
    contacts = grasps.regular_on_ball("pair", friction=friction, torsion_radius=radius)
    for kind, expected in (("total", radius), ("per_finger", 2.0 * radius / math.hypot(1, radius))):
        found = epsilon(contacts, actuation=kind, bounded="normal")  # type: ignore[arg-type]
        assert found.rank == 6
        assert found.lower <= expected * (1.0 + ROUNDING)
        assert found.upper >= expected * (1.0 - ROUNDING)
        assert found.upper - found.lower <= RTOL * found.upper + ROUNDING


@pytest.mark.parametrize("friction", [0.0, [0.1, 0.5, 0.9]])
@pytest.mark.parametrize("kind", ["total", "per_finger"])
def test_parallel_normals_are_never_force_closed(kind: Any, friction: Any) -> None:
    contacts = Contacts([[1, 0, 0], [0, 1, 0], [-1, -1, 0]], [[0, 0, 1.0]] * 3, friction)
    for edges in (None, 8):
        result = epsilon(contacts, actuation=kind, edges=edges)
        assert not result.closed
        check_certificate(contacts, result, edges=edges)
    assert not force_closure(contacts).closed
    assert not force_closure(contacts, cone_offset=-0.2).closed


PLANE = Contacts([[1, 0, 0], [0, 1, 0], [-1, -1, 0]], [[0, 0, 1.0]] * 3, 0.5)
DEGENERATE = {
    "one": Contacts([[1.0, 0.0, 0.0]], [[-1.0, 0.0, 0.0]]),
    "one soft": Contacts([[1.0, 0.0, 0.0]], [[-1.0, 0.0, 0.0]], 0.5, 0.1),
    "one soft at the centre": Contacts([[0.0, 0.0, 0.0]], [[-1.0, 0.0, 0.0]], 0.5, 0.1),
    "two at the centre": Contacts([[0.0, 0.0, 0.0]] * 2, [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
    "three at one point": Contacts([[1.0, 2.0, 3.0]] * 3, [[1, 0, 0], [0, 1, 0], [-1, -1, 1]], 0.5),
    "the same contact twice": Contacts([[1.0, 2.0, 3.0]] * 2, [[1.0, 0.0, 0.0]] * 2),
    "on a line": grasps.LINE,
    "on a line off the centre": grasps.changed(grasps.LINE, points=grasps.LINE.points + 1),
    "on a line, soft": grasps.changed(grasps.LINE, torsion_radius=0.1),
    "in a plane": PLANE,
    "in a plane, frictionless": grasps.changed(PLANE, friction=0.0),
    "exactly critical": Contacts(
        grasps.PAIR, np.array([[-1, 0.5, 0], [1, 0.5, 0]]) / math.hypot(1.0, 0.5)
    ),
    "triangle doubled": Contacts(
        np.repeat(grasps.TRIANGLE, 2, axis=0), -np.repeat(grasps.TRIANGLE, 2, axis=0)
    ),
    **{f"off a line by {gap:g}": grasps.just_off_a_line(gap) for gap in (1e-11, 1e-8, 1e-6, 1e-4)},
}
for _name in grasps.REGULAR_SHAPES:
    _contacts = grasps.regular_on_ball(_name)
    DEGENERATE[_name] = _contacts
    for _mu in (0.0, 1e-12, 1e-6, 1e3, 1e7):
        DEGENERATE[f"{_name}, friction {_mu:g}"] = grasps.changed(_contacts, friction=_mu)
    for _noise in (1e-14, 1e-6):
        _random = np.random.default_rng(1).normal(size=_contacts.points.shape)
        DEGENERATE[f"{_name}, noise {_noise:g}"] = grasps.changed(
            _contacts, points=_contacts.points + _noise * _random, torsion_radius=0.1
        )
    for _arm in (1e-9, 1e9):
        _scaled = grasps.changed(_contacts, points=_arm * _contacts.points)
        DEGENERATE[f"{_name}, arms {_arm:g}"] = _scaled


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


@pytest.mark.slow
@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_grasps_have_valid_results(name: str) -> None:
    contacts = DEGENERATE[name]
    for edges in (None, 3, 4, 8):
        check_certificate(contacts, force_closure(contacts, edges=edges), edges=edges)
    kind: Any
    bounded: Any
    for kind, bounded, offset in itertools.product(
        ("total", "per_finger"), ("force", "normal"), (0.0, -0.1)
    ):
        if bounded == "normal" and (contacts.friction > 1e6).any():
            continue  # refused
        bound = bound_on_epsilon(contacts, kind, bounded, offset)
        for edges in (None, 3, 4, 8):
            result = epsilon(
                contacts, edges=edges, actuation=kind, bounded=bounded, cone_offset=offset
            )
            case = f"edges={edges}, {kind}, {bounded}, {offset}: {result}"
            assert is_valid(result), case
            assert result.lower <= bound * (1.0 + ROUNDING) + 1e-11, case
            missing = np.isnan(result.certificate.equilibrium).any()
            assert not (result.closed and missing), case


def test_the_origin_on_the_hull_is_not_inside() -> None:
    simplex = np.vstack([np.eye(6), -np.ones((1, 6))])
    on_a_facet = simplex - simplex[:6].mean(axis=0)
    on_a_corner = simplex - simplex[0]
    for rows, rank in ((on_a_facet, 6), (on_a_corner, 6), (np.zeros((7, 6)), 0)):
        result = epsilon_of_wrenches(rows)
        assert is_valid(result)
        assert (result.closed, result.rank) == (False, rank)
        assert result.upper < 1e-8


def with_capacity(patch: pytest.MonkeyPatch, first: int, last: int) -> None:
    """Set the initial and the largest capacity of polytopes; the thread's own is discarded."""
    patch.setattr(wrench_problem, "INITIAL_FACETS", first)
    patch.setattr(wrench_problem, "MAX_FACETS", last)
    patch.setattr(wrench_problem, "_local", threading.local())


def test_a_hull_that_exceeds_its_capacity_gets_a_larger_polytope(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    contacts = random_contacts(Shape(4, 8, soft=False), 40, seed=0)
    usual = epsilon(contacts)
    with_capacity(monkeypatch, 16, 1 << 18)
    again = epsilon(contacts)
    for name in ("lower", "upper", "rank", "status", "closed"):
        np.testing.assert_array_equal(getattr(usual, name), getattr(again, name))
    np.testing.assert_array_equal(usual.certificate.equilibrium, again.certificate.equilibrium)


@pytest.mark.parametrize("last", [64, 1024])
def test_a_hull_that_exceeds_the_largest_capacity_is_exhausted_with_valid_bounds(
    last: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    contacts = grasps.regular_on_ball("tetrahedron")
    usual = epsilon(contacts, rtol=1e-3)
    with_capacity(monkeypatch, 32, last)
    result = epsilon(grasps.stacked([contacts, contacts]), rtol=1e-6)
    assert result.status.tolist() == [Status.EXHAUSTED] * 2
    assert is_valid(result)
    assert (result.lower <= usual.upper).all()
    assert (usual.lower <= result.upper).all()
    if last == 1024:
        assert result.closed.all()
        check_certificate(contacts, epsilon(contacts, rtol=1e-6))


TRIPLE = grasps.regular_on_ball("triangle", torsion_radius=0.1)


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
        ({"cone_offset": 1.2}, "those of soft fingers, must stay below 90 degrees"),
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


def test_unit_normal_components_are_refused_at_extreme_friction() -> None:
    with pytest.raises(SettingError, match="friction must stay below 1e\\+06"):
        epsilon(grasps.regular_on_ball("pair", friction=1e9), bounded="normal")


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


SEEDS = st.integers(0, 2**32)
KINDS = st.sampled_from(["antipodal", "nearly", "aligned", "centred", "random", "outward"])
FORMS = st.fixed_dictionaries(
    {
        "actuation": st.sampled_from(["total", "per_finger"]),
        "bounded": st.sampled_from(["force", "normal"]),
    }
)
NOISE = {
    "antipodal": (0.0, 0.0),
    "nearly": (1e-4, 1e-4),
    "aligned": (0.5, 0.0),
    "centred": (0.0, 0.3),
    "random": (0.5, 0.3),
    "outward": (0.5, 0.3),
}
"""Deviation of the line from the centre of mass, and of the normals from the line."""


def drawn(kind: str, seed: int, count: int = 1) -> Contacts:
    """Random pairs, most of them force-closed."""
    rng, (shift, tilt) = np.random.default_rng(seed), NOISE[kind]
    line = rng.normal(size=(count, 3))
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    reach = line * rng.uniform(0.1, 2.0, size=(count, 1))
    center = shift * rng.normal(size=(count, 3))
    points = np.stack([center - reach, center + reach], axis=1)
    sense = -1.0 if kind == "outward" else 1.0
    normals = sense * np.stack([line, -line], axis=1) + tilt * rng.normal(size=(count, 2, 3))
    return Contacts(points, normals, rng.uniform(0.1, 1.5, size=(count, 1)))


def by_growing_hull(contacts: Contacts, **arguments: Any) -> Epsilon:
    with patch.object(WrenchProblem, "is_pairs", return_value=False):
        return epsilon(contacts, **arguments)


@given(KINDS, SEEDS, FORMS, st.sampled_from([0.1, 1e-2, 2e-3]))
@settings(deadline=None, max_examples=60)
def test_the_growing_hull_finds_the_same(
    kind: str, seed: int, form: dict[str, Any], rtol: float
) -> None:
    contacts = drawn(kind, seed, 3)
    ours = epsilon(contacts, rtol=rtol, **form)
    theirs = by_growing_hull(contacts, rtol=1e-2, **form)
    assert ours.closed.tolist() == theirs.closed.tolist()
    assert ours.rank.tolist() == theirs.rank.tolist()
    assert (ours.lower <= theirs.upper * (1.0 + 1e-11)).all()
    assert (theirs.lower <= ours.upper * (1.0 + 1e-11)).all()
    assert (ours.upper - ours.lower <= rtol * ours.upper * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("rtol", [1e-5, 1e-8])
def test_bounds_of_pairs_are_as_close_as_requested(rtol: float) -> None:
    for kind in NOISE:
        found = epsilon(drawn(kind, 3, 40), rtol=rtol)
        assert (found.upper - found.lower <= rtol * found.upper * (1.0 + 1e-9)).all()
        assert found.status.tolist() == [Status.CONVERGED] * 40


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-8])
def test_a_growing_hull_that_has_converged_has_bounds_as_close_as_requested(rtol: float) -> None:
    """At 1e-8 rounding stops many of the hulls before."""
    found = by_growing_hull(drawn("outward", 7, 100), rtol=rtol)
    near = found.upper - found.lower <= (rtol + 1e-12) * found.upper
    expected = np.where(near, Status.CONVERGED, Status.STALLED)
    np.testing.assert_array_equal(found.status, expected)
    assert near.all() == (rtol == 1e-3)


def test_both_contacts_of_wide_cones_may_be_on_their_caps() -> None:
    points, tilt = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], math.radians(40.0)
    normals = [[math.cos(tilt), math.sin(tilt), 0.0], [-math.cos(tilt), math.sin(tilt), 0.0]]
    wide = Contacts(points, normals, math.tan(math.radians(60.0)))
    narrow = Contacts(points, normals, math.tan(math.radians(45.0)))
    assert epsilon(wide).lower > epsilon(narrow).upper
    assert epsilon(wide).upper >= by_growing_hull(wide).lower


def test_closure_at_the_rim_of_a_cone() -> None:
    """The line is within rounding of the rim, or clearly inside or outside."""

    def at_rim(angle: float) -> Contacts:
        tilt = math.atan(0.5) + angle
        normals = [[math.cos(tilt), math.sin(tilt), 0.0], [-1.0, 0.0, 0.0]]
        return Contacts([[-1.0, 0.2, 0.0], [1.0, 0.2, 0.0]], normals, 0.5)

    for angle, closed in ((-1e-3, True), (-1e-5, True), (1e-5, False), (1e-3, False)):
        contacts = at_rim(angle)
        found = epsilon(contacts)
        assert found.closed == closed
        assert (found.lower > 0.0) == closed
        theirs = by_growing_hull(contacts)
        assert found.lower <= theirs.upper
        assert theirs.lower <= found.upper
    # At the rim itself, and where contacts nearly coincide, only the hull decides.
    near = Contacts([[1.0, 0.0, 0.0], [1.0 + 1e-6, 0.0, 0.0]], [[1, 0, 0], [-1, 0, 0]], 0.5)
    for contacts in (at_rim(0.0), near):
        ours, theirs = epsilon(contacts), by_growing_hull(contacts)
        assert (ours.lower, ours.upper, ours.status) == (theirs.lower, theirs.upper, theirs.status)
