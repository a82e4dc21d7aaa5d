import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasp3d import GraspModel, Label, SurfaceLabels
from grasp3d.errors import SearchCoverageError
from grasp3d.pictures.colors import (
    BOTH_SIDES,
    PALETTE,
    RAMP,
    UNSEARCHED,
    corner_codes,
    corner_values,
    labels_at,
    ramp_of,
)
from grasp3d.pictures.subject import Subject, subject_of
from grasp3d.pictures.view_settings import Paint
from grasp3d.surface.vertex_fields import SearchReport
from tests.helpers import viewing

FRICTIONS = st.floats(0.05, 2.0)
RESOLUTIONS = st.floats(0.0, 1.5)


@given(
    friction=FRICTIONS,
    resolution=RESOLUTIONS,
    make=st.sampled_from([viewing.labels, viewing.three_fingers, lambda: viewing.located(1e-4)]),
)
@settings(max_examples=100, deadline=None)
def test_labels_agree_with_relabel_and_are_unknown_where_it_raises(
    friction: float, resolution: float, make: Callable[[], SurfaceLabels]
) -> None:
    labels = make()
    subject = subject_of(labels)
    model = replace(labels.model, friction=friction, sensor_resolution=resolution)
    codes = labels_at(subject.at(model))
    try:
        expected = labels.relabel(friction=friction, sensor_resolution=resolution).label
    except SearchCoverageError:
        assert not subject.covers(model)
        assert not (codes == Label.U).any()
        assert np.array_equal(codes == Label.S, labels.critical_angle < model.sure_angle)
        assert (codes[np.isinf(labels.critical_angle_best)] == UNSEARCHED).all()
    else:
        assert subject.covers(model)
        assert np.array_equal(codes, expected)


def test_labels_are_unknown_where_the_search_may_have_missed_an_s() -> None:
    model = GraspModel(friction=0.2, sensor_resolution=0.1)
    subject = viewing.with_values(
        subject_of(viewing.labels().using(model=model)),
        critical_angle=np.array([0.2, 0.7, 0.7, 1.2]),
        critical_angle_best=np.array([0.2, 0.3, 0.7, 1.2]),
        search=SearchReport(0.6),
    )
    wide = GraspModel(friction=2.0, sensor_resolution=1.0)  # S below 0.607, all U from 1.607
    assert labels_at(subject.at(wide)).tolist() == [Label.S, UNSEARCHED, UNSEARCHED, UNSEARCHED]
    lower = GraspModel(friction=1.0, sensor_resolution=1.0)  # S below 0.285: inside the cone
    assert labels_at(subject.at(lower)).tolist() == [Label.S, Label.M, Label.M, Label.M]


def _drawn(subject: Subject, paint: Paint, model: GraspModel) -> NDArray[np.uint8]:
    """Colour that VTK draws at each vertex: that of the range in which its number is."""
    subject = subject.at(model)
    vertices, ramp = subject.mesh.corner_normals.vertices, ramp_of(subject, paint)
    corners = np.zeros(len(subject.mesh.vertices), dtype=np.int64)
    corners[vertices] = np.arange(len(vertices))
    if ramp is None:
        return np.asarray(PALETTE[corner_codes(subject)][corners])
    values, count = corner_values(subject, paint)[corners], len(ramp.colors)
    steps = (np.nan_to_num(values) - ramp.minimum) / (ramp.maximum - ramp.minimum) * count
    colors = ramp.colors[np.clip(np.floor(steps), 0, count - 1).astype(int)]
    return np.where(np.isnan(values)[:, None], PALETTE[UNSEARCHED], colors)


def test_a_vertex_without_a_grasp_is_u_even_where_no_grasp_is_surely_unstable() -> None:
    subject = subject_of(viewing.three_fingers())
    worst = np.where(
        np.arange(len(subject.mesh.vertices)) < 3, math.inf, subject.labels.critical_angle
    )
    subject = replace(
        viewing.with_values(subject, critical_angle=worst, critical_angle_best=worst),
        searched=math.pi,
    )
    model = GraspModel(friction=2.0, sensor_resolution=1.2, fingers=3)
    assert model.friction_angle + model.tilt > math.pi / 2
    assert (labels_at(subject.at(model))[:3] == Label.U).all()
    assert (_drawn(subject, "label", model)[:3] == PALETTE[Label.U]).all()


@pytest.mark.parametrize("location", [0.0, 1e-4])
def test_margins_change_colour_where_they_are_0(location: float) -> None:
    labels = viewing.located(location).relabel(friction=(0.5, 0.7))
    subject, model = subject_of(labels), labels.model
    ramp = ramp_of(subject.at(model), "margin")
    assert ramp.maximum == -ramp.minimum == pytest.approx(math.degrees(model.friction_angle))
    assert ramp.start == f"≤ −{ramp.maximum:.3g}°"
    known = np.isfinite(labels.critical_angle)
    colors = _drawn(subject, "margin", model).astype(int)
    assert (colors[~known] == PALETTE[UNSEARCHED]).all()
    margins = np.degrees(labels.margin[known])
    steps = np.clip(255.0 * (0.5 + 0.5 * margins / ramp.maximum), 0, 255)
    around = np.clip(np.rint(steps).astype(int)[:, None] + [-1, 0, 1], 0, 255)
    assert (BOTH_SIDES[around] == colors[known][:, None]).all(axis=2).any(axis=1).all()
    green = (colors[:, 1] > colors[:, 0])[known]  # as in no colour below 0
    clear = np.abs(margins) > 0.2
    assert (green == (margins > 0.0))[clear].all()
    assert (green == (labels.label[known] == Label.S))[clear].all()


@pytest.mark.parametrize("paint", ["critical_angle", "max_resolution", "epsilon", "epsilon_min"])
def test_ramps_map_each_number_to_its_colour(paint: str) -> None:
    labels = viewing.labels()
    _ = labels.epsilon_range
    subject, model = subject_of(labels), labels.model
    ramp = ramp_of(subject.at(model), paint)  # type: ignore[arg-type]
    assert ramp is not None
    values = {
        "critical_angle": np.degrees(labels.critical_angle),
        "max_resolution": np.degrees(labels.max_resolution),
        "epsilon": labels.epsilon,
        "epsilon_min": labels.epsilon_min,
    }[paint]
    known = np.isfinite(labels.critical_angle)
    colors = _drawn(subject, paint, model)  # type: ignore[arg-type]
    assert (colors[~known] == PALETTE[UNSEARCHED]).all()
    steps = np.clip(values[known] / ramp.maximum * len(RAMP), 0, len(RAMP) - 1)
    shifts = np.array([-1, 0, 1])
    around = np.clip(steps.astype(int)[:, None] + shifts, 0, len(RAMP) - 1)
    assert (RAMP[around] == colors[known][:, None]).all(axis=2).any(axis=1).all()


@pytest.mark.parametrize("paint", ["critical_angle", "max_resolution", "epsilon_min"])
def test_grey_is_explained_where_it_occurs(paint: Paint) -> None:
    for labels in (viewing.labels(), viewing.box()):
        subject = viewing.with_epsilon(subject_of(labels), 0.0, labels.model)
        ramp = ramp_of(subject.at(labels.model), paint)
        assert ramp is not None
        some = bool(np.isinf(labels.critical_angle[labels.mesh.on_surface]).any())
        assert ramp.grey == ("no grasp found" if some else "")
    assert not some  # every vertex of the box has a grasp


def test_a_subject_with_labels_of_extreme_normals_has_a_note() -> None:
    labels: SurfaceLabels = viewing.box()
    hulls = labels.using(model=replace(labels.model, method="extremes"))
    assert not any("wrench hulls" in note for note in subject_of(labels).notes)
    assert any("wrench hulls" in note for note in subject_of(hulls).notes)
