"""Contacts that coincide, nearly coincide or lie on a line, against oracles from the definition."""

import math

import numpy as np
import pytest

from grasp3d import Contacts, classify, epsilon, force_closure
from grasp3d.quality import Status, critical_friction_angle
from tests.helpers.degenerate import KINDS, critical_angles, random_grasps, unproven_certificates

X, Y, Z = np.eye(3)
CASES = [(kind, count) for kind, counts in KINDS.items() for count in counts if count > 2]
EXACT = [case for case in CASES if "close" not in case[0] and "cluster" not in case[0]]


def at_angle(toward: np.ndarray, across: np.ndarray, degrees: float) -> np.ndarray:
    angle = math.radians(degrees)
    return np.asarray(math.cos(angle) * toward + math.sin(angle) * across)


SLANTED = at_angle(-X, Y, 60.0)
"""A normal 60 degrees off the line to the other contacts."""

REFERENCE = {
    "opposed pair": ([[0, 0, 0], [0, 0, 0], [1, 0, 0]], [Z, -Z, SLANTED], 60.0),
    "opposed pair, other order": ([[1, 0, 0], [0, 0, 0], [0, 0, 0]], [SLANTED, Z, -Z], 60.0),
    "opposed pair off the origin": (
        [[0.1, 0.7, 0.3], [0.1, 0.7, 0.3], [0.9, 0.7, 0.3]], [Z, -Z, SLANTED], 60.0,
    ),
    "two opposed pairs": (
        [[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0]], [Z, -Z, SLANTED, SLANTED], 60.0,
    ),
    "three around a point and one": (
        [[0, 0, 0], [0, 0, 0], [0, 0, 0], [1, 0, 0]],
        [Y, at_angle(Y, Z, 120.0), at_angle(Y, Z, 240.0), SLANTED], 60.0,
    ),
    "opposed pair, two apart": (
        [[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0]],
        [Z, -Z, at_angle(-X, Z, 40.0), at_angle(-Y, Z, 70.0)], 70.0,
    ),
}  # fmt: skip
"""Points, normals and the critical angle in degrees: contacts at one point that squeeze each other
can balance any force there; it is that of the others, which must not turn the object about it."""


@pytest.mark.slow
@pytest.mark.parametrize("name", REFERENCE)
def test_opposed_contacts_at_one_point_do_not_help_the_others(name: str) -> None:
    points, normals, degrees = REFERENCE[name]
    expected = math.radians(degrees)
    contacts = Contacts(points, normals)
    oracle, proven = critical_angles(
        contacts.points[None], contacts.normals[None], np.zeros(1, dtype=np.bool_)
    )
    assert proven.all()
    assert oracle[0] == pytest.approx(expected, abs=1e-5)
    found = float(critical_friction_angle(contacts))
    assert expected - 1e-6 <= found <= expected + 1e-4
    for change in (-0.2, -0.01, 0.01, 0.2):
        given_friction = math.tan(expected + change)
        closure = force_closure(Contacts(points, normals, friction=given_friction))
        assert closure.closed == (change > 0.0), change
        assert (closure.status == Status.CONVERGED) or change < 0.0
        assert epsilon(Contacts(points, normals, friction=given_friction)).closed == (change > 0.0)
    label = classify(Contacts(points, normals, friction=math.tan(expected - 0.2)), 0.2).label
    assert label != 2


def contradictions(kind: str, count: int, seed: int, size: int) -> dict[str, int]:
    """Numbers of wrong results of random grasps of one kind."""
    rng = np.random.default_rng(seed)
    grasps = random_grasps(kind, count, size, rng)
    angle, proven = critical_angles(grasps.points, grasps.normals, grasps.on_line)
    assert proven.all()
    beta = np.clip(
        angle + rng.choice([-1.0, 1.0], size) * 10.0 ** rng.uniform(-4, 0, size), 0.02, 1.5
    )
    tilt = rng.uniform(0.0, 0.2, size)
    contacts = Contacts(
        grasps.points, grasps.normals, friction=np.tan(beta)[:, None] * np.ones(count)
    )
    closure = force_closure(contacts)
    label = classify(contacts, 2.0 * tilt[:, None] * np.ones(count)).label
    apart = np.linalg.norm(grasps.points[:, :, None] - grasps.points[:, None], axis=3)
    # Of contacts that nearly coincide a U may follow from a motion that hardly moves them.
    clear = ~((apart > 0.0) & (apart < 1e-7)).any(axis=(1, 2))
    found = np.asarray(critical_friction_angle(contacts))
    return {
        "too small": int((found < angle - 1e-4).sum()),
        "closed": int((closure.closed & (angle > beta + 1e-5)).sum()),
        "surely open": int(
            (clear & (closure.status != Status.UNDECIDED) & ~closure.closed)[
                angle < beta - 1e-5
            ].sum()
        ),
        "S": int(((label == 2) & (angle > beta - tilt + 1e-5)).sum()),
        "U": int((clear & (label == 0) & (angle < beta + tilt - 1e-5)).sum()),
        "certificates": len(unproven_certificates(contacts, closure, grasps.on_line)),
    }


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0]}, {case[1]}")
def test_many_degenerate_grasps_are_decided_as_by_their_definition(case: tuple[str, int]) -> None:
    assert not any(contradictions(*case, 7, 30).values())


def test_a_closure_may_be_undecided_at_an_angle_below_one_that_is_open() -> None:
    assert not any(contradictions("two points", 4, 0, 6).values())


@pytest.mark.slow
@pytest.mark.parametrize("case", EXACT, ids=lambda case: f"{case[0]}, {case[1]}")
def test_exact_degeneracy_costs_no_accuracy(case: tuple[str, int]) -> None:
    grasps = random_grasps(*case, 15, np.random.default_rng(3))
    angle, proven = critical_angles(grasps.points, grasps.normals, grasps.on_line)
    assert proven.all()
    found = np.asarray(critical_friction_angle(Contacts(grasps.points, grasps.normals)))
    assert found == pytest.approx(np.maximum(angle, 0.0), abs=2e-4)
