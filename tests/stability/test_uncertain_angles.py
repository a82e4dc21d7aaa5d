"""Angles and labels with uncertain locations, normals and friction, and contacts that differ."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from grasp3d import Contacts, Label, classify, force_closure
from grasp3d.arrays import unit_rows
from grasp3d.quality.wrenches import wrenches
from grasp3d.stability.classification import uncertain_angles
from grasp3d.stability.normal_sets import NormalSets
from tests.helpers.tilts import angles, random_tilts

Floats = NDArray[np.float64]

RINGS = (1.0, 0.5, 1e-3)
"""Fractions of a friction angle at which unit forces are sampled."""


class Case(NamedTuple):
    """Random grasps of two fingers and what is known about them, each (b, 2)."""

    contacts: Contacts
    low: Floats
    high: Floats
    tilt: Floats
    location: Floats

    def label(self) -> Floats:
        """Their labels."""
        return np.asarray(
            classify(
                self.contacts,
                2.0 * self.tilt,
                friction_interval=(self.low, self.high),
                location_error=self.location,
            ).label
        )


def random_pairs(count: int, seed: int) -> Case:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 2, 3))
    lines = points[:, 1] - points[:, 0]
    opening = np.linalg.norm(lines, axis=1, keepdims=True)
    inward = np.stack([lines, -lines], axis=1) / opening[..., None]
    spread = rng.uniform(0.0, 1.0, size=(count, 1, 1))
    normals = unit_rows(inward + spread * rng.normal(size=inward.shape))
    friction = rng.uniform(0.2, 1.5, size=(count, 2))
    part = rng.uniform(0.0, 0.4, size=(count, 2)) * (rng.random((count, 1)) < 0.7)
    return Case(
        Contacts(points, normals, friction),
        friction * (1.0 - part),
        friction * (1.0 + part),
        rng.uniform(0.0, 0.3, size=(count, 2)),
        rng.uniform(0.0, 0.25, size=(count, 2)) * opening,
    )


def holds(points: Floats, normals: Floats, friction: Floats) -> NDArray[np.bool_]:
    """Nguyen 1988: two fingers are force-closed if their line is inside both friction cones."""
    line, beta = points[:, 1] - points[:, 0], np.arctan(friction)
    first, second = angles(normals[:, 0], line), angles(normals[:, 1], -line)
    squeezing = (first < beta[:, 0]) & (second < beta[:, 1])
    expanding = (math.pi - first < beta[:, 0]) & (math.pi - second < beta[:, 1])
    return np.asarray(squeezing | expanding)


def shifted(case: Case, rng: np.random.Generator, *, rim: bool) -> Floats:
    """Points within the location errors, on the sphere of each or in its ball."""
    direction = unit_rows(rng.normal(size=case.contacts.points.shape))
    part = 1.0 if rim else rng.random((*case.location.shape, 1)) ** (1.0 / 3.0)
    return np.asarray(case.contacts.points + part * case.location[..., None] * direction)


def toward(vectors: Floats, goals: Floats, angle: Floats) -> Floats:
    """Unit vectors turned toward goals by at most an angle, away from them if it is negative."""
    between = angles(vectors, goals)
    side = goals - (goals * vectors).sum(axis=-1, keepdims=True) * vectors
    length = np.linalg.norm(side, axis=-1, keepdims=True)
    side = np.where(length > 1e-12, side / np.maximum(length, 1e-300), 0.0)
    turn = np.where(angle >= 0.0, np.minimum(angle, between), angle)[..., None]
    return unit_rows(np.cos(turn) * vectors + np.sin(turn) * side)


class TestTwoContacts:
    @pytest.mark.slow
    def test_no_perturbation_contradicts_a_label(self) -> None:
        """Random and adversarial perturbations; the margin is above 0 exactly where it is S."""
        case, rng = random_pairs(30_000, 1), np.random.default_rng(2)
        label, tilt = case.label(), case.tilt
        assert min(np.bincount(label)) > 150
        found = classify(
            case.contacts, 2.0 * tilt, friction_interval=(case.low, case.high),
            location_error=case.location,
        )  # fmt: skip
        assert ((found.margin > 0.0) == (found.label == Label.S)).all()
        stable, unstable = label == Label.S, label == Label.U
        for number in range(40):
            points = shifted(case, rng, rim=number % 3 > 0)
            line = points[:, 1] - points[:, 0]
            lines = np.stack([line, -line], axis=1)
            if number % 2:
                normals = random_tilts(case.contacts.normals, tilt, rng)
            else:
                normals = toward(case.contacts.normals, lines, -tilt if number % 4 else tilt)
            for friction in (case.low, case.high):
                held = holds(points, normals, friction)
                assert held[stable].all()
                assert not held[unstable].any()

    @pytest.mark.parametrize("name", ["location", "tilt", "friction"])
    def test_less_knowledge_never_helps(self, name: str) -> None:
        """A larger error turns S and U into M, and never back."""
        case = random_pairs(5000, 6)
        labels = []
        for scale in (0.0, 0.3, 0.6, 1.0):
            middle = case.contacts.friction
            low, high = case.low, case.high
            if name == "friction":
                low, high = middle + scale * (low - middle), middle + scale * (high - middle)
            changed = case._replace(
                low=low, high=high, tilt=case.tilt * (scale if name == "tilt" else 1.0),
                location=case.location * (scale if name == "location" else 1.0),
            )  # fmt: skip
            labels.append(changed.label())
        for before, after in pairwise(labels):
            assert ((after == before) | (after == Label.M)).all()
        assert (labels[0] != labels[-1]).any()

    def test_margin_of_opposed_fingers(self) -> None:
        """Two fingers 80 mm apart: beta - alpha/2 - asin(2 d / 80 mm)."""
        contacts = Contacts([[-40.0, 0.0, 0.0], [40.0, 0.0, 0.0]], [[1, 0, 0], [-1, 0, 0]], 0.5)
        found = classify(contacts, math.radians(20.0), location_error=2.0)
        expected = math.atan(0.5) - math.radians(10.0) - math.asin(4.0 / 80.0)
        assert float(found.margin) == pytest.approx(expected, abs=1e-14)

    def test_contacts_that_may_coincide_are_never_stable(self) -> None:
        contacts = Contacts([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[1, 0, 0], [-1, 0, 0]], 5.0)
        assert classify(contacts, 0.0, location_error=1.0).label == Label.M
        assert classify(contacts, 0.0, location_error=0.9).label == Label.S
        together = Contacts([[0.0, 0.0, 0.0]] * 2, [[1, 0, 0], [-1, 0, 0]], 5.0)
        assert classify(together, 0.0, location_error=0.1).label == Label.M


class TestMoreContacts:
    @staticmethod
    def _random(count: int, fingers: int, seed: int) -> tuple[Contacts, Floats]:
        rng = np.random.default_rng(seed)
        points = unit_rows(rng.normal(size=(count, fingers, 3)))
        if fingers == 3:  # near a great circle, else few are force-closed
            points[..., 2] *= 0.3
            points = unit_rows(points)
        normals = unit_rows(-points + 0.3 * rng.normal(size=points.shape))
        friction = rng.uniform(0.3, 1.2, size=(count, 1)) * np.ones(fingers)
        return Contacts(points, normals, friction), rng.uniform(0.0, 0.08, size=(count, fingers))

    @pytest.mark.slow
    @pytest.mark.parametrize("fingers", [3, 5])
    def test_no_perturbation_contradicts_a_label(self, fingers: int) -> None:
        contacts, location = self._random(1200, fingers, fingers)
        rng = np.random.default_rng(10)
        alpha = 0.15
        label = classify(contacts, alpha, location_error=location).label
        assert (label != Label.U).all()
        stable = np.flatnonzero(label == Label.S)
        assert len(stable) > 50
        for number in range(12):
            direction = unit_rows(rng.normal(size=contacts.points.shape))
            points = contacts.points + location[..., None] * direction
            normals = random_tilts(contacts.normals, alpha / 2.0, rng)
            if number % 2:  # the worst direction of the perceived grasp, followed by each contact
                u = force_closure(contacts, cone_offset=-alpha / 2.0).certificate.direction
                turning, base = u[:, None, 3:], u[:, None, :3]
                velocity = base + np.cross(turning, points)
                side = 1.0 if number % 4 == 1 else -1.0
                normals = toward(contacts.normals, velocity, -side * alpha / 2.0 * np.ones(1))
                push = np.cross(normals, turning)
                push = unit_rows(push)
                points = contacts.points - side * location[..., None] * push
            tried = Contacts(points[stable], normals[stable], contacts.friction[stable])
            assert force_closure(tried).closed.all()

    @pytest.mark.slow
    @pytest.mark.parametrize("fingers", [3, 4])
    def test_torques_that_are_resisted_decide_on_s(self, fingers: int) -> None:
        """S while unit forces resist every torque of the length of the error, M beyond.

        Bounds of that length: Qhull has the wrenches of rings in the cones, whose hull is inside
        the true one; in the directions of its facets the cones reach as far as they do.
        """
        contacts, _ = self._random(30, fingers, 22)
        cones = [contacts.with_friction(np.tan(part * contacts.friction_angle)) for part in RINGS]
        rows = np.concatenate([wrenches(one, edges=12) for one in cones], axis=1)
        least, most = np.zeros((2, 30))
        for number, one in enumerate(rows.reshape(30, -1, 6)):
            planes = ConvexHull(one, qhull_options="QJ").equations
            if planes[:, 6].max() < 0.0:
                u, turning = planes[:, None, :6], np.linalg.norm(planes[:, 3:6], axis=1)
                reach = u[..., :3] + np.cross(u[..., 3:], contacts.points[number])  # (F, n, 3)
                off = angles(reach, contacts.normals[number]) - contacts.friction_angle[number]
                heights = np.linalg.norm(reach, axis=2) * np.cos(np.maximum(off, 0.0))
                turning = np.maximum(turning, 1e-300)
                least[number] = (-planes[:, 6] / turning).min()
                most[number] = (heights.max(axis=1) / turning).min()
        tolerant = np.flatnonzero(least > 0.02)
        assert len(tolerant) > 5
        assert np.median(most[tolerant] / least[tolerant]) < 1.1
        grasps, error = contacts.take(tolerant), np.stack([0.95 * least, 1.001 * most])[:, tolerant]
        expected = ([Label.S] * len(tolerant), [Label.M] * len(tolerant))
        for length, label in zip(error, expected, strict=True):
            assert classify(grasps, 0.0, location_error=length[:, None]).label.tolist() == label

    def test_a_crease_is_a_cap_of_the_cones(self) -> None:
        """With a location error as well: cones that are narrower by half of the crease's angle."""
        contacts, location = self._random(60, 4, 24)
        across = unit_rows(np.cross(contacts.normals[:, 0], [0.3, 0.5, 0.8]))
        turn, middle = 0.1, contacts.normals[:, 0]
        faces = np.stack(
            [math.cos(turn) * middle + s * math.sin(turn) * across for s in (1.0, -1.0)], axis=1
        )
        wider = np.zeros((60, 4))
        wider[:, 0] = -turn
        sets, smooth = (NormalSets.of_contacts(contacts, one) for one in ({0: faces}, {}))
        worst, best = uncertain_angles(contacts.points, sets, location=location)
        expected, _ = uncertain_angles(
            contacts.points, smooth, location=location, wider=(wider, -wider)
        )
        assert worst == pytest.approx(expected, abs=2e-4)
        worst, best = uncertain_angles(contacts.points, sets)
        expected = uncertain_angles(contacts.points, smooth, wider=(wider, -wider))
        assert worst == pytest.approx(expected[0], abs=2e-4)
        assert best == pytest.approx(expected[1], abs=2e-4)
        assert (worst - best > 0.01).mean() > 0.5


def test_a_crease_at_the_point_of_the_other_contact_may_hold() -> None:
    """Its middle normal is far from the other contact's, but one of its faces is opposite."""
    slope = math.radians(150.0)
    faces = np.array([[1.0, 0.0, 0.0], [math.cos(slope), math.sin(slope), 0.0]])
    for gap in (0.0, 1e-6):
        points = [[0.0, 0.0, 0.0], [gap, 0.0, 0.0]]
        contacts = Contacts(points, [unit_rows(faces.sum(axis=0)), [-1.0, 0.0, 0.0]], 0.5)
        found = classify(contacts, 0.1, location_error=0.01, creases={0: faces})
        assert Label(int(found.label)) is Label.M
