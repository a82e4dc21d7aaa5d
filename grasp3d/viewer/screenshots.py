"""Pictures of an object, written to files without a window."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pyvista
from PIL import Image

from grasp3d.arrays import Bytes
from grasp3d.errors import GraspError, SettingError
from grasp3d.pictures.opengl import averaged, check_rendering, off_screen
from grasp3d.pictures.view_settings import MIN_HEIGHT, MIN_WIDTH, ViewSettings
from grasp3d.system.context import report_progress, within
from grasp3d.system.files import atomic_write, check_suffix, check_writable
from grasp3d.system.names import safe_stem
from grasp3d.viewer.collection import Collection
from grasp3d.viewer.scene import Scene
from grasp3d.viewer.session import Session

POLL_INTERVAL = 0.02
"""Time between two polls of the background job [s]."""


@dataclass(frozen=True, eq=False)
class PictureRenderer:
    """A session in which all visible data are computed, and its scene."""

    session: Session
    scene: Scene
    oversampling: int

    def picture(self) -> Bytes:
        """Render the picture, averaged over oversampled pixels, shape (height, width, 3)."""
        return averaged(self.scene.screenshot(), self.oversampling)


def check_picture(path: Path) -> None:
    """Check that a picture can be rendered and written.

    Raises:
        OutputError: It cannot be rendered or written.
    """
    check_suffix(path, (".png",), "picture")
    check_writable(path)
    check_rendering()


def save_picture(collection: Collection, settings: ViewSettings, path: Path) -> None:
    """Write a picture of a collection's first object as a PNG.

    Args:
        collection: The objects.
        settings: Initial view and size of the picture.
        path: The file, replaced if it exists.

    Raises:
        GraspError: There is no OpenGL, the object cannot be shown, or the file not be written.
    """
    check_picture(path)
    with open_renderer(collection, settings, 0.95) as renderer:
        picture = Image.fromarray(renderer.picture())
        with atomic_write(path) as part:
            picture.save(part, format="PNG", optimize=True)
    report_progress(1.0)


@contextmanager
def open_renderer(
    collection: Collection, settings: ViewSettings, end: float = 1.0, *, legend: bool = True
) -> Iterator[PictureRenderer]:
    """Open a collection's first object off screen, with all visible data computed.

    Args:
        collection: The objects.
        settings: Initial view and size of the picture.
        end: Fraction of the total work at which this part ends.
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
    """Return a file name for the current object that is valid on all systems."""
    return f"{safe_stem(Path(session.name).stem)}_{kind}{suffix}"


def _wait(session: Session) -> None:
    """Poll until nothing remains to be computed."""
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
    gripped = vertex is None and subject.labels.approach_margin is not None
    if gripped:
        session.step_best(1)
        _wait(session)
