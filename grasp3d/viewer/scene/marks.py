"""Marks of a grasp on a surface: contacts, the fingers' line, friction cones, fixed fingers."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pyvista
from vtkmodules.vtkRenderingCore import vtkMapper

from grasp3d.arrays import Floats, unit_rows
from grasp3d.contact.friction_cones import tangents
from grasp3d.settings import GraspModel
from grasp3d.viewer.scene.framing import dots
from grasp3d.viewer.scene.solids import (
    Solid,
    balls,
    closed,
    lines,
    merged,
    rims,
    rods,
    spikes,
    tips,
)
from grasp3d.viewer.session.inspecting import Inspected
from grasp3d.viewer.subjects.subject import Subject

BALL, ROD, RIM = 0.013, 0.0035, 0.0035
"""Radii of balls and rods and the width of the rim about them, as shares of the object's size."""

SLANT = 0.15
"""Length of a cone's lines, likewise."""

ARROW, HEAD, HEAD_RADIUS, SHAFT = 0.19, 0.035, 0.0095, 0.0022
"""Arrows: length, length and radius of the head, radius of the shaft, likewise."""

THROUGH = 0.4
"""How strongly what is hidden shines through."""

NEARER = -60000.0
"""Units of depth by which a mark goes before the surface that hides it."""

WHITE, BLACK, GREY = "#FFFFFF", "#1A1A1A", "#4A5562"
BLUE = "#0072B2"
"""Of the cone that is sure: no label has it."""
SAME = 1e-9
"""Distance below which two contacts are one, as a share of the object's size."""


@dataclass(frozen=True, eq=False)
class Places:
    """Contacts of a grasp."""

    points: Floats
    """Shape (n, 3)."""
    normals: Floats
    """Inward unit normals, (n, 3)."""


NOWHERE = Places(np.empty((0, 3)), np.empty((0, 3)))


class Marks:
    """Marks in one renderer, made anew only when what they mark is another."""

    def __init__(self, renderer: pyvista.Renderer) -> None:
        # What is drawn later lies before what is drawn earlier, but for the surface that hides it.
        renderer.UseOITOff()
        self._halo = _Part(renderer, WHITE, width=4.0)
        self._grey_lines = _Part(renderer, GREY, width=2.0)
        self._blue_lines = _Part(renderer, BLUE, width=2.5)
        self._thin_lines = _Part(renderer, BLACK, width=1.2)
        self._hidden_rims = _Part(renderer, BLACK, rim=True, opacity=THROUGH, nearer=NEARER)
        self._hidden = _Part(renderer, WHITE, opacity=THROUGH, nearer=NEARER)
        self._hidden_fixed = _Part(renderer, BLACK, opacity=THROUGH, nearer=NEARER)
        self._cones = _Part(renderer, GREY, opacity=0.22)
        self._sure_cones = _Part(renderer, BLUE, opacity=0.5)
        self._rims = _Part(renderer, BLACK, rim=True)
        self._cores = _Part(renderer, WHITE)
        self._fixed_rims = _Part(renderer, WHITE, rim=True)
        self._fixed = _Part(renderer, BLACK)
        self._shown: tuple[object, ...] = (None,) * 3

    def show(self, subject: Subject, inspected: Inspected | None, fixed: Floats) -> None:
        """Mark a grasp and fixed fingers.

        Args:
            subject: The surface.
            inspected: The vertex that is told of, with its grasp; None: none is.
            fixed: Where fingers are fixed, shape (n, 3).
        """
        size, still = subject.size, (id(subject.vertices), fixed.tobytes())
        grasp, model = NOWHERE, None
        if inspected is not None:
            grasp, model = Places(inspected.points, inspected.normals), inspected.model
        told = (grasp.points.tobytes(), grasp.normals.tobytes())
        opened = model and (model.friction_angle, model.tilt)
        before, self._shown = self._shown, (still, told, opened)
        if still != before[0]:
            self._show_fixed(_standing(subject, fixed), size)
        if (still, told) != before[:2]:
            self._show_grasp(grasp, fixed, size)
        if (still, told, opened) != before:
            self._show_cones(grasp if len(grasp.points) > 1 else NOWHERE, model, size)

    def hide(self) -> None:
        """Mark nothing."""
        self._shown = (None,) * 3
        for part in vars(self).values():
            if isinstance(part, _Part):
                part.show([])

    def _show_grasp(self, grasp: Places, fixed: Floats, size: float) -> None:
        gaps = np.linalg.norm(grasp.points[:, None] - fixed[None], axis=2)
        free = Places(
            *(one[(gaps > SAME * size).all(axis=1)] for one in (grasp.points, grasp.normals))
        )
        several = len(grasp.points) > 1

        def made(grown: float) -> Solid:
            parts = [balls(free.points, (BALL + grown) * size)]
            if several:
                parts.append(rods(*_joined(grasp.points), (ROD + grown) * size))
            return merged(*parts)

        arrows = [_arrows(free, size, grown) for grown in (0.0, RIM * size)] if several else []
        plain, grown = made(0.0), made(RIM)
        self._hidden.show(plain)
        self._hidden_rims.show(grown)
        self._cores.show(merged(plain, *arrows[:1]))
        self._rims.show(merged(grown, *arrows[1:]))

    def _show_fixed(self, fixed: Places, size: float) -> None:
        plain = merged(balls(fixed.points, 1.15 * BALL * size), _arrows(fixed, size, 0.0))
        self._fixed.show(plain)
        self._hidden_fixed.show(plain)
        rim = RIM * size
        grown = merged(balls(fixed.points, 1.15 * BALL * size + rim), _arrows(fixed, size, rim))
        self._fixed_rims.show(grown)

    def _show_cones(self, grasp: Places, model: GraspModel | None, size: float) -> None:
        """Cones outside the surface: from where a finger may push."""
        beta, tilt = (model.friction_angle, model.tilt) if model else (0.0, 0.0)
        away, length = -grasp.normals, SLANT * size
        self._cones.show(tips(grasp.points, away, beta, length))
        nominal = closed(rims(grasp.points, away, beta, length))
        sure: list[Floats] = []
        self._sure_cones.show([])
        if beta > tilt:
            self._sure_cones.show(tips(grasp.points, away, beta - tilt, length))
            sure = closed(rims(grasp.points, away, beta - tilt, length))
        thin = _extremes(grasp, beta, tilt, length) if tilt > 0.0 else []
        self._grey_lines.show(nominal)
        self._blue_lines.show(sure)
        self._thin_lines.show(thin)
        self._halo.show([*nominal, *sure])


class _Part:
    """What of the marks has one look."""

    def __init__(
        self,
        renderer: pyvista.Renderer,
        color: str,
        *,
        opacity: float = 1.0,
        rim: bool = False,
        nearer: float = 0.0,
        width: float = 0.0,
    ) -> None:
        """Make it, with nothing to show.

        Args:
            renderer: Where it is drawn.
            color: As PyVista takes it.
            opacity: From 0 to 1.
            rim: Only its far side is drawn, about what it holds.
            nearer: Depth by which it is drawn nearer than it is.
            width: Of lines [pixels at 72 per inch].
        """
        self._mapper = pyvista.DataSetMapper()
        self._actor = pyvista.Actor(mapper=self._mapper)
        self._renderer, self._width = renderer, width
        look = self._actor.prop
        look.color, look.opacity, look.lighting = color, opacity, False
        look.culling = "front" if rim else "none"
        if nearer:
            vtkMapper.SetResolveCoincidentTopologyToPolygonOffset()
            self._mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, nearer)
        if not width:
            self._actor.ForceTranslucentOn()  # drawn in the order in which they are made
        self._actor.PickableOff()
        self._actor.VisibilityOff()
        renderer.AddActor(self._actor)

    def show(self, what: Solid | list[Floats]) -> None:
        """Draw triangles, or along paths of shape (k, 3) each; nothing where there are none."""
        some = bool(what) if isinstance(what, list) else len(what.points) > 0
        if some:
            self._mapper.SetInputData(lines(what) if isinstance(what, list) else what.data())
        if self._width:
            self._actor.prop.line_width = self._width * dots(self._renderer)
        self._actor.visibility = some


def _joined(points: Floats) -> tuple[Floats, Floats]:
    """Ends of the lines between contacts; all pairs of three, neighbours of more."""
    count = len(points)
    pairs = list(combinations(range(count), 2))
    if count > 3:
        pairs = [(one, (one + 1) % count) for one in range(count)]
    first, second = np.array(pairs).T
    return points[first], points[second]


def _arrows(places: Places, size: float, grown: float) -> Solid:
    """Arrows that end at contacts, from outside along the normals."""
    tails = places.points - ARROW * size * places.normals
    ends = places.points - (BALL * size - grown) * places.normals
    necks = ends - (HEAD * size + 2.0 * grown) * places.normals
    return merged(
        rods(tails, necks, SHAFT * size + grown),
        spikes(necks, ends, HEAD_RADIUS * size + grown),
    )


def _extremes(grasp: Places, beta: float, tilt: float, length: float) -> list[Floats]:
    """Outlines of the cones about the two extreme normals in the plane of the fingers' line."""
    others = grasp.points.sum(axis=0) - grasp.points
    toward = others / (len(grasp.points) - 1) - grasp.points
    along = (toward * grasp.normals).sum(axis=1, keepdims=True) * grasp.normals
    side = unit_rows(toward - along)
    straight = np.linalg.norm(toward - along, axis=1) < 1e-6 * np.linalg.norm(toward, axis=1)
    side[straight] = tangents(grasp.normals[straight])[0]
    paths: list[Floats] = []
    for turn in (-tilt, tilt):
        axes = -np.cos(turn) * grasp.normals + np.sin(turn) * side
        across = np.sin(turn) * grasp.normals + np.cos(turn) * side
        paths += closed(rims(grasp.points, axes, beta, length))
        ends = [
            grasp.points + length * (np.cos(beta) * axes + sign * np.sin(beta) * across)
            for sign in (-1.0, 1.0)
        ]
        paths += list(np.stack([ends[0], grasp.points, ends[1]], axis=1))
    return paths


def _standing(subject: Subject, fixed: Floats) -> Places:
    """Fixed fingers with the normals of the vertices nearest to them."""
    nearest = [int(np.argmin(((subject.vertices - place) ** 2).sum(axis=1))) for place in fixed]
    return Places(fixed, subject.normals[np.array(nearest, dtype=int)])
