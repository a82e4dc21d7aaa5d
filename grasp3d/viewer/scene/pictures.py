"""Pictures and turntables of what a viewer shows, written to files without a window."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyvista
from PIL import Image

from grasp3d.arrays import Bytes
from grasp3d.errors import GraspError, OutputError, SettingError
from grasp3d.rendering import View, check_rendering, choose_window
from grasp3d.system.files import check_suffix, check_writable, written_whole
from grasp3d.system.names import safe_stem
from grasp3d.system.progress import Progress, ignore, within
from grasp3d.viewer.scene.scene import Scene, new_plotter
from grasp3d.viewer.session.album import Album
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.view_settings import LEAST_HEIGHT, LEAST_WIDTH, ViewSettings

FINE = 2
"""Pixels that are drawn for each of a picture, across and down; their mean is shown."""

MOST_DRAWN = 8192
"""Pixels across that OpenGL surely draws."""

INCH = 72
"""Pixels of a picture that is drawn just as large as it is shown."""

GLANCE = 0.02
"""How often work in the background is looked after [s]."""

MOVING = ".mp4"
STILLS, FILMS = (".png",), (".gif", MOVING)
MOST_FRAMES, LONGEST = 3600, 600.0
SAMPLES = 6
"""Frames from which the colours of a GIF are chosen."""


@dataclass(frozen=True, eq=False)
class Studio:
    """A session whose object is ready, and a scene of it."""

    session: Session
    scene: Scene
    fine: int

    def shot(self) -> Bytes:
        """What is seen, each pixel the mean of those drawn, shape (height, width, 3)."""
        drawn, fine = self.scene.shot(), self.fine
        height, width = drawn.shape[0] // fine, drawn.shape[1] // fine
        parts = drawn.reshape(height, fine, width, fine, 3)
        return np.asarray(np.rint(parts.mean(axis=(1, 3), dtype=np.float32)), dtype=np.uint8)


def check_picture(path: Path) -> None:
    """Tell before the work whether a picture could be drawn and written.

    Raises:
        OutputError: It could not.
    """
    check_suffix(path, STILLS, "picture")
    check_writable(path)
    check_rendering()


def check_film(path: Path) -> None:
    """Tell the same of a film."""
    check_suffix(path, FILMS, "film")
    if path.suffix.lower() == MOVING:
        _check_video()
    check_writable(path)
    check_rendering()


def save_picture(
    album: Album, settings: ViewSettings, path: Path, *, progress: Progress = ignore
) -> None:
    """Write a picture of an album's first object as a PNG.

    Args:
        album: What is looked at.
        settings: How it is shown, and how large.
        path: The file, replaced if it is there.
        progress: Called with the share of the work done, from 0 to 1.

    Raises:
        GraspError: There is no OpenGL here, the object cannot be shown or the file not written.
    """
    check_picture(path)
    with opened(album, settings, within(progress, 0.0, 0.95)) as studio:
        drawn = Image.fromarray(studio.shot())
        with written_whole(path) as part:
            drawn.save(part, format="PNG", optimize=True)
    progress(1.0)


def save_turntable(
    album: Album,
    settings: ViewSettings,
    path: Path,
    *,
    frames: int = 72,
    seconds: float = 6.0,
    progress: Progress = ignore,
) -> None:
    """Write a film of an album's first object that turns once, as a GIF or an MP4.

    Args:
        album: What is looked at.
        settings: How it is shown at first, and how large.
        path: The file, replaced if it is there.
        frames: Pictures in it, at least 2.
        seconds: How long a turn takes.
        progress: Called with the share of the work done, from 0 to 1.

    Raises:
        GraspError: There is no OpenGL here, the object cannot be shown or the file not written.
    """
    if not 2 <= frames <= MOST_FRAMES or not 0.0 < seconds <= LONGEST:
        raise SettingError(
            f"a turntable has from 2 to {MOST_FRAMES} frames and takes up to {LONGEST:g} seconds; "
            f"got {frames} and {seconds:g}"
        )
    check_film(path)
    with opened(album, settings, within(progress, 0.0, 0.5)) as studio:
        views = _views(settings, frames)
        studio.scene.look(studio.session, views)
        shots = _shots(studio, views, within(progress, 0.5, 1.0))
        with written_whole(path) as part:
            if path.suffix.lower() == MOVING:
                _write_video(part, shots, frames / seconds)
            else:
                sampled = _shots(studio, views[:: max(1, frames // SAMPLES)], ignore)
                _write_gif(part, shots, _palette(sampled), _durations(frames, seconds))
    progress(1.0)


@contextmanager
def opened(
    album: Album, settings: ViewSettings, progress: Progress, *, legend: bool = True
) -> Iterator[Studio]:
    """Wait until an album's first object has all that is shown of it, and draw it.

    Args:
        album: What is looked at.
        settings: How it is shown.
        progress: Called with the share of the work done, from 0 to 1.
        legend: Whether the picture tells what colours mean.

    Raises:
        GraspError: There is no OpenGL here, or the object cannot be shown.
    """
    choose_window()
    session = Session(album, settings)
    try:
        _wait(session, progress)
        fine = FINE if FINE * max(settings.width, settings.height) <= MOST_DRAWN else 1
        size = replace(settings, width=fine * settings.width, height=fine * settings.height)
        plotter = new_plotter(size, off_screen=True)
        try:
            plotter.renderers[0].GetRenderWindow().SetDPI(fine * INCH)
            scene = Scene(plotter, legend=legend)
            scene.update(session)
            yield Studio(session, scene, fine)
        finally:
            plotter.close()
    finally:
        session.close()


def copied(session: Session, camera: pyvista.Camera, width: int, height: int) -> Bytes:
    """Draw what is seen elsewhere once more, with a legend.

    Args:
        session: What is shown.
        camera: From where.
        width: Of the picture [pixels].
        height: Of the picture [pixels].

    Returns:
        Red, green, blue, shape (height, width, 3).
    """
    size = ViewSettings(width=max(LEAST_WIDTH, width), height=max(LEAST_HEIGHT, height))
    plotter = new_plotter(size, off_screen=True)
    try:
        scene = Scene(plotter)
        scene.update(session)
        _aim(scene.camera, camera)
        return scene.shot()
    finally:
        plotter.close()


def saved_as(session: Session, kind: str, suffix: str) -> str:
    """What a file of the object is called; its name is safe everywhere."""
    return f"{safe_stem(Path(session.name).stem)}_{kind}{suffix}"


def _aim(camera: pyvista.Camera, like: pyvista.Camera) -> None:
    camera.parallel_projection = like.parallel_projection
    camera.focal_point, camera.position, camera.up = like.focal_point, like.position, like.up
    camera.parallel_scale = like.parallel_scale
    camera.clipping_range = like.clipping_range


def _wait(session: Session, progress: Progress) -> None:
    """Take in what is computed in the background until there is nothing more to compute."""
    while (working := session.working) is not None:
        progress(working[1])
        if not session.poll():
            time.sleep(GLANCE)
    if session.lacking or session.subject is None:
        raise GraspError(session.lacking or f"{session.name} cannot be shown")


def _views(settings: ViewSettings, count: int) -> list[View]:
    turns = 2.0 * math.pi * np.arange(count) / count
    return [View(settings.azimuth + float(turn), settings.elevation) for turn in turns]


def _shots(studio: Studio, views: list[View], progress: Progress) -> Iterator[Bytes]:
    for number, view in enumerate(views):
        studio.scene.turn(view)
        yield studio.shot()
        progress((number + 1) / len(views))


def _durations(frames: int, seconds: float) -> list[int]:
    """How long each frame is shown [ms]: whole hundredths of a second, as GIFs have them."""
    ends = np.rint(100.0 * seconds * np.arange(frames + 1) / frames)
    return [int(10 * step) for step in np.diff(ends)]


def _palette(shots: Iterator[Bytes]) -> Image.Image:
    """Colours for all frames alike, so that what stands still does not flicker."""
    return Image.fromarray(np.concatenate(list(shots))).quantize(256)


def _write_gif(
    path: Path, shots: Iterator[Bytes], palette: Image.Image, durations: list[int]
) -> None:
    kept = (
        Image.fromarray(shot).quantize(palette=palette, dither=Image.Dither.NONE) for shot in shots
    )
    next(kept).save(
        path, format="GIF", save_all=True, append_images=kept, duration=durations, loop=0
    )


def _check_video() -> None:
    try:
        import imageio_ffmpeg  # noqa: F401
    except ImportError as error:
        raise OutputError(
            "films as .mp4 need ffmpeg: pip install 'grasp3d[video]'; a .gif needs nothing more"
        ) from error


def _write_video(path: Path, shots: Iterator[Bytes], rate: float) -> None:
    """Write H.264 as every player has it, which takes even numbers of pixels."""
    import imageio_ffmpeg

    first = _even(next(shots))
    height, width = first.shape[:2]
    writer = imageio_ffmpeg.write_frames(
        str(path), (width, height), fps=rate, codec="libx264", pix_fmt_out="yuv420p", quality=8,
        macro_block_size=2, ffmpeg_log_level="error",
    )  # fmt: skip
    try:
        writer.send(None)
        writer.send(first)
        for shot in shots:
            writer.send(_even(shot))
    finally:
        writer.close()


def _even(shot: Bytes) -> Bytes:
    """Repeat the last row or column where their number is odd."""
    height, width = shot.shape[:2]
    return np.pad(shot, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
