"""Labels of grasps of any numbers of contacts, with different sensors."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, Label, classify, critical_friction_angle
from grasp3d.settings import MAX_FINGERS
from grasp3d.stability.classification import ContactSets, label_sets
from tests.helpers.contact_sets import Sets, closes, random_sets, true_normals

seeds = st.integers(0, 100_000)
few = settings(max_examples=20, deadline=None)
BRACKET = 2e-4
"""Twice the width of the interval of a critical angle [rad]."""


def of_grasp(one: Sets, grasp: int) -> Contacts:
    mine = one.sets.row == grasp
    return Contacts(one.sets.points[mine], one.sets.normals[mine], one.friction)


def test_critical_angles_are_those_of_the_same_contacts() -> None:
    one = random_sets(60, 1)
    worst, best = one.sets.critical_angles
    assert worst.tolist() == best.tolist()
    for grasp in range(one.sets.size):
        expected = critical_friction_angle(of_grasp(one, grasp))
        assert worst[grasp] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("alike", [True, False])
def test_labels_are_those_of_grasps(alike: bool) -> None:
    one = random_sets(200, 2, alike=alike)
    found = label_sets(one.sets, one.tilt, one.angles)
    assert len(np.unique(found.label)) == 3
    for grasp in range(one.sets.size):
        other = classify(of_grasp(one, grasp), 2.0 * one.tilt[one.sets.row == grasp])
        assert found.label[grasp] == other.label or abs(found.margin[grasp]) < 2e-3
        assert (found.margin[grasp] > 0.0) == (found.label[grasp] == Label.S)


def test_location_errors_are_those_of_grasps_whose_tilts_are_wider() -> None:
    one = random_sets(100, 4)
    turns = np.random.default_rng(5).uniform(0.0, 0.05, len(one.tilt))
    sets = replace(one.sets, location_error=0.02, turns=turns)
    found = label_sets(sets, one.tilt, one.angles)
    assert (found.label != label_sets(one.sets, one.tilt, one.angles).label).any()
    for grasp in range(sets.size):
        mine = sets.row == grasp
        wide = 2.0 * (one.tilt + turns)[mine]
        other = classify(of_grasp(one, grasp), wide, location_error=0.02)
        assert found.label[grasp] == other.label
        assert found.margin[grasp] == pytest.approx(other.margin, abs=1e-9)


@pytest.mark.slow
@given(seed=seeds)
@few
def test_labels_hold_against_linear_programs_at_true_normals(seed: int) -> None:
    one = random_sets(6, seed)
    found = label_sets(one.sets, one.tilt, one.angles)
    rng = np.random.default_rng(seed)
    for grasp in np.flatnonzero(found.label != Label.M):
        points = one.sets.points[one.sets.row == grasp]
        for normals in true_normals(one, grasp, 2, rng):
            surely = found.label[grasp] == Label.S
            assert closes(points, normals, one.friction, around=surely) == surely


@pytest.mark.slow
@given(seed=seeds)
@few
def test_sensors_and_friction_do_not_make_an_s_ambiguous(seed: int) -> None:
    one = random_sets(30, seed)
    rng = np.random.default_rng(seed)
    before = label_sets(one.sets, one.tilt, one.angles)
    finer = np.where(rng.random(len(one.tilt)) < 0.5, 0.5, 1.0) * one.tilt
    more = label_sets(one.sets, finer, one.angles)
    beta = math.atan(1.3 * one.friction)
    rubber = label_sets(one.sets, one.tilt, (beta, beta))
    robust = before.margin > BRACKET
    for after in (more, rubber):
        assert (after.label[robust] == Label.S).all()
    assert (more.label[before.label == Label.U] == Label.U).all()


@pytest.mark.slow
@given(seed=seeds)
@few
def test_a_contact_at_equal_rank_does_not_make_an_s_ambiguous(seed: int) -> None:
    one = random_sets(30, seed)
    before = label_sets(one.sets, one.tilt, one.angles)
    last = np.flatnonzero(np.diff(one.sets.row, append=one.sets.size))  # one more of each grasp
    order = np.sort(np.concatenate([np.arange(len(one.tilt)), last]))
    rng = np.random.default_rng(seed)
    added = np.append(np.diff(order), 1) == 0
    points = np.where(added[:, None], rng.normal(size=(len(order), 3)), one.sets.points[order])
    sets = ContactSets(
        size=one.sets.size, row=one.sets.row[order], points=points,
        normals=one.sets.normals[order],
    )  # fmt: skip
    after = label_sets(sets, one.tilt[order], one.angles)
    same = one.sets.rank == sets.rank
    robust = same & (before.margin > BRACKET)
    assert (after.label[robust] == Label.S).all()


def test_a_contact_that_raises_the_rank_may_make_an_s_ambiguous() -> None:
    """Two fingers hold a bar but for turns about their line, which a third one adds, unsurely."""
    points = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    normals = np.array([[1.0, 0, 0], [-1, 0, 0], [0, -1, 0]])
    two = ContactSets(size=1, row=np.zeros(2, int), points=points[:2], normals=normals[:2])
    three = ContactSets(size=1, row=np.zeros(3, int), points=points, normals=normals)
    tilt, angles = np.array([0.1, 0.1, 0.6]), (0.5, 0.5)
    assert label_sets(two, tilt[:2], angles).label.tolist() == [Label.S]
    found = label_sets(three, tilt, angles)
    assert found.label.tolist() == [Label.M]
    assert found.margin[0] < 0.0
    assert (two.rank.tolist(), three.rank.tolist()) == ([5], [6])


def test_cones_of_ninety_degrees_are_never_u() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    up = np.broadcast_to([0.0, 0, 1], (3, 3))
    sets = ContactSets(size=1, row=np.zeros(3, int), points=points, normals=up)
    for tilt, label in ((0.2, Label.U), (0.9, Label.M)):
        assert label_sets(sets, np.full(3, tilt), (0.8, 0.8)).label.tolist() == [label]


def test_few_and_many_contacts_have_no_numbers() -> None:
    counts = np.array([0, 1, 2, MAX_FINGERS + 1])
    row = np.repeat(np.arange(4), counts)
    points = np.random.default_rng(0).normal(size=(len(row), 3))
    normals = -points / np.linalg.norm(points, axis=1, keepdims=True)
    sets = ContactSets(size=4, row=row, points=points, normals=normals)
    found = label_sets(sets, np.full(len(row), 0.1), (0.5, 0.5))
    assert found.label[[0, 1, 3]].tolist() == [Label.U, Label.U, Label.M]
    assert np.isnan(sets.critical_angles[0]).tolist() == [True, True, False, True]
    assert np.isnan(found.margin).tolist() == [True, True, False, True]
