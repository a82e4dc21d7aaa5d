"""Drawings of hands: grippers with dimensions or frames, hands with joints as they close."""

import math
from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox

from grasp3d.arrays import Floats, unit_rows
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.frames import FRAMES
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.triangles import COLORS, Part, Triangles
from grasp3d.pictures.figures import PAGE, bare, draw_arrow, new_figure, styled
from grasp3d.system.names import printable

LINE, FAINT = "#222222", "#777777"
AXIS_COLORS = {"x": "#D55E00", "y": "#009E73", "z": "#0072B2", "approach": "#CC79A7"}

FRONT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""A view: axes to the right, up and toward the viewer in the hand's frame. Here z is down, since
grippers are mostly seen from above."""
SIDE = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
OBLIQUE = np.array([[1.0, -0.55, 0.0], [0.0, -0.4, -1.0]])
"""Oblique projection of frames' axes to right and up, on a gripper seen from the front."""

ORIGIN = np.zeros(3)

LIGHT = np.array([0.3, 0.5, 0.8])
"""Direction of the light in the axes of the view."""
DARKEST = 0.45
"""Brightness of faces in the shade."""

DOUBLE_ARROW: dict[str, Any] = {
    "arrowstyle": "<|-|>", "color": LINE, "shrinkA": 0.0, "shrinkB": 0.0, "linewidth": 0.6,
    "mutation_scale": 6.0,
}  # fmt: skip

STEP = 0.08
"""Distance of dimension lines from the measured part, and between lines, in gripper heights."""
FRAME_LENGTH = 0.38
"""Length of a frame's axes, in gripper heights."""
AXES_LENGTH = 0.2
"""Length of the axes of a hand with joints, relative to the hand's size."""
COLUMNS = 4
"""Number of drawings of frames in a row."""
NAMES_HEIGHT = 0.45
"""Height of the names above a row of drawings [inch]."""


@styled
def hand_figure(hand: ArticulatedHand) -> Figure:
    """Draw a hand: open from the object's side and from the side, and half closed from the side.

    Fingertips are dark. x, y and z are the axes of the hand's frame. The arrow from the palm is the
    approach direction.

    Args:
        hand: The hand.
    """
    opened = hand.preshapes["open"]
    low, high = np.clip(hand.limits_of_joints, -np.pi, np.pi).T
    closed = np.where(hand.closing > 0.0, high, np.where(hand.closing < 0.0, low, opened))
    front, side = _views(hand)
    views = {
        "open, from the object's side": (opened, front),
        "open, from beside": (opened, side),
        "half closed, from beside": (0.5 * (opened + closed), side),
    }
    figure, plots = _sheet(hand.name, list(views), len(views))
    for axes, (posture, view) in zip(plots, views.values(), strict=True):
        shape = hand.shape(0.0, posture)
        across = shape.vertices @ view[0]
        middle = 0.5 * (across.min() + across.max()) * view[0]
        _draw_shape(axes, shape, view, middle=middle)
        palm = hand.link_poses(posture)[0, hand.link_names.index(hand.palm), :3, 3]
        length = AXES_LENGTH * hand.size
        ways = dict(zip("xyz", length * np.eye(3), strict=True))
        for name, way in {**ways, "approach": 2.0 * length * hand.approach}.items():
            if np.linalg.norm(view[:2] @ way) > 0.2 * length:  # neither toward the viewer nor away
                start = palm if name == "approach" else ORIGIN
                _draw_axis(axes, name, view @ (start - middle), view @ (start + way - middle))
    return _fitted(figure, plots, len(plots))


def _views(hand: ArticulatedHand) -> tuple[Floats, Floats]:
    """Return the views from the object's side and from the side of the hand.

    The direction up is the axis of the hand's frame across the approach direction, positive or
    negative, that is closest to the direction of the fingers.
    """
    (poses,) = hand.link_poses(hand.preshapes["open"])
    places = {name: pose[:3, 3] for name, pose in zip(hand.link_names, poses, strict=True)}
    fingers = np.mean([places[tip] for tip in hand.fingertips], axis=0) - places[hand.palm]
    across = np.eye(3) - np.outer(hand.approach, hand.approach)
    best = np.abs(across @ fingers).argmax()
    up = unit_rows(across[best]) * (1.0 if across[best] @ fingers >= 0.0 else -1.0)
    front = np.stack([np.cross(up, hand.approach), up, hand.approach])
    return front, np.stack([hand.approach, up, np.cross(hand.approach, up)])


@styled
def gripper_figure(gripper: ParallelGripper) -> Figure:
    """Draw a gripper from the front and from the side, open, with dimensions in millimetres.

    Dashed lines show the fingers at the smallest opening. The frame is at the tool centre point.

    Args:
        gripper: The gripper.

    Example:
        >>> from grasp3d.hand.parallel_gripper import ParallelGripper
        >>> from grasp3d.pictures.hands import gripper_figure
        >>> figure = gripper_figure(ParallelGripper.preset("franka"))
        >>> [axes.get_title() for axes in figure.axes]
        ['front', 'side']
    """
    title = f"{gripper.name}: lengths in mm, dot: tool centre point"
    figure, plots = _sheet(title, ["front", "side"], 2)
    front, side = plots
    shape, opening = gripper.shape(gripper.max_opening), gripper.max_opening
    corners = shape.vertices[shape.faces]
    half = (shape.parts == Part.PALM) | (corners[..., 0].mean(axis=1) > 0.0)  # with finger 2 only
    palm, finger, tip = (
        np.stack([points.min(axis=0), points.max(axis=0)])
        for points in (
            corners[half & (shape.parts == part)].reshape(-1, 3)
            for part in (Part.PALM, Part.FINGER, Part.TIP if gripper.round_tips else Part.PAD)
        )
    )
    finger[0, 0] = (finger if gripper.round_tips else tip)[0, 0]
    step = STEP * np.ptp([palm[0, 2], finger[1, 2]])
    for axes, view, shown, names in ((front, FRONT, half | True, "xz"), (side, SIDE, half, "yz")):
        _draw_shape(axes, shape, view, shown)
        for name in names:
            _draw_axis(axes, name, ORIGIN, 2.2 * step * view[:2, "xyz".index(name)])
    closed = finger[:, 0] - 0.5 * (opening - gripper.min_opening)
    for ends in (closed, -closed):
        front.plot(ends[[0, 0, 1, 1]], -finger[[0, 1, 1, 0], 2], "--", color=FAINT, linewidth=0.6)
    above, below = palm[0, 2] - step, max(finger[1, 2], tip[1, 2], 2.2 * step) + step
    beside = max(palm[1, 0], finger[1, 0]) + step
    _measure(front, palm[:, 0], palm[0, 2], above)
    _measure(front, tip[0, 0] * np.array([-1.0, 1.0]), 0.0, below, "opening up to ")
    _measure(front, finger[:, 0], finger[1, 2], below + 1.5 * step)
    _measure(front, palm[:, 2], palm[1, 0], beside, upright=True)
    _measure(front, finger[:, 2], finger[1, 0], beside, upright=True)
    if base := gripper.base_to_tcp:
        _measure(front, np.array([-base, 0.0]), 0.0, -beside, "base to TCP\n", upright=True)
        front.plot(0.0, base, "+", color=LINE, zorder=9)
    _measure(side, palm[:, 1], palm[0, 2], above)
    _measure(side, tip[:, 1], tip[1, 2], below, "tip " if gripper.round_tips else "pad ")
    _measure(side, finger[:, 1], finger[1, 2], below + 1.5 * step)
    if not gripper.round_tips:
        beside = max(palm[1, 1], finger[1, 1]) + step
        _measure(side, tip[:, 2], tip[1, 1], beside, "pad ", upright=True)
    return _fitted(figure, plots, 2)


def _measure(
    axes: Axes, ends: Floats, of: float, at: float, text: str = "", *, upright: bool = False
) -> None:
    """Draw a dimension line at `at` with the distance between two ends of a part at `of`.

    Args:
        axes: Axes to draw on.
        ends: Ends in the horizontal direction, or along z if `upright`, shape (2,).
        of: Position of the part in the other direction.
        at: Position of the line in that direction.
        text: Text before the length in millimetres.
        upright: Whether the line is along z.
    """
    low, high = ends.tolist()
    points = np.array([(low, of), (low, at), (high, at), (high, of)])
    points = (points[:, ::-1] if upright else points) * [1.0, -1.0]  # z is down
    axes.plot(*points.T, color=FAINT, linewidth=0.4, zorder=0.5)
    _, one, two, _ = points.tolist()
    axes.annotate("", one, two, arrowprops=DOUBLE_ARROW)
    outward = 1.0 if at > of else -1.0
    place: Any = {"ha": "left" if at > of else "right", "va": "center", "xytext": (3 * outward, 0)}
    if not upright:
        place = {"ha": "center", "va": "top" if at > of else "bottom", "xytext": (0, -3 * outward)}
    axes.annotate(
        f"{text}{1e3 * (high - low):.4g}", points[1:3].mean(axis=0), fontsize=6.5,
        bbox={"facecolor": "white", "linewidth": 0.0, "pad": 0.3}, textcoords="offset points",
        **place,
    )  # fmt: skip


@styled
def frames_figure(gripper: ParallelGripper) -> Figure:
    r"""Draw the frames of all known programs on a gripper, seen from the front, z down.

    Frames that coincide for this gripper are drawn once.

    Args:
        gripper: The gripper.

    Example:
        >>> from grasp3d.hand.parallel_gripper import ParallelGripper
        >>> from grasp3d.pictures.hands import frames_figure
        >>> [axes.get_title() for axes in frames_figure(ParallelGripper.preset("franka")).axes][:2]
        ['tcp', 'hand, isaac, moveit,\npanda_hand']
    """
    frames: dict[tuple[float, ...], list[str]] = {}
    for name, frame in FRAMES.items():
        pose = np.linalg.inv(frame.to_tcp(gripper))
        frames.setdefault(tuple(np.round(pose, 9).ravel()), []).append(name)
    names = [fill(", ".join(same), 26) for same in frames.values()]
    title = f"{gripper.name}: frames by name, dot: tool centre point"
    figure, plots = _sheet(title, names, COLUMNS)
    shape = gripper.shape(gripper.max_opening)
    length = FRAME_LENGTH * np.ptp(shape.vertices[:, 2])
    for axes, numbers in zip(plots, frames, strict=True):
        _draw_shape(axes, shape, FRONT)
        pose = np.reshape(numbers, (4, 4))
        start = OBLIQUE @ pose[:3, 3]
        for number, name in enumerate("xyz"):
            _draw_axis(axes, name, start, start + length * OBLIQUE @ pose[:3, number])
    return _fitted(figure, plots, COLUMNS)


def _sheet(title: str, names: Sequence[str], columns: int) -> tuple[Figure, list[Axes]]:
    """Return a figure of drawings to one scale, `columns` in a row, with names above them."""
    figure = new_figure()
    rows = math.ceil(len(names) / columns)
    plots = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel().tolist()
    for axes in plots[len(names) :]:
        axes.remove()
    for axes, name in zip(plots, names, strict=False):
        bare(axes)
        axes.set_title(name, fontsize=7.5)
    figure.suptitle(printable(title), fontsize=9.0, parse_math=False)
    return figure, plots[: len(names)]


def _fitted(figure: Figure, plots: Sequence[Axes], columns: int) -> Figure:
    """Set the height of the figure to fit its drawings at the width of a page."""
    box = Bbox.union([axes.dataLim for axes in plots])
    height = PAGE / columns * box.height / box.width + NAMES_HEIGHT
    figure.set_size_inches(PAGE, math.ceil(len(plots) / columns) * height + 0.2)
    return figure


def _draw_shape(
    axes: Axes, shape: Triangles, view: Floats, shown: Any = slice(None), middle: Floats = ORIGIN
) -> None:
    """Draw the triangles of a hand from back to front, and the origin of its frame.

    Args:
        axes: Axes to draw on.
        shape: The hand.
        view: Axes to the right, up and toward the viewer, shape (3, 3).
        shown: Mask of the triangles to draw.
        middle: Point of the hand's frame to draw at 0, 0.
    """
    triangles = (shape.vertices[shape.faces[shown]] - middle) @ view.T
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    light = np.clip(unit_rows(normals) @ unit_rows(LIGHT), 0.0, 1.0)
    seen = np.flatnonzero(normals[:, 2] > 0.0)
    order = seen[np.argsort(triangles[seen, :, 2].mean(axis=1))]
    colors = np.array([COLORS[Part(part)] for part in shape.parts[shown]]) / 255.0
    shaded = (colors * (DARKEST + (1.0 - DARKEST) * light)[:, None])[order]
    faces = list(triangles[order, :, :2])
    axes.add_collection(PolyCollection(faces, facecolors=shaded, edgecolors=shaded, linewidths=0.2))
    axes.plot(*(view @ -middle)[:2], "o", color=LINE, markersize=3.0, zorder=9)


def _draw_axis(axes: Axes, name: str, start: Floats, end: Floats) -> None:
    """Draw an axis as an arrow between two points, of which the first two coordinates count."""
    halo = [withStroke(linewidth=2.0, foreground="white")]
    draw_arrow(axes, start[:2], end[:2], AXIS_COLORS[name], name, weight="bold", path_effects=halo)
