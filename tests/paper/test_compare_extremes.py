"""Sampled labels against exact ones: they converge, and all differences are allowed ones."""

import itertools
import math
from typing import Any

import compare_extremes
import numpy as np
import pytest
from compare_extremes import (
    SAMPLES,
    Comparison,
    compare,
    comparisons,
    convergence_tables,
    surface_table,
)

from grasp3d import Label, classify
from grasp3d.paper.paper_settings import PaperSettings
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.system.context import running
from tests.helpers.random_grasps import random_grasps

S, M, U = Label.S, Label.M, Label.U


@pytest.mark.slow
def test_disagreements_become_fewer_and_all_are_allowed() -> None:
    """One test, as all comparisons together take long."""
    assert {fingers: (grasps, normals[-1]) for fingers, (grasps, normals) in SAMPLES.items()} == {
        2: (2000, 32),
        3: (500, 16),
        4: (200, 8),
    }
    measured = comparisons()
    assert len(measured) == 2 * sum(len(normals) for _, normals in SAMPLES.values())
    for fingers, polygonal in itertools.product(SAMPLES, (False, True)):
        check([
            one for one in measured
            if one.fingers == fingers and (one.edges is not None) == polygonal
        ], polygonal=polygonal)  # fmt: skip
    # With 32 extreme normals the labels of two fingers are almost exact.
    finest = next(one for one in measured if one.fingers == 2 and one.extreme_normals == 32)
    assert finest.edges is None
    assert finest.disagreement < 0.01


def check(found: list[Comparison], *, polygonal: bool) -> None:
    """Check comparisons of one number of fingers, from few extreme normals to many."""
    fingers = found[0].fingers
    grasps, numbers = SAMPLES[fingers]
    assert [one.extreme_normals for one in found] == list(numbers)
    exact = found[0].counts.sum(axis=1)
    assert (exact > 0.1 * grasps).all()
    for one in found:
        assert one.counts.sum() == one.grasps == grasps
        assert one.edges == (one.extreme_normals if polygonal else None)
        assert one.not_allowed == 0
        assert one.counts[U, M] == one.counts[U, S] == 0
        assert polygonal or one.counts[S, M] == one.counts[S, U] == 0
        np.testing.assert_array_equal(one.counts.sum(axis=1), exact)
        assert 2 * grasps <= one.hulls <= grasps * (one.extreme_normals + 1) ** fingers
    for less, more in itertools.pairwise(found):
        assert more.disagreement <= less.disagreement + math.hypot(less.error, more.error)
        assert polygonal or more.disagreement <= less.disagreement
    assert found[-1].disagreement < 0.5 * found[0].disagreement
    assert found[0].disagreement > found[0].error > 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fingers", "size", "numbers"), [(2, 400, (4, 8, 16, 32)), (3, 80, (3, 6))]
)
def test_more_extreme_normals_make_no_grasp_more_certain(
    fingers: int, size: int, numbers: tuple[int, ...]
) -> None:
    """With circular cones and each set of normals containing the one before."""
    contacts, resolution = random_grasps(fingers, size, 1)
    exact = classify(contacts, resolution).label
    before: Any = None
    certain = []
    for normals in numbers:
        found = classify(
            contacts,
            resolution,
            method="extremes",
            extreme_normals=normals,
            options=EpsilonOptions(),
        )
        sure = found.label != M
        assert ((found.label == exact) | sure).all()
        if before is not None:
            assert (sure <= (before != M)).all()
            np.testing.assert_array_equal(found.label[sure], before[sure])
        before = found.label
        certain.append(int(sure.sum()))
    assert certain[-1] < certain[0]


def test_random_grasps_are_reproducible_and_have_all_labels() -> None:
    for fingers in (2, 3, 4):
        contacts, resolution = random_grasps(fingers, 300)
        again, _ = random_grasps(fingers, 300)
        np.testing.assert_array_equal(contacts.points, again.points)
        np.testing.assert_array_equal(contacts.friction, again.friction)
        other, _ = random_grasps(fingers, 300, seed=1)
        assert not np.allclose(other.points, contacts.points)
        assert resolution.shape == (300, 1)
        assert contacts.friction.min() >= 0.3
        assert contacts.friction.max() <= 1.0
        assert (resolution <= 2.0 * contacts.friction_angle[:, :1]).all()
        fractions = np.bincount(classify(contacts, resolution).label, minlength=3) / 300.0
        assert fractions.min() > 0.05


def test_a_comparison_counts_the_labels_of_both_methods() -> None:
    one = compare(2, 60, 4, edges=5, seed=3)
    contacts, resolution = random_grasps(2, 60, 3)
    exact = classify(contacts, resolution).label
    sampled = classify(
        contacts, resolution, method="extremes", extreme_normals=4, options=EpsilonOptions(edges=5)
    )
    for row in Label:
        for column in Label:
            expected = ((exact == row) & (sampled.label == column)).sum()
            assert one.counts[row, column] == expected
    assert one.hulls == sampled.hulls.sum()
    assert one.disagreement == pytest.approx((exact != sampled.label).mean())
    error = math.sqrt(one.disagreement * (1.0 - one.disagreement) / 60.0)
    assert one.error == pytest.approx(error)
    assert not one.counts.flags.writeable


def comparison_of(edges: int | None, **cells: int) -> Comparison:
    counts = np.zeros((3, 3), dtype=np.int64)
    for name, number in cells.items():
        counts[Label[name[0]], Label[name[1]]] = number
    return Comparison(3, int(counts.sum()), 8, edges, counts, 12_345)


def test_allowed_disagreements_depend_on_the_cones() -> None:
    cells = {"SS": 40, "MM": 30, "UU": 20, "MS": 3, "MU": 2, "SM": 1, "SU": 4, "UM": 5, "US": 6}
    circular, polygonal = comparison_of(None, **cells), comparison_of(8, **cells)
    assert circular.not_allowed == 1 + 4 + 5 + 6
    assert polygonal.not_allowed == 5 + 6
    for one in (circular, polygonal):
        assert one.disagreement == pytest.approx(21.0 / 111.0)
        assert one.overconfident == pytest.approx(5.0 / 35.0)
    assert comparison_of(None, SS=7).overconfident == 0.0
    assert comparison_of(None, SS=7).error == 0.0


def test_tables_show_both_kinds_of_cones_in_rows_of_equal_length() -> None:
    rows = [comparison_of(None, SS=1990, MS=10), comparison_of(16, SM=3, MU=1, SS=96)]
    text = convergence_tables(rows)
    tables = [line for line in text.splitlines() if line.startswith("|")]
    assert len(tables) == 6
    assert len({line.count("|") for line in tables}) == 1
    circular, polygonal = tables[2], tables[5]
    assert "| 2,000 |" in circular
    assert "| circular | 1990 / 10 / 0 | 10 | 0 | 0 | 0 | 0 | 0.50 ± 0.16 % |" in circular
    assert (
        "| 16 | 99 / 1 / 0 | 0 | 1 | 3 | 0 | 0 | 4.00 ± 1.96 % | 100.00 % | 12,345 |" in polygonal
    )
    assert text.index("Circular friction cones") < text.index("Polygons inside those cones")


def test_progress_is_the_fraction_of_all_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compare_extremes, "SAMPLES", {2: (10, (3, 6)), 3: (4, (3,))})
    progress: list[float] = []
    with running(progress=progress.append):
        found = comparisons()
    sizes = [(one.fingers, one.extreme_normals, one.edges) for one in found]
    expected = [(2, 3, None), (2, 6, None), (3, 3, None), (2, 3, 3), (2, 6, 6), (3, 3, 3)]
    assert sizes == expected
    assert progress == sorted(progress)
    assert 0.0 < progress[0] < progress[-1] == pytest.approx(1.0)
    assert comparisons()[0].counts.tolist() == found[0].counts.tolist()


@pytest.mark.slow
def test_labels_from_hulls_on_solids_differ_only_as_allowed() -> None:
    page = surface_table(PaperSettings())
    rows = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("|")]
    rows = [row for row in rows if row[1] in {"one finger fixed", "searched"}]
    assert [row[0] for row in rows] == ["sphere"] * 4 + ["box"] * 4 + ["cylinder"] * 4
    assert {row[-1] for row in rows} == {"0"}
    differing = [float(row[-2].rstrip(" %")) for row in rows]
    assert 0.0 < max(differing[::2]) < 4.0  # circular cones
    assert max(differing[::2]) < max(differing[1::2]) < 12.0  # polygons are inside them
