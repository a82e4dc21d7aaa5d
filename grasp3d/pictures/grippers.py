"""A gripper in two orthographic views: its boxes with dimensions, and the frames of programs."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, Rectangle
from matplotlib.patheffects import withStroke

from grasp3d.arrays import Floats
from grasp3d.hand.frames import FRAMES
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.triangles import COLORS, PAD_DEPTH, Part
from grasp3d.pictures.figures import PAGE, bare, new_figure, styled
from grasp3d.system.names import printable

LINE, FAINT = "#222222", "#777777"
AXIS_COLORS = {"x": "#D55E00", "y": "#009E73", "z": "#0072B2"}
GAP = 0.08
"""Distance of dimension lines from what they measure, and between them, as a fraction of the
height of the views."""

AXIS_LENGTH = 1.6
"""Length of the frame's axes, in distances between dimension lines."""

TEXT: dict[str, Any] = {
    "fontsize": 6.5,
    "bbox": {"facecolor": "white", "edgecolor": "none", "pad": 0.3},
}
"""Style of dimensions, which cover the lines behind them."""

TITLES = 0.6
"""Height of the titles [inch]."""

FILL = {part: "#{:02X}{:02X}{:02X}".format(*color) for part, color in COLORS.items()}


Point = tuple[float, float]


@dataclass(frozen=True)
class _Drawing:
    """One view; lengths in millimetres, z downward, since grippers are mostly seen from above."""

    axes: Axes
    gripper: ParallelGripper
    step: float
    """Distance between dimension lines."""

    def box(self, part: Part, left: float, right: float, low: float, high: float) -> None:
        """Fill a rectangle."""
        patch = Rectangle((left, low), right - left, high - low)
        self._add(patch, facecolor=FILL[part], edgecolor=LINE, zorder=2 + part)

    def outline(self, left: float, right: float, low: float, high: float) -> None:
        """Draw the dashed edges of a rectangle."""
        patch = Rectangle((left, low), right - left, high - low, fill=False)
        self._add(patch, edgecolor=FAINT, linestyle="--", zorder=1)

    def ball(self, x: float, radius: float) -> None:
        """Fill a round tip."""
        self._add(Circle((x, 0.0), radius), facecolor=FILL[Part.TIP], edgecolor=LINE, zorder=5)

    def _add(self, patch: Patch, **look: Any) -> None:
        patch.set(linewidth=0.6, **look)
        self.axes.add_patch(patch)

    def across(self, left: float, right: float, z: float, text: str, *, at: float) -> None:
        """Dimension line along the horizontal axis at the height `at`, of something at z."""
        self._measure([(left, z), (right, z)], [(left, at), (right, at)])
        below = at > z
        position = 0.5 * (left + right), at + (0.25 if below else -0.25) * self.step
        self.axes.text(*position, text, ha="center", va="top" if below else "bottom", **TEXT)

    def along(self, low: float, high: float, x: float, text: str, *, at: float) -> None:
        """Dimension line along z at the horizontal position `at`, of something at x."""
        self._measure([(x, low), (x, high)], [(at, low), (at, high)])
        right = at > x
        position = at + (0.25 if right else -0.25) * self.step, 0.5 * (low + high)
        self.axes.text(*position, text, ha="left" if right else "right", va="center", **TEXT)

    def _measure(self, points: list[Point], ends: list[Point]) -> None:
        """An arrow between two ends, and lines from them to the points that it measures."""
        for point, end in zip(points, ends, strict=True):
            self.axes.plot(*zip(point, end, strict=True), color=FAINT, linewidth=0.4, zorder=1)
        style = {"arrowstyle": "<|-|>", "color": LINE, "linewidth": 0.6, "shrinkA": 0.0,
                 "shrinkB": 0.0, "mutation_scale": 5.0}  # fmt: skip
        self.axes.annotate("", ends[1], ends[0], arrowprops=style, zorder=6)

    def frame(self, horizontal: str) -> None:
        """Draw the axes of the gripper's frame at the TCP."""
        length = AXIS_LENGTH * self.step
        for name, end in ((horizontal, (length, 0.0)), ("z", (0.0, length))):
            draw_axis(self.axes, np.zeros(2), np.array(end), name, AXIS_COLORS[name])
        draw_origin(self.axes)


def draw_axis(
    axes: Axes, start: Floats, end: Floats, name: str, color: str, *, at: float = 1.2,
    beside: str = "center",
) -> None:  # fmt: skip
    """Draw an arrow between two points (2,) of a drawing, and its name near its end.

    Args:
        axes: Axes to draw on.
        start: Tail of the arrow.
        end: Its tip.
        name: Its name.
        color: Its colour.
        at: Place of the name, in lengths of the arrow from its tail.
        beside: Side of the name that is there.
    """
    arrow = {"arrowstyle": "-|>", "color": color, "linewidth": 1.4, "shrinkA": 0.0,
             "shrinkB": 0.0, "mutation_scale": 8.0}  # fmt: skip
    axes.annotate("", tuple(end), tuple(start), arrowprops=arrow, zorder=8)
    x, y = start + at * (end - start)
    axes.text(
        x, y, name, color=color, ha=beside, va="center", zorder=9,
        fontsize=7.5, fontweight="bold",
        path_effects=[withStroke(linewidth=2.0, foreground="white")],
    )  # fmt: skip


def draw_origin(axes: Axes) -> None:
    """Draw the dot at the origin of a frame."""
    axes.plot(0.0, 0.0, "o", color=LINE, markersize=3.0, zorder=9)


@styled
def gripper_figure(gripper: ParallelGripper) -> Figure:
    """Draw a gripper from the front and from the side, open, with dimensions in millimetres.

    Dashed: the fingers at the smallest opening. The frame is at the tool centre point.

    Args:
        gripper: The gripper.

    Example:
        >>> from grasp3d.hand.parallel_gripper import ParallelGripper
        >>> from grasp3d.pictures.grippers import gripper_figure
        >>> figure = gripper_figure(ParallelGripper.preset("franka"))
        >>> [axes.get_title() for axes in figure.axes]
        ['front', 'side']
    """
    back, _, end = heights(gripper)
    step = GAP * (end - back)
    widths = [_span(gripper.palm_thickness, step), _span(gripper.palm_width, step)]
    height = _lowest(gripper, step) + 4.0 * step - (back - 2.5 * step)
    figure = new_figure(PAGE, PAGE * height / sum(widths) + TITLES)
    views = figure.subplots(1, 2, width_ratios=widths)
    drawings = [_Drawing(axes, gripper, step) for axes in views]
    _draw_front(drawings[0])
    _draw_side(drawings[1])
    for axes, title, width in zip(views, ("front", "side"), widths, strict=True):
        bare(axes)
        axes.set_title(title)
        axes.set_xlim(-0.5 * width, 0.5 * width)
        axes.set_ylim(back - 2.5 * step + height, back - 2.5 * step)  # z points down
    title = f"{printable(gripper.name)}: lengths in mm, dot: tool centre point"
    figure.suptitle(title, fontsize=9.0, parse_math=False)
    return figure


def _span(palm: float, step: float) -> float:
    """Width of a view that leaves space for dimension lines on both sides [mm]."""
    return 1e3 * palm + 10.0 * step


def _lowest(gripper: ParallelGripper, step: float) -> float:
    """Lowest point of the gripper and of the axis z that is drawn [mm]."""
    return max(1e3 * gripper.end, 1e3 * gripper.tip_radius, 1.4 * AXIS_LENGTH * step)


def heights(gripper: ParallelGripper) -> tuple[float, float, float]:
    """Positions along z of the palm's back and front and of the fingers' ends [mm]."""
    front = gripper.end - gripper.finger_length
    return 1e3 * (front - gripper.palm_length), 1e3 * front, 1e3 * gripper.end


def _draw_boxes(view: _Drawing) -> None:
    """Draw the gripper from the front, open."""
    back, front, end = heights(view.gripper)
    palm = 500.0 * view.gripper.palm_thickness
    view.box(Part.PALM, -palm, palm, back, front)
    for side in (-1.0, 1.0):
        _draw_finger(view, side, front, end)


def _draw_front(view: _Drawing) -> None:
    gripper, step = view.gripper, view.step
    back, front, end = heights(gripper)
    palm, opening = 500.0 * gripper.palm_thickness, 1e3 * gripper.max_opening
    _draw_boxes(view)
    lowest = _lowest(gripper, step) - 0.3 * step
    near, far = _finger_sides(gripper, opening)
    view.across(
        -0.5 * opening, 0.5 * opening, 0.0, f"opening up to {opening:.4g}", at=lowest + step
    )
    view.across(near, far, end, _mm(gripper.finger_thickness), at=lowest + 2.5 * step)
    view.across(-palm, palm, back, _mm(gripper.palm_thickness), at=back - step)
    right = max(palm, far) + step
    view.along(front, end, far, _mm(gripper.finger_length), at=right)
    view.along(back, front, palm, _mm(gripper.palm_length), at=right)
    if gripper.base_to_tcp:
        base = -1e3 * gripper.base_to_tcp
        view.along(base, 0.0, 0.0, f"base to TCP\n{-base:.4g}", at=-right)
        view.axes.plot(0.0, base, "+", color="white" if back < base < front else LINE, zorder=9)
    view.frame("x")


def _finger_sides(gripper: ParallelGripper, opening: float) -> tuple[float, float]:
    """Inner and outer side of the box of finger 2 [mm]."""
    thickness = 1e3 * gripper.finger_thickness
    inner = 0.5 * opening
    if gripper.round_tips:
        inner += 1e3 * gripper.tip_radius - 0.5 * thickness
    return inner, inner + thickness


def _draw_finger(view: _Drawing, side: float, front: float, end: float) -> None:
    gripper = view.gripper
    near, far = _finger_sides(gripper, 1e3 * gripper.max_opening)
    view.box(Part.FINGER, *_ordered(side * near, side * far), front, end)
    view.outline(
        *_ordered(*(side * x for x in _finger_sides(gripper, 1e3 * gripper.min_opening))),
        front,
        end,
    )
    if gripper.round_tips:
        radius = 1e3 * gripper.tip_radius
        view.ball(side * (500.0 * gripper.max_opening + radius), radius)
        return
    depth = near + PAD_DEPTH * (far - near)
    half = 500.0 * gripper.pad_height
    view.box(Part.PAD, *_ordered(side * near, side * depth), -half, half)


def _ordered(one: float, two: float) -> tuple[float, float]:
    return min(one, two), max(one, two)


def _draw_side(view: _Drawing) -> None:
    gripper, step = view.gripper, view.step
    back, front, end = heights(gripper)
    palm, finger = 500.0 * gripper.palm_width, 500.0 * gripper.finger_width
    view.box(Part.PALM, -palm, palm, back, front)
    view.box(Part.FINGER, -finger, finger, front, end)
    view.across(-palm, palm, back, _mm(gripper.palm_width), at=back - step)
    lowest = _lowest(gripper, step) - 0.3 * step
    view.across(-finger, finger, end, _mm(gripper.finger_width), at=lowest + 2.5 * step)
    if gripper.round_tips:
        radius = 1e3 * gripper.tip_radius
        view.ball(0.0, radius)
        view.across(-radius, radius, 0.0, f"tip {2.0 * radius:.4g}", at=lowest + step)
    else:
        width, height = 500.0 * gripper.pad_width, 500.0 * gripper.pad_height
        view.box(Part.PAD, -width, width, -height, height)
        view.across(-width, width, height, f"pad {2.0 * width:.4g}", at=lowest + step)
        at = max(palm, finger) + step
        view.along(-height, height, width, f"pad {2.0 * height:.4g}", at=at)
    view.frame("y")


def _mm(length: float) -> str:
    return f"{1e3 * length:.4g}"


COLUMNS = 4
"""Drawings beside each other."""

TOWARD = np.array([-0.55, 0.4])
"""Where y, which points away from or toward the viewer, goes in the drawing, in (x, z)."""

FRAME_LENGTH = 0.38
"""Length of the axes, in heights of the gripper."""

BESIDE, ABOVE, BELOW = 0.2, 0.25, 0.55
"""Space around the gripper, in heights of it."""

NAMES_HEIGHT = 0.16
"""Height of a line of names, in inches."""


@styled
def frames_figure(gripper: ParallelGripper) -> Figure:
    r"""Draw the frames of all known programs on a gripper, seen from the front, z down.

    Frames that are the same one for this gripper are drawn once.

    Args:
        gripper: The gripper.

    Example:
        >>> from grasp3d.hand.parallel_gripper import ParallelGripper
        >>> from grasp3d.pictures.grippers import frames_figure
        >>> [axes.get_title() for axes in frames_figure(ParallelGripper.preset("franka")).axes][:2]
        ['tcp', 'hand, isaac, moveit,\npanda_hand']
    """
    frames = _distinct(gripper)
    rows = math.ceil(len(frames) / COLUMNS)
    low, _, high = heights(gripper)
    tall = high - low
    height, width = (1.0 + ABOVE + BELOW) * tall, 1e3 * gripper.palm_thickness + 2.0 * BESIDE * tall
    figure = new_figure(PAGE, rows * (PAGE / COLUMNS * height / width + 3.0 * NAMES_HEIGHT) + 0.4)
    views = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for axes in views:
        bare(axes)
    for axes, (names, matrix) in zip(views, frames, strict=False):
        _draw_boxes(_Drawing(axes, gripper, GAP * tall))
        draw_origin(axes)
        _draw_frame(axes, matrix, FRAME_LENGTH * tall)
        axes.set_title(_in_lines(names), fontsize=7.5)
        axes.set_xlim(-0.5 * width, 0.5 * width)
        axes.set_ylim(high + BELOW * tall, low - ABOVE * tall)  # z points down
    for axes in views[len(frames) :]:
        axes.remove()
    title = f"{printable(gripper.name)}: frames by name, dot: tool centre point"
    figure.suptitle(title, fontsize=9.0, parse_math=False)
    return figure


def _distinct(gripper: ParallelGripper) -> list[tuple[list[str], Floats]]:
    """Names of equal frames, and the frame in the gripper's coordinates [mm]."""
    found: list[tuple[list[str], Floats]] = []
    for name, frame in FRAMES.items():
        matrix = np.asarray(np.linalg.inv(frame.to_tcp(gripper)), dtype=np.float64)
        same = next((names for names, other in found if np.allclose(matrix, other)), None)
        if same is None:
            found.append(([name], matrix))
        else:
            same.append(name)
    for _, matrix in found:
        matrix[:3, 3] *= 1e3
    return found


def _in_lines(names: list[str]) -> str:
    """Names in lines that fit above a drawing."""
    lines = [""]
    for name in names:
        if len(lines[-1]) + len(name) > 26:
            lines.append("")
        lines[-1] += f"{name}, "
    return "\n".join(line.rstrip() for line in lines).rstrip(",")


def _draw_frame(axes: Axes, matrix: Floats, length: float) -> None:
    """Draw the axes of a frame, those toward the viewer last."""
    start = _in_drawing(matrix[:3, 3])
    for k in np.argsort(-matrix[1, :3]):
        name = "xyz"[k]
        end = start + length * _in_drawing(matrix[:3, k])
        draw_axis(axes, start, end, name, AXIS_COLORS[name])


def _in_drawing(vector: Floats) -> Floats:
    """Coordinates of a vector of the gripper's frame in the drawing, (x, z)."""
    return np.asarray(vector[[0, 2]] + vector[1] * TOWARD)
