"""Labels with uncertainties: of Python, in files and in the viewer."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from grasp3d import (
    GraspModel,
    Sampling,
    SurfaceLabels,
    label_surface,
    load_mesh,
    write_ply,
)
from grasp3d.formats.surface_files import read_labels
from grasp3d.pictures.colors import labels_at
from grasp3d.pictures.subject import subject_of
from tests.helpers import shapes
from tests.helpers.viewing import read_subject

SHAPES = {
    "cone": (shapes.cone(0.35, sections=24), 0.3),
    "sphere": (shapes.sphere(2), 9.0),
    "fins": (shapes.finned(), 0.5),
}
MODELS = {
    "alike": GraspModel(),
    "interval": GraspModel(friction=(0.4, 0.7), sensor_resolution=0.5),
    "location": GraspModel(location_error=0.02),
    "far": GraspModel(location_error=0.2),
    "both": GraspModel(location_error=0.02, friction=(0.3, 0.7)),
}


@cache
def searched(shape: str, model: str) -> SurfaceLabels:
    surface, edge = SHAPES[shape]
    mesh = load_mesh(surface, max_edge=edge)
    return label_surface(mesh, MODELS[model], sampling=Sampling(rays=16, search_angle=1.2))


@pytest.mark.slow
@pytest.mark.parametrize("model", list(MODELS))
@pytest.mark.parametrize("shape", list(SHAPES))
def test_the_viewer_and_files_have_the_labels_of_python(
    tmp_path: Path, shape: str, model: str
) -> None:
    """Of grasps that were searched for a model, and of the same for another one."""
    found = searched(shape, model)
    for labels in (found, found.relabel(friction=0.5, sensor_resolution=0.3)):
        shown = labels_at(subject_of(labels))
        np.testing.assert_array_equal(shown, labels.label)
        write_ply(tmp_path / "labelled.ply", labels)
        stored = read_labels(tmp_path / "labelled.ply")
        np.testing.assert_array_equal(stored.label, labels.label)
        read = read_subject(tmp_path / "labelled.ply")
        clear = _clear(labels)
        assert clear.mean() > 0.5
        np.testing.assert_array_equal(labels_at(read.at(labels.model))[clear], labels.label[clear])


def _clear(labels: SurfaceLabels) -> np.ndarray:
    """Vertices whose label does not depend on the rounding to 32 bits."""
    worst, best = labels.critical_angle, labels.critical_angle_best
    with np.errstate(invalid="ignore"):
        near = np.abs(worst - labels.model.sure_angle) < 1e-6
        return ~(near | (np.abs(best - labels.model.unstable_from) < 1e-6))


def test_three_fingers_are_read_as_they_were_written(tmp_path: Path) -> None:
    mesh = load_mesh(shapes.box(), max_edge=0.5)
    wide = Sampling(candidates=8, search_angle=1.2)
    labels = label_surface(mesh, GraspModel(fingers=3, location_error=0.02), sampling=wide)
    write_ply(tmp_path / "three.ply", labels)
    np.testing.assert_array_equal(read_labels(tmp_path / "three.ply").label, labels.label)
    np.testing.assert_array_equal(labels_at(subject_of(labels)), labels.label)
