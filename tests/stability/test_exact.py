"""Tests of exact labels by `classify`: random tilts, thresholds, and known results."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, Label, classify, critical_friction_angle, force_closure
from tests.helpers import grasps, oracles
from tests.helpers.random_grasps import random_grasps
from tests.helpers.tilts import (
    all_combinations,
    angle_to_set,
    angles,
    best_normals,
    mixed,
    random_tilts,
    with_normals,
    within_sets,
    worst_normals,
)

degrees = math.radians
NEAR = 1e-3
RIGHT = math.pi / 2.0


def pair(off: float, other: float = 0.0, friction: float = 0.5) -> Contacts:
    """Two fingers on the x-axis whose normals make given angles with it."""
    normals = [[math.cos(off), math.sin(off), 0.0], [-math.cos(other), 0.0, math.sin(other)]]
    return Contacts([[-1, 0, 0], [1, 0, 0]], normals, friction)


@pytest.mark.slow
@pytest.mark.parametrize("fingers", [2, 3, 5])
def test_no_tilt_contradicts_an_s_or_a_u(fingers: int) -> None:
    contacts, resolution = mixed(fingers, 150, 1)
    label = np.asarray(classify(contacts, resolution).label)
    assert set(label) == {0, 1, 2}
    rng = np.random.default_rng(2)
    for _ in range(60):
        tilted = with_normals(contacts, random_tilts(contacts.normals, resolution / 2.0, rng))
        closed = force_closure(tilted).closed
        assert closed[label == Label.S].all()
        assert not closed[label == Label.U].any()


@pytest.mark.parametrize("fingers", [2, 3, 4, 5])
def test_every_m_has_an_open_and_a_force_closed_tilt(fingers: int) -> None:
    contacts, resolution = mixed(fingers, 150, 3)
    tilt = np.minimum(resolution / 2.0, 0.99 * contacts.friction_angle)  # else there is no S
    ambiguous = classify(contacts, 2.0 * tilt).label == Label.M
    assert ambiguous.sum() > 20
    worst = worst_normals(contacts, tilt)
    assert (angles(contacts.normals, worst) <= tilt + 1e-9).all()
    assert not force_closure(with_normals(contacts, worst)).closed[ambiguous].any()
    best = best_normals(contacts, tilt)
    known = np.isfinite(best).all(axis=(1, 2))
    below = (contacts.friction_angle + tilt < RIGHT).all(axis=1)
    assert known[ambiguous & (below | (fingers == 2))].all()
    closing = np.where(known[:, None, None], best, contacts.normals)
    assert (angles(contacts.normals, closing) <= tilt + 1e-9).all()
    assert force_closure(with_normals(contacts, closing)).closed[ambiguous & known].all()


@pytest.mark.parametrize("fingers", [2, 3, 4, 5])
def test_labels_are_thresholds_on_the_critical_angle(fingers: int) -> None:
    contacts, resolution = random_grasps(fingers, 200, 4)
    found = classify(contacts, resolution)
    beta, tilt = contacts.friction_angle[:, 0], resolution[:, 0] / 2.0
    critical = critical_friction_angle(contacts)
    assert found.critical_friction_angle == pytest.approx(critical, abs=NEAR)
    near = np.minimum(np.abs(critical - beta + tilt), np.abs(critical - beta - tilt)) < NEAR
    expected = np.where(critical < beta - tilt, Label.S, Label.M)
    expected[(critical >= beta + tilt) & ((beta + tilt < RIGHT) | (fingers == 2))] = Label.U
    np.testing.assert_array_equal(found.label[~near], expected[~near])
    assert near.mean() < 0.1
    assert set(expected) == {0, 1, 2}


@given(
    st.tuples(st.floats(0.0, 3.1), st.floats(0.0, 3.1)),
    st.tuples(st.floats(0.01, 12.0), st.floats(0.01, 12.0)),
    st.tuples(st.floats(0.0, 3.1), st.floats(0.0, 3.1)),
    st.booleans(),
)
@settings(max_examples=200, deadline=None)
def test_two_fingers_have_a_closed_form(
    off: tuple[float, float],
    friction: tuple[float, float],
    resolution: tuple[float, float],
    alike: bool,
) -> None:
    """Each finger needs a friction angle above its angle to the line plus half its resolution."""
    beta, tilt = np.arctan(friction), np.array(resolution) / 2.0
    if alike:
        beta, tilt = beta[[0, 0]], tilt[[0, 0]]
    squeezing, expanding = np.array(off), math.pi - np.array(off)
    between = [way - beta + sign * tilt for way in (squeezing, expanding) for sign in (1, -1)]
    if np.abs(between).min() > 1e-9:
        stable = any((way < beta - tilt).all() for way in (squeezing, expanding))
        unstable = all((way >= beta + tilt).any() for way in (squeezing, expanding))
        expected = Label.S if stable else Label.U if unstable else Label.M
        contacts = grasps.changed(pair(*off), friction=np.tan(beta))
        assert classify(contacts, 2.0 * tilt).label == expected


def test_a_finger_whose_tilts_exceed_friction_prevents_an_s() -> None:
    """Three fingers that are S alone, and one whose tilts exceed its friction."""
    triangle = grasps.regular_on_ball("triangle", friction=0.8)
    assert classify(triangle, 0.4).label == Label.S
    points, normals = np.vstack([triangle.points, [0, 0, 1]]), [*triangle.normals, [0, 0, -1]]
    four = Contacts(points, normals, [0.8, 0.8, 0.8, 0.1])
    for alpha, label in ((0.19, Label.S), (0.5, Label.M), (3.0, Label.M)):
        found = classify(four, [0.4, 0.4, 0.4, alpha])
        assert found.label == label
        assert (found.epsilon_min > 0.0) == (label == Label.S)


def test_three_fingers_on_one_face_can_be_closed_by_tilting_inward() -> None:
    """Friction of 50 degrees, tilts of 45: cones of half-angle 95 degrees are not convex."""
    azimuths = np.arange(3) * 2.0 * math.pi / 3.0
    points = np.stack([np.cos(azimuths), np.sin(azimuths), np.ones(3)], axis=-1)
    contacts = Contacts(points, np.tile([0.0, 0.0, -1.0], (3, 1)), math.tan(degrees(50.0)))
    found = classify(contacts, degrees(90.0))
    assert found.label == Label.M
    inward = -np.sin(degrees(45.0)) * points * [1, 1, 0] + [0, 0, -np.cos(degrees(45.0))]
    assert force_closure(grasps.changed(contacts, normals=inward)).closed
    assert classify(contacts, degrees(79.0)).label == Label.U
    sampled = classify(contacts, degrees(90.0), method="extremes", extreme_normals=12)
    assert sampled.label == Label.M


@pytest.mark.parametrize("fingers", [3, 4])
def test_three_fingers_are_never_u_from_90_degrees_on(fingers: int) -> None:
    contacts, _ = random_grasps(fingers, 100, 6)
    parallel = np.broadcast_to(contacts.normals[:, :1], contacts.normals.shape)
    rough = grasps.changed(contacts, normals=parallel, friction=2.0)
    for resolution in (2.0 * (RIGHT - math.atan(2.0)) + 1e-9, 1.5, 3.0):
        assert (classify(rough, resolution).label == Label.M).all()
    below = classify(rough, 2.0 * (RIGHT - math.atan(2.0)) - 1e-3)
    assert (below.label == Label.U).all()
    # One contact is enough.
    friction, resolution = np.full(fingers, 0.05), np.full(fingers, 0.01)
    friction[-1], resolution[-1] = 10.0, 0.3
    one_rough = grasps.changed(rough, friction=friction)
    assert (classify(one_rough, resolution).label == Label.M).all()
    assert (classify(one_rough, 0.01).label == Label.U).all()


def test_two_contacts_at_one_point_push_along_any_line() -> None:
    for angle in (0.0, 0.4, 1.0):
        normals = [[1, 0, 0], [-math.cos(angle), math.sin(angle), 0]]
        contacts = Contacts([[1, 2, 3]] * 2, normals, [0.5, 0.8])
        safe = math.atan(0.5) + math.atan(0.8)
        for alpha in np.linspace(0.0, 1.5, 16):
            found = classify(contacts, alpha)
            stable = angle < safe - alpha
            expected = Label.S if stable else Label.M if angle < safe + alpha else Label.U
            assert found.label == expected, (angle, alpha)


@pytest.mark.parametrize("method", ["exact", "extremes"])
def test_one_contact_is_always_u(method: Any) -> None:
    contacts = Contacts([[1, 0, 0]], [[-1, 0, 0]], 1.0)
    for alpha in (0.0, 0.5, 3.0):
        for creases in (None, {0: [[-1, 0, 0], [0, -1, 0]]}):
            assert classify(contacts, alpha, method=method, creases=creases).label == Label.U


@pytest.mark.parametrize("method", ["exact", "extremes"])
@pytest.mark.parametrize("fingers", [2, 3])
def test_torsion_does_not_affect_labels(fingers: int, method: Any) -> None:
    contacts, resolution = random_grasps(fingers, 100, 7)
    hard, soft = (
        classify(one, resolution, method=method, extreme_normals=4).label
        for one in (contacts, grasps.changed(contacts, torsion_radius=0.4))
    )
    np.testing.assert_array_equal(soft, hard)


def crease_about(normals: np.ndarray, corners: int, seed: int) -> np.ndarray:
    """Face normals about each of some normals (b, 3), up to 70 degrees apart, shape (b, k, 3)."""
    rng = np.random.default_rng(seed)
    found = []
    for normal in normals:
        cone = oracles.cone_edges(normal, rng.uniform(0.05, 0.6), 60)
        start = rng.integers(60)
        found.append(cone[(start + np.arange(corners) * (60 // corners)) % 60])
    return np.array(found)


@pytest.mark.parametrize("corners", [2, 3])
def test_two_fingers_on_creases_follow_the_angles_of_their_sets(corners: int) -> None:
    contacts, resolution = mixed(2, 150, 8)
    sets = {i: crease_about(contacts.normals[:, i], corners, i) for i in (0, 1)}
    label = classify(contacts, 0.5 * resolution, creases=sets).label
    lines = contacts.points[:, 1] - contacts.points[:, 0]
    lines /= np.linalg.norm(lines, axis=1, keepdims=True)
    safe = contacts.friction_angle - 0.25 * resolution
    widest = contacts.friction_angle + 0.25 * resolution
    for b in range(150):
        stable, unstable, near = False, True, False
        for sign in (1.0, -1.0):
            directions = (sign * lines[b], -sign * lines[b])
            sides = [(sets[i][b], directions[i]) for i in (0, 1)]
            best = np.array([angle_to_set(faces, d) for faces, d in sides])
            worst = np.array([math.pi - angle_to_set(faces, -d) for faces, d in sides])
            stable |= bool((worst < safe[b]).all())
            unstable &= bool((best >= widest[b]).any())
            near |= bool((np.abs(worst - safe[b]) < 1e-6).any())
            near |= bool((np.abs(best - widest[b]) < 1e-6).any())
        if not near:
            assert label[b] == (Label.S if stable else Label.U if unstable else Label.M), b
    assert set(label) == {0, 1, 2}


@pytest.mark.slow
@pytest.mark.parametrize(("fingers", "corners"), [(2, 4), (3, 2)])
def test_no_normal_of_the_sets_contradicts_an_s_or_a_u(fingers: int, corners: int) -> None:
    size = 60 if fingers == 2 else 40
    contacts, resolution = mixed(fingers, size, 9)
    tilt = 0.2 * resolution
    sets = {i: crease_about(contacts.normals[:, i], corners, i) for i in range(fingers - 1)}
    found = classify(contacts, 2.0 * tilt, creases=sets)
    assert set(found.label) == {0, 1, 2}
    rng = np.random.default_rng(0)
    for _ in range(100):
        normals = contacts.normals.copy()
        for i, faces in sets.items():
            normals[:, i] = within_sets(faces, rng)
        tilted = with_normals(contacts, random_tilts(normals, tilt, rng))
        closed = force_closure(tilted).closed
        assert closed[found.label == Label.S].all()
        assert not closed[found.label == Label.U].any()
    sampled = classify(contacts, 2.0 * tilt, creases=sets, method="extremes", extreme_normals=4)
    decided = found.label != Label.M
    np.testing.assert_array_equal(sampled.label[decided], found.label[decided])


EDGE = np.array([[-0.4554, 0.8075, 0.3750], [-0.9670, -0.0427, 0.2510]])
"""Normals of two faces, 60 degrees apart."""

ON_EDGE = Contacts(
    [[0.339, -0.881, -0.330], [-0.707, -0.429, -0.562], [0.945, 0.284, -0.186]],
    [EDGE.sum(axis=0), [0.654, 0.448, 0.610], [-0.970, -0.098, -0.223]],
)


def test_face_normals_alone_miss_the_worst_normal_of_three_fingers() -> None:
    """Those of the faces need 27.6 degrees of friction, the one midway between them 32."""
    for beta, label in ((29.8, Label.M), (31.5, Label.M), (33.0, Label.S)):
        contacts = grasps.at_angle(ON_EDGE, degrees(beta))
        assert classify(contacts, 0.0, creases={0: EDGE}, method="extremes").label == label
        faces_only = all_combinations(contacts, [EDGE, *contacts.normals[1:, None]])
        assert force_closure(faces_only).closed.all()


@pytest.mark.parametrize("half", [0.05, 0.2])
def test_an_edge_of_three_fingers_narrows_and_widens_the_cone_about_its_middle(half: float) -> None:
    faces = np.array([oracles.turned(ON_EDGE.normals[0], face, half) for face in EDGE])
    for sign in (-1.0, 1.0):
        low, high = half, degrees(89.0) - half
        while high - low > 1e-6:
            middle = 0.5 * (low + high)
            cones = middle + np.array([sign * half, 0.0, 0.0])
            closed = force_closure(grasps.changed(ON_EDGE, friction=np.tan(cones))).closed
            low, high = (low, middle) if closed else (middle, high)
        assert half < low < degrees(88.0) - half
        below, above = (
            classify(grasps.at_angle(ON_EDGE, beta), 0.0, creases={0: faces})
            for beta in (low - 1e-3, high + 1e-3)
        )
        if sign < 0.0:
            assert (below.label, above.label) == (Label.M, Label.S)
            assert below.margin == pytest.approx(-1e-3, abs=2e-4)
            assert above.margin == pytest.approx(1e-3, abs=2e-4)
        else:
            assert (below.label, above.label) == (Label.U, Label.M)


def test_no_u_is_claimed_where_a_cone_of_an_edge_reaches_90_degrees() -> None:
    azimuths = np.arange(3) * 2.0 * math.pi / 3.0
    points = np.stack([np.cos(azimuths), np.sin(azimuths), np.ones(3)], axis=-1)
    down = np.tile([0.0, 0.0, -1.0], (3, 1))
    turn = degrees(7.35)
    crease = np.array([[0.0, s * math.sin(turn), -math.cos(turn)] for s in (-1.0, 1.0)])
    smooth = Contacts(points, down, math.tan(degrees(50.0)))
    assert classify(smooth, degrees(90.0), creases={0: crease}).label == Label.M
    assert classify(smooth, degrees(66.0), creases={0: crease}).label == Label.M
    assert classify(smooth, degrees(64.0), creases={0: crease}).label == Label.U


def test_two_contacts_at_one_point_on_a_crease() -> None:
    """The cap of the crease counts on either side."""
    faces = np.array([[math.cos(t), math.sin(t), 0.0] for t in (-0.2, 0.2)])
    for beta, label in ((0.15, Label.M), (0.09, Label.M), (0.21, Label.S)):
        coincident = grasps.at_angle(Contacts([[1.0, 0, 0]] * 2, [[1, 0, 0], [-1.0, 0, 0]]), beta)
        assert classify(coincident, 0.1, creases={0: faces}).label == label
    apart = Contacts([[1.0, 0, 0]] * 2, [[1, 0, 0], [0.0, -1, 0]])
    assert classify(grasps.at_angle(apart, 0.6), 0.1, creases={0: faces}).label == Label.U


def test_a_normal_between_rim_and_centre_may_be_force_closed() -> None:
    """A friction angle of 5.7 degrees, tilts of 20, a normal tilted by 10."""
    contacts = pair(degrees(10.0), friction=math.tan(degrees(5.7)))
    for method in ("exact", "extremes"):
        assert classify(contacts, degrees(40.0), method=method).label == Label.M  # type: ignore[arg-type]


@pytest.mark.parametrize("friction", [1e-6, 0.5, 10.0, 1e6])
def test_perfect_sensors_leave_no_ambiguity(friction: float) -> None:
    beta = math.atan(friction)
    for fraction, label in ((0.9, Label.S), (1.1, Label.U)):
        off = min(fraction * beta, RIGHT + 0.01 * (fraction > 1.0))
        if fraction > 1.0 and off >= RIGHT:
            off = 0.5 * (beta + RIGHT) if friction < 1e3 else RIGHT + 1e-6
        assert classify(pair(off, friction=friction), 0.0).label == label
        sampled = classify(pair(off, friction=friction), 0.0, method="extremes")
        assert sampled.label == label


@pytest.mark.parametrize("friction", [1e-6, 0.5, 10.0])
def test_labels_exactly_at_twice_the_friction_angle(friction: float) -> None:
    beta = math.atan(friction)
    for fingers in (2, 3, 4):
        rough = grasps.changed(random_grasps(fingers, 50, 11)[0], friction=friction)
        assert not (classify(rough, 2.0 * beta).label == Label.S).any()
    aligned = pair(0.0, friction=friction)
    method: Any
    for method, below in (("exact", 1.999), ("extremes", 1.99)):
        assert classify(aligned, 2.0 * beta, method=method).label == Label.M
        if method == "exact" or friction > 1e-4:  # what hulls leave undecided is M
            assert classify(aligned, below * beta, method=method).label == Label.S
