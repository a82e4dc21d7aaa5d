"""Critical angles with uncertain contact locations, friction and fingers that differ."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from grasp3d import Contacts, Label, classify, force_closure
from grasp3d._kernels.search.pair_lines import smallest_over_lines
from grasp3d.arrays import unit_rows
from grasp3d.quality import location_tolerance
from grasp3d.stability.located_angles import ContactLimits, PairLines, located_pairs
from tests.helpers.tilts import angles, random_tilts

Floats = NDArray[np.float64]


class Case(NamedTuple):
    """Random grasps of two fingers and what is known about them, each (b, 2)."""

    contacts: Contacts
    low: Floats
    high: Floats
    tilt: Floats
    location: Floats

    def label(self) -> Floats:
        """Their labels, with half of the tilt as a normal error."""
        return np.asarray(
            classify(
                self.contacts,
                self.tilt,
                friction_interval=(self.low, self.high),
                normal_error=0.5 * self.tilt,
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


def smallest_in_cap(line: Floats, normals: Floats, turn: float) -> float:
    """Minimum over the lines within `turn` of one of the larger angle to two unit vectors."""

    def value(tried: Floats) -> float:
        return float(angles(normals, tried).max())

    bisector = unit_rows(normals.sum(axis=0))
    within = [one for one in (*normals, bisector) if angles(line, one) <= turn]
    across = unit_rows(np.cross(line, [1.0, 0.0, 0.0] if abs(line[0]) < 0.6 else [0.0, 1.0, 0.0]))
    third = np.cross(line, across)

    def on_border(azimuth: float) -> float:
        side = math.cos(azimuth) * across + math.sin(azimuth) * third
        return value(math.cos(turn) * line + math.sin(turn) * side)

    grid = np.linspace(0.0, 2.0 * math.pi, 400, endpoint=False)
    start = grid[int(np.argmin([on_border(azimuth) for azimuth in grid]))]
    step = 2.0 * math.pi / len(grid)
    border = minimize_scalar(
        on_border, bounds=(start - step, start + step), method="bounded", options={"xatol": 1e-10}
    ).fun
    return min(border, *map(value, within), math.inf)


class TestTwoContacts:
    @pytest.mark.slow
    def test_no_perturbation_contradicts_a_label(self) -> None:
        """10^5 grasps, 60 random and adversarial perturbations each."""
        case, rng = random_pairs(100_000, 1), np.random.default_rng(2)
        label, tilt = case.label(), case.tilt
        assert min(np.bincount(label)) > 500
        stable, unstable = label == Label.S, label == Label.U
        for number in range(60):
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

    def test_witnesses_attain_the_limits(self) -> None:
        """Slightly more friction than the limit of U holds, slightly less than that of S fails."""
        case = random_pairs(3000, 3)
        contacts, limits = case.contacts, self._limits(case)
        lines = PairLines.of_contacts(contacts)
        critical = np.minimum(lines.angles[0].max(axis=1), (math.pi - lines.angles[0]).max(axis=1))
        worst, _ = located_pairs(critical, critical, lines, limits)
        usable = critical < 0.5 * math.pi - 0.3
        worst_held = self._held_at(case, worst - 1e-6, lines, worst=True)
        assert not worst_held[usable & (worst < 1.5)].any()
        assert self._held_at(case, worst + 1e-6, lines, worst=True)[usable & (worst < 1.5)].all()

    @pytest.mark.slow
    def test_the_best_line_is_the_minimum_over_the_cap(self) -> None:
        """Against a search: the normals, their bisector, and the border of each cap of lines."""
        case = random_pairs(150, 8)
        lines = PairLines.of_contacts(case.contacts)
        critical = np.minimum(lines.angles[0].max(axis=1), (math.pi - lines.angles[0]).max(axis=1))
        _, best = located_pairs(critical, critical, lines, self._limits(case))
        turn = np.arcsin(np.minimum(case.location.sum(axis=1) / lines.openings, 1.0))
        for g in range(len(best)):
            normals = lines.normals[g]
            found = min(
                smallest_in_cap(sign * lines.lines[g], normals, turn[g]) for sign in (1.0, -1.0)
            )
            assert best[g] == pytest.approx(found, abs=1e-6)

    @staticmethod
    def _limits(case: Case) -> ContactLimits:
        zero = np.zeros_like(case.location)
        return ContactLimits.of_angles(zero, zero, case.location)

    @staticmethod
    def _held_at(case: Case, angle: Floats, lines: PairLines, *, worst: bool) -> NDArray[np.bool_]:
        """Whether grasps hold at a friction angle, the line turned away from the worse normal."""
        points, opening = case.contacts.points, lines.openings
        squeeze = lines.angles[0].max(axis=1) <= (math.pi - lines.angles[0]).max(axis=1)
        used = np.where(squeeze[:, None], lines.angles[0], math.pi - lines.angles[0])
        which = used.argmax(axis=1)
        sign = np.where(squeeze, 1.0, -1.0) * np.where(which == 0, 1.0, -1.0)
        normal = np.take_along_axis(case.contacts.normals, which[:, None, None], 1)[:, 0]
        normal = normal * sign[:, None]  # the line along which that finger pushes is near it
        total = case.location.sum(axis=1)
        eta = np.arcsin(np.minimum(total / opening, 1.0))
        turned = toward(lines.lines, normal, -eta if worst else eta)
        # Contacts move across the turned line: it is tangent to both balls.
        across = turned - (turned * lines.lines).sum(axis=1, keepdims=True) * lines.lines
        across -= (across * turned).sum(axis=1, keepdims=True) * turned
        across = unit_rows(across)
        part = (case.location / np.maximum(total, 1e-300)[:, None])[..., None]
        move = np.stack([-across, across], axis=1) * part * total[:, None, None]
        friction = np.tan(np.clip(angle, 1e-9, 1.57))[:, None] * np.ones(2)
        return holds(points + move, case.contacts.normals, friction)

    def test_zero_errors_change_no_label(self) -> None:
        case = random_pairs(5000, 5)
        plain = classify(case.contacts, case.tilt)
        zero = classify(case.contacts, case.tilt, normal_error=0.0, location_error=0.0)
        tiny = classify(case.contacts, case.tilt, location_error=1e-300)
        assert (zero.label == plain.label).all()
        assert (tiny.label == plain.label).all()

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
                low=low,
                high=high,
                tilt=case.tilt * (scale if name == "tilt" else 1.0),
                location=case.location * (scale if name == "location" else 1.0),
            )
            labels.append(changed.label())
        for before, after in pairwise(labels):
            assert ((after == before) | (after == Label.M)).all()
        assert (labels[0] != labels[-1]).any()

    def test_margin_is_positive_exactly_where_a_grasp_is_stable(self) -> None:
        case = random_pairs(5000, 7)
        found = classify(
            case.contacts, case.tilt, friction_interval=(case.low, case.high),
            location_error=case.location,
        )  # fmt: skip
        assert ((found.margin > 0.0) == (found.label == Label.S)).all()

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

    def test_a_crease_counts_with_all_its_normals(self) -> None:
        """A finger on a 90 degree edge, as at the square's corner: S needs much friction."""
        contacts = Contacts([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[1, 0, 0], [-1, 0, 0]], 1.2)
        edge = {0: [[1.0, 1.0, 0.0], [1.0, -1.0, 0.0]]}
        known = classify(contacts, 0.0, creases=edge)
        unsure = classify(contacts, 0.0, creases=edge, location_error=0.1)
        assert known.label == Label.S
        assert unsure.label == Label.M
        expected = math.atan(1.2) - math.radians(45.0) - math.asin(0.1)
        assert float(unsure.margin) == pytest.approx(expected, abs=1e-12)


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
    @pytest.mark.parametrize("fingers", [3, 4, 5])
    def test_no_perturbation_contradicts_a_label(self, fingers: int) -> None:
        contacts, location = self._random(1200, fingers, fingers)
        rng = np.random.default_rng(10)
        alpha = 0.15
        label = classify(contacts, alpha, location_error=location).label
        stable, unstable = label == Label.S, label == Label.U
        assert stable.sum() > 50
        assert unstable.sum() > 50
        decided = np.flatnonzero(stable | unstable)
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
            tried = Contacts(points[decided], normals[decided], contacts.friction[decided])
            closed = force_closure(tried).closed
            assert closed[stable[decided]].all()
            assert not closed[unstable[decided]].any()

    @pytest.mark.slow
    def test_less_knowledge_never_helps(self) -> None:
        contacts, location = self._random(300, 4, 20)
        before = classify(contacts, 0.1).label
        for scale in (0.5, 1.0):
            after = classify(contacts, 0.1, location_error=scale * location).label
            assert ((after == before) | (after == Label.M)).all()
            before = after

    def test_fingers_that_differ_are_exact_without_location_errors(self) -> None:
        """Located angles decide as the closure tests of `classify` do."""
        contacts, _ = self._random(200, 3, 21)
        tilt = np.array([0.02, 0.1, 0.2])
        expected = classify(contacts, 2.0 * tilt)
        narrowest = contacts.friction_angle - tilt
        margin = expected.margin
        assert (np.sign(margin[np.abs(margin) > 2e-3]) > 0).tolist() == (
            expected.label[np.abs(margin) > 2e-3] == Label.S
        ).tolist()
        assert narrowest.min() > 0.0

    def test_tolerance_is_that_of_the_label(self) -> None:
        """Just inside the tolerated location error a grasp is S, just outside M."""
        contacts, _ = self._random(200, 4, 22)
        allowed = location_tolerance(contacts, cone_offset=-0.05, rtol=1e-4)
        chosen = np.flatnonzero(allowed > 0.01)
        assert len(chosen) > 20
        picked = contacts.take(chosen)
        for factor, expected in ((0.95, Label.S), (1.02, Label.M)):
            error = factor * allowed[chosen][:, None] * np.ones(4)
            assert (classify(picked, 0.1, location_error=error).label == expected).all()


@pytest.mark.parametrize("added", [(0.0, 0.0), (0.3, 0.0), (0.2, 0.5)])
@pytest.mark.parametrize("sine", [0.3, 0.99, 1.0, 1.5])
def test_lines_between_opposite_normals(sine: float, added: tuple[float, float]) -> None:
    """Every line across two opposite normals has equal angles to both."""
    rng = np.random.default_rng(4)
    for number in range(40):
        axis, normal = unit_rows(rng.normal(size=(2, 3)))
        other = -normal if number % 2 else unit_rows(-normal + 1e-16 * rng.normal(size=3))
        found = smallest_over_lines(tuple(axis), tuple(normal), tuple(other), sine, *added)
        angle = float(np.arccos(np.clip(axis @ normal, -1.0, 1.0)))
        turn = math.pi if sine > 1.0 else math.asin(sine)
        reach = np.clip([angle - turn, angle + turn], 0.0, math.pi)
        balanced = np.clip(0.5 * (math.pi + added[1] - added[0]), *reach)
        expected = max(balanced + added[0], math.pi - balanced + added[1])
        assert found == pytest.approx(expected, abs=1e-6)


def test_a_crease_at_the_point_of_the_other_contact_may_hold() -> None:
    """Its middle normal is far from the other contact's, but one of its faces is opposite."""
    slope = math.radians(150.0)
    faces = np.array([[1.0, 0.0, 0.0], [math.cos(slope), math.sin(slope), 0.0]])
    for gap in (0.0, 1e-6):
        points = [[0.0, 0.0, 0.0], [gap, 0.0, 0.0]]
        contacts = Contacts(points, [unit_rows(faces.sum(axis=0)), [-1.0, 0.0, 0.0]], 0.5)
        found = classify(contacts, 0.1, location_error=0.01, creases={0: faces})
        assert Label(int(found.label)) is Label.M
