import inspect
import math
import os
import subprocess
import sys
from collections.abc import Callable
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
from grasp3d.errors import MeshError, OutputError, SettingError
from grasp3d.mesh.primitives import box_mesh, sphere_mesh
from grasp3d.rendering import opengl
from grasp3d.rendering.opengl import can_render
from grasp3d.stability.label import COLORS, Label
from grasp3d.system.context import running
from grasp3d.viewer.scene import pictures
from grasp3d.viewer.scene.pictures import (
    FRAMES,
    SECONDS,
    _durations,
    _palette,
    open_renderer,
    save_picture,
    save_turntable,
)
from grasp3d.viewer.session.collection import Collection, Item, collection_of
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.subjects.subject import Subject
from grasp3d.viewer.view_settings import ViewSettings

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


@pytest.mark.slow
@needs_opengl
def test_messages_do_not_prevent_a_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []

    class Noting(Session):
        def _show(self, subject: Subject) -> None:
            super()._show(subject)
            self.show_message("a note")
            told.append(self.message)

    monkeypatch.setattr(pictures, "Session", Noting)
    collection = collection_of(label_surface(box_mesh((1.0, 2.0, 3.0), max_edge=0.5)))
    save_picture(collection, ViewSettings("epsilon", width=320, height=240), tmp_path / "box.png")
    assert read(tmp_path / "box.png").shape == (240, 320, 3)
    assert told == ["a note"]


@pytest.mark.slow
@needs_opengl
def test_a_gif_shows_every_side_once_and_loops(tmp_path: Path) -> None:
    path = tmp_path / "box.gif"
    save_turntable(collection_of(held_box()), SMALL, path, frames=8, seconds=1.0)
    with Image.open(path) as film:
        assert (film.size, film.n_frames, film.info["loop"]) == ((320, 240), 8, 0)
        frames, durations = [], []
        for number in range(8):
            film.seek(number)
            durations.append(film.info["duration"])
            frames.append(np.asarray(film.convert("RGB")).astype(int))
    assert sum(durations) == 1000
    body = slice(60, 190)  # between the texts
    gaps = [np.abs(one[body] - frames[0][body]).mean() for one in frames[1:]]
    assert min(gaps[:3]) > 0.5
    assert gaps[3] == 0.0  # a box looks the same from both sides
    assert all((one[:45] == frames[0][:45]).all() for one in frames)
    sides = [np.nonzero((one[body] < 235).any(axis=(0, 2)))[0] for one in frames]
    assert all(side.min() > 0 and side.max() < 319 for side in sides)


@pytest.mark.slow
@needs_opengl
def test_an_mp4_can_be_decoded(tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "box.mp4"
    settings = ViewSettings(width=321, height=241)
    save_turntable(collection_of(held_box()), settings, path, frames=6, seconds=0.5)
    assert ffmpeg.count_frames_and_secs(str(path)) == (6, pytest.approx(0.5, abs=0.05))
    tool = [ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path)]
    raw = subprocess.run(
        [*tool, *["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]], check=True, capture_output=True
    )
    frames = np.frombuffer(raw.stdout, np.uint8).reshape(6, 242, 322, 3).astype(int)
    assert np.abs(frames[0] - frames[2]).mean() > 0.5


def test_the_error_without_ffmpeg_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(OutputError, match=r"grasp3d\[video\]"):
        save_turntable(collection_of(held_box()), SMALL, tmp_path / "box.mp4")


@pytest.mark.parametrize(
    ("save", "name", "kind"),
    [(save_picture, "box.jpg", "picture"), (save_turntable, "box.png", "film")],
)
def test_the_error_for_other_suffixes_lists_the_known_ones(
    save: Callable[..., None], name: str, kind: str, tmp_path: Path
) -> None:
    with pytest.raises(OutputError, match=rf"unsupported {kind} format \.\w+: supported are \."):
        save(collection_of(held_box()), SMALL, tmp_path / name)


def test_films_have_25_frames_per_second() -> None:
    assert FRAMES / SECONDS == 25.0
    assert set(_durations(FRAMES, SECONDS)) == {40}
    parameters = inspect.signature(save_turntable).parameters
    assert (parameters["frames"].default, parameters["seconds"].default) == (FRAMES, SECONDS)


def test_a_film_keeps_the_colours_of_small_areas() -> None:
    picture = np.full((100, 100, 3), 255, dtype=np.uint8)
    ramp = np.linspace(0, 255, 95).astype(np.uint8)
    picture[:95] = np.stack([0 * ramp, ramp, ramp // 2], axis=1)[:, None]
    picture[97, :6] = COLORS[Label.U]
    palette = _palette(iter([picture]))
    shown = Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)
    found = np.asarray(shown.convert("RGB"))[97, 0].astype(int)
    assert np.abs(found - COLORS[Label.U]).max() < 12


@pytest.mark.parametrize(
    ("frames", "seconds"), [(1, 6.0), (3601, 6.0), (8, 0.0), (8, math.nan), (8, 601.0)]
)
def test_the_length_of_a_film_is_checked(frames: int, seconds: float, tmp_path: Path) -> None:
    with pytest.raises(SettingError, match="from 2 to 3600 frames"):
        save_turntable(
            collection_of(held_box()), SMALL, tmp_path / "box.gif", frames=frames, seconds=seconds
        )


def test_a_missing_folder_is_reported_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        save_picture(collection_of(held_box()), SMALL, tmp_path / "missing" / "box.png")


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
def test_an_incomplete_film_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pictures, "_write_gif", full)
    with pytest.raises(OutputError, match="No space left"):
        save_turntable(collection_of(held_box()), SMALL, tmp_path / "box.gif", frames=2)
    assert not list(tmp_path.iterdir())


@needs_opengl
def test_very_large_pictures_are_not_oversampled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "MAX_DRAWN", 500)
    with open_renderer(collection_of(held_box()), SMALL) as renderer:
        assert renderer.oversampling == 1
        assert renderer.picture().shape == (240, 320, 3)
