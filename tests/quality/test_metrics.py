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

from grasp3d import Contacts, epsilon, force_closure
from grasp3d.contact.contacts import cone_edges
from grasp3d.errors import SettingError
from grasp3d.quality import metric_names, metrics
from tests.helpers.grasps import changed, just_off_a_line, one, regular_on_ball
from tests.helpers.random_grasps import Shape, random_contacts

Floats = NDArray[np.float64]

PAGE = Path(__file__).parents[2] / "docs" / "theory" / "epsilon.md"

KINDS = [Shape(2, 8, soft=False), Shape(2, 8, soft=True), Shape(3, 8, soft=False),
         Shape(4, 8, soft=True), Shape(5, 8, soft=False)]  # fmt: skip
kinds = st.sampled_from(KINDS)
seeds = st.integers(0, 10_000)
few = settings(max_examples=15, deadline=None)


def grasp(kind: Shape, seed: int) -> Contacts:
    """A random grasp off the centre of mass."""
    contacts = one(random_contacts(kind, 1, seed), 0)
    return changed(contacts, points=contacts.points + [0.2, -0.1, 0.3])


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
    found = metrics(contacts, "smallest_singular_value,grasp_isotropy", torque_scale=scale)
    rank = int(force_closure(contacts).rank)
    values = np.linalg.svd(grasp_matrix(contacts, scale), compute_uv=False)[:rank]
    assert found["smallest_singular_value"] == pytest.approx(values[-1])
    assert found["grasp_isotropy"] == pytest.approx(values[-1] / values[0])


@settings(max_examples=6, deadline=None)
@given(kinds, seeds)
def test_the_volume_of_the_wrench_space_is_that_of_a_hull(kind: Shape, seed: int) -> None:
    contacts = grasp(kind, seed)
    rows = primitive_wrenches(contacts)
    rank = np.linalg.matrix_rank(rows, tol=1e-8)
    basis = np.linalg.svd(rows)[2][:rank]
    volume = ConvexHull(rows @ basis.T).volume
    assert metrics(contacts, "wrench_space_volume")["wrench_space_volume"] == pytest.approx(volume)


@few
@given(kinds, seeds)
@example(Shape(3, 8, soft=False), 2804)  # the mean is at the border, apart from rounding
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
    found = metrics(contacts, "min_weight")["min_weight"]
    assert found == pytest.approx(-result.fun, abs=1e-6)
    assert found <= 1.0 / count + 1e-9
    polygons = epsilon(contacts, edges=8)
    if polygons.status == 0 and not 0.0 < polygons.upper < 1e-6:
        assert (found > 0.0) == polygons.closed


ROOT = math.sqrt(2.0)
KNOWN = {
    "pair": (regular_on_ball("pair"), ROOT, 1.0, 1.0 / 16.0),
    "pair with torsion": (
        regular_on_ball("pair", torsion_radius=0.1), 0.1 * ROOT, 0.1, 1.0 / 20.0,
    ),
    # Forces: G G^T = 3 I. Torques: 1.5, 1.5 and 3, as of three points on a circle.
    "triangle": (regular_on_ball("triangle"), math.sqrt(1.5), math.sqrt(0.5), 1.0 / 24.0),
    "tetrahedron": (
        regular_on_ball("tetrahedron"), math.sqrt(8.0 / 3.0), math.sqrt(2.0 / 3.0), 1.0 / 32.0,
    ),
    "octahedron without friction": (
        regular_on_ball("octahedron", friction=0.0), math.nan, math.nan, 1.0 / 48.0,
    ),
}  # fmt: skip
"""Smallest singular value, isotropy and least weight."""


@pytest.mark.parametrize("name", KNOWN)
def test_known_measures(name: str) -> None:
    contacts, singular, isotropy, weight = KNOWN[name]
    found = metrics(contacts)
    assert found["smallest_singular_value"] == pytest.approx(singular, nan_ok=True)
    assert found["grasp_isotropy"] == pytest.approx(isotropy, nan_ok=True)
    assert found["min_weight"] == pytest.approx(weight)


def test_epsilon_is_that_of_pyramids_with_one_bound_on_all_forces_or_on_each() -> None:
    contacts = regular_on_ball("octahedron")
    found = metrics(contacts, edges=6, torque_scale=2.0)
    assert found["epsilon_l1"] == epsilon(contacts, edges=6, torque_scale=2.0).lower
    own = epsilon(contacts, edges=6, torque_scale=2.0, actuation="per_finger").lower
    assert found["epsilon_linf"] == own > found["epsilon_l1"] > 0.0


def test_what_is_no_grasp_has_no_best_score() -> None:
    one = metrics(Contacts([[1.0, 0, 0]], [[-1.0, 0, 0]]))
    assert np.isnan(list(one.values())).all()
    for position, radius in (([0.0, 0, 0], 0.0), ([1.0, 2.0, 3.0], 0.0), ([1.0, 2.0, 3.0], 0.1)):
        normals = [[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0]]
        found = metrics(Contacts([position] * 3, normals, 0.5, radius))
        assert np.isnan(found["min_weight"])
        assert radius > 0.0 or np.isnan(found["wrench_space_volume"])
        assert radius > 0.0 or np.isnan(found["grasp_isotropy"])
    pushed = Contacts([[-1.0, 0, 0], [1.0, 0, 0]], [[0, 0, 1.0], [0, 0, 1.0]])
    for friction in (0.5, 0.0):
        weight = metrics(pushed.with_friction(friction), "min_weight")["min_weight"]
        assert np.isnan(weight) or weight < 0.0
    for gap in (1e-3, 1e-9, 1e-15):
        near = metrics(just_off_a_line(gap))
        assert np.isfinite([near[name] for name in near if name != "wrench_space_volume"]).all()
        assert near["min_weight"] > 0.0


def test_names() -> None:
    assert metric_names(["min_weight", "all"])[0] == "min_weight"
    assert set(metric_names(["min_weight", "all"])) == set(metric_names("all"))
    assert metric_names("min_weight,epsilon_l1,min_weight") == ("min_weight", "epsilon_l1")
    with pytest.raises(SettingError, match="no metric is called 'beauty'; known: all, epsilon_l1"):
        metric_names(["beauty"])
    for nothing in ("", [], " , "):
        with pytest.raises(SettingError, match="no metric"):
            metric_names(nothing)


def test_the_page_lists_every_metric() -> None:
    _, text = PAGE.read_text(encoding="utf-8").split("## Other quality measures")
    assert re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE) == list(metric_names())
