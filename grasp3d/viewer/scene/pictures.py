"""Pictures and turntable films of an object, written to files without a window."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from grasp3d.arrays import Bytes
from grasp3d.errors import GraspError, OutputError, SettingError
from grasp3d.rendering.opengl import View, check_rendering, choose_window
from grasp3d.system.context import report_progress, within
from grasp3d.system.files import atomic_write, check_suffix, check_writable
from grasp3d.system.names import safe_stem
from grasp3d.viewer.scene.scene import Scene, new_plotter
from grasp3d.viewer.session.collection import Collection
from grasp3d.viewer.session.inspection import best_vertices
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.view_settings import MIN_HEIGHT, MIN_WIDTH, ViewSettings

SOFTWARE = "grasp3d"
"""Name in the metadata of pictures and films."""

OVERSAMPLING = 2
"""Rendered pixels per pixel of a picture, in each direction; they are averaged."""

MAX_DRAWN = 8192
"""Largest width or height that every OpenGL renders [pixels]."""

DPI = 72
"""Resolution at which texts have their nominal size [pixels per inch]."""

POLL_INTERVAL = 0.02
"""Time between two polls of the background job [s]."""

VIDEO = ".mp4"
PICTURE_SUFFIXES, FILM_SUFFIXES = (".png",), (".gif", VIDEO)
MAX_FRAMES, MAX_SECONDS = 3600, 600.0
FRAMES, SECONDS = 150, 6.0
"""Frames and duration of a film: 25 frames per second, whose durations a GIF can store."""
SAMPLES = 6
"""Frames from which the colour palette of a GIF is chosen."""


@dataclass(frozen=True, eq=False)
class PictureRenderer:
    """A session that has computed all it shows, and its scene."""

    session: Session
    scene: Scene
    oversampling: int

    def picture(self) -> Bytes:
        """The picture, averaged over the rendered pixels, shape (height, width, 3)."""
        return averaged(self.scene.screenshot(), self.oversampling)


def averaged(rendered: Bytes, factor: int) -> Bytes:
    """Average the pixels of a picture (h, w, 3) over squares of `factor` pixels."""
    height, width = rendered.shape[0] // factor, rendered.shape[1] // factor
    parts = rendered.reshape(height, factor, width, factor, 3)
    return np.asarray(np.rint(parts.mean(axis=(1, 3), dtype=np.float32)), dtype=np.uint8)


@contextmanager
def off_screen(width: int, height: int) -> Iterator[tuple[pyvista.Plotter, int]]:
    """A plotter for a picture, and its rendered pixels per pixel in each direction."""
    choose_window()
    factor = OVERSAMPLING if OVERSAMPLING * max(width, height) <= MAX_DRAWN else 1
    size = ViewSettings(width=factor * width, height=factor * height)
    plotter = new_plotter(size, off_screen=True)
    try:
        plotter.renderers[0].GetRenderWindow().SetDPI(factor * DPI)
        yield plotter, factor
    finally:
        plotter.close()


def check_picture(path: Path) -> None:
    """Check that a picture can be rendered and written.

    Raises:
        OutputError: It cannot.
    """
    check_suffix(path, PICTURE_SUFFIXES, "picture")
    check_writable(path)
    check_rendering()


def check_film(path: Path) -> None:
    """Check that a film can be rendered and written.

    Raises:
        OutputError: It cannot.
    """
    check_suffix(path, FILM_SUFFIXES, "film")
    if path.suffix.lower() == VIDEO:
        _check_video()
    check_writable(path)
    check_rendering()


def save_picture(collection: Collection, settings: ViewSettings, path: Path) -> None:
    """Write a picture of a collection's first object as a PNG.

    Args:
        collection: The objects.
        settings: Initial view, and size of the picture.
        path: The file, replaced if it exists.

    Raises:
        GraspError: There is no OpenGL, the object cannot be shown or the file not written.
    """
    check_picture(path)
    with open_renderer(collection, settings, 0.95) as renderer:
        picture = Image.fromarray(renderer.picture())
        with atomic_write(path) as part:
            picture.save(part, format="PNG", optimize=True, pnginfo=_written_by())
    report_progress(1.0)


def save_turntable(
    collection: Collection,
    settings: ViewSettings,
    path: Path,
    *,
    frames: int = FRAMES,
    seconds: float = SECONDS,
) -> None:
    """Write a film of one turn of a collection's first object, as a GIF or an MP4.

    Args:
        collection: The objects.
        settings: Initial view, and size of the film.
        path: The file, replaced if it exists.
        frames: Number of frames, at least 2.
        seconds: Duration of the turn.

    Raises:
        GraspError: There is no OpenGL, the object cannot be shown or the file not written.
    """
    if not 2 <= frames <= MAX_FRAMES or not 0.0 < seconds <= MAX_SECONDS:
        raise SettingError(
            f"a turntable film has from 2 to {MAX_FRAMES} frames and takes up to {MAX_SECONDS:g} "
            f"seconds; got {frames} and {seconds:g}"
        )
    check_film(path)
    with open_renderer(collection, settings, 0.5) as renderer:
        views = _views(renderer.scene.view(renderer.session), frames)
        renderer.scene.look(renderer.session, views)
        pictures = _reported(_pictures(renderer, views), frames)
        with atomic_write(path) as part:
            if path.suffix.lower() == VIDEO:
                _write_video(part, pictures, frames / seconds)
            else:
                samples = _pictures(renderer, views[:: max(1, frames // SAMPLES)])
                _write_gif(part, pictures, _palette(samples), _durations(frames, seconds))
    report_progress(1.0)


@contextmanager
def open_renderer(
    collection: Collection, settings: ViewSettings, end: float = 1.0, *, legend: bool = True
) -> Iterator[PictureRenderer]:
    """Open a collection's first object off screen, with everything computed that is shown of it.

    Args:
        collection: The objects.
        settings: Initial view, and size of the picture.
        end: Fraction of the whole work at which this part of it ends.
        legend: Whether the picture has a legend.

    Raises:
        GraspError: There is no OpenGL, or the object cannot be shown.
    """
    session = Session(collection, settings)
    try:
        with within(0.0, end):
            _wait(session)
            _choose_grasp(session)
        with off_screen(settings.width, settings.height) as (plotter, factor):
            scene = Scene(plotter, legend=legend)
            scene.update(session)
            yield PictureRenderer(session, scene, factor)
    finally:
        session.close()


def render_copy(session: Session, camera: pyvista.Camera, width: int, height: int) -> Bytes:
    """Render the current view of a session off screen, with a legend.

    Args:
        session: The session.
        camera: Camera of the view.
        width: Width of the picture [pixels].
        height: Height of the picture [pixels].

    Returns:
        RGB colours, shape (height, width, 3).
    """
    size = max(MIN_WIDTH, width), max(MIN_HEIGHT, height)
    with off_screen(*size) as (plotter, factor):
        scene = Scene(plotter)
        scene.update(session)
        scene.camera.DeepCopy(camera)
        return averaged(scene.screenshot(), factor)


def file_name(session: Session, kind: str, suffix: str) -> str:
    """Name of a file of the current object, valid on all systems."""
    return f"{safe_stem(Path(session.name).stem)}_{kind}{suffix}"


def _wait(session: Session) -> None:
    """Poll until there is nothing more to compute."""
    while (working := session.working) is not None:
        report_progress(working[1])
        if not session.poll():
            time.sleep(POLL_INTERVAL)
    if session.failure or session.subject is None:
        raise GraspError(session.failure or f"{session.name} cannot be shown")


def _choose_grasp(session: Session) -> None:
    """Inspect the best grasp that the gripper reaches, if no vertex was chosen.

    Raises:
        SettingError: The chosen vertex or colours do not exist.
        GraspError: The grasp cannot be found.
    """
    subject, vertex = session.subject, session.settings.vertex
    assert subject is not None
    if vertex is not None and session.state.vertex is None:
        raise SettingError(session.message)
    session.check_paint(session.state.paint)
    if vertex is None and subject.labels.approach_margin is not None:
        for best in best_vertices(subject, 1):
            session.click(int(best), inspect=True)
            _wait(session)


def _views(first: View, count: int) -> list[View]:
    turns = 2.0 * math.pi * np.arange(count) / count
    return [View(first.azimuth + float(turn), first.elevation) for turn in turns]


def _pictures(renderer: PictureRenderer, views: list[View]) -> Iterator[Bytes]:
    for view in views:
        renderer.scene.turn(view)
        yield renderer.picture()


def _reported(pictures: Iterator[Bytes], count: int) -> Iterator[Bytes]:
    """The pictures of a film, the second half of the work."""
    for number, picture in enumerate(pictures, start=1):
        yield picture
        report_progress(0.5 + 0.5 * number / count)


def _durations(frames: int, seconds: float) -> list[int]:
    """Duration of each frame [ms], a multiple of 10 ms as GIFs require."""
    ends = np.rint(100.0 * seconds * np.arange(frames + 1) / frames)
    return [int(10 * step) for step in np.diff(ends)]


def _written_by() -> PngInfo:
    """Metadata of a picture that name the program."""
    metadata = PngInfo()
    metadata.add_text("Software", SOFTWARE)
    return metadata


def _palette(pictures: Iterator[Bytes]) -> Image.Image:
    """One palette for all frames, so that constant parts do not flicker.

    An octree keeps the colours of labels with a small area.
    """
    samples = Image.fromarray(np.concatenate(list(pictures)))
    return samples.quantize(256, Image.Quantize.FASTOCTREE)


def _write_gif(
    path: Path, pictures: Iterator[Bytes], palette: Image.Image, durations: list[int]
) -> None:
    frames = (
        Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE)
        for picture in pictures
    )
    next(frames).save(
        path, format="GIF", save_all=True, append_images=frames, duration=durations, loop=0,
        comment=SOFTWARE,
    )  # fmt: skip


def _check_video() -> None:
    try:
        import imageio_ffmpeg  # noqa: F401
    except ImportError as error:
        raise OutputError(
            "films as .mp4 need ffmpeg: pip install 'grasp3d[video]'; .gif needs no extra"
        ) from error


def _write_video(path: Path, pictures: Iterator[Bytes], rate: float) -> None:
    """Write H.264 in 4:2:0, which all players support and which needs even sizes."""
    import imageio_ffmpeg

    first = _even(next(pictures))
    height, width = first.shape[:2]
    writer = imageio_ffmpeg.write_frames(
        str(path), (width, height), fps=rate, codec="libx264", pix_fmt_out="yuv420p", quality=8,
        macro_block_size=2, ffmpeg_log_level="error",
        output_params=["-metadata", f"comment={SOFTWARE}"],
    )  # fmt: skip
    try:
        writer.send(None)
        writer.send(first)
        for picture in pictures:
            writer.send(_even(picture))
    finally:
        writer.close()


def _even(picture: Bytes) -> Bytes:
    """Repeat the last row or column if their number is odd."""
    height, width = picture.shape[:2]
    return np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
