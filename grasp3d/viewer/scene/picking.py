"""Clicks on the scene, as opposed to drags, and the vertex that a click hits."""

import math
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pyvista

from grasp3d.arrays import Floats
from grasp3d.viewer.session.state import Section
from grasp3d.viewer.subjects.subject import Subject

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
        vars(subject).setdefault("center", before.center)
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
    start = subject.normalized(origin)
    toward = np.asarray(direction, dtype=np.float32)[None]
    hit = subject.rays.hits(np.asarray(start, dtype=np.float32)[None], toward)
    face, distance = int(hit["primID"][0]), float(hit["tfar"][0]) * subject.mesh.size
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
