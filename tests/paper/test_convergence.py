"""Sampled labels beside exact ones: they converge, and err only in the ways that they may."""

import itertools
import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from grasp3d import Label, classify
from grasp3d.paper import convergence
from grasp3d.paper.convergence import (
    SAMPLES,
    Comparison,
    compare,
    comparisons,
    convergence_tables,
    random_grasps,
)

S, M, U = Label.S, Label.M, Label.U


@cache
def measured() -> tuple[Comparison, ...]:
    shares: list[float] = []
    found = tuple(comparisons(shares.append))
    assert shares == sorted(shares)
    assert len(shares) == len(found)
    assert shares[-1] == pytest.approx(1.0)
    return found


def of(fingers: int, *, polygonal: bool) -> list[Comparison]:
    return [
        one for one in measured() if one.fingers == fingers and (one.edges is not None) == polygonal
    ]


@pytest.mark.slow
@pytest.mark.parametrize("polygonal", [False, True])
@pytest.mark.parametrize("fingers", SAMPLES)
def test_disagreements_become_fewer_and_none_is_forbidden(fingers: int, polygonal: bool) -> None:
    found = of(fingers, polygonal=polygonal)
    grasps, rims = SAMPLES[fingers]
    assert [one.extreme_normals for one in found] == list(rims)
    exact = found[0].counts.sum(axis=1)
    assert (exact > 0.1 * grasps).all()
    for one in found:
        assert one.counts.sum() == one.grasps == grasps
        assert one.edges == (one.extreme_normals if polygonal else None)
        assert one.forbidden == 0
        assert one.counts[U, M] == one.counts[U, S] == 0
        assert polygonal or one.counts[S, M] == one.counts[S, U] == 0
        np.testing.assert_array_equal(one.counts.sum(axis=1), exact)
        assert 2 * grasps <= one.hulls <= grasps * (one.extreme_normals + 1) ** fingers
    for less, more in itertools.pairwise(found):
        assert more.share <= less.share + math.hypot(less.error, more.error)
        assert polygonal or more.share <= less.share
    assert found[-1].share < 0.5 * found[0].share
    assert found[0].share > found[0].error > 0.0


@pytest.mark.slow
def test_samples_are_large() -> None:
    assert {fingers: (grasps, rims[-1]) for fingers, (grasps, rims) in SAMPLES.items()} == {
        2: (2000, 32),
        3: (500, 16),
        4: (200, 8),
    }
    assert len(measured()) == 2 * sum(len(rims) for _, rims in SAMPLES.values())
    # On a rim of 32 two fingers are judged almost as if all tilts were tried.
    (finest,) = [one for one in of(2, polygonal=False) if one.extreme_normals == 32]
    assert finest.share < 0.01


@pytest.mark.parametrize(("fingers", "size", "rims"), [(2, 400, (4, 8, 16, 32)), (3, 80, (3, 6))])
def test_more_normals_on_a_rim_make_no_grasp_more_certain(
    fingers: int, size: int, rims: tuple[int, ...]
) -> None:
    """With circular cones, where each rim holds the normals of the one before."""
    contacts, resolution = random_grasps(fingers, size, 1)
    exact = classify(contacts, resolution).label
    before: Any = None
    certain = []
    for around in rims:
        found = classify(
            contacts, resolution, method="extremes", extreme_normals=around, threads=None
        )
        settled = found.label != M
        assert ((found.label == exact) | settled).all()
        if before is not None:
            assert (settled <= (before != M)).all()
            np.testing.assert_array_equal(found.label[settled], before[settled])
        before = found.label
        certain.append(int(settled.sum()))
    assert certain[-1] < certain[0]


def test_random_grasps_are_the_same_every_time_and_of_every_kind() -> None:
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
        shares = np.bincount(classify(contacts, resolution).label, minlength=3) / 300.0
        assert shares.min() > 0.05


def test_a_comparison_counts_what_both_methods_say() -> None:
    one = compare(2, 60, 4, edges=5, seed=3)
    contacts, resolution = random_grasps(2, 60, 3)
    exact = classify(contacts, resolution).label
    sampled = classify(contacts, resolution, method="extremes", extreme_normals=4, edges=5)
    for row in Label:
        for column in Label:
            expected = ((exact == row) & (sampled.label == column)).sum()
            assert one.counts[row, column] == expected
    assert one.hulls == sampled.hulls.sum()
    assert one.share == pytest.approx((exact != sampled.label).mean())
    assert one.error == pytest.approx(math.sqrt(one.share * (1.0 - one.share) / 60.0))
    assert not one.counts.flags.writeable


def drawn_up(edges: int | None, **cells: int) -> Comparison:
    counts = np.zeros((3, 3), dtype=np.int64)
    for name, number in cells.items():
        counts[Label[name[0]], Label[name[1]]] = number
    return Comparison(3, int(counts.sum()), 8, edges, counts, 12_345)


def test_what_is_forbidden_depends_on_the_cones() -> None:
    cells = {"SS": 40, "MM": 30, "UU": 20, "MS": 3, "MU": 2, "SM": 1, "SU": 4, "UM": 5, "US": 6}
    circular, polygonal = drawn_up(None, **cells), drawn_up(8, **cells)
    assert circular.forbidden == 1 + 4 + 5 + 6
    assert polygonal.forbidden == 5 + 6
    for one in (circular, polygonal):
        assert one.share == pytest.approx(21.0 / 111.0)
        assert one.overconfident == pytest.approx(5.0 / 35.0)
    assert drawn_up(None, SS=7).overconfident == 0.0
    assert drawn_up(None, SS=7).error == 0.0


def test_tables_show_both_kinds_of_cones_in_rows_of_equal_length() -> None:
    rows = [drawn_up(None, SS=1990, MS=10), drawn_up(16, SM=3, MU=1, SS=96)]
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
    assert text.index("Circular friction cones") < text.index("Polygons of as many edges")


def test_progress_is_the_share_of_all_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(convergence, "SAMPLES", {2: (10, (3, 6)), 3: (4, (3,))})
    shares: list[float] = []
    found = comparisons(shares.append)
    sizes = [(one.fingers, one.extreme_normals, one.edges) for one in found]
    expected = [(2, 3, None), (2, 6, None), (3, 3, None), (2, 3, 3), (2, 6, 6), (3, 3, 3)]
    assert sizes == expected
    assert shares == sorted(shares)
    assert 0.0 < shares[0] < shares[-1] == pytest.approx(1.0)
    assert comparisons()[0].counts.tolist() == found[0].counts.tolist()
