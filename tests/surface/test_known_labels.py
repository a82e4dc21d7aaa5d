"""Labels whose values are known, as those of files, and grasps that several vertices share."""

import pickle
from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from grasp3d import GraspModel, Load, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.errors import SettingError
from grasp3d.grasps import best_grasps
from grasp3d.hand.scene import Scene
from grasp3d.surface import LoadResult, Reason
from tests.helpers import shapes
from tests.helpers.grippers import HAND, SLIM
from tests.helpers.vertex_labels import with_arrays, with_known

ARRAYS = (
    "critical_angle", "critical_angle_best", "label", "max_resolution", "margin", "epsilon",
    "epsilon_min", "epsilon_max", "opening", "grip", "reason", "partners", "partner_normals",
)  # fmt: skip


@cache
def wedge(**model: Any) -> SurfaceLabels:
    """A wedge with creases, a vertex twice and one on no face."""
    corners, faces = shapes.box((40.0, 30.0, 20.0))
    corners = corners * [[1.0, 1.0 + 0.2 * (corner[2] > 0), 1.0] for corner in corners]
    vertices = np.vstack([corners, corners[:2], [[90.0, 0.0, 0.0]]])
    mesh = load_mesh((vertices, faces), unit="mm", max_edge="12mm")
    load = Load(mass=0.1, grip_force=20.0)
    return label_surface(
        mesh, GraspModel(torsion_radius="2mm", sensor_resolution=0.3, **model), hand=SLIM, load=load
    )


@cache
def tripod() -> SurfaceLabels:
    mesh = load_mesh(shapes.box((1.0, 1.4, 2.0)), max_edge=0.7)
    return label_surface(mesh, GraspModel(fingers=3), sampling=Sampling(candidates=16))


LABELS = {
    "exact": wedge,
    "extremes": lambda: wedge(method="extremes"),
    "location error": lambda: wedge(location_error="1mm"),
    "three fingers": tripod,
}


def test_another_scene_needs_another_search() -> None:
    labels = wedge()
    other = Scene(HAND)
    for found in (labels, labels.take(labels.distinct)):
        with pytest.raises(SettingError, match="for its own scene only"):
            found.using(scene=other)
        assert found.using(scene=labels.scene).reach is found.reach
    assert tripod().using(scene=other).scene is other


def known(labels: SurfaceLabels) -> SurfaceLabels:
    """The same labels, made from what is known of them."""
    names = ("label", "epsilon_range", "load_result")
    return with_known(with_arrays(labels), **{name: getattr(labels, name) for name in names})


def assert_equal(one: SurfaceLabels, other: SurfaceLabels) -> None:
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert (one.load_result is None) == (other.load_result is None)
    if one.load_result is not None and other.load_result is not None:
        for field in fields(LoadResult):
            values = getattr(one.load_result, field.name), getattr(other.load_result, field.name)
            if isinstance(values[0], np.ndarray):
                np.testing.assert_array_equal(*values, err_msg=field.name)


@pytest.mark.slow
@pytest.mark.parametrize("name", LABELS)
def test_vertices_at_one_position_share_a_grasp(name: str) -> None:
    labels = LABELS[name]()
    grasps, vertices = labels.take(labels.distinct), labels.distinct
    assert len(vertices) == grasps.size <= np.count_nonzero(labels.reason == Reason.FOUND)
    for attribute in ("label", "critical_angle", "margin", "epsilon", "opening", "max_resolution"):
        rows, places = getattr(grasps, attribute), getattr(labels, attribute)
        np.testing.assert_array_equal(places[vertices], rows, err_msg=attribute)
        np.testing.assert_array_equal(places, places[labels.mesh.canonical], err_msg=attribute)
    missing = labels.reason != Reason.FOUND
    assert np.isinf(labels.critical_angle[missing]).all()
    assert (labels.label[missing] == 0).all()
    assert np.isnan(labels.epsilon[missing]).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", LABELS)
def test_a_table_has_the_numbers_of_its_rows(name: str) -> None:
    """Whether they are computed before rows are taken or afterwards."""
    labels = LABELS[name]()
    rows = labels.distinct[::3]
    fresh = with_arrays(labels).take(rows)
    assert fresh.computed("epsilon_range") is None
    assert len(labels.epsilon)
    taken = labels.take(rows)
    assert taken.computed("epsilon_range") is not None
    for attribute in ("label", "epsilon", "epsilon_min", "margin"):
        one, other = getattr(fresh, attribute), getattr(taken, attribute)
        np.testing.assert_allclose(one, other, atol=1e-12, err_msg=attribute)


@pytest.mark.slow
@pytest.mark.parametrize("name", LABELS)
def test_labels_of_known_values_are_the_same(name: str) -> None:
    labels = LABELS[name]()
    found = known(labels)
    assert found.computed("epsilon_range") is labels.epsilon_range
    assert_equal(labels, found)
    np.testing.assert_array_equal(found.partner_points.faces, labels.partner_points.faces)
    assert_equal(labels.relabel(friction=0.4), found.relabel(friction=0.4))
    assert repr(found) == repr(labels)


def test_known_values_belong_to_the_settings() -> None:
    """Those of another friction are computed again."""
    labels = wedge()
    other = replace(known(labels), model=replace(labels.model, friction=0.2))
    assert other.computed("epsilon_range") is None
    assert not np.array_equal(other.label, labels.label)


def test_known_labels_are_pickled() -> None:
    labels = wedge()
    copy = pickle.loads(pickle.dumps(known(labels)))  # noqa: S301
    assert_equal(labels, copy)


def ball() -> SurfaceLabels:
    return label_surface(load_mesh(shapes.sphere(1), max_edge=9.0))


def test_results_of_another_model_are_those_of_that_model() -> None:
    found = ball()
    model = replace(found.model, friction=0.05)
    assert np.isfinite(found.epsilon).all()
    changed = found.using(model=model)
    assert changed.computed("epsilon_range") is None
    np.testing.assert_array_equal(changed.label, found.relabel(friction=0.05).label)
    assert not np.array_equal(changed.epsilon, found.epsilon)
    grasps = best_grasps(found, 3)
    other = replace(grasps, model=replace(grasps.model, friction=0.05))
    assert not np.array_equal(other.epsilon, grasps.epsilon)


def test_results_are_pickled_with_what_was_computed() -> None:
    found = ball()
    assert len(found.epsilon) == len(found.label)
    copy = pickle.loads(pickle.dumps(found))  # noqa: S301
    assert copy.computed("epsilon_range") is not None
    np.testing.assert_array_equal(copy.epsilon, found.epsilon)
    assert repr(copy) == repr(found)
