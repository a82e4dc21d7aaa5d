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
from tests.helpers.grasps import changed, just_off_a_line, one, regular_on_ball, stacked
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


# --- other formulations --------------------------------------------------------------------------


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


# --- laws ----------------------------------------------------------------------------------------


@pytest.mark.slow
@few
@given(kinds, seeds, st.floats(0.01, 100.0))
@example(Shape(2, 8, soft=True), 5427, 1.0)  # only without a presolver the moved one is solved
def test_min_weight_depends_on_no_centre_and_no_scale(kind: Shape, seed: int, scale: float) -> None:
    contacts = grasp(kind, seed)
    moved = changed(contacts, points=contacts.points + [3.0, -2.0, 1.0])
    before = metrics(contacts, "min_weight")["min_weight"]
    after = metrics(moved, "min_weight", torque_scale=scale)["min_weight"]
    assert after == pytest.approx(before, rel=1e-5, abs=2e-6, nan_ok=True)


@settings(max_examples=6, deadline=None)
@given(seeds)
def test_another_finger_lowers_no_volume_and_no_epsilon(seed: int) -> None:
    contacts = grasp(Shape(4, 8, soft=False), seed)
    fewer = Contacts(contacts.points[:3], contacts.normals[:3], contacts.friction[:3])
    names = "wrench_space_volume,smallest_singular_value,epsilon_l1,epsilon_linf"
    before, after = metrics(fewer, names), metrics(contacts, names)
    for name in before:
        assert after[name] >= before[name] * (1.0 - 1e-9), name


def test_a_batch_has_the_values_of_its_grasps() -> None:
    single = [grasp(Shape(4, 8, soft=True), seed) for seed in range(6)]
    single[2] = changed(single[2], torsion_radius=np.array([0.0, 0.2, 0.0, 0.1]))
    single[4] = changed(single[4], points=np.ones((4, 3)))
    found = metrics(stacked(single).reshape((2, 3)))
    for k, contacts in enumerate(single):
        alone = metrics(contacts)
        for name, values in found.items():
            assert values.shape == (2, 3)
            assert values[divmod(k, 3)] == pytest.approx(
                alone[name], rel=1e-6, abs=1e-8, nan_ok=True
            ), name


# --- known shapes --------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [0.2, 0.5, 1.0])
def test_opposed_fingers(friction: float) -> None:
    found = metrics(regular_on_ball("pair", friction))
    assert found["smallest_singular_value"] == pytest.approx(math.sqrt(2.0))
    assert found["grasp_isotropy"] == pytest.approx(1.0)
    assert found["min_weight"] == pytest.approx(1.0 / 16.0)


def test_torsion_of_opposed_fingers_adds_a_dimension() -> None:
    found = metrics(regular_on_ball("pair", 0.5, torsion_radius=0.1))
    assert found["smallest_singular_value"] == pytest.approx(0.1 * math.sqrt(2.0))
    assert found["min_weight"] == pytest.approx(1.0 / 20.0)


def test_three_fingers_at_120_degrees() -> None:
    found = metrics(regular_on_ball("triangle"), "smallest_singular_value")
    # Forces: G G^T = 3 I. Torques: 1.5, 1.5 and 3, as of three points on a circle.
    assert found["smallest_singular_value"] == pytest.approx(math.sqrt(1.5))


def test_fingers_at_the_corners_of_a_tetrahedron() -> None:
    found = metrics(regular_on_ball("tetrahedron"))
    assert found["smallest_singular_value"] == pytest.approx(math.sqrt(8.0 / 3.0))
    assert found["grasp_isotropy"] == pytest.approx(math.sqrt(2.0 / 3.0))


def test_epsilon_is_that_of_pyramids_with_one_bound_on_all_forces_or_on_each() -> None:
    contacts = regular_on_ball("octahedron")
    found = metrics(contacts, edges=6, torque_scale=2.0)
    assert found["epsilon_l1"] == epsilon(contacts, edges=6, torque_scale=2.0).lower
    own = epsilon(contacts, edges=6, torque_scale=2.0, actuation="per_finger").lower
    assert found["epsilon_linf"] == own > found["epsilon_l1"] > 0.0


# --- degenerate grasps ---------------------------------------------------------------------------


def test_one_contact_is_no_grasp() -> None:
    found = metrics(Contacts([[1.0, 0, 0]], [[-1.0, 0, 0]]))
    assert np.isnan(list(found.values())).all()


@pytest.mark.parametrize("torsion_radius", [0.0, 0.1])
@pytest.mark.parametrize("position", [[0.0, 0, 0], [1.0, 2.0, 3.0]])
def test_contacts_at_one_point_have_no_best_score(
    position: list[float], torsion_radius: float
) -> None:
    normals = [[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0]]
    found = metrics(Contacts([position] * 3, normals, 0.5, torsion_radius))
    assert np.isnan(found["min_weight"])
    if torsion_radius == 0.0:
        for name in ("grasp_isotropy", "smallest_singular_value", "wrench_space_volume"):
            assert np.isnan(found[name]), name


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9, 1e-12, 1e-15])
def test_contacts_nearly_on_a_line_have_values(gap: float) -> None:
    found = metrics(just_off_a_line(gap))
    assert np.isfinite([found[name] for name in found if name != "wrench_space_volume"]).all()
    assert found["min_weight"] > 0.0


def test_without_friction_only_normal_forces_count() -> None:
    found = metrics(regular_on_ball("octahedron", friction=0.0))
    assert np.isnan(found["grasp_isotropy"])
    assert found["min_weight"] == pytest.approx(1.0 / 48.0)


def test_fingers_that_only_push_one_way_have_no_weights() -> None:
    contacts = Contacts([[-1.0, 0, 0], [1.0, 0, 0]], [[0, 0, 1.0], [0, 0, 1.0]])
    for friction in (0.5, 0.0):
        found = metrics(contacts.with_friction(friction), "min_weight")["min_weight"]
        assert np.isnan(found) or found < 0.0


# --- names, settings, documentation --------------------------------------------------------------


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
    text = PAGE.read_text(encoding="utf-8").partition("## Other quality measures")[2]
    assert re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE) == list(metric_names())
