"""The scene: surface, grasp and section in a PyVista plotter, and the vertices that clicks hit."""

import math
import threading
import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista

from grasp3d.arrays import Bytes, Floats
from grasp3d.rendering.grasp_views import grasp_view
from grasp3d.rendering.opengl import UPRIGHT, View, screenshot, view_axes
from grasp3d.viewer.scene.captions import Captions
from grasp3d.viewer.scene.framing import (
    Frame,
    FreeArea,
    aim,
    axes_of,
    frame_of,
    parallel_scale,
    pixel_ratio,
    visible_fraction,
)
from grasp3d.viewer.scene.marks import CONTACT_RADIUS
from grasp3d.viewer.scene.overlays import (
    OverlayItem,
    TextArea,
    contact_numbers,
    display_positions,
    text_size,
)
from grasp3d.viewer.scene.panes import Pane
from grasp3d.viewer.session.inspection import Inspection
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.session.state import Section
from grasp3d.viewer.subjects.subject import Subject
from grasp3d.viewer.view_settings import ViewSettings

if TYPE_CHECKING:
    from grasp3d.viewer.session.collection import Item

MAX_MOVE = 4.0
"""Largest movement of the mouse between press and release of a click [pixels]."""


def prepare_picking(subject: Subject, before: Subject | None) -> None:
    """Build the ray tracer for clicks in the background, or reuse that of the same geometry.

    Args:
        subject: The surface.
        before: The surface displayed before.
    """
    if (
        before is not None
        and before.mesh.vertices is subject.mesh.vertices
        and before.mesh.faces is subject.mesh.faces
        and "rays" in vars(before)
    ):
        vars(subject).setdefault("rays", before.rays)
    else:
        threading.Thread(target=lambda: subject.rays, daemon=True).start()


def vertex_at(
    subject: Subject, origin: Floats, direction: Floats, section: Section | None = None
) -> int | None:
    """Find the vertex nearest to the hit of a ray, among the corners of the face that is hit.

    Args:
        subject: The surface.
        origin: Start of the ray, in the mesh's frame, shape (3,).
        direction: Direction of the ray, shape (3,), of any length.
        section: A section; its hidden part cannot be hit.

    Returns:
        The vertex; None if the ray hits nothing.
    """
    direction = direction / np.linalg.norm(direction)
    reach = np.inf
    if section is not None:
        point, normal = section.plane(subject.bounds)
        height, climb = float(normal @ (origin - point)), float(normal @ direction)
        crossing = -height / climb if climb else np.inf
        if height < 0.0:
            if climb <= 0.0:
                return None
            origin = origin + crossing * direction
        elif climb < 0.0:
            reach = crossing
    start = (origin - subject.mesh.center) / subject.mesh.size
    toward = np.asarray(direction, dtype=np.float32)[None]
    faces, far = subject.rays.hits(np.asarray(start, dtype=np.float32)[None], toward)
    face, distance = int(faces[0]), float(far[0]) * subject.mesh.size
    if face < 0 or distance > reach:
        return None
    corners = subject.mesh.faces[face]
    gaps = np.linalg.norm(subject.mesh.vertices[corners] - (origin + distance * direction), axis=1)
    return int(corners[np.argmin(gaps)])


class ClickDetector:
    """Calls a function for clicks with the left button, but not for drags.

    After a press, VTK's interactor style grabs the mouse and other observers do not receive the
    release; therefore the end of the style's interaction is observed. The style is looked up once:
    another style needs another detector.
    """

    def __init__(
        self, plotter: pyvista.Plotter, on_click: Callable[[float, float, bool], None]
    ) -> None:
        """Register the observers.

        Args:
            plotter: Plotter whose interactor receives the mouse events.
            on_click: Called with the position [pixels from the lower left], and whether shift was
                held.
        """
        window: Any = plotter.iren
        self._mouse = window.interactor
        self._on_click = on_click
        self._pressed: tuple[int, int] | None = None
        self._shift = False
        self._mouse.AddObserver("LeftButtonPressEvent", self._press, 1.0)
        style = window.style
        style.AddObserver("InteractionEvent", self._move)
        style.AddObserver("EndInteractionEvent", self._release)

    def _press(self, *_: object) -> None:
        self._pressed = self._mouse.GetEventPosition()
        self._shift = bool(self._mouse.GetShiftKey())

    def _move(self, *_: object) -> None:
        if self._pressed and math.dist(self._pressed, self._mouse.GetEventPosition()) > MAX_MOVE:
            self._pressed = None

    def _release(self, *_: object) -> None:
        self._move()
        pressed, self._pressed = self._pressed, None
        if pressed is not None:
            x, y = self._mouse.GetEventPosition()
            self._on_click(float(x), float(y), self._shift)


MOSTLY = 0.9
"""Visible fraction of a gripper's corners below which the camera moves away to show it."""


def new_plotter(
    settings: ViewSettings, *, off_screen: bool, panel: bool = False
) -> pyvista.Plotter:
    """Make a plotter for a scene.

    Args:
        settings: Size of the window.
        off_screen: Render without a window.
        panel: Add a second renderer beside the scene's.
    """
    plotter = pyvista.Plotter(
        shape=(1, 2 if panel else 1),
        off_screen=off_screen,
        window_size=[settings.width, settings.height],
        border=False,
        lighting="none",
    )
    plotter.disable_anti_aliasing()
    return plotter


class Scene:
    """Draws a session in a plotter, which the caller opens and closes."""

    def __init__(
        self,
        plotter: pyvista.Plotter,
        *,
        area: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0),
        legend: bool = True,
    ) -> None:
        """Use the first renderer of a plotter made by `new_plotter`.

        Args:
            plotter: The plotter.
            area: Part of the window for the scene: left, bottom, right, top, from 0 to 1.
            legend: Whether the picture has a legend of the colours.
        """
        self.plotter = plotter
        self.area = area
        self.legend = legend
        self._pane = Pane(plotter.renderers[0])
        self._inspection: Inspection | None = None
        self.captions = Captions()
        self._subject: Subject | None = None
        self._item: Item | None = None
        self._free_area: FreeArea | None = None
        self._up = UPRIGHT
        self._size = 1.0
        self._steps = 0
        self._scale = 0.0
        """Scale of the last frame, by which a zoom of the user's is recognised."""
        before_render = weakref.WeakMethod(self._before_render)

        def on_render(*_: object) -> None:
            call = before_render()
            if call is not None:
                call()

        plotter.renderers[0].GetRenderWindow().AddObserver("StartEvent", on_render)

    @property
    def camera(self) -> pyvista.Camera:
        """The camera."""
        camera: pyvista.Camera = self._pane.renderer.camera
        return camera

    def update(self, session: Session) -> None:
        """Update what has changed; the owner of the plotter renders."""
        subject = session.subject
        self._pane.renderer.viewport = self.area
        self.captions = Captions.of(session, legend=self.legend)
        before, self._subject = self._subject, subject
        if subject is None:
            self._clear()
        else:
            if subject is not before:
                prepare_picking(subject, before)
            inspection = session.inspection
            if inspection is not None and not session.state.show_gripper:
                inspection = replace(inspection, held=None)
            self._inspection = inspection
            self._set_surroundings(session, subject)
            before_grasp = len(self._pane.gripper.points)
            has_moved = self._draw(session, inspection)
            item = session.collection.items[session.number]
            if item is not self._item or session.steps != self._steps:
                self._item, self._steps = item, session.steps
                self.look(session)
            elif has_moved:
                self._show_whole_gripper()
            elif len(self._pane.gripper.points) < before_grasp and (
                self.camera.parallel_scale == self._scale
            ):
                self._frame_all(axes_of(self.camera))
        self._before_render()

    def look(self, session: Session) -> None:
        """Set the camera to the initial view, so that the object fills its pane."""
        subject = self._subject
        if subject is None:
            return
        self._frame_all(view_axes(self.view(session), self._up))
        self._before_render()

    def view(self, session: Session) -> View:
        """The initial view: as it is set, else across the closing axis of the grasp."""
        settings, inspection = session.settings, self._inspection
        chosen = settings.azimuth is not None or settings.elevation is not None
        if chosen or inspection is None or len(inspection.points) < 2:
            azimuth = View.azimuth if settings.azimuth is None else settings.azimuth
            return View(
                azimuth, View.elevation if settings.elevation is None else settings.elevation
            )
        return grasp_view(inspection.points, self._up, inspection.held)

    def pick(self, session: Session, x: float, y: float) -> int | None:
        """Vertex at a window position [pixels from the lower left]; None: there is none."""
        subject = session.subject
        (width, height), (left, bottom, right, top) = self.plotter.window_size, self.area
        inside = left * width <= x < right * width and bottom * height <= y < top * height
        if subject is None or not inside:
            return None
        near, far = (_world(self._pane.renderer, x, y, depth) for depth in (0.0, 1.0))
        return vertex_at(subject, near, far - near, session.state.section)

    def screenshot(self) -> Bytes:
        """RGB colours of the window, shape (height, width, 3)."""
        return screenshot(self.plotter)

    def _set_surroundings(self, session: Session, subject: Subject) -> None:
        """Set the direction that is up, and the size of all that may be shown."""
        scene, self._size, self._up = session.scene, subject.mesh.size, UPRIGHT
        if scene is not None:
            self._size += scene.hand.size
            self._up = scene.up

    def _frame_all(self, axes: Floats) -> None:
        """Show all from a direction."""
        self._frame(frame_of(self._pane.points, self._pane.beside, axes), axes)

    def _show_whole_gripper(self) -> None:
        """Move the camera away, in the same direction, if most of the gripper is not visible."""
        axes, beside = axes_of(self.camera), self._pane.gripper.points
        free = self._find_free_area()
        per_pixel = 2.0 * self.camera.parallel_scale / max(1.0, free.height)
        width, height = free.free
        now = Frame(
            np.array(self.camera.focal_point), (0.5 * width * per_pixel, 0.5 * height * per_pixel)
        )
        if visible_fraction(beside, now, axes) < MOSTLY:
            self._frame_all(axes)
        self._pane.renderer.ResetCameraClippingRange()

    def _frame(self, frame: Frame, axes: Floats) -> None:
        """Point the camera at a frame."""
        aim(self.camera, self._size, axes, frame.middle)
        self._free_area = free = self._find_free_area()
        self.camera.parallel_scale = parallel_scale(frame.reach, free)
        self._scale = self.camera.parallel_scale

    def _draw(self, session: Session, inspection: Inspection | None) -> bool:
        """Draw the object; returns whether another gripper is drawn than before."""
        subject, state, pane = self._subject, session.state, self._pane
        assert subject is not None
        pane.show(subject, state.paint, session.model, stale=session.stale)
        pane.cut(state.section.plane(subject.bounds) if state.section else None)
        fixed = np.array(state.fixed, dtype=float).reshape(-1, 3)
        scene = session.scene
        table = scene.table if scene is not None and state.show_table else None
        return pane.hold(inspection, None if scene is None else scene.hand, table, fixed)

    def _clear(self) -> None:
        self._item = self._inspection = None
        self._pane.hide()

    def _find_free_area(self) -> FreeArea:
        """The part of the pane that is free of texts."""
        area = self._text_area()
        top, bottom = self.captions.margins(area)
        return FreeArea(area.width, area.height, top=top, bottom=bottom, sides=area.margin)

    def _before_render(self) -> None:
        """Adapt to the window size and the zoom; called before each rendering."""
        free = self._find_free_area()
        subject, camera = self._subject, self.camera
        if self._free_area is not None and free != self._free_area and subject is not None:
            axes, pane = axes_of(camera), self._pane
            reach = frame_of(pane.points, pane.beside, axes).reach
            zoom = parallel_scale(reach, free) / parallel_scale(reach, self._free_area)
            is_own = camera.parallel_scale == self._scale
            camera.parallel_scale *= zoom
            self._scale = camera.parallel_scale if is_own else self._scale
        self._free_area = free
        camera.SetWindowCenter(0.0, -free.shift)
        per_pixel = 2.0 * camera.parallel_scale / max(1.0, free.height)
        area = self._text_area()
        self._pane.captions.show(self.captions.items(area, per_pixel))
        self._pane.numbers.show(self._contact_numbers(area, per_pixel))

    def _contact_numbers(self, area: TextArea, per_pixel: float) -> list[OverlayItem]:
        """Numbers of a grasp's contacts at their current positions."""
        subject, inspection = self._subject, self._inspection
        if subject is None or inspection is None or len(inspection.points) < 2:
            return []
        points, radius = inspection.points, CONTACT_RADIUS * subject.mesh.size
        tips = points + radius * inspection.normals
        contacts, ahead = (display_positions(self._pane.renderer, one) for one in (points, tips))
        return contact_numbers(area, contacts, ahead, radius / per_pixel)

    def _text_area(self) -> TextArea:
        """Size of the pane and of its texts."""
        width, height = self._pane.renderer.GetSize()
        return TextArea(width, height, text_size(width, height, pixel_ratio(self._pane.renderer)))


def _world(renderer: pyvista.Renderer, x: float, y: float, depth: float) -> Floats:
    """Point of the mesh's frame at a window position and depth, shape (3,)."""
    renderer.SetDisplayPoint(x, y, depth)
    renderer.DisplayToWorld()
    point = np.array(renderer.GetWorldPoint())
    return np.asarray(point[:3] / point[3])
