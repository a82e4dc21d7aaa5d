"""The scene: the surface, a grasp, a section, as a PyVista plotter shows them."""

import weakref
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pyvista

from grasp3d.arrays import Bytes, Floats
from grasp3d.rendering import View
from grasp3d.settings import GraspModel
from grasp3d.viewer.scene.captions import Captions
from grasp3d.viewer.scene.framing import (
    Room,
    aim,
    axes_of,
    dots,
    extents,
    middle_of,
    parallel_scale,
)
from grasp3d.viewer.scene.layout import Item, Paper, letter_size
from grasp3d.viewer.scene.marks import BALL, Marks
from grasp3d.viewer.scene.numbers import numbers, seen_at
from grasp3d.viewer.scene.overlays import Overlay
from grasp3d.viewer.scene.panes import Pane
from grasp3d.viewer.scene.picking import prepare, vertex_at
from grasp3d.viewer.session.inspecting import Inspected
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.subjects.subject import Subject
from grasp3d.viewer.view_settings import ViewSettings

if TYPE_CHECKING:
    from grasp3d.viewer.session.album import Exhibit


def new_plotter(
    settings: ViewSettings, *, off_screen: bool, panel: bool = False
) -> pyvista.Plotter:
    """Make a plotter for a scene.

    Args:
        settings: Size of the window.
        off_screen: Without a window.
        panel: With a third renderer, beside the scene's two.
    """
    plotter = pyvista.Plotter(
        shape=(1, 3 if panel else 2),
        off_screen=off_screen,
        window_size=[settings.width, settings.height],
        border=False,
        lighting="none",
    )
    plotter.disable_anti_aliasing()
    return plotter


class Scene:
    """What a session shows, drawn by a plotter that someone else opens and closes."""

    def __init__(
        self,
        plotter: pyvista.Plotter,
        *,
        area: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0),
        legend: bool = True,
    ) -> None:
        """Take a plotter of `new_plotter`.

        Args:
            plotter: Its first two renderers are used.
            area: Part of the window that the scene takes: left, bottom, right, top, from 0 to 1.
            legend: Whether the picture itself tells what colours mean.
        """
        self.plotter = plotter
        self.area = area
        self.legend = legend
        renderers = plotter.renderers[:2]
        self._panes = [Pane(renderer) for renderer in renderers]
        self._marks = [Marks(renderer) for renderer in renderers]
        self._overlays = [Overlay(renderer) for renderer in renderers]
        self._numbers = [Overlay(renderer) for renderer in renderers]
        self._inspected: Inspected | None = None
        self._captions = Captions()
        self._subject: Subject | None = None
        self._exhibit: Exhibit | None = None
        self._room: Room | None = None
        self._count = 1
        renderers[1].camera = renderers[0].camera
        before = weakref.WeakMethod(self._before)

        def settle(*_: object) -> None:
            call = before()
            if call is not None:
                call()

        renderers[0].GetRenderWindow().AddObserver("StartEvent", settle)

    @property
    def camera(self) -> pyvista.Camera:
        """What both pictures are seen with."""
        camera: pyvista.Camera = self._panes[0].renderer.camera
        return camera

    def update(self, session: Session) -> None:
        """Draw what has changed; whoever holds the plotter renders."""
        subject, other = session.subject, session.other_model
        self._count = 2 if other is not None and subject is not None else 1
        self._divide()
        self._captions = Captions.of(session, legend=self.legend)
        before, self._subject = self._subject, subject
        if subject is None:
            self._clear()
        else:
            if subject is not before:
                prepare(subject, before)
            self._inspected = inspected = session.inspected
            self._draw(0, session, session.model, inspected)
            if other is not None:
                self._draw(1, session, other, inspected and replace(inspected, model=other))
            exhibit = session.album.exhibits[session.number]
            if exhibit is not self._exhibit:
                self._exhibit = exhibit
                self.look(session)
        self._before()

    def look(self, session: Session, turns: Sequence[View] = ()) -> None:
        """Aim the camera as the settings say, so that the object fills its pane.

        Args:
            session: What is shown.
            turns: Other views in which it must stay within the pane, with the same middle.
        """
        subject = self._subject
        if subject is None:
            return
        view = View(session.settings.azimuth, session.settings.elevation)
        points = _used(subject)
        middle = subject.center if turns else middle_of(points, view.axes)
        aim(self.camera, subject, view, middle)
        self._room = room = self._free()
        reach = extents(points, middle, [one.axes for one in (view, *turns)])
        self.camera.parallel_scale = parallel_scale(reach, room)
        self._before()

    def turn(self, view: View) -> None:
        """Look from another side at the same point, as far away."""
        if self._subject is not None:
            aim(self.camera, self._subject, view, np.array(self.camera.focal_point))

    def pick(self, session: Session, x: float, y: float) -> int | None:
        """Vertex under a place of the window [pixels, from the lower left]; None: there is none."""
        subject = session.subject
        width, height = self.plotter.window_size
        for pane in self._panes[: self._count]:
            left, bottom, right, top = pane.renderer.viewport
            inside = left * width <= x < right * width and bottom * height <= y < top * height
            if subject is not None and inside:
                near, far = (_world(pane.renderer, x, y, depth) for depth in (0.0, 1.0))
                return vertex_at(subject, near, far - near, session.shown.section)
        return None

    def shot(self) -> Bytes:
        """What is seen, red, green and blue, shape (height, width, 3)."""
        self.plotter.render()  # a second picture would otherwise be the first
        return np.array(self.plotter.screenshot(return_img=True), dtype=np.uint8)[..., :3]

    def _divide(self) -> None:
        """Give each pane its part of the window."""
        left, bottom, right, top = self.area
        middle = 0.5 * (left + right) if self._count > 1 else right
        self._panes[0].renderer.viewport = (left, bottom, middle, top)
        self._panes[1].renderer.viewport = (middle, bottom, right, top)
        self._panes[1].renderer.SetDraw(self._count > 1)

    def _draw(
        self, number: int, session: Session, model: GraspModel, inspected: Inspected | None
    ) -> None:
        subject, shown = self._subject, session.shown
        assert subject is not None
        pane = self._panes[number]
        pane.show(subject, shown.paint, model, stale=session.stale)
        pane.cut(shown.section.plane(subject.bounds) if shown.section else None)
        fixed = np.array(shown.fixed, dtype=float).reshape(-1, 3)
        self._marks[number].show(subject, inspected, fixed)

    def _clear(self) -> None:
        self._exhibit = self._inspected = None
        for pane, marks in zip(self._panes, self._marks, strict=True):
            pane.hide()
            marks.hide()

    def _free(self) -> Room:
        """The part of a pane that words leave."""
        width, height = self._panes[0].renderer.GetSize()
        papers = self._papers()
        rooms = [self._captions.taken(paper, number) for number, paper in enumerate(papers)]
        return Room(
            width, height,
            top=max(top for top, _ in rooms),
            bottom=max(bottom for _, bottom in rooms),
            sides=papers[0].margin,
        )  # fmt: skip

    def _before(self) -> None:
        """Before each picture: fit what depends on the window's size and on the zoom."""
        room = self._free()
        subject, camera = self._subject, self.camera
        if self._room is not None and room != self._room and subject is not None:
            axes = axes_of(camera)
            reach = extents(_used(subject), middle_of(_used(subject), axes), [axes])
            zoom = parallel_scale(reach, room) / parallel_scale(reach, self._room)
            camera.parallel_scale *= zoom
        self._room = room
        camera.SetWindowCenter(0.0, -room.shift)
        per_pixel = 2.0 * camera.parallel_scale / max(1.0, room.height)
        for number, paper in enumerate(self._papers()):
            last = number == self._count - 1
            self._overlays[number].show(
                self._captions.items(paper, number, per_pixel if last else None)
            )
            self._numbers[number].show(self._numbered(number, paper, per_pixel))

    def _numbered(self, number: int, paper: Paper, per_pixel: float) -> list[Item]:
        """Numbers of the contacts of a grasp, where it is seen in a pane now."""
        subject, inspected = self._subject, self._inspected
        if subject is None or inspected is None or len(inspected.points) < 2:
            return []
        renderer, points = self._panes[number].renderer, inspected.points
        tips = points + BALL * subject.size * inspected.normals
        places, further = seen_at(renderer, points), seen_at(renderer, tips)
        return numbers(paper, places, further, BALL * subject.size / per_pixel)

    def _papers(self) -> list[Paper]:
        """The panes to write on; letters have one size, that of the whole scene."""
        sizes = [pane.renderer.GetSize() for pane in self._panes[: self._count]]
        unit = dots(self._panes[0].renderer)
        size = letter_size(sum(width for width, _ in sizes), sizes[0][1], unit)
        return [Paper(width, height, size) for width, height in sizes]


def _used(subject: Subject) -> Floats:
    """Vertices that belong to a face, shape (n, 3)."""
    return subject.vertices[subject.corner_normals.vertices]


def _world(renderer: pyvista.Renderer, x: float, y: float, depth: float) -> Floats:
    renderer.SetDisplayPoint(x, y, depth)
    renderer.DisplayToWorld()
    place = np.array(renderer.GetWorldPoint())
    return np.asarray(place[:3] / place[3])
