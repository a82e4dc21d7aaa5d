"""A hand with joints from the object's side and from beside, open and half closed."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from grasp3d.arrays import Floats, unit_rows
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.triangles import COLORS, Part
from grasp3d.pictures.figures import PAGE, bare, new_figure, styled
from grasp3d.pictures.grippers import AXIS_COLORS, draw_axis, draw_origin
from grasp3d.system.names import printable

LIGHT = np.array([0.3, 0.5, 0.8])
"""Direction of the light, in coordinates of the view: right, up, toward the viewer."""

NARROWEST = 0.7
"""Width of a view, relative to the widest one."""

DARKEST = 0.45
"""Brightness of faces in the shade."""

ARROW = 0.2
"""Length of axes, in sizes of the hand."""

APPROACH = "#CC79A7"


@styled
def hand_figure(hand: ArticulatedHand) -> Figure:
    """Draw a hand: open from the object's side and from beside, and half closed from beside.

    Fingertips are dark. x, y and z are the axes of the hand's frame, the arrow from the palm is the
    approach direction.

    Args:
        hand: The hand.
    """
    opened = hand.preshapes["open"]
    low, high = np.clip(hand.limits_of_joints, -np.pi, np.pi).T
    closed = np.where(hand.closing > 0.0, high, np.where(hand.closing < 0.0, low, opened))
    half = opened + 0.5 * (closed - opened)
    front, side = _axes(hand)
    views = [("open, from the object's side", opened, front), ("open, from beside", opened, side)]
    views.append(("half closed, from beside", half, side))
    drawings = [_Drawing(hand, posture, axes) for _, posture, axes in views]
    boxes = [drawing.box() for drawing in drawings]
    widths = [float(box[1, 0] - box[0, 0]) for box in boxes]
    widths = [max(width, NARROWEST * max(widths)) for width in widths]  # titles need space
    tall = max(float(box[1, 1] - box[0, 1]) for box in boxes)
    figure = new_figure(PAGE, PAGE * tall / sum(widths) + 0.6)
    plots = figure.subplots(1, 3, width_ratios=widths)
    for number, plot in enumerate(plots):
        (title, _, _), drawing, width = views[number], drawings[number], widths[number]
        bare(plot)
        plot.set_title(title)
        drawing.draw(plot)
        x, y = boxes[number].mean(axis=0)
        plot.set_xlim(x - 0.5 * width, x + 0.5 * width)
        plot.set_ylim(y - 0.5 * tall, y + 0.5 * tall)
    figure.suptitle(printable(hand.name), fontsize=9.0, parse_math=False)
    return figure


def _axes(hand: ArticulatedHand) -> tuple[Floats, Floats]:
    """Right, up and toward the viewer in the hand's frame, for both directions of view, (3, 3).

    Up is that axis of the hand's frame across the approach direction that fingers point along most,
    or along the negative axis.
    """
    (poses,) = hand.link_poses(hand.preshapes["open"])
    places = {name: pose[:3, 3] for name, pose in zip(hand.link_names, poses, strict=True)}
    fingers = np.mean([places[tip] for tip in hand.fingertips], axis=0) - places[hand.palm]
    across = np.eye(3) - np.outer(hand.approach, hand.approach)
    best = np.abs(across @ fingers).argmax()
    up = unit_rows(across[best]) * (1.0 if across[best] @ fingers >= 0.0 else -1.0)
    front = np.stack([np.cross(up, hand.approach), up, hand.approach])
    side = np.stack([hand.approach, up, np.cross(hand.approach, up)])
    return front, side


class _Drawing:
    """A hand at a posture, in coordinates of a view: right, up, toward the viewer."""

    def __init__(self, hand: ArticulatedHand, posture: Floats, axes: Floats) -> None:
        shape = hand.shape(0.0, posture)
        self.triangles = shape.vertices[shape.faces] @ axes.T
        self.parts = shape.parts
        self.length = ARROW * hand.size
        palm = hand.link_poses(posture)[0, hand.link_names.index(hand.palm), :3, 3]
        self.arrows = [
            (np.zeros(3), axes[:, number], self.length, AXIS_COLORS[name], name)
            for number, name in enumerate("xyz")
        ]
        toward = axes @ hand.approach
        self.arrows.append((axes @ palm, toward, 2.0 * self.length, APPROACH, "approach"))

    def box(self) -> Floats:
        """Ends of the box around all that is drawn, shape (2, 2)."""
        ends = [start + 1.3 * length * way for start, way, length, _, _ in self.arrows]
        points = np.concatenate([self.triangles.reshape(-1, 3), *np.array(ends)[None]])[:, :2]
        space = 0.4 * self.length
        return np.stack([points.min(axis=0) - space, points.max(axis=0) + space])

    def draw(self, plot: Axes) -> None:
        """Draw faces from the back to the front, and arrows over them."""
        triangles = self.triangles
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        light = np.clip(unit_rows(normals) @ unit_rows(LIGHT), 0.0, 1.0)
        seen = np.flatnonzero(normals[:, 2] > 0.0)
        order = seen[np.argsort(triangles[seen, :, 2].mean(axis=1))]
        colors = np.array([COLORS[Part(part)] for part in self.parts]) / 255.0
        shaded = (colors * (DARKEST + (1.0 - DARKEST) * light)[:, None])[order]
        corners = list(triangles[order, :, :2])
        faces = PolyCollection(corners, facecolors=shaded, edgecolors=shaded, linewidths=0.2)
        plot.add_collection(faces)
        for start, way, length, color, name in self.arrows:
            if np.linalg.norm(way[:2]) < 0.2:  # toward the viewer, or away
                continue
            beside = "left" if way[0] > 0.7 else "right" if way[0] < -0.7 else "center"
            end = start + length * way
            draw_axis(plot, start[:2], end[:2], name, color, at=1.07, beside=beside)
        draw_origin(plot)
