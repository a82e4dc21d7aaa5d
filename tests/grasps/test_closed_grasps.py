"""Grasps of ideal points as the jaws make them, and the order that this gives the best grasps."""

import math
import pickle
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grasp3d import (
    GraspModel,
    Label,
    Load,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    best_grasps,
    evaluate_grasps,
    label_surface,
    load_mesh,
    write_grasps,
)
from grasp3d.arrays import Floats
from grasp3d.grasps import (
    grasp_kinds,
    poses_of,
    verdict_of,
)
from grasp3d.grasps.pose_files import read_poses
from grasp3d.grasps.ranking import stated_label
from grasp3d.mesh import ObjectMesh
from grasp3d.stability.thresholds import label_angles
from grasp3d.surface import GraspTable
from grasp3d.surface.closed_grasps import UNKNOWN
from tests.helpers import shapes
from tests.helpers.grippers import HAND, SLIM

MODEL = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0))

ALL = 1000
"""More than there are distinct grasps."""


@cache
def wedge() -> SurfaceLabels:
    """A block of 60 x 40 x 40 mm, narrower above, two sides of which are inclined by 5 degrees."""
    corners, faces = shapes.box((60.0, 40.0, 40.0))
    corners[:, 1] *= np.where(corners[:, 2] > 0.0, 1.0 - math.tan(math.radians(5.0)), 1.0)
    mesh = load_mesh((corners, faces), unit="mm", max_edge=10.0)
    return label_surface(mesh, MODEL, hand=HAND)


@cache
def cone(degrees: float, friction: float) -> SurfaceLabels:
    """A cone of 80 mm with this half-angle at the apex."""
    surface = shapes.cone(math.radians(degrees), 80.0, 24)
    mesh = load_mesh(surface, unit="mm", max_edge=12.0)
    model = replace(MODEL, friction=friction)
    return label_surface(mesh, model, hand=HAND)


@cache
def tube(grip: str) -> SurfaceLabels:
    corners, faces = shapes.tube(sections=32)
    mesh = load_mesh((corners * 60.0, faces), unit="mm", max_edge=12.0)
    sampling = Sampling(grip=grip)
    return label_surface(mesh, MODEL, sampling=sampling, hand=SLIM)


@cache
def loaded() -> SurfaceLabels:
    """The wedge with a load that some grasps hold surely, and others not at all."""
    return wedge().using(
        model=replace(MODEL, torsion_radius=3.0), load=Load(mass=0.6, grip_force=30.0)
    )


LABELS = {
    "wedge": wedge,
    "steep cone": lambda: cone(17.4, 0.4),
    "cone": lambda: cone(14.5, 0.5),
    "loaded": loaded,
}


def vertices_of(labels: SurfaceLabels, grasps: GraspTable) -> np.ndarray:
    """Vertices whose grasps these are, shape (b,)."""
    gaps = np.linalg.norm(labels.mesh.vertices[:, None] - grasps.contacts.points[:, 0], axis=2)
    return labels.mesh.canonical[gaps.argmin(axis=0)]


def after(grasps: GraspTable) -> np.ndarray:
    return grasps.closed.label


@pytest.fixture
def closings(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of poses at which jaws are closed."""
    sizes: list[int] = []
    close = ParallelGripper.close

    def counting(hand: ParallelGripper, mesh: ObjectMesh, poses: Floats, **options: Any) -> object:
        sizes.append(len(poses))
        return close(hand, mesh, poses, **options)

    monkeypatch.setattr(ParallelGripper, "close", counting)
    return sizes


@pytest.mark.slow
@pytest.mark.parametrize("name", LABELS)
def test_no_grasp_is_before_one_with_a_better_label_after_closing(name: str) -> None:
    labels = LABELS[name]()
    best = best_grasps(labels, ALL)
    codes = after(best) if labels.load is None else stated_label(best, best.closed)
    assert (np.diff(codes.astype(int)) <= 0).all()
    assert len(set(codes)) > 1


@pytest.mark.slow
@pytest.mark.parametrize("name", LABELS)
def test_as_many_kinds_as_possible_are_among_grasps_of_the_same_label(name: str) -> None:
    labels = LABELS[name]()
    best, every = best_grasps(labels, ALL), grasp_kinds(labels)
    kinds, codes = every[vertices_of(labels, best)], stated_label(best, best.closed)
    first = len(set(kinds[codes == codes[0]]))
    few = best_grasps(labels, first)
    assert len(set(every[vertices_of(labels, few)])) == first
    # The first one is that of all.
    np.testing.assert_array_equal(few.contacts.points[0], best.contacts.points[0])


def test_labels_of_points_and_of_what_the_jaws_touch_differ() -> None:
    """On a cone the jaws touch what is wider; on a wedge they turn it until its faces lie flat."""
    best = best_grasps(cone(14.5, 0.5), ALL)
    assert {(2, 1), (2, 2)} <= set(zip(best.label, after(best), strict=True))
    steep = best_grasps(cone(19.0, 0.4), ALL)
    assert {(1, 0), (1, 1)} <= set(zip(steep.label, after(steep), strict=True))
    turned = best_grasps(wedge(), ALL)
    assert (0, 2) in set(zip(turned.label, after(turned), strict=True))
    first = after(turned).argsort(kind="stable")[-1]
    assert turned.closed.jaws.turn[first] >= 0.0


def test_labels_and_margins_are_those_of_the_critical_angles_of_the_closed_jaws() -> None:
    best = best_grasps(cone(17.4, 0.35), ALL)
    found = evaluate_grasps(best.mesh, poses_of(best), best.model, hand=HAND)
    closed = best.closed.jaws.closed
    assert closed.any()
    assert not closed.all()
    angles = np.where(closed, found.critical_angle, math.inf)
    np.testing.assert_array_equal(best.closed.label, label_angles(angles, angles, best.model))
    expected = best.model.effective_friction_angle - found.critical_angle
    np.testing.assert_array_equal(best.closed.margin, expected)
    assert np.isnan(best.closed.margin[~closed]).all()
    assert (best.closed.label[~closed] == Label.U).all()


@pytest.mark.parametrize("suffix", ["json", "csv", "parquet"])
def test_poses_that_are_written_evaluate_to_the_same_labels(tmp_path: Path, suffix: str) -> None:
    best, path = best_grasps(wedge(), 40), tmp_path / f"wedge.{suffix}"
    write_grasps(path, best)
    poses = read_poses(path)
    again = evaluate_grasps(wedge().mesh, poses, MODEL, hand=HAND)
    np.testing.assert_array_equal(again.label, best.closed.label)
    np.testing.assert_allclose(again.margin, best.closed.margin, rtol=1e-9, atol=1e-7)
    assert poses.columns["closed_label"].tolist() == [Label(code).name for code in again.label]
    np.testing.assert_allclose(poses.columns["closed_margin"], again.margin, atol=1e-7)
    # They may be of other settings, and are not kept.
    assert not {"closed_label", "closed_margin"} & set(again.to_poses().columns)


def test_the_jaws_close_once(closings: list[int]) -> None:
    labels = wedge.__wrapped__()  # none of whose jaws have been closed
    best = best_grasps(labels, 3)
    (candidates,) = closings
    assert candidates > 3
    assert best.closed.label.tolist() == [Label.S] * 3
    poses_of(best)
    best.to_table()
    assert verdict_of(labels).word == "surely"
    every = best_grasps(labels, ALL)
    assert len(closings) == 1
    np.testing.assert_array_equal(every.closed.margin[:3], best.closed.margin)
    np.testing.assert_array_equal(every.closed.jaws.points[:3], best.closed.jaws.points)


def test_of_chosen_vertices_the_jaws_close_when_that_is_read(closings: list[int]) -> None:
    labels = wedge()
    vertices = labels.vertices[:2]
    chosen = labels.grasps.take(labels.row[vertices]).whole()
    others = labels.grasps.take(labels.row[labels.vertices[2:4]]).whole()
    assert closings == []
    assert len(after(chosen)) == 2
    assert len(after(others)) == 2
    assert closings == [2, 2]
    copy = pickle.loads(pickle.dumps(chosen))  # noqa: S301
    np.testing.assert_array_equal(copy.closed.margin, chosen.closed.margin)
    assert len(closings) == 2


def test_another_model_closes_the_jaws_again() -> None:
    best = best_grasps(wedge(), 3)
    slippery = replace(best, model=replace(MODEL, friction=0.1))
    assert (slippery.closed.label < best.closed.label).all()
    assert (slippery.closed.margin < best.closed.margin).all()


def test_internal_grasps_are_not_known(tmp_path: Path) -> None:
    best = best_grasps(tube("expand"), 3)
    assert best.size
    assert best.closed.jaws is None
    assert after(best).tolist() == [UNKNOWN] * best.size
    assert np.isnan(best.closed.margin).all()
    assert best.closed.note(best.label) == ""
    write_grasps(tmp_path / "a.json", best)
    columns = read_poses(tmp_path / "a.json").columns
    assert columns["closed_label"].tolist() == [""] * best.size
    assert np.isnan(columns["closed_margin"]).all()


@pytest.mark.slow
def test_internal_grasps_count_as_ambiguous_beside_external_ones() -> None:
    best = best_grasps(tube("both"), ALL)
    internal = best.reach.pregrasp_opening < best.reach.opening
    assert internal.any()
    assert not internal.all()
    np.testing.assert_array_equal(after(best) == UNKNOWN, internal)
    counted = np.where(internal, np.minimum(best.label, Label.M), after(best))
    assert (np.diff(counted) <= 0).all()
    rows = np.array([best.size - 1, 0, int(internal.argmax())])
    taken = best.closed.take(rows)
    np.testing.assert_array_equal(taken.label, best.closed.label[rows])
    np.testing.assert_array_equal(taken.margin, best.closed.margin[rows])
    assert best.closed.take(np.flatnonzero(internal)).jaws is None


def test_a_note_says_that_no_label_is_confirmed() -> None:
    """Of a cone that is too steep for the friction most slides out, though some points are M."""
    best = best_grasps(cone(17.4, 0.2), ALL, distance=10.0)
    best = best.take(np.flatnonzero(after(best) == Label.U))
    assert set(best.label) == {Label.U, Label.M}
    note = best.closed.note(best.label)
    ambiguous = (best.label == Label.M).sum()
    assert note.startswith(f"no label is confirmed when the jaws close ({ambiguous} U): ")
    some = best_grasps(cone(14.5, 0.5), ALL)
    assert some.closed.note(some.label) == ""
    lost = np.flatnonzero(after(some) < some.label)
    assert f"({len(lost)} M)" in some.closed.take(lost).note(some.label[lost])
    # One of them that keeps its label is enough.
    kept = np.append(lost, np.flatnonzero(after(some) == Label.S)[0])
    assert some.closed.take(kept).note(some.label[kept]) == ""


def test_grasps_without_a_pose_are_not_known() -> None:
    labels = wedge()
    reach = labels.reach.take(labels.vertices[:3])
    missing = replace(reach, poses=np.where(np.arange(3)[:, None, None] == 1, np.nan, reach.poses))
    found = replace(labels.grasps.take(np.arange(3)), reach=missing).closed
    assert found.row.tolist() == [0, -1, 1]
    assert found.label[1] == UNKNOWN
