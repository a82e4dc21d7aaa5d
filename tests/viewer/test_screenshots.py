import math
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from grasp3d import (
    GraspError,
    GraspModel,
    Sampling,
    SurfaceLabels,
    label_surface,
    scan_surface,
)
from grasp3d.errors import MeshError, OutputError
from grasp3d.pictures import opengl
from grasp3d.pictures.opengl import can_render
from grasp3d.pictures.subject import Subject
from grasp3d.pictures.view_settings import ViewSettings
from grasp3d.system.context import running
from grasp3d.viewer.collection import Collection, Item, collection_of
from grasp3d.viewer.screenshots import open_renderer, save_picture
from tests.helpers.solids import box_mesh, sphere_mesh

# In continuous integration missing OpenGL is a failure.
needs_opengl = pytest.mark.skipif(not (os.environ.get("CI") or can_render()), reason="needs OpenGL")

SMALL = ViewSettings(width=320, height=240)


def held_box() -> SurfaceLabels:
    model = GraspModel(friction=1.0, sensor_resolution=math.radians(15.0))
    return scan_surface(box_mesh((1.0, 2.0, 3.0), max_edge=1.0), model, fixed=(0.0, 0.0, -1.5))


def read(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB"))


@pytest.mark.slow
@needs_opengl
@pytest.mark.parametrize("size", [(320, 240), (501, 301)])
def test_a_picture_has_its_size_and_smooth_edges(size: tuple[int, int], tmp_path: Path) -> None:
    path = tmp_path / "box.png"
    reported: list[float] = []
    settings = ViewSettings(width=size[0], height=size[1])
    with running(progress=reported.append):
        save_picture(collection_of(held_box()), settings, path)
    drawn = read(path)
    assert drawn.shape == (size[1], size[0], 3)
    assert reported == sorted(reported)
    assert reported[-1] == 1.0
    colours = np.unique(drawn.reshape(-1, 3), axis=0)
    assert len(colours) > 200  # edges have mixtures of both colours
    assert [one.name for one in tmp_path.iterdir()] == ["box.png"]


@pytest.mark.slow
@needs_opengl
def test_epsilon_is_computed_before_it_is_drawn(tmp_path: Path) -> None:
    model = GraspModel(friction=0.5, sensor_resolution=math.radians(10.0))
    collection = collection_of(label_surface(sphere_mesh(subdivisions=1), model))
    path = tmp_path / "ball.png"
    save_picture(collection, ViewSettings(paint="epsilon", width=320, height=240), path)
    drawn = read(path).astype(int)
    middle = drawn[110:130, 150:170]
    assert (
        middle[..., 0].min() > middle[..., 2].max() + 40
    )  # bright, as epsilon is the same everywhere


def test_without_opengl_the_old_file_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opengl, "can_render", lambda: False)
    path = tmp_path / "box.png"
    path.write_bytes(b"before")
    with pytest.raises(OutputError, match="need OpenGL"):
        save_picture(collection_of(held_box()), SMALL, path)
    assert path.read_bytes() == b"before"


@needs_opengl
def test_the_error_of_an_object_is_raised(tmp_path: Path) -> None:
    def broken() -> Subject:
        raise MeshError("cup.stl: is not a mesh")

    collection = Collection((Item("cup.stl", broken),), GraspModel(), Sampling())
    with pytest.raises(GraspError, match=r"cup\.stl: is not a mesh"):
        save_picture(collection, SMALL, tmp_path / "cup.png")
    assert not list(tmp_path.iterdir())


@needs_opengl
def test_very_large_pictures_are_not_oversampled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opengl, "MAX_DRAWN", 500)
    with open_renderer(collection_of(held_box()), SMALL) as renderer:
        assert renderer.oversampling == 1
        assert renderer.picture().shape == (240, 320, 3)
