"""Numbers beside the contacts of a grasp, which identify the fingers."""

from collections.abc import Sequence

import numpy as np
import pyvista

from grasp3d.arrays import Floats
from grasp3d.viewer.scene.layout import INK, OverlayItem, Rectangle, TextArea, TextLine
from grasp3d.viewer.scene.text_layout import text_width

DISTANCE = 1.15
"""Distance of a number's centre from the contact marker, relative to the text size."""

BACKGROUND = "#FFFFFF"

Box = tuple[float, float, float, float]
"""Left, bottom, right, top [pixels]."""


def display_positions(renderer: pyvista.Renderer, points: Floats) -> Floats:
    """Positions of points (n, 3) in a renderer's part of the window, shape (n, 2) [pixels]."""
    left, bottom = renderer.GetOrigin()
    positions = []
    for point in points:
        renderer.SetWorldPoint(*point, 1.0)
        renderer.WorldToDisplay()
        x, y, _ = renderer.GetDisplayPoint()
        positions.append((x - left, y - bottom))
    return np.array(positions).reshape(-1, 2)


def contact_numbers(
    area: TextArea, contacts: Floats, tips: Floats, radius: float
) -> list[OverlayItem]:
    """Number contacts from 1, each beside its contact where nothing of the grasp is drawn.

    Args:
        area: Size of the pane.
        contacts: Displayed positions of the contacts, shape (n, 2) [pixels].
        tips: Displayed positions of points further along their normals, (n, 2).
        radius: Radius of the contact markers [pixels].
    """
    items: list[OverlayItem] = []
    taken: list[Box] = []
    for number, (contact, tip) in enumerate(zip(contacts, tips, strict=True), start=1):
        box = _box(area, f"{number}", contact, tip - contact, radius, taken)
        taken.append(box)
        items += _badge(area, f"{number}", box)
    return items


def _box(
    area: TextArea, text: str, contact: Floats, normal: Floats, radius: float, taken: Sequence[Box]
) -> Box:
    """Box of a number: beside the normal if there is space, else on another side."""
    length = float(np.linalg.norm(normal))
    ahead = normal / length if length > 0.5 * radius else np.array([1.0, 0.0])
    side = np.array([-ahead[1], ahead[0]])
    side = side if side[1] >= 0.0 else -side
    height = 1.35 * area.size
    width = max(height, text_width(text, area.size, bold=True) + 0.7 * area.size)
    distance = radius + DISTANCE * area.size
    boxes = []
    for offset in (side, -side, side + ahead, side - ahead, ahead - side, -side - ahead):
        x, y = contact + distance * offset
        boxes.append((x - 0.5 * width, y - 0.5 * height, x + 0.5 * width, y + 0.5 * height))
    return next((box for box in boxes if _free(area, box, taken)), boxes[0])


def _free(area: TextArea, box: Box, taken: Sequence[Box]) -> bool:
    left, bottom, right, top = box
    if left < 0.0 or bottom < 0.0 or right > area.width or top > area.height:
        return False
    return all(right < one[0] or one[2] < left or top < one[1] or one[3] < bottom for one in taken)


def _badge(area: TextArea, text: str, box: Box) -> list[OverlayItem]:
    """A number on a white background with a dark border, readable on every colour."""
    left, bottom, right, top = (round(side) for side in box)
    edge = max(1, round(area.size / 12.0))
    width, height = right - left, top - bottom
    x = 0.5 * (left + right - text_width(text, area.size, bold=True))
    y = bottom + 0.08 * area.size
    return [
        Rectangle(left - edge, bottom - edge, width + 2 * edge, height + 2 * edge, INK),
        Rectangle(left, bottom, width, height, BACKGROUND),
        TextLine(text, x, y, area.size, bold=True),
    ]
