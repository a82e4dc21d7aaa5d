"""The scene: draws a session in a PyVista plotter, and finds the vertices that clicks hit."""

import math
import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista
from vtkmodules.vtkRenderingCore import vtkCellPicker

from grasp3d.arrays import Bytes, Floats
from grasp3d.describe.explanations import finger_words
from grasp3d.pictures.camera import (
    UPRIGHT,
    FreeArea,
    View,
    aim,
    axes_of,
    frame_of,
    grasp_view,
    parallel_scale,
    view_axes,
)
from grasp3d.pictures.captions import Captions, LegendEntry, Texts
from grasp3d.pictures.opengl import screenshot
from grasp3d.pictures.pane import Pane
from grasp3d.pictures.subject import Subject
from grasp3d.settings.grasp_model import friction_text, location_texts
from grasp3d.viewer.inspection import Inspection
from grasp3d.viewer.panel_text import panel_text
from grasp3d.viewer.session import Session

if TYPE_CHECKING:
    from grasp3d.viewer.collection import Item

MAX_MOVE = 4.0
"""Largest movement of the mouse between press and release of a click [pixels]."""


class Scene:
    """Drawing of a session in the first renderer of a plotter; the caller opens and closes it.

    Args:
        plotter: The plotter.
        area: Part of the window for the scene: left, bottom, right, top, from 0 to 1.
        legend: Whether the picture has a title, settings and a legend of the colours.
    """

    def __init__(
        self,
        plotter: pyvista.Plotter,
        *,
        area: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0),
        legend: bool = True,
    ) -> None:
        self.plotter, self.area, self.legend = plotter, area, legend
        self._renderer = plotter.renderers[0]
        self._pane, self._texts = Pane(self._renderer), Texts(plotter)
        self._captions = Captions()
        self._picker = vtkCellPicker()
        self._picker.SetTolerance(0.0)
        self._inspection: Inspection | None = None
        self._subject: Subject | None = None
        self._item: Item | None = None
        self._framed: FreeArea | None = None
        """Free area for which the scale of the camera was set."""
        self._up, self._size, self._steps = UPRIGHT, 1.0, 0
        before_render = weakref.WeakMethod(self._before_render)

        def on_render(*_: object) -> None:
            call = before_render()
            if call is not None:
                call()

        self._renderer.GetRenderWindow().AddObserver("StartEvent", on_render)

    @property
    def camera(self) -> pyvista.Camera:
        """The camera."""
        camera: pyvista.Camera = self._renderer.camera
        return camera

    def update(self, session: Session) -> None:
        """Update what has changed; the owner of the plotter renders the scene."""
        subject, state = session.subject, session.state
        self._renderer.viewport = self.area
        self._subject = subject
        if subject is None:
            self._item = self._inspection = self._framed = None
            self._pane.hide()
            self._captions = captions_of(session, None, legend=self.legend)
            self._before_render()
            return
        found = self._inspection = session.inspection
        self._captions = captions_of(session, found, legend=self.legend)
        scene = session.scene
        self._size = subject.mesh.size + (0.0 if scene is None else scene.hand.size)
        self._up = UPRIGHT if scene is None else scene.up
        had_hand = bool(len(self._pane.hand_points))
        self._draw(session, found if state.show_gripper else found and replace(found, held=None))
        item = session.collection.items[session.number]
        if item is not self._item or session.steps != self._steps:
            self._item, self._steps = item, session.steps
            self.look(session)
        elif len(self._pane.hand_points) and not had_hand:
            self._frame(axes_of(self.camera))
        self._renderer.ResetCameraClippingRange()
        self._before_render()

    def look(self, session: Session) -> None:
        """Set the camera to the initial view, in which the object fills the picture."""
        if self._subject is not None:
            self._frame(view_axes(self._view(session), self._up))
            self._before_render()

    def pick(self, x: float, y: float) -> int | None:
        """Vertex at a window position [pixels from the lower left]; None if there is none.

        It is the nearest corner of the visible face.
        """
        subject = self._subject
        if subject is None or not self._picker.Pick(x, y, 0.0, self._renderer):
            return None
        mesh, point = subject.mesh, np.array(self._picker.GetPickPosition())
        corners = [self._picker.GetDataSet().GetCell(self._picker.GetCellId()).GetPointId(k)
                   for k in range(3)]  # fmt: skip
        vertices = mesh.corner_normals.vertices[corners]
        gaps = np.linalg.norm(mesh.vertices[vertices] - point, axis=1)
        return int(vertices[np.argmin(gaps)])

    def screenshot(self) -> Bytes:
        """RGB colours of the window, shape (height, width, 3)."""
        return screenshot(self.plotter)

    def _view(self, session: Session) -> View:
        """Return the view of the settings, or else one across the closing axis of the grasp."""
        settings, inspection = session.settings, self._inspection
        chosen = settings.azimuth is not None or settings.elevation is not None
        if not chosen and inspection is not None and len(inspection.points) > 1:
            return grasp_view(inspection.points, self._up, inspection.held)
        azimuth = View.azimuth if settings.azimuth is None else settings.azimuth
        return View(azimuth, View.elevation if settings.elevation is None else settings.elevation)

    def _draw(self, session: Session, inspection: Inspection | None) -> None:
        """Draw the object, and the hand or contacts that hold it."""
        subject, state, pane, scene = self._subject, session.state, self._pane, session.scene
        assert subject is not None
        pane.show(subject, state.paint, stale=session.stale)
        pane.cut(state.section.plane(subject.bounds) if state.section else None)
        fixed = np.array(state.fixed, dtype=float).reshape(-1, 3)
        table = scene.table if scene is not None and state.show_table else None
        pane.hold(inspection, None if scene is None else scene.hand, table, fixed)

    def _frame(self, axes: Floats) -> None:
        """Fit everything into the picture, seen along given axes."""
        frame = frame_of(self._pane.points, self._pane.beside, axes)
        aim(self.camera, self._size, axes, frame.middle)
        self._framed = self._free
        self.camera.parallel_scale = parallel_scale(frame.reach, self._framed)

    @property
    def _free(self) -> FreeArea:
        """Part of the picture that texts leave free."""
        return self._texts.free_area(self._captions)

    def _before_render(self) -> None:
        """Adapt the texts to window size and zoom; called before each rendering."""
        free, camera = self._free, self.camera
        if self._framed not in {None, free}:
            reach = frame_of(self._pane.points, self._pane.beside, axes_of(camera)).reach
            camera.parallel_scale *= parallel_scale(reach, free) / parallel_scale(
                reach, self._framed
            )
            self._framed = free
        camera.SetWindowCenter(0.0, -free.shift)
        self._texts.show(self._captions, 2.0 * camera.parallel_scale / max(1.0, free.height))


def captions_of(session: Session, inspection: Inspection | None, *, legend: bool) -> Captions:
    """Return the captions for the current state of a session.

    Args:
        session: The session.
        inspection: The grasp that is shown.
        legend: Whether to add title, legend and settings, which a view without a panel needs.
    """
    subject = session.subject
    if subject is None:
        working = session.working
        wrong = session.message or f"{session.name} cannot be shown"
        return Captions(placeholder=wrong if working is None else f"{working[0]} …")
    metres = subject.mesh.unit is not None
    several = inspection is not None and len(inspection.points) > 1
    numbered = inspection.tails(subject.mesh.size) if inspection and several else np.empty((0, 3))
    if not legend:
        return Captions(metres=metres, contacts=numbered)
    text = panel_text(session)
    entries = [
        LegendEntry(one.color, f"{one.letter}  {one.text}  {one.percent}") for one in text.fractions
    ]
    return Captions(
        title=text.title, settings=_settings(session, subject), legend=tuple(entries),
        ramp=text.ramp, metres=metres, contacts=numbered,
    )  # fmt: skip


def _settings(session: Session, subject: Subject) -> str:
    """Return the settings of the picture in one line."""
    model, scene, metres = session.model, session.scene, subject.mesh.unit is not None
    resolution = f"α {round(math.degrees(model.sensor_resolution), 2):g}°"
    parts = [resolution, f"μ {friction_text(model)}", *location_texts(model, metres=metres)]
    limit = session.collection.sampling.max_opening
    if subject.poses is None:
        parts.append(finger_words(model.fingers))
        if subject.labels.mode != "scan" and math.isfinite(limit):  # the search had a limit
            parts.append(f"opening ≤ {subject.mesh.length_text(limit)}")
    return "   ".join([*parts, *([] if scene is None else [scene.hand.name])])


class ClickDetector:
    """Detector of clicks with the left button; it ignores drags.

    After a press, VTK's interactor style grabs the mouse, and other observers do not receive the
    release. So the end of the style's interaction is observed. The style is looked up once: another
    style needs another detector.
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
