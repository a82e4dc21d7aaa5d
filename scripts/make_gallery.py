"""Make the pictures of the documentation.

    python scripts/make_gallery.py [NAME ...] [-o docs]

Without names it makes all that need neither a browser nor files of experiments. Most need OpenGL
(EGL or a display). `report` and `viewer` need Chromium and the package playwright of the extra
`test`; `physics` needs the folder that `evidence_physics.py -o physics` wrote. Other pictures are
drawn by commands, which are in a comment above each picture.
"""

import argparse
import math
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from PIL import Image, ImageDraw, ImageFont

from grasp3d import (
    GraspModel,
    Label,
    ObjectMesh,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    Table,
    best_grasps,
    label_library,
    label_surface,
    load_mesh,
    planar,
)
from grasp3d._kernels.hull.growing_hull import AROUND_ORIGIN, grow
from grasp3d._kernels.hull.polytope import Polytope, make_polytope
from grasp3d._kernels.hull.support_functions import ROWS, WrenchSpace
from grasp3d.arrays import Bytes, Floats
from grasp3d.outcomes.success import success_rate
from grasp3d.paper.writing import FIGURES, PaperSettings
from grasp3d.pictures.camera import MARGIN, View
from grasp3d.pictures.captions import BOLD, PLAIN
from grasp3d.pictures.figures import (
    LABEL_COLORS,
    LINES,
    bare,
    label_patches,
    new_figure,
    save_as,
    show_picture,
    styled,
)
from grasp3d.pictures.stills import draw_colors, draw_grasps, draw_labels
from grasp3d.pictures.view_settings import ViewSettings
from grasp3d.quality.loads import Load
from grasp3d.settings import with_fingers
from grasp3d.stability.label import COLORS, MEANING
from grasp3d.system.tables import read_columns
from grasp3d.viewer.collection import collection_of
from grasp3d.viewer.screenshots import open_renderer

ROOT = Path(__file__).parents[1]
MESHES = ROOT / "meshes"
SUFFIXES = {".stl", ".obj", ".ply", ".off", ".glb"}

DPI = 140
"""Resolution of most pictures, in pixels per inch."""


def fine_mesh(name: str, fineness: float = 1.0 / 100.0) -> ObjectMesh:
    """Load a mesh of the library, fine relative to its size, for smooth borders."""
    path = MESHES / name
    return load_mesh(path, unit="m", max_edge=load_mesh(path).size * fineness)


def fraction_words(labels: SurfaceLabels, digits: int = 0) -> str:
    """Write the area fractions of S, M and U."""
    parts = labels.fractions().items()
    return "  ".join(f"{name} {100.0 * part:.{digits}f} %" for name, part in parts)


def graded(values: Floats) -> Bytes:
    """Colours of values from 0 to 1, shape (V, 3)."""
    return np.asarray(255.0 * mpl.colormaps["viridis"](values)[:, :3], dtype=np.uint8)


def add_scale(figure: Figure, scale: Normalize, axes: Any, **options: Any) -> Any:
    """Add the colour bar of `graded` values."""
    bar = figure.colorbar(mpl.cm.ScalarMappable(scale, "viridis"), ax=axes, **options)
    bar.ax.grid(visible=False)
    return bar


def add_labels(figure: Figure) -> None:
    """Add the legend of searched labels."""
    figure.legend(handles=label_patches(MEANING["label"]), loc="outside lower center", ncols=3)


def save_tight(figure: Figure, path: Path) -> None:
    """Write a figure without its white margin."""
    figure.savefig(path, dpi=DPI, bbox_inches="tight", pad_inches=0.05)


@styled
def draw_resolutions(path: Path) -> None:
    """Draw a row per mesh with a column per sensor resolution and the coarsest resolution for S."""
    friction, resolutions, cell = 0.5, (10.0, 22.6, 40.0), 1.8
    coarsest = 2.0 * math.degrees(math.atan(friction))
    names, view = ("mug.glb", "spray.glb", "banana.ply"), View()
    figure = new_figure(cell * (len(resolutions) + 1) + 0.5, 1.15 * cell * len(names) + 0.6)
    grid = figure.subplots(len(names), len(resolutions) + 1)
    titles = (
        *(f"sensor resolution {angle:g}°" for angle in resolutions),
        "coarsest resolution for S",
    )
    for row, name in zip(grid, names, strict=True):
        model = GraspModel(friction=friction, sensor_resolution=math.radians(max(resolutions)))
        labels = label_surface(fine_mesh(name, 1.0 / 120.0), model)
        for axes, angle in zip(row, resolutions, strict=False):
            shown = labels.relabel(sensor_resolution=math.radians(angle))
            image = draw_labels(shown, view=view, size=(640, 640))
            show_picture(axes, image, "", fraction_words(shown))
        show_picture(row[-1], coarsest_picture(labels, coarsest, view, (640, 640)), "", "")
    for axes, title in zip(grid[0], titles, strict=True):
        axes.set_title(title)
    add_scale(
        figure, Normalize(0.0, coarsest), grid[:, -1], shrink=0.6, format="%g°",
        ticks=[0, 10, 22.6, 40],
    )  # fmt: skip
    add_labels(figure)
    figure.savefig(path, dpi=DPI)


def coarsest_picture(
    labels: SurfaceLabels, coarsest: float, view: View, size: tuple[int, int]
) -> Bytes:
    """Render the coarsest resolution at which the best grasp of each vertex is surely stable."""
    mesh, colors = labels.mesh, graded(np.degrees(labels.max_resolution) / coarsest)
    return draw_colors(mesh, colors, view=view, size=size)


@styled
def draw_grips(path: Path) -> None:
    """Draw one object labelled for different grippers, and the coarsest sensor for each."""
    model = GraspModel(friction=0.3, sensor_resolution=math.radians(20.0))
    grippers: dict[str, tuple[int, Sampling]] = {
        "two fingers, up to 60 mm": (2, Sampling(max_opening=0.06)),
        "two fingers, up to 80 mm": (2, Sampling(max_opening=0.08)),
        "two fingers, any width": (2, Sampling()),
        "three fingers, up to 80 mm": (3, Sampling(max_opening=0.08)),
    }
    coarsest, view, size = (
        2.0 * math.degrees(model.friction_angle),
        View(elevation=math.radians(20.0)),
        (520, 760),
    )
    figure = new_figure(1.75 * len(grippers) + 0.4, 5.4)
    grid = figure.subplots(2, len(grippers))
    for axes, (title, (fingers, sampling)) in zip(grid.T, grippers.items(), strict=True):
        model = with_fingers(model, fingers)
        labels = label_surface(fine_mesh("bottle.off"), model, sampling=sampling)
        image = draw_labels(labels, view=view, size=size)
        show_picture(axes[0], image, title, fraction_words(labels))
        show_picture(axes[1], coarsest_picture(labels, coarsest, view, size), "", "")
    add_scale(
        figure, Normalize(0.0, coarsest), grid[1], shrink=0.8, format="%g°",
        label="coarsest α for S",
    )  # fmt: skip
    add_labels(figure)
    figure.savefig(path, dpi=110)


GRIPPER = ParallelGripper.preset("robotiq_2f85")
MODEL = GraspModel(friction=0.5, sensor_resolution=math.radians(22.6))
HANDLE = 0.03
"""Opening [m] below which a grasp of the mug is one of the handle or the wall."""


@styled
def draw_reach(path: Path) -> None:
    """Draw a mug on a table, labelled for points and for a gripper, and grasps at two vertices."""
    view, mesh = View(math.radians(-70.0), math.radians(25.0)), fine_mesh("mug.glb")
    low, high = GRIPPER.limits
    points = label_surface(mesh, MODEL, sampling=Sampling(min_opening=low, max_opening=high))
    labels = label_surface(mesh, MODEL, hand=GRIPPER, table=Table.below(mesh))
    grasps = best_grasps(labels, 40)
    rows = [
        next(row for row, width in enumerate(grasps.opening) if (width < HANDLE) == is_narrow)
        for is_narrow in (False, True)
    ]
    figure = new_figure(1.8 * 4, 2.8)
    panels = iter(figure.subplots(1, 4))
    for title, one in (
        ("two points, same stroke", points), (f"gripper {GRIPPER.name}, on a table", labels)
    ):  # fmt: skip
        image = draw_labels(one, view=view, size=(560, 600))
        show_picture(next(panels), image, title, fraction_words(one))
    pictures = draw_grasps(grasps.take(np.array(rows)), labels)
    for kind, row, image in zip(("across", "handle"), rows, pictures, strict=True):
        show_picture(next(panels), image, f"{kind}, score {grasps.score[row]:.2f}", "")
    add_labels(figure)
    figure.savefig(path, dpi=130)


LOWEST = 0.1
"""Payload of the first colour [kg], which smaller payloads share."""
GREY = (0x9A, 0xA0, 0xA6)
"""Colour of vertices without a grasp that the gripper reaches."""


class Loaded(NamedTuple):
    """One object in the picture of payloads."""

    name: str
    view: View
    size: tuple[int, int]
    """Width and height of its picture [pixels]."""
    labels: SurfaceLabels
    payload: Floats
    """Payload of each vertex [kg], shape (V,); nan if there is no grasp."""


def loaded(name: str, azimuth: float, elevation: float, width: int) -> Loaded:
    """Label a mesh for the gripper with 40 N available; the view is in degrees."""
    labels = label_surface(
        load_mesh(MESHES / name, unit="m"), MODEL, hand=GRIPPER, load=Load(grip_force=40.0)
    )
    assert labels.load_result is not None
    view = View(math.radians(azimuth), math.radians(elevation))
    return Loaded(Path(name).stem, view, (width, 640), labels, labels.load_result.payload)


@styled
def draw_payload(path: Path) -> None:
    """Draw the largest mass that the best grasp of each vertex holds in every orientation.

    The mass is held whatever the true normals are; a cross marks the centre of mass.
    """
    objects = [
        loaded("hammer.ply", 100.0, 10.0, 400),
        loaded("mug.glb", -70.0, 30.0, 640),
        loaded("wrench.glb", -80.0, 60.0, 860),
    ]
    most = max(float(np.nanmax(one.payload)) for one in objects)
    scale, widths = LogNorm(LOWEST, most), [one.size[0] for one in objects]
    figure = new_figure(sum(widths) / 300.0 + 0.7, 2.6)
    grid = figure.subplots(1, len(objects), width_ratios=widths)
    for axes, one in zip(grid, objects, strict=True):
        draw_loaded(axes, one, scale)
    bar = add_scale(
        figure, scale, list(grid), shrink=0.8, format="%g kg", extend="min",
        ticks=[tick for tick in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0) if tick <= most],
    )  # fmt: skip
    bar.ax.minorticks_off()
    bar.ax.set_title("payload", fontsize=8)
    figure.savefig(path, dpi=150)


def draw_loaded(axes: Axes, one: Loaded, scale: Normalize) -> None:
    """Render an object and mark its centre of mass."""
    mesh, view, size = one.labels.mesh, one.view, one.size
    known = np.isfinite(one.payload)
    ramp = graded(np.asarray(scale(np.where(known, np.maximum(one.payload, LOWEST), LOWEST))))
    colors = np.where(known[:, None], ramp, np.array(GREY, dtype=np.uint8))
    image = draw_colors(mesh, colors, view=view, size=size)
    best, median = one.payload[known].max(), np.median(one.payload[known])
    show_picture(axes, image, one.name, f"best {best:.1f} kg,\nmedian {median:.2f} kg")
    used = mesh.vertices[np.unique(mesh.faces)]
    across = used @ view.axes.T  # to the right, up and toward the camera
    pixel = float(np.min(size / np.ptp(across[:, :2], axis=0))) / MARGIN
    middle = 0.5 * (across.min(axis=0) + across.max(axis=0))
    right, up, _ = pixel * (view.axes @ mesh.center_mass - middle)
    for color, width in (("white", 3.0), ("black", 1.2)):
        axes.plot(
            0.5 * size[0] + right, 0.5 * size[1] - up, "+", color=color, markersize=9.0,
            markeredgewidth=width,
        )  # fmt: skip


LIBRARY_MODEL = GraspModel(friction=0.2, sensor_resolution=math.radians(15.0))
COLUMNS = 6
CELL = (320, 280)
"""Width and height of a picture [pixels]."""

CAPTION, LEGEND, EDGE = 66, 64, 16
"""Heights of a picture's caption and of the legend, and the margin around everything [pixels]."""

INK, QUIET = "#20262D", "#5B6470"
NAME, TEXT = ImageFont.truetype(str(BOLD), 18), ImageFont.truetype(str(PLAIN), 15)


@dataclass(frozen=True)
class Entry:
    """An object of the gallery."""

    name: str
    picture: Image.Image
    fractions: dict[str, float]


def entry(path: Path) -> Entry:
    """Label and render a mesh."""
    labels = label_surface(load_mesh(path, unit="m"), LIBRARY_MODEL)
    settings = ViewSettings(width=CELL[0], height=CELL[1])
    with open_renderer(collection_of(labels), settings, legend=False) as renderer:
        return Entry(path.stem, Image.fromarray(renderer.picture()), labels.fractions())


def draw_caption(draw: ImageDraw.ImageDraw, middle: float, top: float, one: Entry) -> None:
    """Write a name and, below it, the area fractions, each after a square of its colour."""
    draw.text((middle, top + 10), one.name, INK, NAME, anchor="mm")
    parts = [f"{letter} {100.0 * value:.0f} %" for letter, value in one.fractions.items()]
    gap, square = 16.0, 20.0
    widths = [square + TEXT.getlength(part) for part in parts]
    x = middle - 0.5 * (sum(widths) + gap * (len(parts) - 1))
    for part, width in zip(parts, widths, strict=True):
        draw_key(draw, x, top + 38, part, COLORS[Label[part[0]]])
        x += width + gap


def draw_key(
    draw: ImageDraw.ImageDraw, x: float, y: float, text: str, color: tuple[int, int, int]
) -> None:
    """Draw a square of a colour, and text to its right."""
    draw.rectangle((x, y - 7, x + 13, y + 6), fill=color)
    draw.text((x + 20, y), text, INK, TEXT, anchor="lm")


def draw_meshes(path: Path) -> None:
    """Draw all meshes of the library, each labelled and with its area fractions.

    With the chosen friction and resolution, most objects have all three labels.
    """
    objects = [entry(one) for one in sorted(MESHES.iterdir()) if one.suffix.lower() in SUFFIXES]
    rows = math.ceil(len(objects) / COLUMNS)
    width, height = CELL[0], CELL[1] + CAPTION
    image = Image.new("RGB", (COLUMNS * width + 2 * EDGE, rows * height + LEGEND + EDGE), "white")
    draw = ImageDraw.Draw(image)
    for number, one in enumerate(objects):
        left, top = EDGE + number % COLUMNS * width, EDGE + number // COLUMNS * height
        image.paste(one.picture, (left, top))
        draw_caption(draw, left + 0.5 * width, top + CELL[1], one)
    x, y = 2.0 * EDGE, image.height - 0.5 * LEGEND
    draw.line((EDGE, y - 26, image.width - EDGE, y - 26), fill="#DDE1E5", width=1)
    for label in sorted(Label, reverse=True):
        text = f"{label.name}: {MEANING['label'][label]}"
        draw_key(draw, x, y, text, COLORS[label])
        x += TEXT.getlength(text) + 60
    settings = (
        f"two fingers, friction μ {LIBRARY_MODEL.friction:g}, "
        f"sensor resolution α {math.degrees(LIBRARY_MODEL.sensor_resolution):g}°"
    )
    draw.text((image.width - 2 * EDGE, y), settings, QUIET, TEXT, anchor="rm")
    image.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def draw_paper(path: Path) -> None:
    """Draw figures of Wan & Howe 2018."""
    for name, draw in PAPER.items():
        draw(PaperSettings()).savefig(path.with_stem(name), dpi=DPI)


PAPER = {"paper_cones": FIGURES["figure_05"], "paper_ceilings": FIGURES["figure_11"]}
"""Functions that draw the pictures, by name."""


OUTLINE_FRICTION = 0.5
OUTLINE_RESOLUTIONS = (0.0, 10.0, 22.6, 40.0, 60.0)
OUTLINE_POINTS = 1440
OUTLINES = (planar.Circle(), planar.Square())


def draw_outline(axes: Axes, outline: planar.Outline, degrees: float) -> None:
    """Draw an outline in the colours of its labels."""
    model = GraspModel(friction=OUTLINE_FRICTION, sensor_resolution=math.radians(degrees))
    found = planar.scan(outline, model, points=OUTLINE_POINTS)
    bare(axes)
    axes.fill(*found.contacts.points.T, color="#F1F1F1")
    ends = np.concatenate([found.contacts.points, found.contacts.points[:1]])
    first = np.flatnonzero(np.diff(found.label, prepend=255))
    for start, end in pairwise([*first.tolist(), len(found.label)]):
        color = LABEL_COLORS[Label(found.label[start])]
        axes.plot(*ends[start : end + 1].T, color=color, linewidth=4.0, solid_capstyle="butt")
    point = found.contacts.points[0]
    inward = np.array([0.0, 0.45])
    axes.annotate(
        "", point + inward, point - inward, arrowprops={"arrowstyle": "-|>", "color": "#333333"}
    )
    fractions = outline.fractions(
        friction=OUTLINE_FRICTION, sensor_resolution=model.sensor_resolution
    )
    text = "\n".join(f"{name} {100.0 * part:.0f} %" for name, part in fractions.items())
    axes.text(0.0, 0.15, text, ha="center", va="center")
    axes.set(xlim=(-1.2, 1.2), ylim=(-1.5, 1.15))


@styled
def draw_planar(path: Path) -> None:
    """Draw the paper's circle and square, labelled by the position of the second finger.

    The arrow is the first finger; the numbers are fractions of the perimeter in closed form.
    """
    figure = new_figure(1.45 * len(OUTLINE_RESOLUTIONS), 1.62 * len(OUTLINES) + 0.4)
    grid = figure.subplots(len(OUTLINES), len(OUTLINE_RESOLUTIONS))
    for row, outline in zip(grid, OUTLINES, strict=True):
        for axes, degrees in zip(row, OUTLINE_RESOLUTIONS, strict=True):
            draw_outline(axes, outline, degrees)
    for axes, degrees in zip(grid[0], OUTLINE_RESOLUTIONS, strict=True):
        axes.set_title(f"α = {degrees:g}°")
    figure.legend(handles=label_patches(), loc="outside lower center", ncols=3)
    save_tight(figure, path)


DIRECTIONS = np.radians([80.0, 205.0, 310.0])
"""Polar angles of the inward normals at the contacts."""
FRICTION_ANGLE = math.radians(20.0)
CONE_FORCES = 25
"""Number of forces with which the arc of a cone is drawn."""
TRIANGLE = 3
"""Number of vertices of the first polytope, a triangle."""
HULL_PLANE = (0, 0)
"""A tuple as long as the wrenches have components: two."""
HULL_GOAL = (0.0, 0.0, math.inf)

SPACE, FACET, NEAR, POINT = "#D9DEE3", "#0072B2", "#D55E00", "#111111"


class Step(NamedTuple):
    """The polytope before its nearest facet is replaced."""

    facets: Floats
    """Ends of the edges, shape (f, 2, 2)."""
    nearest: int
    normal: Floats
    """Outward unit normal of the nearest facet, shape (2,)."""
    distance: float
    height: float
    """Support of the wrench space in the direction of the normal."""
    point: Floats
    """Wrench that attains the support, shape (2,)."""


def cones() -> Floats:
    """Unit forces of the three contacts, shape (3 * CONE_FORCES, 2)."""
    turn = DIRECTIONS[:, None] + np.linspace(-FRICTION_ANGLE, FRICTION_ANGLE, CONE_FORCES)
    return np.stack([np.cos(turn), np.sin(turn)], axis=-1).reshape(-1, 2)


def grown(wrenches: Floats, vertices: int) -> tuple[Polytope, float, float]:
    """Grow the kernel's polytope to at most `vertices` vertices; also return epsilon's bounds."""
    whole = make_polytope(256)
    polytope = whole._replace(points=whole.points[:vertices])
    axes = np.zeros((1, 6, len(wrenches)))
    axes[0, :2] = wrenches.T
    space = WrenchSpace(
        kind=ROWS, spherical=True, soft=False, axes=axes, cones=np.ones((1, 2)),
    )  # fmt: skip
    metric = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    _, lower, upper, _, _ = grow(
        space, HULL_PLANE, metric, None, AROUND_ORIGIN, HULL_GOAL, polytope
    )
    return polytope, lower, upper


def step_of(wrenches: Floats, polytope: Polytope) -> Step:
    """Read the facets of a polytope and find the support at the nearest one."""
    planes, corners = polytope.planes, polytope.corners
    present = np.flatnonzero((planes[:2] != 0.0).any(axis=0) & ~np.isnan(planes[6]))
    facets = polytope.points[corners[present, :2]][..., :2]
    nearest = int(planes[6, present].argmin())
    normal = planes[:2, present[nearest]]
    heights = wrenches @ normal
    return Step(
        facets, nearest, normal, float(planes[6, present[nearest]]), float(heights.max()),
        wrenches[heights.argmax()],
    )  # fmt: skip


def draw_step(axes: Axes, wrenches: Floats, shown: Step, upper: float) -> None:
    """Draw one step, with the bounds of epsilon known after it."""
    axes.fill(*wrenches.T, color=SPACE, zorder=0)
    for facet in shown.facets:
        axes.plot(*facet.T, color=FACET, linewidth=1.4)
    axes.plot(*shown.facets[shown.nearest].T, color=NEAR, linewidth=2.6)
    axes.add_patch(Circle((0.0, 0.0), shown.distance, fill=False, color=NEAR, linewidth=0.8))
    axes.plot(0.0, 0.0, "+", color=POINT, markersize=6)
    along = np.array([-shown.normal[1], shown.normal[0]])
    line = shown.height * shown.normal + np.outer([-0.6, 0.6], along)
    axes.plot(*line.T, color=POINT, linewidth=0.9, linestyle=(0, (4, 2)))
    found = shown.height - shown.distance < 1e-9
    if not found:
        axes.plot(*shown.point, "o", color=POINT, markersize=4.5)
    lower = f"{shown.distance:.3f}"
    axes.set_title(f"ε = {lower}" if found else f"{lower} ≤ ε ≤ {upper:.3f}")
    axes.set(xlim=(-1.2, 1.1), ylim=(-1.1, 1.15), xticks=[], yticks=[], aspect="equal")
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)


@styled
def draw_hull(path: Path) -> None:
    """Draw how the growing hull finds epsilon, step by step.

    The wrenches are those of three planar contacts. Only the two force components are drawn, so
    facets are edges. The steps are those of the kernel, which is stopped at each number of
    vertices until the nearest facet is one of the wrench space.
    """
    wrenches, steps = cones(), []
    for vertices in range(TRIANGLE, len(wrenches)):
        steps.append(step_of(wrenches, grown(wrenches, vertices)[0]))
        if steps[-1].height - steps[-1].distance < 1e-9:
            break
    _, lower, _ = grown(wrenches, len(wrenches))
    assert math.isclose(lower, steps[-1].distance)
    figure = new_figure(1.75 * len(steps), 2.1)
    bounds = np.minimum.accumulate([shown.height for shown in steps])
    for axes, shown, upper in zip(
        figure.subplots(1, len(steps)), steps, bounds.tolist(), strict=True
    ):
        draw_step(axes, wrenches, shown, upper)
    handles = [
        Line2D([], [], color=SPACE, linewidth=6, label="grasp wrench space"),
        Line2D([], [], color=FACET, label="polytope inside it"),
        Line2D([], [], color=NEAR, linewidth=2.6, label="nearest facet"),
        Line2D([], [], color=POINT, linewidth=0.9, linestyle=(0, (4, 2)),
               label="support in its direction"),
        Line2D([], [], color=POINT, marker="o", markersize=4.5, linestyle="none",
               label="new vertex"),
    ]  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    save_tight(figure, path)


ELLIPSE, DISC = "#0072B2", "#111111"
MOMENT = 0.6
"""Torsional moment at which the friction circles are compared, relative to the largest."""
DISC_STEPS = 400
"""Steps of the integrals over a disc along its radius; around it there are twice as many."""
CENTERS = np.array([0.0, 0.1, 0.25, 0.5, 0.75, 1.0, 1.3, 1.8, 3.0, 8.0])
"""Distances of the centre of rotation from the disc's centre, in radii."""
OFFSET = 1.18
"""Height of the text above the middle."""


def disc(centers: Floats) -> tuple[Floats, Floats]:
    """Friction force and moment of an evenly pressed disc that starts to turn about points.

    Every part of the disc has full friction, opposite to its velocity.

    Args:
        centers: Distances of the points from the disc's centre, in radii.

    Returns:
        Tangential force and moment, as fractions of their largest values.
    """
    radius, around = np.meshgrid(
        (np.arange(DISC_STEPS) + 0.5) / DISC_STEPS,
        (np.arange(2 * DISC_STEPS) + 0.5) * math.pi / DISC_STEPS,
    )
    x, y = radius * np.cos(around), radius * np.sin(around)
    area = radius / radius.sum()
    forces, moments = [], []
    for center in centers:
        along = x - center  # component of the velocity across the line to the centre of rotation
        speed = np.hypot(along, y)
        forces.append(abs((area * along / speed).sum()))
        moments.append(abs((area * (x * along + y * y) / speed).sum()))
    return np.array(forces), np.array(moments) / (2.0 / 3.0)


def draw_section(axes: Axes) -> None:
    """Draw tangential force against torsional moment."""
    turn = np.linspace(0.0, 2.0 * math.pi, 200)
    axes.plot(np.cos(turn), np.sin(turn), color=ELLIPSE)
    axes.fill(np.cos(turn), np.sin(turn), color=ELLIPSE, alpha=0.08)
    force, moment = disc(CENTERS)
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        axes.plot(signs[0] * force, signs[1] * moment, "o", color=DISC, markersize=2.5)
    axes.axhline(MOMENT, color="#888888", linewidth=0.8, linestyle=(0, (4, 2)))
    axes.set(title="section", xlabel="tangential force / μ$f_n$", ylabel="moment / e$f_n$")


def draw_circles(axes: Axes) -> None:
    """Draw the tangential forces that remain without and with a moment."""
    turn = np.linspace(0.0, 2.0 * math.pi, 200)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    left = math.sqrt(1.0 - MOMENT**2)
    axes.plot(*circle, color="#888888", linewidth=0.9)
    axes.plot(*(left * circle), color=ELLIPSE, linestyle=(0, (4, 2)))
    for radius, text in ((1.0, "no moment"), (left, f"{left:.1f}")):
        axes.text(0.0, radius - 0.03, text, ha="center", va="top", fontsize=7)
    axes.set(
        title=f"forces beside {MOMENT:g} of the moment",
        xlabel="tangential force / μ$f_n$",
    )


def draw_solid(figure: Figure, number: int) -> None:
    """Draw the surface in space."""
    axes = figure.add_subplot(1, 3, number, projection="3d", computed_zorder=False)
    turn, height = np.meshgrid(np.linspace(0.0, 2.0 * math.pi, 49), np.linspace(-1.0, 1.0, 25))
    radius = np.sqrt(1.0 - height**2)
    x, y = radius * np.cos(turn), radius * np.sin(turn)
    axes.plot_surface(x, y, height, color=ELLIPSE, alpha=0.22, linewidth=0, shade=True)
    circle = np.linspace(0.0, 2.0 * math.pi, 100)
    axes.plot(np.cos(circle), np.sin(circle), np.zeros(100), color="#333333", linewidth=0.8)
    axes.view_init(elev=18.0, azim=-60.0)
    axes.set_box_aspect((1, 1, 1), zoom=1.25)
    axes.set_axis_off()
    axes.set_title("limit surface at one normal force")
    axes.text(0, 0, OFFSET, "moment", ha="center", va="center", fontsize=8)
    axes.text2D(0.5, 0.06, "across: tangential force", ha="center", transform=axes.transAxes)


@styled
def draw_limit_surface(path: Path) -> None:
    """Draw what a pad's friction resists at a given normal force.

    The ellipse of Howe & Cutkosky is compared with the integral over an evenly pressed disc.
    """
    figure = new_figure(7.16, 2.9)
    draw_solid(figure, 1)
    for number, draw in ((2, draw_section), (3, draw_circles)):
        axes = figure.add_subplot(1, 3, number)
        draw(axes)
        axes.set(xlim=(-1.15, 1.15), ylim=(-1.15, 1.15), aspect="equal", xticks=[-1, 0, 1],
                 yticks=[-1, 0, 1])  # fmt: skip
    handles = [
        Line2D([], [], color=ELLIPSE, label="ellipse"),
        Line2D([], [], color=DISC, marker="o", markersize=2.5, linestyle="none",
               label="evenly pressed disc, e = 2/3 μ r"),
    ]  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    figure.savefig(path, dpi=DPI)


BORDERS = np.array([-45.0, -30.0, -22.6, -17.0, -11.3, -5.7, 0.0, 4.0, 8.0, 16.0])
"""Limits of the bins of the margin [degrees]."""


@styled
def draw_physics(path: Path, folder: Path) -> None:
    """Draw slip of facets, success over the margin, and grip forces, as simulated."""
    figure = new_figure(height=2.5)
    axes = figure.subplots(1, 3, width_ratios=(1.0, 1.7, 1.0))
    draw_facets(axes[0], read_columns(folder / "facets.csv"))
    draw_margins(axes[1], read_columns(folder / "labels.csv"))
    draw_forces(axes[2], read_columns(folder / "forces.csv"))
    save_as(figure, path)


def draw_facets(axes: Axes, columns: dict[str, np.ndarray]) -> None:
    """Draw the friction below which pairs of facets slip, against the critical angle."""
    computed = np.degrees(columns["critical_angle"])
    axes.plot([0.0, 90.0], [0.0, 90.0], color="#999999", linewidth=0.7)
    axes.plot(
        computed, np.degrees(columns["slip_friction_angle"]), ".", color="#0072B2", markersize=3
    )
    axes.set(
        xlabel="critical friction angle β* [°]",
        ylabel="slips below [°]",
        title=f"{len(computed)} pairs of facets",
        xlim=(0, 90),
        ylim=(0, 90),
    )


def draw_margins(axes: Axes, columns: dict[str, np.ndarray]) -> None:
    """Draw the fractions of pairs of facets that held, over the margin as perceived."""
    border = -math.degrees(GraspModel().sensor_resolution)
    for label, low, high in (
        (Label.U, BORDERS[0], border),
        (Label.M, border, 0.0),
        (Label.S, 0.0, BORDERS[-1]),
    ):
        axes.axvspan(low, high, color=LABEL_COLORS[label], alpha=0.18, linewidth=0.0)
        axes.text(0.5 * (low + high), 1.06, label.name, ha="center", va="bottom")
    mine = columns["friction"] >= 0.5  # those with the resolution at the border
    margin, held = np.degrees(columns["margin"][mine]), columns["held"][mine].astype(bool)
    inside = [held[(margin >= low) & (margin < high)] for low, high in pairwise(BORDERS)]
    rates = [success_rate("", of) for of in inside]
    rows = [number for number, one in enumerate(rates) if one.count]
    rate = np.array([rates[number].rate for number in rows])
    ends = np.array([rates[number].interval for number in rows])
    axes.errorbar(
        0.5 * (BORDERS[:-1] + BORDERS[1:])[rows], rate, np.abs(ends - rate[:, None]).T, marker="o",
        markersize=3, elinewidth=0.8, capsize=1.5, **LINES[0],
    )  # fmt: skip
    axes.set(
        xlabel="margin [°]",
        ylabel="fraction that held",
        xlim=(BORDERS[0], BORDERS[-1]),
        ylim=(-0.04, 1.15),
        yticks=np.linspace(0.0, 1.0, 6),
    )
    axes.set_title(f"{len(held)} perceived pairs")


def draw_forces(axes: Axes, columns: dict[str, np.ndarray]) -> None:
    """Draw the smallest forces that held, against the computed ones."""
    most = 1.1 * max(columns["computed"].max(), columns["simulated"].max())
    axes.plot([0.0, most], [0.0, most], color="#999999", linewidth=0.7)
    soft = columns["soft"].astype(bool)
    for name, mine, marker in (("hard tips", ~soft, "o"), ("soft tips", soft, "^")):
        axes.plot(
            columns["computed"][mine], columns["simulated"][mine], marker, label=name, markersize=3
        )
    axes.set(
        xlabel="computed grip force [N]",
        ylabel="smallest force that holds [N]",
        title=f"{len(soft)} loads of 1 N",
        xlim=(0.0, most),
        ylim=(0.0, most),
    )
    axes.legend(loc="upper left")


BROWSER_OPTIONS = [
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]  # fmt: skip


@contextmanager
def browser() -> Iterator[Any]:
    """Start Chromium."""
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium") or shutil.which("google-chrome")
    with (
        sync_playwright() as driver,
        driver.chromium.launch(executable_path=program, args=BROWSER_OPTIONS) as started,
    ):
        yield started


def click(page: Any, place: str, at: tuple[float, float]) -> None:
    """Click a page's element at fractions of its width and height."""
    box = page.locator(place).first.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + at[0] * box["width"], box["y"] + at[1] * box["height"])


def draw_report(path: Path) -> None:
    """Draw the report of a library."""
    with TemporaryDirectory() as name, browser() as started:
        label_library([MESHES], Path(name) / "results")
        page = started.new_page(viewport={"width": 1300, "height": 950})
        page.goto((Path(name) / "results" / "report" / "index.html").as_uri())
        page.wait_for_timeout(1500)
        page.screenshot(path=path)
    compress(path)


def compress(path: Path) -> None:
    """Save a picture again with fewer colours."""
    with Image.open(path) as image:
        reduced = image.convert("RGB").quantize(
            method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
        )
    reduced.save(path, optimize=True)


def draw_viewer(path: Path) -> None:
    """Draw the viewer's page with a vertex inspected."""
    main = [sys.executable, "-c", "import sys; from grasp3d.cli import main; sys.exit(main())"]
    view = [*main, "view", str(MESHES / "spray.glb"), "--web"]
    with subprocess.Popen(view, stdout=subprocess.PIPE, text=True) as server:  # noqa: S603
        assert server.stdout is not None
        address = re.match(r"(http:\S+) ", server.stdout.readline())
        assert address is not None
        with browser() as started:
            page = started.new_page(viewport={"width": 1280, "height": 1010})
            photograph(page, address[1], path)
        server.terminate()
    compress(path)


def photograph(page: Any, address: str, path: Path) -> None:
    """Wait for the object, click it, and take a screenshot."""
    page.goto(address)
    page.locator("#fractions").wait_for(timeout=60_000)
    page.wait_for_timeout(1500)
    click(page, "#stage, .stage, main", (0.44, 0.66))
    page.locator("#reason").wait_for()
    page.wait_for_timeout(1500)
    page.screenshot(path=path)


PICTURES: dict[str, Callable[[Path], None]] = {
    "labels": draw_resolutions,
    "grips": draw_grips,
    "reach": draw_reach,
    "meshes": draw_meshes,
    "planar": draw_planar,
    "paper": draw_paper,
    "hull": draw_hull,
    "payload": draw_payload,
    "limit_surface": draw_limit_surface,
}
"""Pictures by name, each NAME.png; `paper` makes several."""

OF_PAGES: dict[str, Callable[[Path], None]] = {"report": draw_report, "viewer": draw_viewer}
"""Pictures that need a browser."""


def main() -> None:
    """Make the pictures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    known = (*PICTURES, *OF_PAGES, "physics")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(known))
    parser.add_argument(
        "-o", "--output", type=Path, help="folder (default: docs, and meshes for that of meshes)"
    )
    parser.add_argument("--physics", type=Path, default=Path("physics"), help="default: physics")
    options = parser.parse_args()
    unknown = sorted(set(options.names) - set(known))
    if unknown:
        parser.error(f"no picture is called {unknown[0]!r}; known: {', '.join(known)}")
    for name in options.names or PICTURES:
        path = (options.output or ROOT / "docs") / f"{name}.png"
        if name == "meshes":
            path = (options.output or MESHES) / "gallery.png"
        if name == "physics":
            draw_physics(path, options.physics)
        else:
            (PICTURES | OF_PAGES)[name](path)
        print(f"made: {name}")


if __name__ == "__main__":
    main()
