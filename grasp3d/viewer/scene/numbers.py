"""Numbers beside the contacts of a grasp, so that "the second finger" can be found."""

from collections.abc import Sequence

import numpy as np
import pyvista

from grasp3d.arrays import Floats
from grasp3d.viewer.scene.layout import INK, Item, Paper, Patch, Words
from grasp3d.viewer.scene.lettering import width_of

AWAY = 1.15
"""From a contact to the middle of its number, in letters."""

PAPER = "#FFFFFF"

Box = tuple[float, float, float, float]


def seen_at(renderer: pyvista.Renderer, points: Floats) -> Floats:
    """Where points (n, 3) are seen in a renderer's part of the window, shape (n, 2) [pixels]."""
    left, bottom = renderer.GetOrigin()
    places = []
    for point in points:
        renderer.SetWorldPoint(*point, 1.0)
        renderer.WorldToDisplay()
        x, y, _ = renderer.GetDisplayPoint()
        places.append((x - left, y - bottom))
    return np.array(places).reshape(-1, 2)


def numbers(paper: Paper, places: Floats, tips: Floats, radius: float) -> list[Item]:
    """Number contacts from 1, each on the side of it where nothing of the grasp is drawn.

    Args:
        paper: The pane.
        places: Where the contacts are seen, shape (n, 2) [pixels].
        tips: Where points further along their normals are seen, (n, 2).
        radius: Of the balls that mark them [pixels].
    """
    items: list[Item] = []
    taken: list[Box] = []
    for number, (place, tip) in enumerate(zip(places, tips, strict=True), start=1):
        box = _box(paper, f"{number}", place, tip - place, radius, taken)
        taken.append(box)
        items += _chip(paper, f"{number}", box)
    return items


def _box(
    paper: Paper, text: str, place: Floats, along: Floats, radius: float, taken: Sequence[Box]
) -> Box:
    """Where a number stands: across the normal if there is room, else on another side."""
    length = float(np.linalg.norm(along))
    way = along / length if length > 0.5 * radius else np.array([1.0, 0.0])
    side = np.array([-way[1], way[0]])
    side = side if side[1] >= 0.0 else -side
    high = 1.35 * paper.size
    wide = max(high, width_of(text, paper.size, bold=True) + 0.7 * paper.size)
    reach = radius + AWAY * paper.size
    boxes = []
    for turn in (side, -side, side + way, side - way, way - side, -side - way):
        x, y = place + reach * turn
        boxes.append((x - 0.5 * wide, y - 0.5 * high, x + 0.5 * wide, y + 0.5 * high))
    return next((box for box in boxes if _free(paper, box, taken)), boxes[0])


def _free(paper: Paper, box: Box, taken: Sequence[Box]) -> bool:
    left, bottom, right, top = box
    if left < 0.0 or bottom < 0.0 or right > paper.width or top > paper.height:
        return False
    return all(right < one[0] or one[2] < left or top < one[1] or one[3] < bottom for one in taken)


def _chip(paper: Paper, text: str, box: Box) -> list[Item]:
    """A number on white paper with a dark edge, to be read on every colour."""
    left, bottom, right, top = (round(side) for side in box)
    edge = max(1, round(paper.size / 12.0))
    wide = width_of(text, paper.size, bold=True)
    return [
        Patch(left - edge, bottom - edge, right - left + 2 * edge, top - bottom + 2 * edge, INK),
        Patch(left, bottom, right - left, top - bottom, PAPER),
        Words(text, 0.5 * (left + right - wide), bottom + 0.08 * paper.size, paper.size, bold=True),
    ]
